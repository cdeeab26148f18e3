//! What went wrong, as a number, a section and a message that the caller has the memory for.

use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use translux_format::{FormatError, Tag};

use crate::views::{TAG_BYTES, tag_text};

/// Bytes of a message, its zero included.
pub const MESSAGE_BYTES: usize = 512;

/// The result of a call. 1 to 99 are the errors of the format (`formats/SPEC.md`), whose numbers never change their meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// The bytes do not begin with the magic.
    BadMagic = 1,
    /// The bytes end inside the header or the directory.
    TooShort = 2,
    /// Written by an incompatible version.
    UnsupportedVersion = 3,
    /// The header states another length.
    FileLength = 4,
    /// Header and directory do not match their checksum.
    HeaderChecksum = 5,
    /// A byte that must be zero is not.
    NotZero = 6,
    /// More sections than the format allows.
    TooManySections = 7,
    /// A tag is empty or has characters that tags may not have.
    BadTag = 8,
    /// Two sections have one tag.
    DuplicateTag = 9,
    /// A code of the directory has no meaning.
    UnknownCode = 10,
    /// A section is not where it must be.
    Offset = 11,
    /// A section ends beyond the file, or the file goes on after the last one.
    SectionEnd = 12,
    /// The lengths of a section contradict each other.
    SectionLength = 13,
    /// Decoding takes more memory than the budget.
    OverBudget = 14,
    /// The machine has no memory for a section.
    OutOfMemory = 15,
    /// A section does not match its checksum.
    SectionChecksum = 16,
    /// Compressed bytes are damaged, or this library was built without the means to read them.
    Compression = 17,
    /// A section that must be there is not.
    MissingSection = 18,
    /// A section holds another type, width or kind.
    WrongType = 19,
    /// A record does not parse.
    Record = 20,
    /// A section parses and its content is not valid.
    Invalid = 21,
    /// The asset is whole and has nothing of the kind.
    Absent = 100,
    /// A pointer that must not be null is.
    NullArgument = 101,
    /// An index or a length is beyond its end.
    OutOfRange = 102,
    /// A fault of the library.
    Internal = 103,
}

/// The format's errors by their numbers, from 1 on.
const OF_FORMAT: [Status; 21] = [
    Status::BadMagic,
    Status::TooShort,
    Status::UnsupportedVersion,
    Status::FileLength,
    Status::HeaderChecksum,
    Status::NotZero,
    Status::TooManySections,
    Status::BadTag,
    Status::DuplicateTag,
    Status::UnknownCode,
    Status::Offset,
    Status::SectionEnd,
    Status::SectionLength,
    Status::OverBudget,
    Status::OutOfMemory,
    Status::SectionChecksum,
    Status::Compression,
    Status::MissingSection,
    Status::WrongType,
    Status::Record,
    Status::Invalid,
];

// An error that the format gains needs a status here.
const _: () = assert!(OF_FORMAT.len() == FormatError::NAMES.len());

/// Names by number, as C has texts.
const NAMES: [(Status, &CStr); 26] = [
    (Status::Ok, c"Ok"),
    (Status::BadMagic, c"BadMagic"),
    (Status::TooShort, c"TooShort"),
    (Status::UnsupportedVersion, c"UnsupportedVersion"),
    (Status::FileLength, c"FileLength"),
    (Status::HeaderChecksum, c"HeaderChecksum"),
    (Status::NotZero, c"NotZero"),
    (Status::TooManySections, c"TooManySections"),
    (Status::BadTag, c"BadTag"),
    (Status::DuplicateTag, c"DuplicateTag"),
    (Status::UnknownCode, c"UnknownCode"),
    (Status::Offset, c"Offset"),
    (Status::SectionEnd, c"SectionEnd"),
    (Status::SectionLength, c"SectionLength"),
    (Status::OverBudget, c"OverBudget"),
    (Status::OutOfMemory, c"OutOfMemory"),
    (Status::SectionChecksum, c"SectionChecksum"),
    (Status::Compression, c"Compression"),
    (Status::MissingSection, c"MissingSection"),
    (Status::WrongType, c"WrongType"),
    (Status::Record, c"Record"),
    (Status::Invalid, c"Invalid"),
    (Status::Absent, c"Absent"),
    (Status::NullArgument, c"NullArgument"),
    (Status::OutOfRange, c"OutOfRange"),
    (Status::Internal, c"Internal"),
];

pub(crate) fn name_of(status: i32) -> &'static CStr {
    NAMES.iter().find(|(known, _)| *known as i32 == status).map_or(c"Unknown", |(_, name)| name)
}

/// What a failed call has to say. A call that succeeds leaves it alone.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Error {
    /// The same as the call's result.
    pub status: Status,
    /// Tag of the section at fault, ended by a zero; empty where the error concerns none.
    pub section: [c_char; TAG_BYTES],
    /// One line of UTF-8 for people, ended by a zero; cut where it is longer.
    pub message: [c_char; MESSAGE_BYTES],
}

/// An error on its way to the caller.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) status: Status,
    pub(crate) section: Option<Tag>,
    pub(crate) message: String,
}

impl Fault {
    pub(crate) fn null(argument: &str) -> Self {
        Self { status: Status::NullArgument, section: None, message: format!("{argument} is null") }
    }

    pub(crate) fn absent(what: &str) -> Self {
        Self { status: Status::Absent, section: None, message: what.to_owned() }
    }

    pub(crate) fn out_of_range(what: &str, index: usize, count: usize) -> Self {
        Self { status: Status::OutOfRange, section: None, message: format!("{what} {index}: there are {count}") }
    }

    fn into_error(self) -> Error {
        let mut message = [0; MESSAGE_BYTES];
        let mut end = self.message.len().min(MESSAGE_BYTES - 1);
        while !self.message.is_char_boundary(end) {
            end -= 1;
        }
        for (to, byte) in message.iter_mut().zip(&self.message.as_bytes()[..end]) {
            *to = *byte as c_char;
        }
        Error { status: self.status, section: self.section.map_or([0; TAG_BYTES], tag_text), message }
    }
}

impl From<FormatError> for Fault {
    fn from(error: FormatError) -> Self {
        let status = OF_FORMAT.get(usize::from(error.code()).wrapping_sub(1)).copied().unwrap_or(Status::Internal);
        Self { status, section: error.tag(), message: error.to_string() }
    }
}

/// Runs a call: its fault, or a panic's, goes to `error`, which is null or can be written.
pub(crate) fn guarded(error: *mut Error, run: impl FnOnce() -> Result<(), Fault>) -> Status {
    // What a panic leaves behind is read by nobody: values are written whole or not at all, and an asset's own are set once.
    let result = catch_unwind(AssertUnwindSafe(run));
    let internal = |_| Fault { status: Status::Internal, section: None, message: "a fault of the library".into() };
    match result.map_err(internal) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(fault)) | Err(fault) => {
            let status = fault.status;
            if !error.is_null() {
                // SAFETY: not null, and every caller's promise.
                unsafe { error.write(fault.into_error()) };
            }
            status
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_of_the_format_has_its_number_and_name() {
        for ((number, name), status) in (1..).zip(FormatError::NAMES).zip(OF_FORMAT) {
            assert_eq!((status as i32, name_of(number).to_str()), (number, Ok(name)));
        }
        assert_eq!(
            [name_of(0), name_of(103), name_of(-1), name_of(i32::MAX)],
            [c"Ok", c"Internal", c"Unknown", c"Unknown"]
        );
    }

    #[test]
    fn a_panic_is_a_status_and_a_long_message_is_cut_between_characters() {
        let mut error = Fault::null("").into_error();
        assert_eq!(guarded(&mut error, || panic!("planted")), Status::Internal);
        assert_eq!(error.status, Status::Internal);
        let long = Fault { message: "é".repeat(400), ..Fault::absent("") }.into_error();
        let bytes: Vec<u8> = long.message.iter().map(|c| *c as u8).collect();
        let text = CStr::from_bytes_until_nul(&bytes).unwrap().to_str().unwrap();
        assert_eq!(text.chars().count(), (MESSAGE_BYTES - 1) / 2);
    }
}
