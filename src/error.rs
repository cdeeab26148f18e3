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
    /// Name of the cause in JSON reports.
    pub fn kind(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::CommandLine => "command-line",
            Self::Io => "io",
            Self::InvalidInput => "invalid-input",
            Self::Runtime => "runtime",
            Self::Unsupported => "unsupported",
            Self::QualityNotMet => "quality-not-met",
            Self::Difference => "difference",
        }
    }

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

/// An error: its cause, one message for a person, and the file that it is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Error {
    code: ExitCode,
    message: String,
    path: Option<Box<Path>>,
}

impl Error {
    /// An error with an explicit cause.
    pub fn new(code: ExitCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), path: None }
    }

    /// The command line is wrong (exit 1).
    pub fn command_line(message: impl Into<String>) -> Self {
        Self::new(ExitCode::CommandLine, message)
    }

    /// A file could not be read or written (exit 2).
    pub fn io(path: &Path, source: &std::io::Error) -> Self {
        Self::new(ExitCode::Io, format!("{}: {source}", path.display())).of_file(path)
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
        Self { message: format!("{place}: {}", self.message), ..self }
    }

    /// The same error with a file in front, `path: message`, which it is about.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        self.at(path.display()).of_file(path)
    }

    /// The same error, about a file unless it is about another one already; the message stays.
    #[must_use]
    pub fn of_file(mut self, path: &Path) -> Self {
        self.path.get_or_insert_with(|| path.into());
        self
    }

    /// The file that it is about.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The line of that file, where the message names one as `path:line` or `line N`.
    pub fn line(&self) -> Option<u64> {
        let name = self.path()?.display().to_string();
        let rest = &self.message[self.message.find(&name)? + name.len()..];
        let digits = match rest.strip_prefix(": line ") {
            Some(line) => line,
            None => rest.strip_prefix(':')?,
        };
        let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        digits[..end].parse().ok()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_and_lines_are_told_apart_from_the_message() {
        let path = Path::new("a b.obj");
        let of = |error: Error| (error.path().map(Path::to_path_buf), error.line());
        assert_eq!(of(Error::input("x")), (None, None));
        assert_eq!(of(Error::input("x").in_file(path)), (Some(path.into()), None));
        assert_eq!(of(Error::input("a b.obj:41: x").of_file(path)), (Some(path.into()), Some(41)));
        assert_eq!(of(Error::input("41 x").in_file(path)), (Some(path.into()), None));
        assert_eq!(of(Error::input("x").at("line 7").in_file(path)), (Some(path.into()), Some(7)));
        let inner = Error::input("a b.obj:4:2: x").of_file(path).in_file(Path::new("other"));
        assert_eq!(of(inner), (Some(path.into()), Some(4)));
    }
}
