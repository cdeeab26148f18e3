//! Files that appear whole or not at all: a temporary file beside the target, synced, then renamed.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::error::{Error, Result};

/// Temporary files that exist now, for [`remove_unfinished`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Writes a file atomically; `-` is standard output. An existing file is replaced only when all bytes are on disk.
///
/// # Errors
/// I/O errors with the path.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    if path == Path::new("-") {
        let mut out = std::io::stdout().lock();
        return out.write_all(bytes).and_then(|()| out.flush()).map_err(|e| Error::io(path, &e));
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let fail = |e: std::io::Error| Error::io(path, &e);
    if path.is_dir() {
        return Err(Error::new(crate::error::ExitCode::Io, format!("{}: is a folder", path.display())));
    }
    // Listed before anybody else can look: an interrupt between the two would leave the file.
    let mut unfinished = lock();
    let mut file = tempfile::Builder::new().prefix(".translux-").suffix(".part").tempfile_in(folder).map_err(fail)?;
    let temporary = file.path().to_path_buf();
    unfinished.push(temporary.clone());
    drop(unfinished);
    let result = (|| {
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        set_mode(file.as_file(), path)?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    })();
    lock().retain(|p| p != &temporary);
    result.map_err(fail)
}

/// Deletes temporary files of writes in flight; for the handler of an interrupt, just before the process ends.
///
/// Every write that is in flight or starts later waits until then: it neither makes another file nor reports that its
/// own is gone.
pub fn remove_unfinished() {
    let mut unfinished = lock();
    for path in unfinished.drain(..) {
        // The process is about to end: a file that cannot be removed has nobody left to tell.
        let _ = std::fs::remove_file(path);
    }
    std::mem::forget(unfinished);
}

fn lock() -> std::sync::MutexGuard<'static, Vec<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Sets the mode of a temporary file, which is private (0600), to the target's, or to that of a new file.
#[cfg(unix)]
fn set_mode(file: &std::fs::File, target: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let mode = match std::fs::metadata(target) {
        Ok(existing) => existing.permissions().mode() & 0o777,
        Err(_) => 0o666 & !umask(),
    };
    file.set_permissions(std::fs::Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn set_mode(_file: &std::fs::File, _target: &Path) -> std::io::Result<()> {
    Ok(())
}

/// The umask without changing it, where the system reports it (Linux); 022 elsewhere.
#[cfg(unix)]
fn umask() -> u32 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|status| {
            let line = status.lines().find_map(|l| l.strip_prefix("Umask:"))?;
            u32::from_str_radix(line.trim(), 8).ok()
        })
        .unwrap_or(0o022)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn replaces_whole_files_and_leaves_no_rest() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        write(&path, b"first").unwrap();
        write(&path, b"second").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_missing_folder_is_an_io_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let error = write(&folder.path().join("no/such/a.bin"), b"x").unwrap_err();
        assert_eq!(error.code(), crate::error::ExitCode::Io);
        assert!(error.message().contains("a.bin"));
    }
}
