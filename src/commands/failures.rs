//! How the program fails: errors as a line for people or as JSON, panics as errors, output that nobody takes.

use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};

use serde::Serialize;

use super::configuration::parser_message;
use crate::error::{Error, ExitCode, Result};

/// Schema of errors.
pub(super) const SCHEMA: &str = "translux.error.v1";

/// An error for programs.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ErrorReport<'a> {
    schema: &'static str,
    version: &'static str,
    /// Exit code of the process.
    exit: u8,
    /// Name of the exit code's cause.
    kind: &'static str,
    /// The file that it is about.
    path: Option<String>,
    /// The line of that file.
    line: Option<u64>,
    message: &'a str,
}

/// Tells an error on standard error, and on standard output as JSON where that is asked for; its exit code.
pub(super) fn tell(error: &Error, json: bool) -> ExitCode {
    // The exit code tells it too where nothing can be written.
    let _ = writeln!(std::io::stderr(), "translux: {error}");
    if json {
        print_json(error);
    }
    error.code()
}

/// Help and version, which the parser takes for errors that are none, and command lines that are wrong.
pub(super) fn of_parser(error: &clap::Error, json: bool) -> ExitCode {
    if error.use_stderr() {
        let _ = error.print();
        if json {
            print_json(&Error::command_line(parser_message(error)));
        }
        return ExitCode::CommandLine;
    }
    match error.print().and_then(|()| std::io::stdout().flush()) {
        // A reader that has had enough is nobody's fault.
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            tell(&Error::new(ExitCode::Io, format!("standard output: {e}")), false)
        }
        _ => ExitCode::Ok,
    }
}

fn print_json(error: &Error) {
    let report = ErrorReport {
        schema: SCHEMA,
        version: env!("CARGO_PKG_VERSION"),
        exit: error.code() as u8,
        kind: error.code().kind(),
        path: error.path().map(|path| path.to_string_lossy().into_owned()),
        line: error.line(),
        message: error.message(),
    };
    // Strings and numbers are always JSON.
    let text = serde_json::to_string_pretty(&report).unwrap_or_default();
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "{text}").and_then(|()| out.flush());
}

/// Runs the work; a panic, which is a fault of this program, is an error (exit 4) of one line.
///
/// # Errors
/// Those of the work; a panic.
pub(super) fn guarded(work: impl FnOnce() -> Result<ExitCode>) -> Result<ExitCode> {
    /// What the first panic said and where: others follow from it, in other threads.
    static FIRST: Mutex<Option<String>> = Mutex::new(None);
    let first = || FIRST.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    *first() = None;
    let before = Arc::new(std::panic::take_hook());
    let after = Arc::clone(&before);
    let traced = std::env::var_os("RUST_BACKTRACE").is_some_and(|value| value != "0");
    std::panic::set_hook(Box::new(move |info| {
        if traced {
            before(info);
        }
        let what = info.payload_as_str().unwrap_or("no message").lines().next().unwrap_or_default();
        let place = info.location().map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        first().get_or_insert_with(|| format!("{what}{place}"));
    }));
    let outcome = catch_unwind(AssertUnwindSafe(work));
    // Work within work has a hook of its own.
    std::panic::set_hook(Box::new(move |info| after(info)));
    outcome.unwrap_or_else(|_| {
        let what = first().take().unwrap_or_default();
        Err(Error::runtime(format!(
            "a fault of this program, which should not happen whatever it is given; please report it: {what}"
        )))
    })
}

#[cfg(test)]
#[allow(clippy::panic)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_of_one_line() {
        let error = guarded(|| panic!("lost\nits way")).unwrap_err();
        assert_eq!(error.code(), ExitCode::Runtime);
        let message = error.message();
        assert!(message.contains("please report it: lost (") && message.contains("failures.rs:"), "{message}");
        assert!(!message.contains('\n'), "{message}");
        assert_eq!(guarded(|| Ok(ExitCode::Difference)), Ok(ExitCode::Difference));
        assert_eq!(guarded(|| Err(Error::input("x"))), Err(Error::input("x")));
    }
}
