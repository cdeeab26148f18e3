//! Memory that an opened asset takes, told by its arrays before they are decoded.

use translux_format::{Budget, coefficients, distant_transport, filtered_normals, quantised_lights};

use crate::asset::Asset;
use crate::error::Result;
use crate::scene::Scene;

/// Limits on the memory that opening an asset may take.
#[derive(Clone, Copy)]
pub struct Limits<'a> {
    /// Limit on what is decoded from the file.
    pub budget: Budget,
    /// Refuses an evaluator that takes so many bytes more than the process has.
    pub admit: &'a dyn Fn(u64) -> Result<()>,
}

impl Limits<'static> {
    /// Those of a reader that nobody has told anything: any evaluator of content up to 2 GiB.
    pub fn none() -> Self {
        Self { budget: Budget::default(), admit: &|_| Ok(()) }
    }
}

/// Bytes of a vertex beside its position: receiver, area, normal, radiosity twice.
const OF_A_VERTEX: u64 = 160;

/// Bytes of a triangle beside its corners: hierarchy of the occluders, part, material.
const OF_A_TRIANGLE: u64 = 220;

/// Bytes of a surface sample: patch, facets, tree, light.
const OF_A_SAMPLE: u64 = 260;

/// Bytes of a number of a coded matrix: decoded, predicted, and as it is evaluated.
const OF_A_CODED_NUMBER: u64 = 11;

/// Bytes that mesh, occluders and receivers take.
pub fn of_scene(scene: &Scene) -> u64 {
    scene.mesh.local_mm.len() as u64 * OF_A_VERTEX + scene.mesh.triangles.len() as u64 * OF_A_TRIANGLE
}

/// Bytes of the sections.
pub fn of_sections(asset: &Asset) -> u64 {
    asset.sections.iter().map(|section| section.bytes.len() as u64).sum()
}

/// Numbers of the coded matrices, as many as they claim.
fn coded_numbers(asset: &Asset) -> u64 {
    let sets = quantised_lights::tags::SETS
        .iter()
        .chain([&distant_transport::tags::SET, &distant_transport::tags::SINGLE_SET]);
    let mut tags: Vec<_> = sets.flat_map(|set| [set.basis, set.coefficients]).collect();
    tags.push(filtered_normals::tags::FIELDS);
    let coded = asset.sections.iter().filter(|section| tags.contains(&section.tag));
    coded
        .filter_map(|section| coefficients::shape(section.tag, &section.bytes).ok())
        .map(|(rows, columns)| (rows as u64).saturating_mul(columns as u64))
        .fold(0, u64::saturating_add)
}

/// Bytes that an evaluator takes beside its asset, where nothing else is known of its form.
pub fn of_evaluator(asset: &Asset) -> u64 {
    // What is claimed and not there may be anything.
    let stored = coded_numbers(asset).min(1 << 50) * OF_A_CODED_NUMBER + 2 * of_sections(asset);
    of_scene(&asset.scene) + asset.samples.len() as u64 * OF_A_SAMPLE + stored
}
