//! Bytes to sections. Nothing is trusted: every length is checked before memory is taken for it.

use std::borrow::Cow;
use std::collections::BTreeSet;

use serde::de::DeserializeOwned;

use crate::container::{CHECKSUM_AT, ENTRY_BYTES, HEADER_BYTES, MAGIC, SectionInfo, align, field, head_checksum};
use crate::error::{FormatError, Result};
use crate::types::{Budget, Codec, Element, ElementType, Kind, MAX_SECTIONS, Scalar, Tag, VERSION_MAJOR};
use crate::{codec, compression};

/// A file whose header and directory are valid. Sections are checked and decoded on demand, so that an engine that maps
/// the file touches only the bytes that it uses.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    version: (u16, u16),
    sections: Vec<SectionInfo>,
}

impl<'a> Reader<'a> {
    /// Checks magic, version, length, checksum of the directory, the place and length of every section, the padding,
    /// and that all sections together stay within `budget`.
    ///
    /// # Errors
    /// Errors 1 to 14 of `SPEC.md`.
    pub fn parse(bytes: &'a [u8], budget: Budget) -> Result<Self> {
        Self::parse_with(bytes, budget, &mut Err)
    }

    /// Like [`Reader::parse`] where `report` returns every error. Where `report` swallows them, the reader has the
    /// sections with a place in the file; an error is returned where nothing can be said about the rest of the file.
    pub(crate) fn parse_with(bytes: &'a [u8], budget: Budget, report: Report<'_>) -> Result<Self> {
        let extent = Extent { head: bytes, length: bytes.len() as u64, whole: Some(bytes) };
        let (version, sections) = parse_directory(&extent, budget, report)?;
        Ok(Self { bytes, version, sections })
    }

    /// A reader of sections whose stored bytes are at these offsets of `bytes`.
    pub(crate) fn of_parts(bytes: &'a [u8], version: (u16, u16), sections: Vec<SectionInfo>) -> Self {
        Self { bytes, version, sections }
    }

    /// Major and minor version in the header.
    pub fn version(&self) -> (u16, u16) {
        self.version
    }

    /// Every section, known or not, in the order of the file.
    pub fn sections(&self) -> &[SectionInfo] {
        &self.sections
    }

    /// The section with this tag.
    pub fn find(&self, tag: Tag) -> Option<&SectionInfo> {
        self.sections.iter().find(|section| section.tag == tag)
    }

    /// The section with this tag.
    ///
    /// # Errors
    /// [`FormatError::MissingSection`].
    pub fn section(&self, tag: Tag) -> Result<&SectionInfo> {
        self.find(tag).ok_or(FormatError::MissingSection { tag })
    }

    /// A section as rows of `T`, `len = info.rows()`.
    ///
    /// # Errors
    /// The section is missing, damaged, or of another type.
    pub fn array<T: Element>(&self, tag: Tag) -> Result<Vec<T>> {
        let info = self.section(tag)?;
        expect_type(info, T::TYPE, T::COMPONENTS)?;
        self.decode(info)
    }

    /// Like [`Reader::array`], also checking the purpose of the section.
    pub(crate) fn array_of<T: Element>(&self, tag: Tag, kind: Kind) -> Result<Vec<T>> {
        expect_kind(self.section(tag)?, kind)?;
        self.array(tag)
    }

    /// A section as single numbers, for any number of components: `len = info.rows() * info.components`.
    ///
    /// # Errors
    /// As [`Reader::array`].
    pub fn scalars<T: Scalar>(&self, tag: Tag) -> Result<Vec<T>> {
        let info = self.section(tag)?;
        expect_type(info, T::TYPE, info.components)?;
        self.decode(info)
    }

    /// Like [`Reader::array`], but in place where the section is raw and `bytes` lies aligned in memory.
    ///
    /// # Errors
    /// As [`Reader::array`].
    pub fn view<T: Element>(&self, tag: Tag) -> Result<Cow<'a, [T]>> {
        let info = self.section(tag)?;
        expect_type(info, T::TYPE, T::COMPONENTS)?;
        if info.codec == Codec::Raw
            && let Ok(rows) = bytemuck::try_cast_slice(self.stored(info)?)
        {
            return Ok(Cow::Borrowed(rows));
        }
        self.decode(info).map(Cow::Owned)
    }

    /// A serialised structure, see [`crate::Writer::add_record`]. `T` holds no lists of zero-sized elements.
    ///
    /// # Errors
    /// The section is missing, damaged, no record, or another record.
    pub fn record<T: DeserializeOwned>(&self, tag: Tag) -> Result<T> {
        let info = self.section(tag)?;
        expect_type(info, ElementType::Record, 1)?;
        codec::decode(tag, &self.bytes_of(info)?)
    }

    /// Like [`Reader::record`], also checking the purpose of the section.
    pub(crate) fn record_of<T: DeserializeOwned>(&self, tag: Tag, kind: Kind) -> Result<T> {
        expect_kind(self.section(tag)?, kind)?;
        self.record(tag)
    }

    /// The decoded bytes of a section of any type.
    ///
    /// # Errors
    /// The section is missing or damaged.
    pub fn bytes(&self, tag: Tag) -> Result<Cow<'a, [u8]>> {
        self.bytes_of(self.section(tag)?)
    }

    /// Checks the checksum of every section without decoding it.
    ///
    /// # Errors
    /// [`FormatError::SectionChecksum`] of the first damaged section.
    pub fn verify_checksums(&self) -> Result<()> {
        self.sections.iter().try_for_each(|info| self.stored(info).map(drop))
    }

    fn bytes_of(&self, info: &SectionInfo) -> Result<Cow<'a, [u8]>> {
        match info.codec {
            Codec::Raw => self.stored(info).map(Cow::Borrowed),
            Codec::Zstd => self.decode(info).map(Cow::Owned),
        }
    }

    /// The stored bytes, their checksum verified.
    fn stored(&self, info: &SectionInfo) -> Result<&'a [u8]> {
        // `parse` has found offset and length inside the file, so both fit in `usize`.
        let start = info.offset as usize;
        let stored = &self.bytes[start..start + info.stored_bytes as usize];
        let computed = crc32fast::hash(stored);
        if computed != info.crc32 {
            return Err(FormatError::SectionChecksum { tag: info.tag, stated: info.crc32, computed });
        }
        Ok(stored)
    }

    /// Checks the checksum of a section and that it decodes.
    pub(crate) fn check(&self, info: &SectionInfo) -> Result<()> {
        self.bytes_of(info).map(drop)
    }

    /// The same file with only the sections that `keep` selects.
    pub(crate) fn keeping(mut self, keep: impl Fn(&SectionInfo) -> bool) -> Self {
        self.sections.retain(keep);
        self
    }

    fn decode<T: bytemuck::Pod>(&self, info: &SectionInfo) -> Result<Vec<T>> {
        let tag = info.tag;
        let stored = self.stored(info)?;
        if info.codec == Codec::Zstd {
            compression::check_frame(tag, stored, info.decoded_bytes)?;
        }
        let no_memory = FormatError::OutOfMemory { tag, bytes: info.decoded_bytes };
        let size = size_of::<T>() as u64;
        if size == 0 || !info.decoded_bytes.is_multiple_of(size) {
            let reason = format!("{} bytes are not whole rows of {size}", info.decoded_bytes);
            return Err(FormatError::SectionLength { tag, reason });
        }
        let Ok(rows) = usize::try_from(info.decoded_bytes / size) else { return Err(no_memory) };
        let mut out = Vec::new();
        if out.try_reserve_exact(rows).is_err() {
            return Err(no_memory);
        }
        out.resize(rows, T::zeroed());
        let out_bytes = bytemuck::cast_slice_mut(&mut out);
        match info.codec {
            Codec::Raw => out_bytes.copy_from_slice(stored),
            Codec::Zstd => compression::decompress(tag, stored, out_bytes)?,
        }
        Ok(out)
    }
}

/// Handler of an error, which decides whether to go on: the strict reader returns it, a scan records it.
pub(crate) type Report<'r> = &'r mut dyn FnMut(FormatError) -> Result<()>;

/// What is known of a file before its sections are looked at.
pub(crate) struct Extent<'a> {
    /// Its first bytes: header and directory, as far as the file has them.
    pub(crate) head: &'a [u8],
    /// Its length.
    pub(crate) length: u64,
    /// All of its bytes, where padding is to be checked.
    pub(crate) whole: Option<&'a [u8]>,
}

/// Version and sections of a file; the sections have a place in it. Where `report` swallows errors, an error is returned where nothing
/// can be said about the rest.
pub(crate) fn parse_directory(
    extent: &Extent<'_>,
    budget: Budget,
    report: Report<'_>,
) -> Result<((u16, u16), Vec<SectionInfo>)> {
    let (version, count) = parse_header(extent, report)?;
    let head_end = HEADER_BYTES + ENTRY_BYTES * count;
    let mut sections = Vec::with_capacity(count);
    let mut tags = BTreeSet::new();
    // Unknown behind an entry that does not parse.
    let mut end = Some(head_end as u64);
    let mut cost = 0u64;
    for index in 0..count {
        let at = HEADER_BYTES + ENTRY_BYTES * index;
        let info = match SectionInfo::from_entry(index as u32, at as u64, &field(extent.head, at)) {
            Ok(info) => info,
            Err(error) => {
                report(error)?;
                end = None;
                continue;
            }
        };
        let repeated = !tags.insert(info.tag);
        if repeated {
            report(FormatError::DuplicateTag { tag: info.tag })?;
        }
        end = check_place(extent, &info, end, report)?;
        let needed = cost.saturating_add(decoding_cost(&info));
        if needed > budget.max_decoded_bytes {
            report(FormatError::OverBudget { tag: info.tag, needed, budget: budget.max_decoded_bytes })?;
        } else if end.is_some() && !repeated {
            cost = needed;
            sections.push(info);
        }
    }
    match end {
        Some(end) if end != extent.length => {
            report(FormatError::SectionEnd { end, length: extent.length })?;
        }
        _ => {}
    }
    Ok((version, sections))
}

/// Reads version and number of sections, and makes all checks that need no directory entry.
fn parse_header(extent: &Extent<'_>, report: Report<'_>) -> Result<((u16, u16), usize)> {
    let (bytes, length) = (extent.head, extent.length);
    let there = bytes.len() as u64;
    let need = |needed: u64| if there < needed { Err(FormatError::TooShort { needed, length: there }) } else { Ok(()) };
    if !MAGIC.starts_with(&bytes[..bytes.len().min(MAGIC.len())]) {
        return Err(FormatError::BadMagic);
    }
    need(HEADER_BYTES as u64)?;
    let major = u16::from_le_bytes(field(bytes, 8));
    let minor = u16::from_le_bytes(field(bytes, 10));
    if major != VERSION_MAJOR {
        return Err(FormatError::UnsupportedVersion { major, minor });
    }
    let stated = u64::from_le_bytes(field(bytes, 16));
    if stated != length {
        report(FormatError::FileLength { stated, actual: length })?;
    }
    let count = u32::from_le_bytes(field(bytes, 12)) as usize;
    if count > MAX_SECTIONS {
        return Err(FormatError::TooManySections { count: count as u64 });
    }
    let head_end = HEADER_BYTES + ENTRY_BYTES * count;
    need(head_end as u64)?;
    let stated = u32::from_le_bytes(field(bytes, CHECKSUM_AT));
    let computed = head_checksum(&bytes[..head_end]);
    if stated != computed {
        report(FormatError::HeaderChecksum { stated, computed })?;
    }
    check_zero(bytes, 28, HEADER_BYTES, "reserved, header").or_else(report)?;
    Ok(((major, minor), count))
}

/// Checks that a section begins at the first boundary after `previous_end`; returns its end, if inside the file.
fn check_place(
    extent: &Extent<'_>,
    info: &SectionInfo,
    previous_end: Option<u64>,
    report: Report<'_>,
) -> Result<Option<u64>> {
    let length = extent.length;
    if let Some(previous_end) = previous_end {
        let expected = align(previous_end).unwrap_or(u64::MAX);
        if info.offset != expected {
            report(FormatError::Offset { tag: info.tag, offset: info.offset, expected })?;
        } else if let Some(bytes) = extent.whole.filter(|_| expected <= length) {
            check_zero(bytes, previous_end as usize, expected as usize, "padding").or_else(&mut *report)?;
        }
    }
    let end = info.offset.saturating_add(info.stored_bytes);
    if end > length {
        report(FormatError::SectionEnd { end, length })?;
        return Ok(None);
    }
    Ok(Some(end))
}

fn check_zero(bytes: &[u8], from: usize, to: usize, place: &'static str) -> Result<()> {
    match bytes[from..to].iter().position(|&byte| byte != 0) {
        Some(i) => Err(FormatError::NotZero { offset: (from + i) as u64, place }),
        None => Ok(()),
    }
}

pub(crate) fn decoding_cost(info: &SectionInfo) -> u64 {
    let factor = if info.element == ElementType::Record { Budget::RECORD_FACTOR } else { 1 };
    info.decoded_bytes.saturating_mul(factor)
}

fn expect_type(info: &SectionInfo, expected: ElementType, expected_components: u16) -> Result<()> {
    let (found, found_components) = (info.element, info.components);
    if found == expected && found_components == expected_components {
        return Ok(());
    }
    Err(FormatError::WrongType { tag: info.tag, expected, expected_components, found, found_components })
}

fn expect_kind(info: &SectionInfo, kind: Kind) -> Result<()> {
    if info.kind == kind {
        return Ok(());
    }
    Err(FormatError::Invalid { tag: info.tag, reason: format!("its kind is {}, not {kind}", info.kind) })
}
