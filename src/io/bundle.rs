//! A file of results that are read one by one: the results one after the other, what is said of them at the end.
//!
//! Bytes: `TLXSHARD`, the results, a text that says what they are, its length in 8 bytes (little endian), its BLAKE3 hash.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use super::atomic::Writing;
use crate::error::{Error, Result};

/// First bytes.
pub const MAGIC: &[u8; 8] = b"TLXSHARD";

/// Bytes behind the text.
const TAIL: u64 = 8 + 32;

/// Longest text that is read.
const LONGEST: u64 = 1 << 28;

/// Where a result lies in its file.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Extent {
    /// First byte.
    pub offset: u64,
    /// Number of bytes.
    pub length: u64,
    /// BLAKE3 hash of the bytes, hexadecimal.
    pub blake3: String,
}

/// A file that is being filled.
#[derive(Debug)]
pub struct Bundle {
    file: Writing,
    length: u64,
}

impl Bundle {
    /// Begins a file.
    ///
    /// # Errors
    /// I/O errors with the path.
    pub fn begin(path: &Path) -> Result<Self> {
        let mut file = Writing::begin(path)?;
        file.add(MAGIC)?;
        Ok(Self { file, length: MAGIC.len() as u64 })
    }

    /// Adds a result.
    ///
    /// # Errors
    /// I/O errors with the path.
    pub fn add(&mut self, bytes: &[u8]) -> Result<Extent> {
        self.file.add(bytes)?;
        let (offset, length) = (self.length, bytes.len() as u64);
        self.length += length;
        Ok(Extent { offset, length, blake3: blake3::hash(bytes).to_hex().to_string() })
    }

    /// Completes the file, whose results a text tells of; its length.
    ///
    /// # Errors
    /// I/O errors with the path.
    pub fn finish(mut self, text: &str) -> Result<u64> {
        self.file.add(text.as_bytes())?;
        self.file.add(&(text.len() as u64).to_le_bytes())?;
        self.file.add(blake3::hash(text.as_bytes()).as_bytes())?;
        self.file.finish()?;
        Ok(self.length + text.len() as u64 + TAIL)
    }
}

/// A file that results are read from when they are needed.
#[derive(Debug)]
pub struct OpenBundle {
    file: Mutex<File>,
    /// Where the text begins.
    end: u64,
}

impl OpenBundle {
    /// Opens a file; the text with it.
    ///
    /// # Errors
    /// I/O; invalid input: no such file, or it is cut or changed. Both with the path.
    pub fn open(path: &Path) -> Result<(Self, String)> {
        let fail = |e: std::io::Error| Error::io(path, &e);
        let invalid = |what: &str| Error::input(what).in_file(path);
        let mut file = File::open(path).map_err(fail)?;
        let length = file.metadata().map_err(fail)?.len();
        let mut magic = [0; MAGIC.len()];
        if length < MAGIC.len() as u64 + TAIL || file.read_exact(&mut magic).is_err() || magic != *MAGIC {
            return Err(invalid("no shard of a bake, or cut"));
        }
        let mut tail = [0; TAIL as usize];
        file.seek(SeekFrom::Start(length - TAIL)).and_then(|_| file.read_exact(&mut tail)).map_err(fail)?;
        let (of_text, hash) = tail.split_at(8);
        let of_text = of_text.iter().rev().fold(0u64, |sum, byte| sum << 8 | u64::from(*byte));
        let start = (length - TAIL).checked_sub(of_text).filter(|start| *start >= MAGIC.len() as u64);
        let Some(end) = start.filter(|_| of_text <= LONGEST) else {
            return Err(invalid("a shard of a bake that is cut"));
        };
        let mut text = vec![0; of_text as usize];
        file.seek(SeekFrom::Start(end)).and_then(|_| file.read_exact(&mut text)).map_err(fail)?;
        if blake3::hash(&text).as_bytes() != hash {
            return Err(invalid("a shard of a bake that is cut or damaged: its contents do not have their hash"));
        }
        let text = String::from_utf8(text).map_err(|_| invalid("a shard of a bake whose contents are no text"))?;
        Ok((Self { file: Mutex::new(file), end }, text))
    }

    /// Reads a result; none where it is not there or not the one that was put there.
    ///
    /// # Errors
    /// I/O, without the path.
    pub fn read(&self, extent: &Extent) -> std::io::Result<Option<Vec<u8>>> {
        let end = extent.offset.checked_add(extent.length).filter(|end| *end <= self.end);
        if end.is_none() {
            return Ok(None);
        }
        let mut bytes = vec![0; extent.length as usize];
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(extent.offset))?;
        file.read_exact(&mut bytes)?;
        Ok(Some(bytes).filter(|bytes| blake3::hash(bytes).to_hex().as_str() == extent.blake3))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn results_come_back_unless_they_are_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.shard");
        let mut bundle = Bundle::begin(&path).unwrap();
        let extents = [&b"first"[..], b"", b"third"].map(|bytes| bundle.add(bytes).unwrap());
        assert!(!path.exists());
        let length = bundle.finish("what they are").unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(bytes.len() as u64, length);
        let (open, text) = OpenBundle::open(&path).unwrap();
        assert_eq!(text, "what they are");
        let read = |open: &OpenBundle, index: usize| open.read(&extents[index]).unwrap();
        assert_eq!([0, 1, 2].map(|i| read(&open, i).unwrap()), [&b"first"[..], b"", b"third"]);
        // Beyond the results there is nothing to read.
        let beyond = Extent { length: 6, ..extents[2].clone() };
        assert_eq!(open.read(&beyond).unwrap(), None);
        assert_eq!(open.read(&Extent { offset: u64::MAX, ..beyond }).unwrap(), None);

        let mut changed = bytes.clone();
        changed[extents[2].offset as usize] ^= 1;
        std::fs::write(&path, &changed).unwrap();
        let (open, _) = OpenBundle::open(&path).unwrap();
        assert_eq!((read(&open, 0).unwrap(), read(&open, 2)), (b"first".to_vec(), None));
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(OpenBundle::open(&path).is_err(), "{length}");
        }
        for at in (0..8).chain(extents[2].offset as usize + 5..bytes.len()) {
            let mut changed = bytes.clone();
            changed[at] ^= 0x10;
            std::fs::write(&path, &changed).unwrap();
            assert!(OpenBundle::open(&path).is_err(), "{at}");
        }
    }
}
