//! Destinations of results: files by suffix, standard output.

use std::path::{Path, PathBuf};

use super::console::Console;
use crate::error::{Error, ExitCode, Result};
use crate::import::file::suffix;
use crate::io::atomic;

/// Refuses outputs that collide or cannot be written, before the work rather than after it.
pub(super) fn check(outputs: &[PathBuf], suffixes: &[&str], console: &Console) -> Result<()> {
    for (index, path) in outputs.iter().enumerate() {
        if outputs[..index].contains(path) {
            return Err(Error::command_line(format!("-o {}: given twice", path.display())));
        }
        if path == Path::new("-") {
            if console.global.json {
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
            return Err(Error::new(ExitCode::Io, format!("-o {}: is a folder", path.display())).of_file(path));
        }
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            let message = format!("-o {}: there is no folder {}", path.display(), folder.display());
            return Err(Error::new(ExitCode::Io, message).of_file(path));
        }
        probe("-o", path)?;
    }
    Ok(())
}

/// Tries whether a file can be written that an option names, before the work that fills it.
pub(super) fn probe(option: &str, path: &Path) -> Result<()> {
    atomic::probe(path).map_err(|e| Error::new(e.code(), format!("{option} {}", e.message())).of_file(path))
}

/// Writes the same bytes to every output; without outputs the bytes are not made.
pub(super) fn write<P: AsRef<Path>>(
    outputs: &[P],
    console: &Console,
    bytes: impl FnOnce() -> Result<Vec<u8>>,
) -> Result<()> {
    if outputs.is_empty() {
        return Ok(());
    }
    console.stage("write", || {
        let bytes = bytes()?;
        outputs.iter().try_for_each(|path| atomic::write(path.as_ref(), &bytes))
    })
}
