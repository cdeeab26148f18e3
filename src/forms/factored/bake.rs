//! Bake of `factored`: samples in tree order, a basis of far profiles, and the transport of each basis function.

use std::ops::Range;
use std::sync::Arc;

use translux_format::far_field::{FarField, Group, Shape};
use translux_format::{RawSection, Tag, profile_basis as file};

use super::choice::{self, Choice, Tuning};
use super::evaluate::open;
use super::forecast::forecast;
use super::interpolation::choose_points;
use super::ledger::{self, Baked};
use super::ordered_samples::{OrderedSamples, Work};
use super::points::{FarPoints, RowPlaces};
use super::settings::{Factored, MOST_LEVELS};
use crate::asset::Asset;
use crate::compress::blocks;
use crate::error::{Error, Result};
use crate::evaluate::blocks::Blocks;
use crate::evaluate::form::write_error;
use crate::evaluate::stage_cache::Key;
use crate::evaluate::{AssetParts, BakeSettings, Capabilities, Evaluator, Forecast, Form, MaterialEdit, ProfileEdit};
use crate::forms::density;
use crate::forms::environment_rows::{self, EnvironmentRows};
use crate::forms::sample_count::{UNLIKE_MATERIALS, samples_for};
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::Samples;
use crate::light::{Light, LightKind};
use crate::medium::profile_basis::{BasisSettings, ProfileBasis};
use crate::parallel::*;
use crate::progress::{Progress, stage};
use crate::scene::Scene;
use crate::transport::balanced_tree::{LightDetails, expected_details};
use crate::transport::far_field::{FarTransport, LANES, Precision, Rows, TERMS};
use crate::transport::irradiance::LightSampling;

/// Bytes that a receiver's coefficients take while they are made, before quantisation, at an error of 1 %; about in
/// proportion to its inverse.
const BYTES_PER_RECEIVER: f64 = 32_000.0;

/// Samples that each row of the threshold's choice knows one by one, where nothing is dropped yet: all of a body that is a few free paths thick, and
/// of more samples the tree opens a share.
const OPENED: usize = 1 << 15;

/// Functions of a basis, where nobody says how many.
const USUAL_TERMS: usize = 8;

impl Form for Factored {
    const NAME: &'static str = "factored";

    fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.sampling.validate()?;
        self.near.validate()?;
        self.environment.iter().try_for_each(EnvironmentRows::validate)?;
        let shares = [self.basis_error, self.interpolation, self.levels_error, self.truncation, self.quantiser];
        if let Some(share) = shares.into_iter().find(|share| !(*share > 0.0 && *share <= 1.0)) {
            return Err(Error::input(format!("an asked error of {share}, not above 0 and at most 1")));
        }
        let spacings = self.far_spacing.into_iter().chain([self.widest_far_spacing]);
        let fits = self.terms.is_none_or(|terms| (1..=TERMS).contains(&terms))
            && (1..=MOST_LEVELS).contains(&self.levels)
            && (4.0..=64.0).contains(&self.split)
            && (1e-3..=1.0).contains(&self.opening)
            && spacings.into_iter().all(|spacing| (0.0..=8.0).contains(&spacing));
        if !fits {
            return Err(Error::input(format!("settings of the far field out of range: {self:?}")));
        }
        Ok(())
    }

    fn divides(&self) -> bool {
        true
    }

    fn edits(&self, has: &dyn Fn(Tag) -> bool) -> Option<Capabilities> {
        let source_fields = environment_rows::source_fields(has);
        Some(Capabilities { material: MaterialEdit::Any, profile: ProfileEdit::None, source_fields })
    }

    fn bake_memory(&self, scene: &Scene, settings: &BakeSettings) -> u64 {
        let count = self.density.count(scene, settings.samples);
        let rows = self.environment.filter(|_| settings.is_for(LightKind::Environment)).map_or(0, |e| e.memory(count));
        let far = scene.mesh.local_mm.len() as f64 * BYTES_PER_RECEIVER * (0.01 / settings.max_rms).clamp(0.3, 30.0);
        let of_choice =
            count.min(OPENED) * self.terms.unwrap_or(USUAL_TERMS) * choice::GROUPS * LANES * size_of::<f32>();
        density::memory(count, scene, settings.model) + far as u64 + of_choice as u64 + rows
    }

    fn forecast(&self, scene: &Scene, settings: &BakeSettings) -> Option<Forecast> {
        Some(forecast(self, scene, settings))
    }

    fn bake(&self, scene: &Scene, settings: &BakeSettings, progress: &dyn Progress) -> Result<AssetParts> {
        progress.start("samples", 0);
        let count = samples_for(scene, (self.density, self.sampling), settings, &UNLIKE_MATERIALS)?;
        let mut ordered = OrderedSamples::new(scene, count, self);
        progress.finish();

        progress.start("basis", 0);
        let basis = basis(&ordered, scene, self);
        let (table, spread) = (basis.table(), basis.spread());
        progress.finish();

        let (cache, lights) = (&settings.cache, settings.probes.tuning.as_slice());
        let asked = |key: &mut Key| {
            key.text(&format!("{self:?} {}", settings.max_rms)).number(count as u64);
        };
        let lit = || expected_light(scene, &ordered, lights, self.sampling, progress);
        let (expected, tuning) = cache.common("typical light", asked, lit)?;
        ordered.points = cache.common("points", asked, || {
            let work = Work { scene, ordered: &ordered, form: self, basis: &basis, table: &table };
            Ok(stage(progress, "points", || choose_points(work, &tuning)))
        })?;
        let work = Work { scene, ordered: &ordered, form: self, basis: &basis, table: &table };
        // Inside the split radius the functions change as at its edge; what is as well known from points twice as far apart changes half as fast.
        let smooth = |level: &u8| 0.5 * ordered.split_mm * f64::from(1u32 << level);
        let smooth_mm: Vec<f64> = ordered.points.levels.iter().map(smooth).collect();
        let transport = FarTransport {
            tree: &ordered.tree,
            patches: &ordered.patches,
            table: &table,
            spread: &spread,
            expected: &expected,
            smooth_mm: &smooth_mm,
            precision: Precision { opening: self.opening, threshold: 0.0, keep: 0.0 },
        };
        let choice = cache.common("threshold", asked, || {
            Ok(stage(progress, "threshold", || Choice::new(work, &transport, &tuning)))
        })?;
        let precision = Precision { opening: self.opening, threshold: choice.threshold, keep: choice.threshold };
        let transport = FarTransport { precision, ..transport };
        let environment = self.environment.filter(|_| settings.is_for(LightKind::Environment));
        let surface = ordered.surface(scene);
        let blocks = cache.blocks("transport", ordered.points.rows.places.groups.len().div_ceil(CHUNK), asked);
        blocks.records_ahead(progress, |block| {
            Ok(rows(&transport, &ordered.points.rows, chunk(&ordered.points, block)))
        })?;
        if let Some(rows) = environment {
            environment_rows::ahead(&surface, (rows, self.sampling), settings, progress)?;
        }
        cache.gather()?;
        let far = far_field(&transport, &ordered.points, (&choice, &blocks), progress)?;

        let mut sections = sections(&basis, &far, &scene.mesh, &ordered.samples)?;
        let mut ledger = ledger::measure(&Baked {
            work,
            transport: &transport,
            far: &far,
            unseen: &settings.probes.unseen,
            progress,
        })?;
        if let Some(rows) = environment {
            let (place, how) = ((&surface, &ordered.receivers), (rows, self.sampling, self.near));
            sections.extend(environment_rows::bake(place, how, settings, &mut ledger, progress)?);
        }
        Ok(AssetParts { samples: ordered.samples, ledger, sections, opener: None })
    }

    fn open(&self, asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
        open(*self, &asset)
    }
}

/// Sections of the basis and the far field.
fn sections(basis: &ProfileBasis, far: &FarField, mesh: &Mesh, samples: &Samples) -> Result<Vec<RawSection>> {
    let mut sections = file::ProfileBasis {
        split_mm: basis.split_mm(),
        nodes_mm: basis.nodes_mm().to_vec(),
        weights_mm4: basis.weights_mm4().to_vec(),
        functions: basis.functions().to_vec(),
        totals: basis.totals().map(<[f64]>::to_vec),
    }
    .to_sections()
    .map_err(write_error)?;
    let shape = Shape { vertices: mesh.local_mm.len(), part_offsets: &samples.part_offsets };
    sections.extend(far.to_coded_sections(&shape).map_err(write_error)?);
    Ok(sections)
}

/// Basis of as few functions as the asked error allows, at most as many as a row of the far field holds.
fn basis(ordered: &OrderedSamples, scene: &Scene, form: &Factored) -> ProfileBasis {
    let settings = BasisSettings {
        split_mm: ordered.split_mm,
        reach_mm: ordered.reach_mm(scene),
        family: form.family,
        terms: form.terms,
        error: form.basis_error,
    };
    let basis = ProfileBasis::new(&settings);
    if basis.terms() <= TERMS {
        return basis;
    }
    ProfileBasis::new(&BasisSettings { terms: Some(TERMS), ..settings })
}

/// Expected light details at each node of the tree, and some of the lights, for choices.
fn expected_light(
    scene: &Scene,
    ordered: &OrderedSamples,
    lights: &[Light],
    sampling: LightSampling,
    progress: &dyn Progress,
) -> Result<(Vec<f32>, Vec<Tuning>)> {
    progress.start("typical light", lights.len() as u64);
    let chosen: Vec<usize> = choice::tuning_lights(lights).collect();
    let (mut details, mut tuning) = (Vec::with_capacity(lights.len()), Vec::with_capacity(chosen.len()));
    for (index, light) in lights.iter().enumerate() {
        let (irradiance, _) = ordered.irradiance(scene, light, sampling)?;
        let found = LightDetails::new(&ordered.samples, &ordered.patches, &irradiance);
        if chosen.contains(&index) {
            tuning.push(Tuning { irradiance, details: found.clone() });
        }
        details.push(found);
        progress.advance(1);
    }
    progress.finish();
    let parts = scene.parts.parts.len();
    Ok((expected_details(&ordered.tree, parts, ordered.samples.len(), &details), tuning))
}

/// Rows of a range of groups: independent of how the groups are cut into ranges.
fn rows(transport: &FarTransport, stored: &RowPlaces, range: Range<usize>) -> Vec<Rows> {
    let of_group = |(group, functions): (&crate::transport::receivers::Group, &u16)| {
        transport.rows(&stored.places.positions[group.run.range()], group.part as usize, *functions)
    };
    stored.places.groups[range.clone()].par_iter().zip(&stored.functions[range]).map(of_group).collect()
}

/// Groups of a block.
const CHUNK: usize = 64;

/// The groups of a block.
fn chunk(points: &FarPoints, block: usize) -> Range<usize> {
    let groups = points.rows.places.groups.len();
    (block * CHUNK).min(groups)..((block + 1) * CHUNK).min(groups)
}

fn far_field(
    transport: &FarTransport,
    points: &FarPoints,
    (choice, blocks): (&Choice, &Blocks),
    progress: &dyn Progress,
) -> Result<FarField> {
    let groups = points.rows.places.groups.len();
    progress.start("transport", groups as u64);
    let mut all = Vec::with_capacity(groups);
    for block in 0..groups.div_ceil(CHUNK) {
        let range = chunk(points, block);
        progress.advance(range.len() as u64);
        let made: Vec<Rows> = blocks.record(block, || Ok(rows(transport, &points.rows, range.clone())))?;
        if made.len() != range.len() {
            return Err(Error::input(format!("a block of {} groups in place of {}", made.len(), range.len())));
        }
        all.extend(made);
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
    Ok(far)
}

/// Adds the quantised rows of a group; those that round to 0 are dropped.
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
