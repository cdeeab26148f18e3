//! One error type: the fault, its section, and a number that never changes meaning.

use crate::{ElementType, Tag};

/// Result of every fallible function in this crate.
pub type Result<T> = std::result::Result<T, FormatError>;

/// The reason why bytes were refused, or why an asset cannot be written.
///
/// [`FormatError::code`] gives the stable number that `SPEC.md` lists; numbers are never reused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// 1: the file does not begin with the magic.
    #[error("not a .tlux file: the first 8 bytes are not its magic")]
    BadMagic,
    /// 2: the file ends inside its header or directory.
    #[error("the file is cut: {needed} bytes are needed and {length} are there")]
    TooShort {
        /// Bytes needed to go on.
        needed: u64,
        /// Bytes available.
        length: u64,
    },
    /// 3: written by an incompatible version.
    #[error("format version {major}.{minor} is not supported (this reader knows {}.x)", crate::types::VERSION_MAJOR)]
    UnsupportedVersion {
        /// Major version in the header.
        major: u16,
        /// Minor version in the header.
        minor: u16,
    },
    /// 4: the header states a different length.
    #[error("the header says {stated} bytes and the file has {actual}: it is cut, or something was appended")]
    FileLength {
        /// Length in the header.
        stated: u64,
        /// Length of the bytes given.
        actual: u64,
    },
    /// 5: header and directory do not match their checksum.
    #[error("checksum of the header and directory is {computed:08x} and should be {stated:08x}: the file is damaged")]
    HeaderChecksum {
        /// Checksum in the header.
        stated: u32,
        /// Checksum of the bytes.
        computed: u32,
    },
    /// 6: a byte that must be zero is not.
    #[error("byte {offset} must be zero and is not ({place})")]
    NotZero {
        /// Offset in the file.
        offset: u64,
        /// The field or padding that the byte belongs to.
        place: &'static str,
    },
    /// 7: more sections than the format allows.
    #[error("{count} sections; the format allows {}", crate::types::MAX_SECTIONS)]
    TooManySections {
        /// Sections stated or added.
        count: u64,
    },
    /// 8: a tag is empty or holds characters that tags may not have.
    #[error("directory entry {index}: the tag is not 1 to 8 characters of A-Z a-z 0-9 _ . - padded with zeros")]
    BadTag {
        /// Position in the directory, from 0.
        index: u32,
    },
    /// 9: two sections have one tag.
    #[error("section {tag} is there twice")]
    DuplicateTag {
        /// The tag.
        tag: Tag,
    },
    /// 10: a code in the directory has no meaning.
    #[error("section {tag}: {field} {value} is unknown")]
    UnknownCode {
        /// The section.
        tag: Tag,
        /// Field of the directory entry.
        field: &'static str,
        /// Its value.
        value: u32,
    },
    /// 11: a section is not where it must be.
    #[error("section {tag}: offset {offset} should be {expected}")]
    Offset {
        /// The section.
        tag: Tag,
        /// Offset in the directory.
        offset: u64,
        /// The offset that follows from the sections before.
        expected: u64,
    },
    /// 12: a section ends beyond the file, or the file goes on after the last one.
    #[error("the sections end at byte {end} and the file at {length}")]
    SectionEnd {
        /// End of the sections.
        end: u64,
        /// Length of the file.
        length: u64,
    },
    /// 13: the lengths of a section contradict each other.
    #[error("section {tag}: {reason}")]
    SectionLength {
        /// The section.
        tag: Tag,
        /// The fault.
        reason: String,
    },
    /// 14: decoding takes more memory than the caller allowed.
    #[error("section {tag}: decoding takes {needed} bytes up to here and the budget is {budget}: raise the budget")]
    OverBudget {
        /// The section that crosses the budget.
        tag: Tag,
        /// Bytes up to and including this section.
        needed: u64,
        /// The budget in bytes.
        budget: u64,
    },
    /// 15: the machine has no memory for a section.
    #[error("section {tag}: no memory for {bytes} bytes")]
    OutOfMemory {
        /// The section.
        tag: Tag,
        /// Bytes asked for.
        bytes: u64,
    },
    /// 16: a section does not match its checksum.
    #[error("section {tag}: checksum is {computed:08x} and should be {stated:08x}: the file is damaged")]
    SectionChecksum {
        /// The section.
        tag: Tag,
        /// Checksum in the directory.
        stated: u32,
        /// Checksum of the bytes.
        computed: u32,
    },
    /// 17: the compressed bytes are not one valid zstd frame of the stated length.
    #[error("section {tag}: zstd: {reason}")]
    Compression {
        /// The section.
        tag: Tag,
        /// The fault.
        reason: String,
    },
    /// 18: a section that must be there is not.
    #[error("section {tag} is missing")]
    MissingSection {
        /// The section.
        tag: Tag,
    },
    /// 19: a section holds elements of another type, width or kind than asked for.
    #[error("section {tag} holds {found} x {found_components}, not {expected} x {expected_components}")]
    WrongType {
        /// The section.
        tag: Tag,
        /// Element type asked for.
        expected: ElementType,
        /// Components asked for.
        expected_components: u16,
        /// Element type in the directory.
        found: ElementType,
        /// Components in the directory.
        found_components: u16,
    },
    /// 20: a record section does not parse.
    #[error("section {tag}: record: {reason}")]
    Record {
        /// The section.
        tag: Tag,
        /// The fault.
        reason: String,
    },
    /// 21: a section parses and its content is not valid.
    #[error("section {tag}: {reason}")]
    Invalid {
        /// The section.
        tag: Tag,
        /// The fault and its place.
        reason: String,
    },
}

impl FormatError {
    /// The stable number of this error, as `SPEC.md` lists it.
    pub fn code(&self) -> u16 {
        match self {
            Self::BadMagic => 1,
            Self::TooShort { .. } => 2,
            Self::UnsupportedVersion { .. } => 3,
            Self::FileLength { .. } => 4,
            Self::HeaderChecksum { .. } => 5,
            Self::NotZero { .. } => 6,
            Self::TooManySections { .. } => 7,
            Self::BadTag { .. } => 8,
            Self::DuplicateTag { .. } => 9,
            Self::UnknownCode { .. } => 10,
            Self::Offset { .. } => 11,
            Self::SectionEnd { .. } => 12,
            Self::SectionLength { .. } => 13,
            Self::OverBudget { .. } => 14,
            Self::OutOfMemory { .. } => 15,
            Self::SectionChecksum { .. } => 16,
            Self::Compression { .. } => 17,
            Self::MissingSection { .. } => 18,
            Self::WrongType { .. } => 19,
            Self::Record { .. } => 20,
            Self::Invalid { .. } => 21,
        }
    }

    /// The name of this error, as `SPEC.md` lists it.
    pub fn name(&self) -> &'static str {
        Self::NAMES[usize::from(self.code() - 1)]
    }

    /// Names of the numbers, from 1 on.
    pub const NAMES: [&'static str; 21] = [
        "BadMagic",
        "TooShort",
        "UnsupportedVersion",
        "FileLength",
        "HeaderChecksum",
        "NotZero",
        "TooManySections",
        "BadTag",
        "DuplicateTag",
        "UnknownCode",
        "Offset",
        "SectionEnd",
        "SectionLength",
        "OverBudget",
        "OutOfMemory",
        "SectionChecksum",
        "Compression",
        "MissingSection",
        "WrongType",
        "Record",
        "Invalid",
    ];

    /// The section of the error, if it concerns one.
    pub fn tag(&self) -> Option<Tag> {
        match self {
            Self::DuplicateTag { tag }
            | Self::UnknownCode { tag, .. }
            | Self::Offset { tag, .. }
            | Self::SectionLength { tag, .. }
            | Self::OverBudget { tag, .. }
            | Self::OutOfMemory { tag, .. }
            | Self::SectionChecksum { tag, .. }
            | Self::Compression { tag, .. }
            | Self::MissingSection { tag }
            | Self::WrongType { tag, .. }
            | Self::Record { tag, .. }
            | Self::Invalid { tag, .. } => Some(*tag),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::FormatError;

    #[test]
    fn the_specification_lists_every_number() {
        let page = include_str!("../SPEC.md");
        for (number, name) in (1..).zip(FormatError::NAMES) {
            assert!(page.contains(&format!("\n| {number} | `{name}` | ")), "{number} {name}");
        }
        let error = FormatError::BadTag { index: 0 };
        assert_eq!((error.code(), error.name()), (8, "BadTag"));
        let debug = |error: FormatError| format!("{error:?}").starts_with(error.name());
        assert!(debug(FormatError::BadMagic) && debug(FormatError::TooManySections { count: 1 }) && debug(error));
    }
}
