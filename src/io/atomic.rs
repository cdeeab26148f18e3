//! Files that appear whole or not at all: a temporary file beside the target, synced, then renamed.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::error::{Error, ExitCode, Result};

/// Temporary files that exist now, for [`remove_unfinished`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Name of a temporary file before and after its random letters.
const PREFIX: &str = ".translux-";
const SUFFIX: &str = ".part";

/// Links that a name may go through.
const LINKS: usize = 40;

/// Writes a file atomically; `-` is standard output, whose reader may have gone. An existing file is replaced only when all bytes are on
/// disk; a link is kept, and the file that it names replaced. What is no regular file, such as a pipe, is written to.
///
/// # Errors
/// I/O errors with the path.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    if path == Path::new("-") {
        let mut out = std::io::stdout().lock();
        return match out.write_all(bytes).and_then(|()| out.flush()) {
            Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::io(path, &e)),
            _ => Ok(()),
        };
    }
    let target = target(path)?;
    if is_special(&target) {
        let fail = |e: std::io::Error| Error::io(path, &e);
        let mut file = std::fs::OpenOptions::new().write(true).open(&target).map_err(fail)?;
        return file.write_all(bytes).map_err(fail);
    }
    let mut writing = Writing::begin(path)?;
    writing.add(bytes)?;
    writing.finish()
}

/// A file that is written bit by bit and appears when it is complete; dropped before, it never was.
#[derive(Debug)]
pub struct Writing {
    file: Option<tempfile::NamedTempFile>,
    path: PathBuf,
    target: PathBuf,
    temporary: PathBuf,
}

impl Writing {
    /// Begins a file.
    ///
    /// # Errors
    /// I/O errors with the path.
    pub fn begin(path: &Path) -> Result<Self> {
        let target = target(path)?;
        let folder = folder(&target);
        remove_stale(folder);
        // Listed before anybody else can look: an interrupt between the two would leave the file.
        let mut unfinished = lock();
        let file = temporary(folder).map_err(|e| Error::io(path, &plain(e)))?;
        let temporary = file.path().to_path_buf();
        unfinished.push(temporary.clone());
        drop(unfinished);
        Ok(Self { file: Some(file), path: path.to_path_buf(), target, temporary })
    }

    /// Adds bytes at the end.
    ///
    /// # Errors
    /// I/O errors with the path.
    pub fn add(&mut self, bytes: &[u8]) -> Result<()> {
        match &mut self.file {
            Some(file) => file.write_all(bytes).map_err(|e| Error::io(&self.path, &e)),
            None => Ok(()),
        }
    }

    /// Puts the file in place when all bytes are on disk.
    ///
    /// # Errors
    /// I/O errors with the path.
    pub fn finish(mut self) -> Result<()> {
        let Some(file) = self.file.take() else { return Ok(()) };
        let done = (|| {
            file.as_file().sync_all()?;
            set_mode(file.as_file(), &self.target)?;
            file.persist(&self.target).map_err(|e| e.error).map(drop)
        })();
        done.map_err(|e| Error::io(&self.path, &e))
    }
}

impl Drop for Writing {
    fn drop(&mut self) {
        drop(self.file.take());
        lock().retain(|path| path != &self.temporary);
    }
}

/// Checks that a file could be written, before the work that fills it: a file is made in its folder and removed.
///
/// # Errors
/// I/O errors with the path.
pub fn probe(path: &Path) -> Result<()> {
    if path == Path::new("-") {
        return Ok(());
    }
    let target = target(path)?;
    if is_special(&target) {
        return Ok(());
    }
    let folder = folder(&target);
    remove_stale(folder);
    // As in `write`: never to be left behind by an interrupt.
    let unfinished = lock();
    let made = temporary(folder).map(drop);
    drop(unfinished);
    made.map_err(|e| Error::io(path, &plain(e)))
}

/// An error without the name of the temporary file.
fn plain(error: std::io::Error) -> std::io::Error {
    match error.get_ref().and_then(|inner| inner.source()).map(ToString::to_string) {
        Some(text) => std::io::Error::new(error.kind(), text),
        None => error,
    }
}

/// The file that a name stands for, links followed.
fn target(path: &Path) -> Result<PathBuf> {
    let mut target = path.to_path_buf();
    for _ in 0..LINKS {
        match std::fs::read_link(&target) {
            Ok(next) => target = folder(&target).join(next),
            Err(_) if target.is_dir() => {
                return Err(Error::new(ExitCode::Io, format!("{}: is a folder", path.display())));
            }
            Err(_) => return Ok(target),
        }
    }
    Err(Error::new(ExitCode::Io, format!("{}: too many links", path.display())))
}

/// True for what exists and cannot be replaced by a file: devices and pipes.
fn is_special(target: &Path) -> bool {
    std::fs::metadata(target).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A temporary file, locked as long as it is open, where the file system has locks: who finds it unlocked knows that nobody writes it.
fn temporary(folder: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    loop {
        let file = tempfile::Builder::new().prefix(PREFIX).suffix(SUFFIX).tempfile_in(folder)?;
        // Between making and locking somebody else may have taken it for a stale one.
        if file.as_file().lock().is_err() || file.path().exists() {
            return Ok(file);
        }
    }
}

/// Removes what writes have left that were killed: temporary files that nobody has locked. What cannot be looked at stays.
fn remove_stale(folder: &Path) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_ours = name.to_str().is_some_and(|name| name.starts_with(PREFIX) && name.ends_with(SUFFIX));
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let path = entry.path();
        if std::fs::File::open(&path).is_ok_and(|file| file.try_lock().is_ok() && std::fs::remove_file(&path).is_ok()) {
            lock().retain(|p| p != &path);
        }
    }
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
    fn what_nobody_writes_is_removed_and_what_somebody_writes_stays() {
        let folder = tempfile::tempdir().unwrap();
        let [stale, other, alive] =
            ["aaaaaa", "x", "bbbbbb"].map(|name| folder.path().join(format!(".translux-{name}.part")));
        let foreign = folder.path().join(".other-aaaaaa.part");
        [&stale, &other, &alive, &foreign].into_iter().for_each(|path| std::fs::write(path, b"half").unwrap());
        let held = std::fs::File::open(&alive).unwrap();
        held.lock().unwrap();
        write(&folder.path().join("a.bin"), b"whole").unwrap();
        assert!(!stale.exists() && !other.exists() && alive.exists() && foreign.exists());
        drop(held);
        probe(&folder.path().join("a.bin")).unwrap();
        assert!(!alive.exists());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_what_is_no_file_is_written_to() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("there")).unwrap();
        symlink("there/b.bin", at("a.bin")).unwrap();
        symlink("a.bin", at("again.bin")).unwrap();
        for content in ["first", "second"] {
            write(&at("again.bin"), content.as_bytes()).unwrap();
            assert_eq!(std::fs::read_to_string(at("there/b.bin")).unwrap(), content);
            assert!(at("a.bin").is_symlink() && at("again.bin").is_symlink());
        }
        symlink("/dev/null", at("null.bin")).unwrap();
        write(&at("null.bin"), b"gone").unwrap();
        assert!(at("null.bin").is_symlink() && !Path::new("/dev/null").is_file());
        symlink("loop.bin", at("loop.bin")).unwrap();
        assert!(write(&at("loop.bin"), b"x").unwrap_err().message().contains("links"));
        symlink("none/c.bin", at("dangling.bin")).unwrap();
        assert!(probe(&at("dangling.bin")).unwrap_err().message().contains("dangling.bin"));
    }

    #[test]
    fn a_missing_folder_is_an_io_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let error = write(&folder.path().join("no/such/a.bin"), b"x").unwrap_err();
        assert_eq!(error.code(), ExitCode::Io);
        assert!(error.message().contains("a.bin"));
    }
}
