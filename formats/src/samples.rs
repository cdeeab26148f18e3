//! Surface samples: patches of facets, grouped by part.

use crate::checks::{Ranges, addressable, indices_below, invalid, offsets, same_length};
use crate::error::Result;
use crate::reader::Reader;
use crate::types::{Codec, Kind};
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

    /// Checks everything that reading guarantees: valid paths, offsets that start at 0, ascend and end at
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

    /// Reads stored samples and validates them.
    ///
    /// # Errors
    /// A section is missing, damaged, of another type, or its content is not valid.
    pub(crate) fn decode(reader: &Reader<'_>) -> Result<Self> {
        let samples = Self {
            facets: reader.array_of(tags::FACETS, Kind::Samples)?,
            patch_offsets: reader.array_of(tags::PATCH_OFFSETS, Kind::Samples)?,
            part_offsets: reader.array_of(tags::PART_OFFSETS, Kind::Samples)?,
        };
        samples.validate()?;
        Ok(samples)
    }
}
