//! Commands that take many files: each is looked at whatever becomes of the others; the exit code is the largest of theirs.

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::console::Console;
use crate::error::{Error, ExitCode, Result};

/// Reports of several files, and the errors of those that have none.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Reports<T> {
    files: Vec<T>,
    failed: Vec<Failed>,
}

/// A file that no report could be made of.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Failed {
    #[serde(serialize_with = "crate::report::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    path: PathBuf,
    exit: u8,
    kind: &'static str,
    message: String,
}

impl<T: fmt::Display> fmt::Display for Reports<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, file) in self.files.iter().enumerate() {
            write!(f, "{}{file}", if index == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}

/// Whether reports are shown as text.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Text {
    /// They are what was asked for.
    Always,
    /// The exit code says what was asked for.
    UnlessQuiet,
}

/// Shows the report of one file as it is, those of several together.
///
/// # Errors
/// That of a single file; output that cannot be written.
pub(super) fn show<T: Serialize + fmt::Display>(
    command: &str,
    paths: &[PathBuf],
    console: &Console,
    text: Text,
    of_file: impl Fn(&Path) -> Result<(T, ExitCode)>,
) -> Result<ExitCode> {
    if let [path] = paths {
        let (report, code) = of_file(path)?;
        tell(command, &report, console, text)?;
        return Ok(code);
    }
    let mut reports = Reports { files: Vec::with_capacity(paths.len()), failed: Vec::new() };
    let mut worst = ExitCode::Ok;
    let mut meet = |code: ExitCode| {
        if code as u8 > worst as u8 {
            worst = code;
        }
    };
    for path in paths {
        match of_file(path) {
            Ok((report, code)) => {
                reports.files.push(report);
                meet(code);
            }
            Err(error) => {
                meet(error.code());
                reports.failed.push(failed(path, &error));
            }
        }
    }
    tell(command, &reports, console, text)?;
    Ok(worst)
}

fn tell<T: Serialize + fmt::Display>(command: &str, report: &T, console: &Console, text: Text) -> Result<ExitCode> {
    if text == Text::Always {
        return console.show(command, report);
    }
    console.say(&report.to_string())?;
    console.report(command, report)
}

/// Tells an error at once, like that of a single file.
fn failed(path: &Path, error: &Error) -> Failed {
    // The report and the exit code tell it too.
    let _ = writeln!(std::io::stderr(), "translux: {error}");
    let code = error.code();
    Failed { path: path.to_owned(), exit: code as u8, kind: code.kind(), message: error.message().to_owned() }
}
