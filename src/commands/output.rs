//! Where results go: files by suffix, standard output.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::console::{Console, Format};
use crate::error::{Error, ExitCode, Result};
use crate::import::file::suffix;

/// Prints one line on standard output. A reader that closed the pipe has seen enough.
pub(super) fn print_line(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::new(ExitCode::Io, format!("standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// Refuses outputs that cannot be told apart or written: before the work, not after it.
pub(super) fn check(outputs: &[PathBuf], suffixes: &[&str], console: &Console) -> Result<()> {
    for (index, path) in outputs.iter().enumerate() {
        if outputs[..index].contains(path) {
            return Err(Error::command_line(format!("-o {}: given twice", path.display())));
        }
        if path == Path::new("-") {
            if console.format == Format::Json {
                return Err(Error::command_line("-o - and --json both want standard output: give -o a file"));
            }
            continue;
        }
        if !suffixes.contains(&suffix(path).as_str()) {
            let known: Vec<String> = suffixes.iter().map(|s| format!(".{s}")).collect();
            let (path, known) = (path.display(), known.join(" or "));
            return Err(Error::command_line(format!("-o {path}: the name must end in {known}")));
        }
        if path.is_dir() {
            return Err(Error::new(ExitCode::Io, format!("-o {}: is a folder", path.display())));
        }
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            let (path, folder) = (path.display(), folder.display());
            return Err(Error::new(ExitCode::Io, format!("-o {path}: there is no folder {folder}")));
        }
    }
    Ok(())
}

/// Rows as text with aligned columns.
pub(super) fn table<const N: usize>(rows: &[[String; N]]) -> String {
    let mut widths = [0; N];
    for row in rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let line = |row: &[String; N]| {
        let cells: Vec<String> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        cells.join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}
