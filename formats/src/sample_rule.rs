//! Samples in a file: stored, or named by the rule of [`subdivision`] where they follow it.

use std::borrow::Cow;

use crate::checks::invalid;
use crate::error::{FormatError, Result};
use crate::mesh::Mesh;
use crate::parts::Parts;
use crate::reader::Reader;
use crate::samples::{Samples, tags};
use crate::subdivision::{self, Surface};
use crate::types::{Budget, Codec, Element, Kind};
use crate::writer::Writer;

/// Samples and triangles together, up to which samples that follow the rule are made again instead of read: within a second.
pub const MOST_MADE: usize = 3 << 18;

/// Bytes that a sample or a triangle takes while samples are made, at most.
const BYTES_MADE: u64 = 320;

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

    /// The order in which the rule makes some samples, if it does.
    fn of(samples: &Samples, mesh: &Mesh, parts: &Parts) -> Option<Self> {
        let count = samples.patch_count();
        if count == 0 || count + mesh.triangles.len() > MOST_MADE {
            return None;
        }
        let surface = Surface::new(mesh, parts);
        let made = subdivision::subdivide(&surface, &transfers(parts), count);
        if made == *samples {
            return Some(Self::Subdivision);
        }
        let same_parts = made.part_offsets == samples.part_offsets;
        (same_parts && subdivision::in_tree_order(&surface, &made) == *samples).then_some(Self::Tree)
    }
}

/// Which parts have samples.
fn transfers(parts: &Parts) -> Vec<bool> {
    parts.parts.iter().map(|part| !part.opaque).collect()
}

/// CRC-32 of facets, offsets of patches and offsets of parts, as they would be stored.
fn checksum(samples: &Samples) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(bytemuck::cast_slice(&samples.facets));
    hasher.update(bytemuck::cast_slice(&samples.patch_offsets));
    hasher.update(bytemuck::cast_slice(&samples.part_offsets));
    hasher.finalize()
}

/// Adds what valid samples are made from again, where they follow the rule on a valid mesh with valid parts; else, or where they are to be
/// `stored`, the samples.
///
/// # Errors
/// As [`Samples::encode`].
pub(crate) fn encode<'a>(
    samples: &'a Samples,
    (mesh, parts): (&Mesh, &Parts),
    stored: bool,
    writer: &mut Writer<'a>,
) -> Result<()> {
    let rule = if stored { None } else { Order::of(samples, mesh, parts) };
    let Some(order) = rule else { return samples.encode(writer) };
    let bytes = [order.code(), checksum(samples)].iter().flat_map(|x| x.to_le_bytes()).collect();
    let element = (<[u32; 2]>::TYPE, <[u32; 2]>::COMPONENTS);
    writer.add_bytes(tags::RULE, Kind::Samples, element, Codec::Raw, Cow::Owned(bytes))?;
    writer.add(tags::PART_OFFSETS, Kind::Samples, Codec::Raw, &samples.part_offsets)?;
    Ok(())
}

/// Reads samples and validates them, or makes them again on a valid mesh with valid parts.
///
/// # Errors
/// A section is missing, damaged, of another type, or its content is not valid; samples that would take more than the budget to make.
pub fn decode(reader: &Reader<'_>, (mesh, parts): (&Mesh, &Parts), budget: Budget) -> Result<Samples> {
    if reader.find(tags::RULE).is_none() {
        return Samples::decode(reader);
    }
    match [tags::FACETS, tags::PATCH_OFFSETS].into_iter().find(|tag| reader.find(*tag).is_some()) {
        Some(tag) => invalid(tag, format!("samples are stored, and there is `{}`", tags::RULE)),
        None => made(reader, (mesh, parts), budget),
    }
}

/// Makes the samples again that a file names.
fn made(reader: &Reader<'_>, (mesh, parts): (&Mesh, &Parts), budget: Budget) -> Result<Samples> {
    let tag = tags::RULE;
    let rule: Vec<[u32; 2]> = reader.array_of(tag, Kind::Samples)?;
    let part_offsets: Vec<u32> = reader.array_of(tags::PART_OFFSETS, Kind::Samples)?;
    let [[code, stated]] = rule[..] else {
        return invalid(tag, format!("{} rows where there is one", rule.len()));
    };
    let Some(order) = Order::ALL.into_iter().find(|order| order.code() == code) else {
        return invalid(tag, format!("order {code} is none"));
    };
    let count = part_offsets.last().copied().unwrap_or_default() as usize;
    let size = count.saturating_add(mesh.triangles.len());
    if count == 0 || size > MOST_MADE {
        return invalid(tag, format!("{count} samples of {} triangles are not made", mesh.triangles.len()));
    }
    let (needed, budget) = (size as u64 * BYTES_MADE, budget.max_decoded_bytes);
    if needed > budget {
        return Err(FormatError::OverBudget { tag, needed, budget });
    }
    let surface = Surface::new(mesh, parts);
    let mut samples = subdivision::subdivide(&surface, &transfers(parts), count);
    if order == Order::Tree {
        samples = subdivision::in_tree_order(&surface, &samples);
    }
    let found = checksum(&samples);
    if found != stated || samples.part_offsets != part_offsets {
        let reason = format!("the samples that it makes have checksum {found:08x}, where it says {stated:08x}");
        return invalid(tag, reason);
    }
    Ok(samples)
}
