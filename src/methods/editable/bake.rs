//! What `editable` precomputes: samples in tree order, a basis of far profiles, and the transport of each basis function.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::{FarField, Group};

use super::choice::{self, Choice, Tuning};
use super::environment;
use super::interpolation::choose_points;
use super::ledger::{self, Baked};
use super::plan::{Plan, Transport};
use super::points::{FarPoints, RowPlaces};
use super::sources::{Merged, Sources};
use super::{sections, unstored};
use crate::compress::blocks;
use crate::error::{Error, Result};
use crate::evaluate::{AssetParts, BakeSettings};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{Patch, Samples};
use crate::light::{Light, LightKind};
use crate::medium::profile_basis::{BasisSettings, ProfileBasis};
use crate::methods::sampling::{self, Density};
use crate::progress::{Progress, Silent};
use crate::transport::balanced_tree::{BalancedTree, LightDetails, in_tree_order};
use crate::transport::expected_light::expected_details;
use crate::transport::far_field::{FarTransport, LANES, Precision, Rows, TERMS};
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::near_field::Corners;
use crate::transport::receivers::Receivers;
use crate::transport::scene::{self, Scene, Surface};

/// Shadow boundaries stay well inside the kernel.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 17, most: 1 << 18 };

/// The error that the density is made for; a smaller one asks for more samples.
const DENSITY_RMS: f64 = 0.01;

/// Bytes that a receiver's coefficients take while they are made, before quantisation, at an error of 1 %; about in
/// proportion to its inverse.
const BYTES_PER_RECEIVER: f64 = 24_000.0;

/// Bytes of a sample's irradiance row for each coefficient, with a copy while it is written. Blocks keep a fifth of the coefficients
/// or less where samples see much the same, but no surface has to be like that.
const BYTES_PER_ROW_COEFFICIENT: u64 = 10;

fn count(scene: &Scene, settings: &BakeSettings) -> usize {
    DENSITY.count(scene, settings, (DENSITY_RMS / settings.max_rms).sqrt())
}

pub(super) fn memory(scene: &Scene, settings: &BakeSettings) -> u64 {
    let count = count(scene, settings);
    let coefficients =
        settings.values.get(super::COEFFICIENTS.name).and_then(|text| text.parse().ok()).unwrap_or(128u64);
    let stored = settings.for_lights.contains(&LightKind::Environment);
    let rows = if stored { count as u64 * coefficients * BYTES_PER_ROW_COEFFICIENT } else { 0 };
    if matches!(Transport::of(&settings.values), Ok(Transport::None)) {
        return sampling::memory(count, scene) + unstored::memory(count, scene) + rows;
    }
    let far = scene.mesh.local_mm.len() as f64 * BYTES_PER_RECEIVER * (0.01 / settings.max_rms).clamp(0.3, 30.0);
    sampling::memory(count, scene) + far as u64 + rows
}

/// Side of a square of the samples' mean area.
pub(super) fn spacing_mm(patches: &[Patch]) -> f64 {
    let area: f64 = patches.iter().map(|p| p.area_mm2).sum();
    (area / patches.len().max(1) as f64).sqrt()
}

/// Geometry that every stage reads.
pub(super) struct Stage {
    pub(super) bvh: Bvh,
    pub(super) samples: Samples,
    pub(super) patches: Vec<Patch>,
    pub(super) tree: BalancedTree,
    pub(super) corners: Corners,
    pub(super) receivers: Receivers,
    /// Of the far field; every receiver until they are chosen.
    pub(super) points: FarPoints,
    pub(super) split_mm: f64,
    pub(super) merged: Merged,
}

impl Stage {
    fn new(scene: &Scene, count: usize, plan: &Plan) -> Self {
        let unordered = Samples::new(&scene.mesh, &scene.parts, count);
        let samples = in_tree_order(&unordered, &scene::patches(scene, &unordered));
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || scene::patches(scene, &samples));
        let tree = BalancedTree::new(&samples, &patches);
        let corners = Corners::new(&scene.mesh, &samples, &patches);
        let receivers = Receivers::new(&scene.mesh, &scene.parts, LANES);
        let points = FarPoints::choose(&receivers, 0.0, &[]);
        let split_mm = (plan.split * spacing_mm(&patches)).max(f64::MIN_POSITIVE);
        let merged = Merged::new(&samples, &patches);
        Self { bvh, samples, patches, tree, corners, receivers, points, split_mm, merged }
    }

    pub(super) fn surface<'a>(&'a self, scene: &'a Scene) -> Surface<'a> {
        Surface { scene, bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Every sample.
    pub(super) fn sources(&self) -> Sources<'_> {
        (&self.patches, &self.samples.part_offsets)
    }

    /// Irradiance of every sample under one light, and of the pieces of those that are not lit evenly.
    pub(super) fn irradiance(
        &self,
        scene: &Scene,
        light: &Light,
        sampling: LightSampling,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let surface = self.surface(scene);
        let lights = std::slice::from_ref(light);
        Ok(Illumination::new(&surface, lights, &etas, sampling)?.all_with_pieces(&Silent))
    }

    /// Largest distance between two points of one part, mm, or a little more.
    fn reach_mm(&self, scene: &Scene) -> f64 {
        let extent =
            |part: usize| self.tree.root(part).map_or(0.0, |root| 2.0 * self.tree.cell(root, &self.patches).radius_mm);
        let reach = (0..scene.parts.parts.len()).map(extent).fold(0.0, f64::max);
        reach.clamp(self.split_mm * 2.0, scene.mesh.diagonal_mm().max(self.split_mm * 2.0))
    }
}

pub(super) fn bake(scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
    let plan = Plan::new(&settings.values, settings.max_rms)?;
    progress.start("samples", 0);
    let mut stage = Stage::new(scene, count(scene, settings), &plan);
    progress.finish();
    if plan.transport == Transport::None {
        return unstored::bake((scene, stage), (settings, &plan), progress);
    }

    progress.start("basis", 0);
    let basis = basis(&stage, scene, &plan);
    let (table, spread) = (basis.table(), basis.spread());
    progress.finish();

    let (expected, tuning) = expected_light(scene, &stage, &settings.probes.tuning, plan.sampling, progress)?;
    progress.start("points", 0);
    stage.points = choose_points(scene, &stage, &plan, (&basis, &table), &tuning);
    progress.finish();
    // Inside the split radius the functions change as at its edge; what is as well known from points twice as far apart changes half as fast.
    let smooth = |level: &u8| 0.5 * stage.split_mm * f64::from(1u32 << level);
    let smooth_mm: Vec<f64> = stage.points.levels.iter().map(smooth).collect();
    let transport = FarTransport {
        tree: &stage.tree,
        patches: &stage.patches,
        table: &table,
        spread: &spread,
        expected: &expected,
        smooth_mm: &smooth_mm,
        precision: Precision { opening: plan.opening, threshold: 0.0, keep: 0.0 },
    };
    progress.start("threshold", 0);
    let choice = Choice::new(scene, &stage, &plan, (&basis, &transport), &tuning);
    progress.finish();
    let precision = Precision { opening: plan.opening, threshold: choice.threshold, keep: choice.threshold };
    let transport = FarTransport { precision, ..transport };
    let far = far_field(&transport, &stage.points, &choice, progress);

    let mut sections = sections::write(&basis, &far, &scene.mesh, &stage.samples)?;
    let mut ledger = ledger::measure(&Baked {
        scene,
        stage: &stage,
        plan: &plan,
        basis: &basis,
        transport: &transport,
        far: &far,
        unseen: &settings.probes.unseen,
        progress,
    })?;
    if settings.for_lights.contains(&LightKind::Environment) {
        let rows = environment::rows(&stage.surface(scene), &plan, progress)?;
        environment::measure(scene, &stage, &plan, &settings.probes.unseen, &mut ledger, progress)?;
        let fail = |e: translux_format::FormatError| Error::runtime(format!("asset: {e}"));
        sections.extend(rows.into_data().to_sections().map_err(fail)?);
    }
    Ok(AssetParts { samples: stage.samples, ledger, sections })
}

/// As few functions as the asked error allows, as many as a row of the far field holds.
fn basis(stage: &Stage, scene: &Scene, plan: &Plan) -> ProfileBasis {
    let settings = BasisSettings {
        split_mm: stage.split_mm,
        reach_mm: stage.reach_mm(scene),
        family: plan.family,
        terms: plan.terms,
        error: plan.basis_error,
    };
    let basis = ProfileBasis::new(&settings);
    if basis.terms() <= TERMS {
        return basis;
    }
    ProfileBasis::new(&BasisSettings { terms: Some(TERMS), ..settings })
}

/// What typical lights do at each node, and some of these lights for choices.
fn expected_light(
    scene: &Scene,
    stage: &Stage,
    lights: &[Light],
    sampling: LightSampling,
    progress: &dyn Progress,
) -> Result<(Vec<f32>, Vec<Tuning>)> {
    progress.start("typical light", lights.len() as u64);
    let chosen: Vec<usize> = choice::tuning_lights(lights).collect();
    let (mut details, mut tuning) = (Vec::with_capacity(lights.len()), Vec::with_capacity(chosen.len()));
    for (index, light) in lights.iter().enumerate() {
        let (irradiance, _) = stage.irradiance(scene, light, sampling)?;
        let found = LightDetails::new(&stage.samples, &stage.patches, &irradiance);
        if chosen.contains(&index) {
            tuning.push(Tuning { irradiance, details: found.clone() });
        }
        details.push(found);
        progress.advance(1);
    }
    progress.finish();
    let parts = scene.parts.parts.len();
    Ok((expected_details(&stage.tree, parts, stage.samples.len(), &details), tuning))
}

/// Rows of the groups `first..end`: independent of how the groups are cut into ranges.
fn rows(transport: &FarTransport, stored: &RowPlaces, range: std::ops::Range<usize>) -> Vec<Rows> {
    let of_group = |(group, functions): (&crate::transport::receivers::Group, &u16)| {
        transport.rows(&stored.places.positions[group.run.range()], group.part as usize, *functions)
    };
    stored.places.groups[range.clone()].par_iter().zip(&stored.functions[range]).map(of_group).collect()
}

fn far_field(transport: &FarTransport, points: &FarPoints, choice: &Choice, progress: &dyn Progress) -> FarField {
    const CHUNK: usize = 64;
    let groups = points.rows.places.groups.len();
    progress.start("transport", groups as u64);
    let mut all = Vec::with_capacity(groups);
    for first in (0..groups).step_by(CHUNK) {
        let range = first..groups.min(first + CHUNK);
        progress.advance(range.len() as u64);
        all.extend(rows(transport, &points.rows, range));
    }
    progress.finish();
    let terms = transport.spread.len();
    let mut largest = vec![0.0f64; terms];
    for (rows, group) in all.iter_mut().zip(&points.rows.places.groups) {
        for row in &mut rows.values {
            *row = blocks::transformed(row, group.run.range().len());
        }
    }
    for_each_value(&all, |k, row| {
        largest[k] = row.iter().fold(largest[k], |a, v| a.max(f64::from(v.abs())));
    });
    let steps: Vec<f32> = choice.steps.iter().zip(&largest).map(|(&s, &l)| blocks::fitting_step(s, l)).collect();
    let mut far = FarField {
        terms,
        receiver_of_vertex: points.receivers.of_vertex.clone(),
        others: points.rows.others.clone(),
        ..FarField::default()
    };
    for ((rows, group), &functions) in all.iter().zip(&points.rows.places.groups).zip(&points.rows.functions) {
        quantise(rows, &steps, &mut far);
        far.row_sums.extend_from_slice(&rows.sums);
        let coefficients_end = far.nodes.len() as u32;
        far.groups.push(Group { part: group.part, rows_end: group.run.end, coefficients_end, functions });
    }
    far.steps = steps;
    far
}

/// Adds the rows of a group. What is rounded to nothing is not kept.
fn quantise(rows: &Rows, steps: &[f32], far: &mut FarField) {
    let mut values = rows.values.iter();
    for (&node, &mask) in rows.nodes.iter().zip(&rows.masks) {
        let (mut kept, mut wide) = (0, 0);
        for k in (0..u16::BITS as usize).filter(|k| mask >> k & 1 == 1) {
            let Some(row) = values.next() else { break };
            let row = blocks::quantise(row, steps[k]);
            if row.iter().all(|&q| q == 0) {
                continue;
            }
            kept |= 1 << k;
            match row.map(|q| q as i8) {
                narrow if narrow.map(i16::from) == row => far.narrow.push(narrow),
                _ => {
                    wide |= 1 << k;
                    far.wide.push(row);
                }
            }
        }
        if kept != 0 {
            far.nodes.push(node);
            far.masks.push(kept);
            far.wide_masks.push(wide);
        }
    }
}

/// Visits the values of every kept coefficient with its basis function, in the order of the file.
fn for_each_value(all: &[Rows], mut visit: impl FnMut(usize, &[f32; LANES])) {
    for rows in all {
        let mut values = rows.values.iter();
        for &mask in &rows.masks {
            for k in (0..u16::BITS as usize).filter(|k| mask >> k & 1 == 1) {
                if let Some(row) = values.next() {
                    visit(k, row);
                }
            }
        }
    }
}
