//! zstd frames, compressed the same way every time and decompressed into a buffer of the known length.
//!
//! The feature `zstd` is the library of the format's authors, in C. Without it, `ruzstd` decompresses in Rust alone, for targets that
//! have no C compiler; nothing is compressed then.

use crate::error::{FormatError, Result};
use crate::frame::Frame;
use crate::types::Tag;

/// Compression level of the writer. Part of the bytes, so part of the frozen file.
///
/// Levels 1, 3, 9 leave 0.567, 0.535, 0.505 of the triangles of a 100k-triangle scan and 0.750, 0.762, 0.768 of noisy
/// 16-bit coefficients; 9 takes about three to six times as long as 3. A higher level buys nothing where the bytes are.
pub const ZSTD_LEVEL: i32 = 3;

/// Largest content of one block (RFC 8878, 3.1.1.2.4), and the fewest bytes that a non-empty block takes.
const MAX_BLOCK_CONTENT: u64 = 128 << 10;
const MIN_BLOCK: u64 = 4;

fn refused(tag: Tag, reason: impl ToString) -> FormatError {
    FormatError::Compression { tag, reason: reason.to_string() }
}

pub(crate) fn compress(tag: Tag, bytes: &[u8]) -> Result<Vec<u8>> {
    library::compress(bytes).map_err(|reason| refused(tag, reason))
}

/// Refuses bytes that cannot be one frame with `decoded` bytes of content, before any memory is taken.
pub(crate) fn check_frame(tag: Tag, stored: &[u8], decoded: u64) -> Result<()> {
    let refuse = |reason: String| Err(refused(tag, reason));
    let Frame { length, content } = Frame::read(stored).map_err(|reason| refused(tag, reason))?;
    if length != stored.len() {
        return refuse(format!("the frame has {length} bytes and the section {}", stored.len()));
    }
    match content {
        Some(content) if content == decoded => {}
        Some(content) => {
            return refuse(format!("the frame holds {content} bytes and the directory says {decoded}"));
        }
        None => return refuse("the frame does not state its content size".into()),
    }
    if decoded > (stored.len() as u64 / MIN_BLOCK).saturating_mul(MAX_BLOCK_CONTENT) {
        return refuse(format!("{} bytes cannot hold {decoded}", stored.len()));
    }
    Ok(())
}

/// Decompresses one frame that fills `out` exactly.
pub(crate) fn decompress(tag: Tag, stored: &[u8], out: &mut [u8]) -> Result<()> {
    check_frame(tag, stored, out.len() as u64)?;
    let needed = out.len();
    match library::decompress(stored, out) {
        Ok(written) if written == needed => Ok(()),
        Ok(written) => Err(refused(tag, format!("{written} bytes came out, not {needed}"))),
        Err(reason) => Err(refused(tag, reason)),
    }
}

#[cfg(feature = "zstd")]
mod library {
    use zstd::zstd_safe;

    pub(super) fn compress(bytes: &[u8]) -> Result<Vec<u8>, String> {
        zstd::bulk::compress(bytes, super::ZSTD_LEVEL).map_err(|error| error.to_string())
    }

    pub(super) fn decompress(stored: &[u8], out: &mut [u8]) -> Result<usize, String> {
        zstd_safe::decompress(out, stored).map_err(|code| zstd_safe::get_error_name(code).to_owned())
    }
}

#[cfg(not(feature = "zstd"))]
mod library {
    pub(super) fn compress(_: &[u8]) -> Result<Vec<u8>, String> {
        Err("this build compresses nothing: translux-format without its feature `zstd`".to_owned())
    }

    #[cfg(feature = "ruzstd")]
    pub(super) fn decompress(stored: &[u8], out: &mut [u8]) -> Result<usize, String> {
        super::in_rust(stored, out)
    }

    #[cfg(not(feature = "ruzstd"))]
    pub(super) fn decompress(_: &[u8], _: &mut [u8]) -> Result<usize, String> {
        Err("this build decompresses nothing: translux-format without its features `zstd` and `ruzstd`".to_owned())
    }
}

/// Decompresses in Rust alone; how many bytes came out.
#[cfg(any(test, all(feature = "ruzstd", not(feature = "zstd"))))]
fn in_rust(stored: &[u8], out: &mut [u8]) -> std::result::Result<usize, String> {
    ruzstd::decoding::FrameDecoder::new().decode_all(stored, out).map_err(|error| error.to_string())
}

#[cfg(all(test, feature = "zstd"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// The same content, and of damaged frames no panic; where both read one, the same content too.
    #[test]
    fn rust_alone_reads_what_the_library_writes() {
        let tag = Tag::new("x.one").unwrap();
        let mut seed = 1_u32;
        let mut random = move || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as usize
        };
        for length in [0, 1, 300, 5_000, 200_000] {
            let content: Vec<u8> = (0..length).map(|i| (i / 3 % 40) as u8 ^ (random() % 7) as u8).collect();
            let frame = compress(tag, &content).unwrap();
            let mut out = vec![0; length];
            assert_eq!(in_rust(&frame, &mut out), Ok(length));
            assert!(out == content);
            for _ in 0..if length > 10_000 { 40 } else { 400 } {
                let mut changed = frame.clone();
                let place = random() % changed.len();
                changed[place] ^= 1 << (random() % 8);
                let mut theirs = vec![0; length];
                let is_read = check_frame(tag, &changed, length as u64).is_ok();
                if is_read
                    && in_rust(&changed, &mut out) == Ok(length)
                    && decompress(tag, &changed, &mut theirs).is_ok()
                {
                    assert!(out == theirs, "byte {place} of {}", changed.len());
                }
            }
        }
    }
}
