//! One error type: a cause, which fixes the exit code, and a message that tells the fault, its place and the remedy.

use std::fmt;
use std::path::Path;

/// Result of every fallible function in this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Exit codes of the program, one for each cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ExitCode {
    /// Everything went well.
    Ok = 0,
    /// The command line is wrong.
    CommandLine = 1,
    /// A file could not be read or written.
    Io = 2,
    /// A file was read, and its contents are not valid.
    InvalidInput = 3,
    /// The work failed while it ran (memory, a lost device, an interrupt).
    Runtime = 4,
    /// The input is valid, but this program does not support it.
    Unsupported = 5,
    /// The asked quality, size or time was not met.
    QualityNotMet = 6,
    /// A comparison found a difference.
    Difference = 7,
}

impl ExitCode {
    /// Every exit code with the line that help prints for it.
    pub const ALL: [(ExitCode, &'static str); 8] = [
        (ExitCode::Ok, "ok"),
        (ExitCode::CommandLine, "wrong command line"),
        (ExitCode::Io, "a file could not be read or written"),
        (ExitCode::InvalidInput, "invalid input"),
        (ExitCode::Runtime, "failed while running"),
        (ExitCode::Unsupported, "unsupported"),
        (ExitCode::QualityNotMet, "asked quality, size or time not met"),
        (ExitCode::Difference, "difference found"),
    ];
}

/// An error: its cause and one message for a person.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    code: ExitCode,
    message: String,
}

impl Error {
    /// An error with an explicit cause.
    pub fn new(code: ExitCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }

    /// The command line is wrong (exit 1).
    pub fn command_line(message: impl Into<String>) -> Self {
        Self::new(ExitCode::CommandLine, message)
    }

    /// A file could not be read or written (exit 2).
    pub fn io(path: &Path, source: &std::io::Error) -> Self {
        Self::new(ExitCode::Io, format!("{}: {source}", path.display()))
    }

    /// Invalid input (exit 3).
    pub fn input(message: impl Into<String>) -> Self {
        Self::new(ExitCode::InvalidInput, message)
    }

    /// Failed while running (exit 4).
    pub fn runtime(message: impl Into<String>) -> Self {
        Self::new(ExitCode::Runtime, message)
    }

    /// Valid and unsupported (exit 5).
    pub fn unsupported(message: impl Into<String>) -> Self {
        Self::new(ExitCode::Unsupported, message)
    }

    /// The same error with a place in front: `place: message`.
    #[must_use]
    pub fn at(self, place: impl fmt::Display) -> Self {
        Self { code: self.code, message: format!("{place}: {}", self.message) }
    }

    /// The exit code of this error.
    pub fn code(&self) -> ExitCode {
        self.code
    }

    /// The message without its cause.
    pub fn message(&self) -> &str {
        &self.message
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Error {}
