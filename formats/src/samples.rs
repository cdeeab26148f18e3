//! Surface samples: patches of facets, grouped by part.

use std::borrow::Cow;

use crate::checks::{Ranges, addressable, indices_below, invalid, offsets, same_length};
use crate::error::{FormatError, Result};
use crate::mesh::Mesh;
use crate::parts::Parts;
use crate::reader::Reader;
use crate::subdivision::{self, Surface};
use crate::types::{Budget, Codec, Element, Kind};
use crate::writer::Writer;

/// Tags of the samples.
pub mod tags {
    use crate::types::Tag;

    /// Facets, u32 x 2: triangle and path.
    pub const FACETS: Tag = Tag::from_static("samp.fac");
    /// Offsets of the patches into the facets, u32.
    pub const PATCH_OFFSETS: Tag = Tag::from_static("samp.off");
    /// Offsets of the parts into the patches, u32.
    pub const PART_OFFSETS: Tag = Tag::from_static("samp.prt");
    /// In the place of facets and offsets of patches: the order of patches that the rule makes, and a checksum, u32 x 2.
    pub const RULE: Tag = Tag::from_static("samp.rul");
}

/// Samples and triangles together, up to which samples that follow the rule are made again instead of read: within a second.
pub const MOST_MADE: usize = 1 << 20;

/// Bytes that a sample and a triangle take while samples are made, at most.
const BYTES_MADE: u64 = 128;

/// The order of the patches of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    /// As they were cut.
    Subdivision,
    /// That of a balanced tree.
    Tree,
}

impl Order {
    const ALL: [Self; 2] = [Self::Subdivision, Self::Tree];

    fn code(self) -> u32 {
        match self {
            Self::Subdivision => 0,
            Self::Tree => 1,
        }
    }
}

/// Path of a facet that is its whole triangle.
pub const WHOLE_TRIANGLE: u32 = 1;

/// The surface samples. A facet is a triangle or a piece of one; a patch is a range of facets; a part has a range of
/// patches.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Samples {
    /// `[triangle, path]`. The bits of `path` after its leading one select, from the most significant down, the halves
    /// of a longest-edge bisection (`SPEC.md` names the halves); 1 is the whole triangle, 0 is no path.
    pub facets: Vec<[u32; 2]>,
    /// Patch `i` is `facets[patch_offsets[i]..patch_offsets[i + 1]]`, never empty; `len = patches + 1`.
    pub patch_offsets: Vec<u32>,
    /// Part `p` has the patches `part_offsets[p]..part_offsets[p + 1]`; `len = parts + 1`.
    pub part_offsets: Vec<u32>,
}

impl Samples {
    /// Samples without patches for this many parts.
    pub fn none(parts: usize) -> Self {
        Self { facets: Vec::new(), patch_offsets: vec![0], part_offsets: vec![0; parts + 1] }
    }

    /// Number of patches.
    pub fn patch_count(&self) -> usize {
        self.patch_offsets.len().saturating_sub(1)
    }

    /// Checks everything that [`Samples::decode`] guarantees: valid paths, offsets that start at 0, ascend and end at
    /// the end.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        addressable(tags::FACETS, self.facets.len())?;
        if let Some(i) = self.facets.iter().position(|[_, path]| *path == 0) {
            return invalid(tags::FACETS, format!("facet {i} has path 0"));
        }
        offsets(tags::PATCH_OFFSETS, &self.patch_offsets, self.facets.len(), Ranges::NonEmpty)?;
        offsets(tags::PART_OFFSETS, &self.part_offsets, self.patch_count(), Ranges::MayBeEmpty)
    }

    /// Checks valid samples against valid parts: every facet lies on a triangle of its patch's part.
    pub(crate) fn validate_against(&self, triangle_part: &[u32], parts: usize) -> Result<()> {
        indices_below(tags::FACETS, self.facets.iter().map(|[triangle, _]| *triangle), triangle_part.len())?;
        same_length(tags::PART_OFFSETS, "parts and their end", self.part_offsets.len(), parts + 1)?;
        for (part, range) in self.part_offsets.windows(2).enumerate() {
            // Offsets of patches, and through them of facets; both ascend and end at the end.
            let first = self.patch_offsets[range[0] as usize] as usize;
            let end = self.patch_offsets[range[1] as usize] as usize;
            let stray = |facet: &[u32; 2]| triangle_part[facet[0] as usize] as usize != part;
            if let Some(i) = self.facets[first..end].iter().position(stray) {
                return invalid(
                    tags::FACETS,
                    format!("facet {} is not on part {part}, which has its patch", first + i),
                );
            }
        }
        Ok(())
    }

    /// Adds the sections of valid samples.
    ///
    /// # Errors
    /// The samples are not valid, or the writer already has one of their sections.
    pub fn encode<'a>(&'a self, writer: &mut Writer<'a>) -> Result<()> {
        self.validate()?;
        writer
            .add(tags::FACETS, Kind::Samples, Codec::Zstd, &self.facets)?
            .add(tags::PATCH_OFFSETS, Kind::Samples, Codec::Zstd, &self.patch_offsets)?
            .add(tags::PART_OFFSETS, Kind::Samples, Codec::Zstd, &self.part_offsets)?;
        Ok(())
    }

    /// Adds what samples are made from again, where they follow the rule on a valid mesh with valid parts; else, or where they are to be
    /// `stored`, the samples.
    ///
    /// # Errors
    /// As [`Samples::encode`].
    pub(crate) fn encode_for<'a>(
        &'a self,
        (mesh, parts): (&Mesh, &Parts),
        stored: bool,
        writer: &mut Writer<'a>,
    ) -> Result<()> {
        let rule = if stored { None } else { self.rule(mesh, parts) };
        let Some(order) = rule else { return self.encode(writer) };
        let bytes = [order.code(), self.checksum()].iter().flat_map(|x| x.to_le_bytes()).collect();
        let element = (<[u32; 2]>::TYPE, <[u32; 2]>::COMPONENTS);
        writer
            .add_bytes(tags::RULE, Kind::Samples, element, Codec::Raw, Cow::Owned(bytes))?
            .add(tags::PART_OFFSETS, Kind::Samples, Codec::Raw, &self.part_offsets)?;
        Ok(())
    }

    /// The order in which the rule makes these samples, if it does.
    fn rule(&self, mesh: &Mesh, parts: &Parts) -> Option<Order> {
        let count = self.patch_count();
        if count == 0 || count + mesh.triangles.len() > MOST_MADE {
            return None;
        }
        let (surface, transfers) = (Surface::new(mesh, parts), transfers(parts));
        let made = subdivision::subdivide(&surface, &transfers, count);
        if made == *self {
            return Some(Order::Subdivision);
        }
        let same_parts = made.part_offsets == self.part_offsets;
        (same_parts && subdivision::in_tree_order(&surface, &made) == *self).then_some(Order::Tree)
    }

    /// CRC-32 of facets, offsets of patches and offsets of parts, as they would be stored.
    fn checksum(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(bytemuck::cast_slice(&self.facets));
        hasher.update(bytemuck::cast_slice(&self.patch_offsets));
        hasher.update(bytemuck::cast_slice(&self.part_offsets));
        hasher.finalize()
    }

    /// Makes the samples again that a file names by the rule.
    fn decode_rule(reader: &Reader<'_>, (mesh, parts): (&Mesh, &Parts), budget: Budget) -> Result<Self> {
        let rule: Vec<[u32; 2]> = reader.array_of(tags::RULE, Kind::Samples)?;
        let part_offsets: Vec<u32> = reader.array_of(tags::PART_OFFSETS, Kind::Samples)?;
        let tag = tags::RULE;
        let [[code, checksum]] = rule[..] else { return invalid(tag, format!("{} rows where there is one", rule.len())) };
        let Some(order) = Order::ALL.into_iter().find(|order| order.code() == code) else {
            return invalid(tag, format!("order {code} is none"));
        };
        let count = part_offsets.last().copied().unwrap_or_default() as usize;
        let size = count.saturating_add(mesh.triangles.len());
        if count == 0 || size > MOST_MADE {
            return invalid(tag, format!("{count} samples of {} triangles are not made", mesh.triangles.len()));
        }
        let (needed, most) = (size as u64 * BYTES_MADE, budget.max_decoded_bytes);
        if needed > most {
            return Err(FormatError::OverBudget { tag, needed, budget: most });
        }
        let surface = Surface::new(mesh, parts);
        let mut samples = subdivision::subdivide(&surface, &transfers(parts), count);
        if order == Order::Tree {
            samples = subdivision::in_tree_order(&surface, &samples);
        }
        let found = samples.checksum();
        if found != checksum || samples.part_offsets != part_offsets {
            let reason = format!("the samples that it makes have checksum {found:08x}, where it says {checksum:08x}");
            return invalid(tag, reason);
        }
        Ok(samples)
    }

    /// Reads the samples and validates them, or makes them again on a valid mesh with valid parts.
    ///
    /// # Errors
    /// A section is missing, damaged, of another type, or its content is not valid; samples that would take more than the budget.
    pub fn decode(reader: &Reader<'_>, mesh: &Mesh, parts: &Parts, budget: Budget) -> Result<Self> {
        if reader.find(tags::RULE).is_some() {
            let beside = [tags::FACETS, tags::PATCH_OFFSETS].into_iter().find(|tag| reader.find(*tag).is_some());
            return match beside {
                Some(tag) => invalid(tag, format!("samples are stored, and there is `{}`", tags::RULE)),
                None => Self::decode_rule(reader, (mesh, parts), budget),
            };
        }
        let samples = Self {
            facets: reader.array_of(tags::FACETS, Kind::Samples)?,
            patch_offsets: reader.array_of(tags::PATCH_OFFSETS, Kind::Samples)?,
            part_offsets: reader.array_of(tags::PART_OFFSETS, Kind::Samples)?,
        };
        samples.validate()?;
        Ok(samples)
    }
}

/// Which parts have samples.
fn transfers(parts: &Parts) -> Vec<bool> {
    parts.parts.iter().map(|part| !part.opaque).collect()
}
