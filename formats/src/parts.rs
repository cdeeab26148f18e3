//! Parts of the mesh and the media that fill them.

use serde::{Deserialize, Serialize};

use crate::checks::{in_range, indices_below, invalid, same_length, text};
use crate::error::Result;
use crate::reader::Reader;
use crate::types::{Codec, Kind};
use crate::writer::Writer;

/// Tags of the parts.
pub mod tags {
    use crate::types::Tag;

    /// Part of each triangle, u32.
    pub const TRIANGLE_PART: Tag = Tag::from_static("part.tri");
    /// The parts, a record.
    pub const PARTS: Tag = Tag::from_static("part.rec");
    /// The media, a record.
    pub const MEDIA: Tag = Tag::from_static("part.med");
}

/// Part index of a triangle that belongs to no part.
pub const NO_PART: u32 = u32::MAX;
/// Medium index of an opaque part without one.
pub const NO_MEDIUM: u32 = u32::MAX;

/// A part: triangles that light travels between inside one medium, or an opaque object that only casts shadows.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartRecord {
    /// Name for people.
    pub name: String,
    /// Whether the part only casts shadows.
    pub opaque: bool,
    /// Index into [`Parts::media`]; an opaque part may have [`NO_MEDIUM`].
    pub medium: u32,
}

/// Optical properties of a medium, per channel in linear sRGB.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MediumRecord {
    /// Name for people.
    pub name: String,
    /// Reduced scattering coefficient sigma_s' = sigma_s (1 - g), in 1/mm, at least 0.
    pub sigma_s_reduced_per_mm: [f64; 3],
    /// Absorption coefficient, in 1/mm, at least 0.
    pub sigma_a_per_mm: [f64; 3],
    /// Mean cosine of the phase function, in (-1, 1), positive forward.
    pub g: f64,
    /// Refractive index inside over outside, above 0.
    pub eta_inside_over_outside: f64,
}

/// The part of each triangle, the parts, and their media.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parts {
    /// Index into `parts`, or [`NO_PART`], for each triangle.
    pub triangle_part: Vec<u32>,
    /// The parts.
    pub parts: Vec<PartRecord>,
    /// The media.
    pub media: Vec<MediumRecord>,
}

impl Parts {
    /// Checks everything that [`Parts::decode`] guarantees: indices and optical properties in range.
    ///
    /// # Errors
    /// [`crate::FormatError::Invalid`] with the tag of the section at fault.
    pub fn validate(&self) -> Result<()> {
        let parts_of_triangles = self.triangle_part.iter().copied().map(|part| if part == NO_PART { 0 } else { part });
        if !self.parts.is_empty() {
            indices_below(tags::TRIANGLE_PART, parts_of_triangles, self.parts.len())?;
        } else if let Some(i) = self.triangle_part.iter().position(|&part| part != NO_PART) {
            return invalid(tags::TRIANGLE_PART, format!("triangle {i} has a part, and there are no parts"));
        }
        for (i, part) in self.parts.iter().enumerate() {
            text(tags::PARTS, "the name of a part", &part.name)?;
            let none = part.opaque && part.medium == NO_MEDIUM;
            if !none && part.medium as usize >= self.media.len() {
                let (medium, media) = (part.medium, self.media.len());
                return invalid(tags::PARTS, format!("part {i}: medium {medium} is not below {media}"));
            }
        }
        self.media.iter().try_for_each(MediumRecord::validate)
    }

    /// Checks that the arrays fit a mesh with this many triangles.
    pub(crate) fn validate_against(&self, triangles: usize) -> Result<()> {
        same_length(tags::TRIANGLE_PART, "triangles", self.triangle_part.len(), triangles)
    }

    /// Adds the sections of valid parts.
    ///
    /// # Errors
    /// The parts are not valid, or the writer already has one of their sections.
    pub fn encode<'a>(&'a self, writer: &mut Writer<'a>) -> Result<()> {
        self.validate()?;
        writer
            .add(tags::TRIANGLE_PART, Kind::Metadata, Codec::Zstd, &self.triangle_part)?
            .add_record(tags::PARTS, Kind::Metadata, Codec::Zstd, &self.parts)?
            .add_record(tags::MEDIA, Kind::Metadata, Codec::Zstd, &self.media)?;
        Ok(())
    }

    /// Reads the parts and validates them.
    ///
    /// # Errors
    /// A section is missing, damaged, of another type, or its content is not valid.
    pub fn decode(reader: &Reader<'_>) -> Result<Self> {
        let parts = Self {
            triangle_part: reader.array_of(tags::TRIANGLE_PART, Kind::Metadata)?,
            parts: reader.record_of(tags::PARTS, Kind::Metadata)?,
            media: reader.record_of(tags::MEDIA, Kind::Metadata)?,
        };
        parts.validate()?;
        Ok(parts)
    }
}

impl MediumRecord {
    fn validate(&self) -> Result<()> {
        let tag = tags::MEDIA;
        text(tag, "the name of a medium", &self.name)?;
        in_range(tag, "sigma_s'", &self.sigma_s_reduced_per_mm, 0.0)?;
        in_range(tag, "sigma_a", &self.sigma_a_per_mm, 0.0)?;
        if !(self.g > -1.0 && self.g < 1.0) {
            return invalid(tag, format!("g is {}: it must lie between -1 and 1", self.g));
        }
        if !(self.eta_inside_over_outside > 0.0 && self.eta_inside_over_outside.is_finite()) {
            return invalid(tag, format!("eta is {}: it must be finite and above 0", self.eta_inside_over_outside));
        }
        Ok(())
    }
}
