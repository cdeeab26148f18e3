//! From sections to bytes, the same bytes every time.

use std::borrow::Cow;
use std::io::{self, Write};

use serde::Serialize;

use crate::container::{ALIGNMENT, CHECKSUM_AT, ENTRY_BYTES, HEADER_BYTES, MAGIC, SectionInfo, align, head_checksum};
use crate::error::{FormatError, Result};
use crate::types::{Codec, Element, ElementType, Kind, MAX_SECTIONS, Tag, VERSION_MAJOR, VERSION_MINOR};
use crate::{codec, compression};

/// Collects sections and writes the file. Sections lie in the file in the order in which they were added.
#[derive(Default)]
pub struct Writer<'a> {
    sections: Vec<(SectionInfo, Cow<'a, [u8]>)>,
}

impl<'a> Writer<'a> {
    /// A file without sections.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an array of any length. [`Codec::Raw`] borrows it until the file is written.
    ///
    /// # Errors
    /// [`FormatError::DuplicateTag`], [`FormatError::TooManySections`], or zstd failed.
    pub fn add<T: Element>(&mut self, tag: Tag, kind: Kind, codec: Codec, rows: &'a [T]) -> Result<&mut Self> {
        let bytes = Cow::Borrowed(bytemuck::cast_slice(rows));
        self.add_bytes(tag, kind, (T::TYPE, T::COMPONENTS), codec, bytes)
    }

    /// Adds a serialised structure (see `SPEC.md` for the encoding). `T` holds no maps with a random order.
    ///
    /// # Errors
    /// As [`Writer::add`], and [`FormatError::Record`] if `value` is too long.
    pub fn add_record<T: Serialize>(&mut self, tag: Tag, kind: Kind, codec: Codec, value: &T) -> Result<&mut Self> {
        let bytes = Cow::Owned(codec::encode(tag, value)?);
        self.add_bytes(tag, kind, (ElementType::Record, 1), codec, bytes)
    }

    /// Adds decoded bytes of a given element type and number of components.
    pub(crate) fn add_bytes(
        &mut self,
        tag: Tag,
        kind: Kind,
        (element, components): (ElementType, u16),
        codec: Codec,
        bytes: Cow<'a, [u8]>,
    ) -> Result<&mut Self> {
        if self.sections.len() >= MAX_SECTIONS {
            return Err(FormatError::TooManySections { count: self.sections.len() as u64 + 1 });
        }
        if self.sections.iter().any(|(section, _)| section.tag == tag) {
            return Err(FormatError::DuplicateTag { tag });
        }
        let decoded_bytes = bytes.len() as u64;
        let stored = match codec {
            Codec::Raw => bytes,
            Codec::Zstd => Cow::Owned(compression::compress(tag, &bytes)?),
        };
        let info = SectionInfo {
            tag,
            kind,
            element,
            components,
            codec,
            offset: 0,
            stored_bytes: stored.len() as u64,
            decoded_bytes,
            crc32: crc32fast::hash(&stored),
        };
        info.check_lengths()?;
        self.sections.push((info, stored));
        Ok(self)
    }

    /// Encodes the file.
    pub fn finish(self) -> Vec<u8> {
        let (head, length) = self.head();
        let mut out = Vec::with_capacity(length as usize);
        out.extend_from_slice(&head);
        for (_, stored) in &self.sections {
            out.resize(out.len().next_multiple_of(ALIGNMENT as usize), 0);
            out.extend_from_slice(stored);
        }
        out
    }

    /// Writes the same bytes as [`Writer::finish`] to a stream, without a copy of the whole file in memory.
    ///
    /// # Errors
    /// Errors of `out`.
    pub fn write_to(self, out: &mut dyn Write) -> io::Result<()> {
        let (head, _) = self.head();
        out.write_all(&head)?;
        let mut at = head.len() as u64;
        for (_, stored) in &self.sections {
            let padding = (ALIGNMENT - at % ALIGNMENT) % ALIGNMENT;
            out.write_all(&[0; ALIGNMENT as usize][..padding as usize])?;
            out.write_all(stored)?;
            at += padding + stored.len() as u64;
        }
        Ok(())
    }

    /// Header and directory, and the length of the file.
    fn head(&self) -> (Vec<u8>, u64) {
        let mut head = vec![0; HEADER_BYTES];
        let mut end = (HEADER_BYTES + ENTRY_BYTES * self.sections.len()) as u64;
        for (info, stored) in &self.sections {
            // Both lengths are those of slices in memory, so the sum stays far below 2^64.
            let offset = align(end).unwrap_or(end);
            end = offset + stored.len() as u64;
            head.extend_from_slice(&SectionInfo { offset, ..*info }.to_entry());
        }
        head[0..8].copy_from_slice(&MAGIC);
        head[8..10].copy_from_slice(&VERSION_MAJOR.to_le_bytes());
        head[10..12].copy_from_slice(&VERSION_MINOR.to_le_bytes());
        head[12..16].copy_from_slice(&(self.sections.len() as u32).to_le_bytes());
        head[16..24].copy_from_slice(&end.to_le_bytes());
        let checksum = head_checksum(&head);
        head[CHECKSUM_AT..CHECKSUM_AT + 4].copy_from_slice(&checksum.to_le_bytes());
        (head, end)
    }
}
