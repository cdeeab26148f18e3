//! zstd frames, compressed the same way every time and decompressed into a buffer of the known length.

use zstd::zstd_safe;

use crate::error::{FormatError, Result};
use crate::types::Tag;

/// Compression level of the writer. Part of the bytes, so part of the frozen file.
///
/// Levels 1, 3, 9 leave 0.567, 0.535, 0.505 of the triangles of a 100k-triangle scan and 0.750, 0.762, 0.768 of noisy
/// 16-bit coefficients; 9 takes about three to six times as long as 3. A higher level buys nothing where the bytes are.
pub const ZSTD_LEVEL: i32 = 3;

/// First bytes of a zstd frame (RFC 8878, 3.1.1). Skippable frames and the formats before zstd 0.8 begin otherwise.
const FRAME_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Largest content of one block (RFC 8878, 3.1.1.2.4), and the fewest bytes that a non-empty block takes.
const MAX_BLOCK_CONTENT: u64 = 128 << 10;
const MIN_BLOCK: u64 = 4;

pub(crate) fn compress(tag: Tag, bytes: &[u8]) -> Result<Vec<u8>> {
    zstd::bulk::compress(bytes, ZSTD_LEVEL).map_err(|error| FormatError::Compression { tag, reason: error.to_string() })
}

/// Refuses bytes that cannot be one frame with `decoded` bytes of content, before any memory is taken.
pub(crate) fn check_frame(tag: Tag, stored: &[u8], decoded: u64) -> Result<()> {
    let refuse = |reason: String| Err(FormatError::Compression { tag, reason });
    if !stored.starts_with(&FRAME_MAGIC) {
        return refuse("not a zstd frame".into());
    }
    match zstd_safe::find_frame_compressed_size(stored) {
        Ok(length) if length == stored.len() => {}
        Ok(length) => return refuse(format!("the frame has {length} bytes and the section {}", stored.len())),
        Err(code) => return refuse(zstd_safe::get_error_name(code).into()),
    }
    match zstd_safe::get_frame_content_size(stored) {
        Ok(Some(content)) if content == decoded => {}
        Ok(Some(content)) => {
            return refuse(format!("the frame holds {content} bytes and the directory says {decoded}"));
        }
        _ => return refuse("the frame does not state its content size".into()),
    }
    if decoded > (stored.len() as u64 / MIN_BLOCK).saturating_mul(MAX_BLOCK_CONTENT) {
        return refuse(format!("{} bytes cannot hold {decoded}", stored.len()));
    }
    Ok(())
}

/// Decompresses one frame that fills `out` exactly.
pub(crate) fn decompress(tag: Tag, stored: &[u8], out: &mut [u8]) -> Result<()> {
    check_frame(tag, stored, out.len() as u64)?;
    match zstd_safe::decompress(out, stored) {
        Ok(written) if written == out.len() => Ok(()),
        Ok(written) => {
            Err(FormatError::Compression { tag, reason: format!("{written} bytes came out, not {}", out.len()) })
        }
        Err(code) => Err(FormatError::Compression { tag, reason: zstd_safe::get_error_name(code).into() }),
    }
}
