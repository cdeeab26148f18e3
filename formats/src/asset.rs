//! A whole file as plain arrays: the content that all methods share, and the method's own sections.

use std::borrow::Cow;
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::codec;
use crate::container::SectionInfo;
use crate::error::{FormatError, Result};
use crate::mesh::{self, Mesh};
use crate::metadata::{self, LedgerEntry, Provenance};
use crate::parts::{self, Parts};
use crate::reader::Reader;
use crate::sample_rule;
use crate::samples::{self, Samples};
use crate::types::{Budget, Codec, Element, ElementType, Kind, Scalar, Tag};
use crate::writer::Writer;

/// Every tag of the sections that this crate reads and writes itself.
pub const COMMON_TAGS: [Tag; 20] = [
    mesh::tags::ORIGIN,
    mesh::tags::POSITIONS,
    mesh::tags::TRIANGLES,
    mesh::tags::NORMALS,
    mesh::tags::NORMAL_CORNERS,
    mesh::tags::UVS,
    mesh::tags::UV_CORNERS,
    mesh::tags::TRIANGLE_MATERIAL,
    mesh::tags::MATERIALS,
    mesh::tags::WELD,
    parts::tags::TRIANGLE_PART,
    parts::tags::PARTS,
    parts::tags::MEDIA,
    samples::tags::FACETS,
    samples::tags::PATCH_OFFSETS,
    samples::tags::PART_OFFSETS,
    samples::tags::RULE,
    metadata::tags::PROVENANCE,
    metadata::tags::LEDGER,
    metadata::tags::DARK,
];

/// Decoded size in bytes from which two threads read the sections.
const TWO_THREADS: u64 = 8 << 20;

/// The sections without a type in this crate, in the order of the file.
fn read_extra(reader: &Reader<'_>) -> Result<Vec<RawSection>> {
    let infos: Vec<_> = reader.sections().iter().filter(|info| !COMMON_TAGS.contains(&info.tag)).collect();
    let total: u64 = infos.iter().map(|info| info.decoded_bytes).sum();
    if total < TWO_THREADS || infos.len() < 2 {
        return infos.into_iter().map(|info| RawSection::read(reader, info)).collect();
    }
    // The largest go first, each to whoever is free.
    let mut order: Vec<usize> = (0..infos.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(infos[i].decoded_bytes), i));
    let next = AtomicUsize::new(0);
    let work = || {
        let mut mine = Vec::new();
        while let Some(&i) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
            mine.push((i, RawSection::read(reader, infos[i])));
        }
        mine
    };
    let mut read = std::thread::scope(|scope| {
        let other = scope.spawn(work);
        let mut read = work();
        // The thread does not panic; if it did, its sections would be missing below.
        read.extend(other.join().unwrap_or_default());
        read
    });
    read.sort_by_key(|(i, _)| *i);
    if let Some(missing) = infos.iter().enumerate().find(|(i, _)| read.get(*i).is_none_or(|(j, _)| i != j)) {
        return Err(FormatError::MissingSection { tag: missing.1.tag });
    }
    read.into_iter().map(|(_, section)| section).collect()
}

/// A section without a type in this crate: a method's own data, or one from a later minor version.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawSection {
    /// Name; none of [`COMMON_TAGS`].
    pub tag: Tag,
    /// Purpose of the section.
    pub kind: Kind,
    /// Type of its scalars.
    pub element: ElementType,
    /// Scalars in one row; 1 for a record.
    pub components: u16,
    /// Encoding of the stored bytes.
    pub codec: Codec,
    /// Decoded bytes, whole rows, little-endian.
    pub bytes: Vec<u8>,
}

impl RawSection {
    /// A section of rows.
    pub fn from_rows<T: Element>(tag: Tag, kind: Kind, codec: Codec, rows: &[T]) -> Self {
        let bytes = bytemuck::cast_slice(rows).to_vec();
        Self { tag, kind, element: T::TYPE, components: T::COMPONENTS, codec, bytes }
    }

    /// A section of rows of `components` scalars, a width known at run time: `scalars.len()` is a multiple of it.
    pub fn from_scalars<T: Scalar>(tag: Tag, kind: Kind, codec: Codec, components: u16, scalars: &[T]) -> Self {
        let bytes = bytemuck::cast_slice(scalars).to_vec();
        Self { tag, kind, element: T::TYPE, components, codec, bytes }
    }

    /// A section with a serialised structure; see [`Writer::add_record`].
    ///
    /// # Errors
    /// [`FormatError::Record`] if `value` is too long.
    pub fn from_record<T: Serialize>(tag: Tag, kind: Kind, codec: Codec, value: &T) -> Result<Self> {
        let bytes = codec::encode(tag, value)?;
        Ok(Self { tag, kind, element: ElementType::Record, components: 1, codec, bytes })
    }

    /// The section of a file with this tag.
    ///
    /// # Errors
    /// The section is missing or damaged.
    pub fn of(reader: &Reader<'_>, tag: Tag) -> Result<Self> {
        Self::read(reader, reader.section(tag)?)
    }

    pub(crate) fn read(reader: &Reader<'_>, info: &SectionInfo) -> Result<Self> {
        let &SectionInfo { tag, kind, element, components, codec, .. } = info;
        Ok(Self { tag, kind, element, components, codec, bytes: reader.bytes(tag)?.into_owned() })
    }

    /// The section's rows.
    ///
    /// # Errors
    /// [`FormatError::WrongType`] if the section has another element type or width, [`FormatError::SectionLength`] if
    /// its bytes are not whole rows.
    pub fn rows<T: Element>(&self) -> Result<Vec<T>> {
        self.cast(T::TYPE, T::COMPONENTS)
    }

    /// The scalars of all rows, for any width: `len = rows * components`.
    ///
    /// # Errors
    /// As [`RawSection::rows`].
    pub fn scalars<T: Scalar>(&self) -> Result<Vec<T>> {
        self.cast(T::TYPE, self.components)
    }

    /// The section's structure. `T` holds no lists of zero-sized elements.
    ///
    /// # Errors
    /// [`FormatError::WrongType`] or [`FormatError::Record`].
    pub fn record<T: DeserializeOwned>(&self) -> Result<T> {
        self.expect(ElementType::Record, 1)?;
        codec::decode(self.tag, &self.bytes)
    }

    /// The rows in place; only for elements of one byte, which lie aligned anywhere.
    pub(crate) fn view<T: Element>(&self) -> Result<&[T]> {
        self.expect(T::TYPE, T::COMPONENTS)?;
        bytemuck::try_cast_slice(&self.bytes).map_err(|_| {
            let reason = format!("{} bytes are not whole rows of {}", self.bytes.len(), size_of::<T>());
            FormatError::SectionLength { tag: self.tag, reason }
        })
    }

    fn expect(&self, expected: ElementType, expected_components: u16) -> Result<()> {
        if self.element == expected && self.components == expected_components {
            return Ok(());
        }
        let (tag, found, found_components) = (self.tag, self.element, self.components);
        Err(FormatError::WrongType { tag, expected, expected_components, found, found_components })
    }

    fn cast<T: bytemuck::Pod>(&self, element: ElementType, components: u16) -> Result<Vec<T>> {
        self.expect(element, components)?;
        let (length, size) = (self.bytes.len(), size_of::<T>());
        if size == 0 || !length.is_multiple_of(size) {
            let reason = format!("{length} bytes are not whole rows of {size}");
            return Err(FormatError::SectionLength { tag: self.tag, reason });
        }
        let mut out = vec![T::zeroed(); length / size];
        bytemuck::cast_slice_mut(&mut out).copy_from_slice(&self.bytes);
        Ok(out)
    }
}

/// The sections with these tags, of this kind; `None` if none of them exists.
pub(crate) fn pick<const N: usize>(
    sections: &[RawSection],
    tags: [Tag; N],
    kind: Kind,
) -> Result<Option<[&RawSection; N]>> {
    let find = |tag: Tag| sections.iter().find(|section| section.tag == tag);
    if tags.iter().all(|tag| find(*tag).is_none()) {
        return Ok(None);
    }
    let found = tags.iter().map(|&tag| find(tag).ok_or(FormatError::MissingSection { tag }));
    let found: Vec<&RawSection> = found.collect::<Result<_>>()?;
    if let Some(section) = found.iter().find(|section| section.kind != kind) {
        let reason = format!("its kind is {}, not {kind}", section.kind);
        return Err(FormatError::Invalid { tag: section.tag, reason });
    }
    Ok(<[&RawSection; N]>::try_from(found).ok())
}

/// The content of a `.tlux` file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AssetFile {
    /// The mesh.
    pub mesh: Mesh,
    /// Parts and media.
    pub parts: Parts,
    /// Surface samples.
    pub samples: Samples,
    /// Whether samples are stored that could be made again from the mesh.
    pub samples_stored: bool,
    /// Provenance of the asset.
    pub provenance: Provenance,
    /// The error that each lossy stage added.
    pub ledger: Vec<LedgerEntry>,
    /// The method's own sections, in the order of the file.
    pub extra: Vec<RawSection>,
}

impl AssetFile {
    /// Checks every component and their consistency.
    ///
    /// # Errors
    /// [`FormatError::Invalid`] with the tag of the section at fault, or [`FormatError::DuplicateTag`].
    pub fn validate(&self) -> Result<()> {
        self.mesh.validate()?;
        self.parts.validate()?;
        self.samples.validate()?;
        self.provenance.validate()?;
        self.ledger.iter().try_for_each(LedgerEntry::validate)?;
        self.validate_together()
    }

    /// Checks the consistency of components, each of which is valid.
    fn validate_together(&self) -> Result<()> {
        self.parts.validate_against(self.mesh.triangles.len())?;
        self.samples.validate_against(&self.parts.triangle_part, self.parts.parts.len())?;
        match self.extra.iter().find(|section| COMMON_TAGS.contains(&section.tag)) {
            Some(section) => Err(FormatError::DuplicateTag { tag: section.tag }),
            None => Ok(()),
        }
    }

    /// Encodes the file; the same asset gives the same bytes.
    ///
    /// # Errors
    /// The asset is not valid, or an extra section has a bad width or a tag that is taken.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        Ok(self.writer()?.finish())
    }

    /// Writes the same bytes as [`AssetFile::to_bytes`] to a stream, without the whole file in memory.
    ///
    /// # Errors
    /// As [`AssetFile::to_bytes`] (kind `InvalidData`), and errors of `out`.
    pub fn write_to(&self, out: &mut dyn io::Write) -> io::Result<()> {
        let writer = self.writer().map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
        writer.write_to(out)
    }

    fn writer(&self) -> Result<Writer<'_>> {
        self.provenance.validate()?;
        let mut writer = Writer::new();
        writer.add_record(metadata::tags::PROVENANCE, Kind::Metadata, Codec::Zstd, &self.provenance)?;
        metadata::add_ledger(&self.ledger, &mut writer)?;
        self.mesh.encode(&mut writer)?;
        self.parts.encode(&mut writer)?;
        self.samples.validate()?;
        self.validate_together()?;
        sample_rule::encode(&self.samples, (&self.mesh, &self.parts), self.samples_stored, &mut writer)?;
        for RawSection { tag, kind, element, components, codec, bytes } in &self.extra {
            writer.add_bytes(*tag, *kind, (*element, *components), *codec, Cow::Borrowed(bytes.as_slice()))?;
        }
        Ok(writer)
    }

    /// Reads a whole file and validates it. Sections without a type in this crate are kept in `extra`.
    ///
    /// # Errors
    /// Any error of `SPEC.md`.
    pub fn from_bytes(bytes: &[u8], budget: Budget) -> Result<Self> {
        let reader = Reader::parse(bytes, budget)?;
        let extra = read_extra(&reader)?;
        let (mesh, parts) = (Mesh::decode(&reader)?, Parts::decode(&reader)?);
        parts.validate_against(mesh.triangles.len())?;
        let asset = Self {
            samples: sample_rule::decode(&reader, (&mesh, &parts), budget)?,
            samples_stored: reader.find(samples::tags::FACETS).is_some(),
            mesh,
            parts,
            provenance: metadata::provenance(&reader)?,
            ledger: metadata::ledger(&reader)?,
            extra,
        };
        asset.validate_together()?;
        Ok(asset)
    }
}
