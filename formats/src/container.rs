//! Layout of the file: header, directory, sections. `SPEC.md` states the same numbers.

use crate::error::{FormatError, Result};
use crate::types::{Codec, ElementType, Kind, Tag};

/// First bytes of every file. The last four reveal a transfer in text mode.
pub const MAGIC: [u8; 8] = *b"\x89TLUX\r\n\x1a";
pub(crate) const HEADER_BYTES: usize = 32;
pub(crate) const ENTRY_BYTES: usize = 48;
pub(crate) const ALIGNMENT: u64 = 64;
pub(crate) const CHECKSUM_AT: usize = 24;

/// Directory entry of a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SectionInfo {
    /// Name.
    pub tag: Tag,
    /// Purpose of the section.
    pub kind: Kind,
    /// Type of its scalars.
    pub element: ElementType,
    /// Scalars in one row.
    pub components: u16,
    /// Encoding of the stored bytes.
    pub codec: Codec,
    /// Offset of its stored bytes in the file.
    pub offset: u64,
    /// Bytes in the file, without padding.
    pub stored_bytes: u64,
    /// Bytes after decoding.
    pub decoded_bytes: u64,
    /// CRC-32 (IEEE 802.3) of the stored bytes.
    pub crc32: u32,
}

impl SectionInfo {
    /// Number of rows; for a record, its length in bytes.
    pub fn rows(&self) -> u64 {
        self.decoded_bytes / self.row_bytes().max(1)
    }

    pub(crate) fn row_bytes(&self) -> u64 {
        self.element.size() * u64::from(self.components)
    }

    pub(crate) fn to_entry(self) -> [u8; ENTRY_BYTES] {
        let mut entry = [0; ENTRY_BYTES];
        entry[0..8].copy_from_slice(&self.tag.to_bytes());
        entry[8] = self.element.code();
        entry[9] = self.codec.code();
        entry[10..12].copy_from_slice(&self.components.to_le_bytes());
        entry[12] = self.kind.code();
        entry[16..24].copy_from_slice(&self.offset.to_le_bytes());
        entry[24..32].copy_from_slice(&self.stored_bytes.to_le_bytes());
        entry[32..40].copy_from_slice(&self.decoded_bytes.to_le_bytes());
        entry[40..44].copy_from_slice(&self.crc32.to_le_bytes());
        entry
    }

    /// Reads entry `index`, which lies at `at` in the file, and makes all checks that need no other entry.
    pub(crate) fn from_entry(index: u32, at: u64, entry: &[u8; ENTRY_BYTES]) -> Result<Self> {
        let tag = Tag::from_bytes(field(entry, 0)).ok_or(FormatError::BadTag { index })?;
        let unknown = |field, value: u8| FormatError::UnknownCode { tag, field, value: value.into() };
        if let Some(i) = (13..16).chain(44..48).find(|&i| entry[i] != 0) {
            return Err(FormatError::NotZero { offset: at + i as u64, place: "reserved, directory" });
        }
        let info = Self {
            tag,
            element: ElementType::from_code(entry[8]).ok_or_else(|| unknown("element type", entry[8]))?,
            codec: Codec::from_code(entry[9]).ok_or_else(|| unknown("codec", entry[9]))?,
            components: u16::from_le_bytes(field(entry, 10)),
            kind: Kind::from_code(entry[12]).ok_or_else(|| unknown("kind", entry[12]))?,
            offset: u64::from_le_bytes(field(entry, 16)),
            stored_bytes: u64::from_le_bytes(field(entry, 24)),
            decoded_bytes: u64::from_le_bytes(field(entry, 32)),
            crc32: u32::from_le_bytes(field(entry, 40)),
        };
        info.check_lengths()?;
        Ok(info)
    }

    pub(crate) fn check_lengths(&self) -> Result<()> {
        let refuse = |reason: String| Err(FormatError::SectionLength { tag: self.tag, reason });
        let record = self.element == ElementType::Record;
        if self.components == 0 || (record && self.components != 1) {
            return Err(FormatError::UnknownCode {
                tag: self.tag,
                field: "component count",
                value: self.components.into(),
            });
        }
        if !self.decoded_bytes.is_multiple_of(self.row_bytes()) {
            return refuse(format!("{} bytes are not whole rows of {}", self.decoded_bytes, self.row_bytes()));
        }
        if self.codec == Codec::Raw && self.stored_bytes != self.decoded_bytes {
            return refuse(format!("raw, with {} bytes stored and {} decoded", self.stored_bytes, self.decoded_bytes));
        }
        if record && self.decoded_bytes > crate::codec::MAX_RECORD_BYTES {
            return refuse(format!("a record of {} bytes is too long", self.decoded_bytes));
        }
        Ok(())
    }
}

/// `N` bytes at `at`; the callers' constants stay inside.
pub(crate) fn field<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&bytes[at..at + N]);
    out
}

/// `at` rounded up to the next section boundary.
pub(crate) fn align(at: u64) -> Option<u64> {
    at.checked_next_multiple_of(ALIGNMENT)
}

/// Checksum of the header and directory, with its own field taken as zero.
pub(crate) fn head_checksum(head: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&head[..CHECKSUM_AT]);
    hasher.update(&[0; 4]);
    hasher.update(&head[CHECKSUM_AT + 4..]);
    hasher.finalize()
}
