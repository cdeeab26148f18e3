//! What a zstd frame says of itself before it is decompressed (RFC 8878, 3.1.1): its length and that of its content.

/// First bytes of a zstd frame. Skippable frames and the formats before zstd 0.8 begin otherwise.
const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Largest window that is read, as a power of two.
const MAX_WINDOW_LOG: u8 = 31;

/// The lengths of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    /// Bytes of the frame.
    pub(crate) length: usize,
    /// Bytes of its content, where it states them.
    pub(crate) content: Option<u64>,
}

impl Frame {
    /// Reads the header and the headers of all blocks.
    ///
    /// # Errors
    /// What is wrong with the frame.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, &'static str> {
        const SHORT: &str = "the frame is cut off";
        let rest = bytes.strip_prefix(&MAGIC).ok_or("not a zstd frame")?;
        let (&descriptor, rest) = rest.split_first().ok_or(SHORT)?;
        if descriptor & 8 != 0 {
            return Err("the frame's header is of another format");
        }
        let is_single = descriptor & 32 != 0;
        let window = usize::from(!is_single);
        if rest[..window.min(rest.len())].iter().any(|window| (window >> 3) + 10 > MAX_WINDOW_LOG) {
            return Err("the frame's window is too large");
        }
        let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
        let content = [usize::from(is_single), 2, 4, 8][usize::from(descriptor >> 6)];
        let stated = rest.get(window + dictionary..window + dictionary + content).ok_or(SHORT)?;
        let number = stated.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte));
        // Two bytes begin at what one cannot hold.
        let content_bytes = (content > 0).then_some(if content == 2 { number + 256 } else { number });
        let mut at = MAGIC.len() + 1 + window + dictionary + content;
        loop {
            let header = bytes.get(at..).and_then(|rest| rest.first_chunk::<3>()).ok_or(SHORT)?;
            let header = u32::from_le_bytes([header[0], header[1], header[2], 0]);
            let size = match header >> 1 & 3 {
                0 | 2 => (header >> 3) as usize,
                1 => 1,
                _ => return Err("a block is of an unknown kind"),
            };
            at = at.checked_add(3 + size).filter(|at| *at <= bytes.len()).ok_or(SHORT)?;
            if header & 1 == 1 {
                break;
            }
        }
        let checksum = if descriptor & 4 == 0 { 0 } else { 4 };
        let length = at.checked_add(checksum).filter(|length| *length <= bytes.len()).ok_or(SHORT)?;
        Ok(Self { length, content: content_bytes })
    }
}

#[cfg(all(test, feature = "zstd"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use zstd::zstd_safe;

    use super::*;

    fn content(length: usize) -> Vec<u8> {
        (0..length).map(|i| (i * i / 7 % 23) as u8 ^ (i % 5) as u8).collect()
    }

    /// The lengths that the library of the format's authors finds, for frames of every size of header, cut and damaged.
    #[test]
    fn frames_are_read_as_the_library_reads_them() {
        let mut seed = 7_u32;
        let mut tried = [0, 0];
        for length in [0, 1, 255, 256, 300, 65_791, 65_792, 70_000, 300_000] {
            let mut encoder = zstd::bulk::Compressor::new(3).unwrap();
            for checksum in [false, true] {
                encoder.set_parameter(zstd_safe::CParameter::ChecksumFlag(checksum)).unwrap();
                let frame = encoder.compress(&content(length)).unwrap();
                assert_eq!(Frame::read(&frame), Ok(Frame { length: frame.len(), content: Some(length as u64) }));
                for _ in 0..2_000 {
                    let mut changed = frame.clone();
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let place = (seed >> 8) as usize % changed.len().min(24);
                    changed[place] ^= 1 << (seed >> 5 & 7);
                    changed.truncate(changed.len() - (seed >> 28) as usize % changed.len().min(5));
                    let theirs = zstd_safe::find_frame_compressed_size(&changed).ok();
                    let ours = Frame::read(&changed).ok();
                    // Skippable frames have another beginning, and no content of a section.
                    if changed.starts_with(&MAGIC) {
                        assert_eq!(ours.map(|frame| frame.length), theirs, "{:?}", &changed[..changed.len().min(24)]);
                    } else {
                        assert_eq!(ours, None);
                    }
                    if let Some(frame) = ours {
                        assert_eq!(zstd_safe::get_frame_content_size(&changed).unwrap(), frame.content);
                    }
                    tried[usize::from(ours.is_some())] += 1;
                }
            }
        }
        assert!(tried.iter().all(|count| *count > 1_000), "{tried:?}");
    }
}
