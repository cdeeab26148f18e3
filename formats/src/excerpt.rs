//! Parts of a file: header and directory, and the sections that are asked for. The rest is not read, however large it is.

use std::io::{self, Read, Seek, SeekFrom};

use crate::container::{ENTRY_BYTES, HEADER_BYTES, SectionInfo};
use crate::error::FormatError;
use crate::reader::{Extent, Reader, decoding_cost, parse_directory};
use crate::types::{Budget, MAX_SECTIONS};

/// The reason why no part of a file could be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The source failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The bytes are refused.
    #[error(transparent)]
    Format(#[from] FormatError),
}

/// Header and directory of a file, with some of its sections.
#[derive(Clone, Debug)]
pub struct Excerpt {
    length: u64,
    version: (u16, u16),
    directory: Vec<SectionInfo>,
    /// Sections that are here, their offsets those in `bytes`.
    sections: Vec<SectionInfo>,
    /// Stored bytes of these sections.
    bytes: Vec<u8>,
}

impl Excerpt {
    /// Reads header and directory, and the stored bytes of the sections that `wanted` selects, whose cost is within `budget`. The
    /// padding between sections, which [`Reader::parse`] checks, is not looked at.
    ///
    /// # Errors
    /// Errors of the source; errors 1 to 14 of `SPEC.md`; [`FormatError::OutOfMemory`].
    pub fn read(
        source: &mut (impl Read + Seek),
        budget: Budget,
        wanted: impl Fn(&SectionInfo) -> bool,
    ) -> Result<Self, ReadError> {
        let length = source.seek(SeekFrom::End(0))?;
        source.seek(SeekFrom::Start(0))?;
        let mut head = Vec::new();
        source.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut head)?;
        // What a header claims that has no magic, or of sections beyond the limit, is refused below.
        if let Some(Ok(count)) = head.get(12..16).map(<[u8; 4]>::try_from) {
            let count = (u32::from_le_bytes(count) as usize).min(MAX_SECTIONS);
            source.by_ref().take((ENTRY_BYTES * count) as u64).read_to_end(&mut head)?;
        }
        let extent = Extent { head: &head, length, whole: None };
        let (version, directory) = parse_directory(&extent, Budget::bytes(u64::MAX), &mut Err)?;
        let (mut sections, mut bytes) = (Vec::new(), Vec::new());
        let (mut needed, budget) = (0u64, budget.max_decoded_bytes);
        for info in directory.iter().filter(|info| wanted(info)) {
            // The directory has been found to lie inside the file, which may have been cut since.
            let (offset, tag) = (bytes.len() as u64, info.tag);
            needed = needed.saturating_add(decoding_cost(info));
            if needed.max(info.stored_bytes) > budget {
                return Err(FormatError::OverBudget { tag, needed, budget }.into());
            }
            let Some(room) = usize::try_from(info.stored_bytes).ok().filter(|room| bytes.try_reserve(*room).is_ok())
            else {
                return Err(FormatError::OutOfMemory { tag, bytes: info.stored_bytes }.into());
            };
            source.seek(SeekFrom::Start(info.offset))?;
            if source.by_ref().take(info.stored_bytes).read_to_end(&mut bytes)? != room {
                return Err(FormatError::SectionEnd { end: info.offset + info.stored_bytes, length }.into());
            }
            sections.push(SectionInfo { offset, ..*info });
        }
        Ok(Self { length, version, directory, sections, bytes })
    }

    /// Length of the whole file.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Every section of the file, read or not.
    pub fn directory(&self) -> &[SectionInfo] {
        &self.directory
    }

    /// A reader of the sections that were read.
    pub fn reader(&self) -> Reader<'_> {
        Reader::of_parts(&self.bytes, self.version, self.sections.clone())
    }
}
