//! A folder of results by the names of their inputs: each a file that appears whole or not at all, checked as it is read; the oldest go where
//! they take too much room. Any number of processes may use one.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::atomic;
use crate::error::{Error, Result};

/// First bytes of an entry.
const MAGIC: &[u8; 8] = b"TLXSTAGE";

/// Suffix of entries: nothing else in the folder is read or removed.
const SUFFIX: &str = "stage";

/// Bytes before the result: magic, name, hash of the result.
const HEAD: usize = 8 + 32 + 32;

/// What programs that copy or index folders know caches by (the cache directory tagging specification).
const TAG_FILE: &str = "CACHEDIR.TAG";
const TAG: &str =
    "Signature: 8a477f597d28d172789f06886806bc55\n# Results of stages of translux; may be removed at any time.\n";

/// A folder of results.
#[derive(Debug)]
pub struct Cache {
    folder: PathBuf,
    most_bytes: u64,
}

impl Cache {
    /// A cache in a folder, which is made where it is not there, of at most so many bytes.
    ///
    /// # Errors
    /// I/O: the folder cannot be made.
    pub fn open(folder: &Path, most_bytes: u64) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
        let tag = folder.join(TAG_FILE);
        if !tag.exists() {
            // A folder that only others may write still has what they left.
            let _ = fs::write(&tag, TAG);
        }
        Ok(Self { folder: folder.to_owned(), most_bytes })
    }

    fn path(&self, name: &[u8; 32]) -> PathBuf {
        self.folder.join(format!("{}.{SUFFIX}", blake3::Hash::from_bytes(*name).to_hex()))
    }

    /// The result of a name; none where there is none, or it is damaged.
    pub fn get(&self, name: &[u8; 32]) -> Option<Vec<u8>> {
        let path = self.path(name);
        let mut bytes = fs::read(&path).ok()?;
        let (head, result) = bytes.split_first_chunk::<HEAD>()?;
        let hash = blake3::hash(result);
        if head[..8] != *MAGIC || head[8..40] != *name || head[40..] != *hash.as_bytes() {
            return None;
        }
        // Used last, it goes last; where that cannot be written it goes by when it was made.
        if let Ok(file) = File::options().append(true).open(&path) {
            let _ = file.set_modified(SystemTime::now());
        }
        bytes.drain(..HEAD);
        Some(bytes)
    }

    /// Keeps the result of a name; what was used longest ago goes where all together take too much.
    ///
    /// # Errors
    /// I/O with the place.
    pub fn put(&self, name: &[u8; 32], result: &[u8]) -> Result<()> {
        let length = (HEAD + result.len()) as u64;
        if length > self.most_bytes {
            return Ok(());
        }
        let mut bytes = Vec::with_capacity(HEAD + result.len());
        bytes.extend(MAGIC);
        bytes.extend(name);
        bytes.extend(blake3::hash(result).as_bytes());
        bytes.extend(result);
        let path = self.path(name);
        atomic::write(&path, &bytes)?;
        self.evict(&path)
    }

    /// Removes entries until the rest fits, the one that was used longest ago first; `new` stays.
    fn evict(&self, new: &Path) -> Result<()> {
        let fail = |e: std::io::Error| Error::io(&self.folder, &e);
        let mut entries = Vec::new();
        for entry in fs::read_dir(&self.folder).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            let is_entry = path.extension().is_some_and(|suffix| suffix == SUFFIX);
            // One that has just gone was removed by another process.
            if let (true, Ok(found)) = (is_entry, fs::metadata(&path)) {
                entries.push((found.modified().unwrap_or(SystemTime::UNIX_EPOCH), path, found.len()));
            }
        }
        entries.sort();
        let mut total: u64 = entries.iter().map(|entry| entry.2).sum();
        for (_, path, length) in entries.into_iter().filter(|entry| entry.1 != new) {
            if total <= self.most_bytes {
                break;
            }
            match fs::remove_file(&path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(Error::io(&path, &e)),
                _ => total -= length,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn name(index: u8) -> [u8; 32] {
        [index; 32]
    }

    #[test]
    fn what_was_put_is_there_until_it_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::open(&folder.path().join("a/b"), 1 << 20).unwrap();
        assert_eq!(cache.get(&name(1)), None);
        cache.put(&name(1), b"result").unwrap();
        cache.put(&name(2), b"").unwrap();
        assert_eq!((cache.get(&name(1)).unwrap(), cache.get(&name(2)).unwrap()), (b"result".to_vec(), Vec::new()));
        let path = cache.path(&name(1));
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            fs::write(&path, &damaged).unwrap();
            assert_eq!(cache.get(&name(1)), None, "{at}");
            fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(cache.get(&name(1)), None, "cut at {at}");
        }
        // Another entry under this name is another result.
        fs::copy(cache.path(&name(2)), &path).unwrap();
        assert_eq!(cache.get(&name(1)), None);
        cache.put(&name(1), b"again").unwrap();
        assert_eq!(cache.get(&name(1)).unwrap(), b"again");
        let file = folder.path().join("file");
        fs::write(&file, b"").unwrap();
        assert_eq!(Cache::open(&file, 1).unwrap_err().code(), crate::error::ExitCode::Io);
    }

    #[test]
    fn what_was_used_longest_ago_goes_first_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let entry = (HEAD + 100) as u64;
        let cache = Cache::open(folder.path(), 3 * entry).unwrap();
        fs::write(folder.path().join("mine.txt"), [0; 1000]).unwrap();
        for index in 0..3 {
            cache.put(&name(index), &[index; 100]).unwrap();
            let file = File::options().append(true).open(cache.path(&name(index))).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(100 - u64::from(index))).unwrap();
        }
        // The first is used, so that the second is the oldest.
        assert!(cache.get(&name(0)).is_some());
        cache.put(&name(3), &[3; 100]).unwrap();
        assert_eq!([0, 1, 2, 3].map(|index| cache.get(&name(index)).is_some()), [true, false, true, true]);
        cache.put(&name(4), &[4; 1000]).unwrap();
        assert!(cache.get(&name(4)).is_none() && cache.get(&name(3)).is_some(), "larger than the cache");
        assert!(folder.path().join("mine.txt").exists());
    }
}
