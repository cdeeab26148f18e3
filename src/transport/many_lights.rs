//! Radiosity under many lights at once: the transfer from samples to receivers is computed once for all of them, and
//! applied as a product of matrices.
//!
//! All lights of a call share one choice of clusters, with the centroid of the flux of all of them. Lights of one call
//! should be neighbours; samples that none of them reaches cost nothing then. Irradiance of directional and point
//! lights is scalar (F_t depends on eta alone), transfer is RGB.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::gather::{Criterion, Gather, Scheme, Source};
use super::receivers::{Group, ProbePoints, Receivers};
use super::tree::SampleTree;
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::math::statistics::VertexError;
use crate::parallel::*;
use crate::progress::Progress;

/// Irradiance of every sample under each of some lights; for a scene of one index of refraction, white lights.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IrradianceRows {
    /// Lights.
    pub lights: usize,
    /// Whether each channel has irradiance of its own.
    pub by_channel: bool,
    /// Of each sample that under every light, channel after channel where each has its own.
    pub values: Vec<f32>,
}

impl IrradianceRows {
    /// Values of a sample.
    pub fn columns(&self) -> usize {
        self.lights * self.channels()
    }

    fn channels(&self) -> usize {
        if self.by_channel { 3 } else { 1 }
    }

    /// Irradiance of every sample under one light, RGB.
    pub fn under(&self, light: usize) -> Vec<DVec3> {
        let channel = |row: &[f32], c: usize| f64::from(row[if self.by_channel { c * self.lights } else { 0 } + light]);
        let rows = self.values.chunks_exact(self.columns().max(1));
        rows.map(|row| DVec3::from([0, 1, 2].map(|c| channel(row, c)))).collect()
    }
}

/// Radiosity of every receiver under each light: `values[(receiver * 3 + channel) * lights + light]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadiosityRows {
    /// Lights.
    pub lights: usize,
    /// In the order of the receivers.
    pub values: Vec<f32>,
}

impl RadiosityRows {
    /// The three rows of a receiver, channel after channel.
    pub fn of(&self, receiver: usize) -> &[f32] {
        let size = 3 * self.lights;
        self.values.get(receiver * size..(receiver + 1) * size).unwrap_or(&[])
    }

    /// Radiosity of every receiver under one light, RGB.
    pub fn under(&self, light: usize) -> Vec<DVec3> {
        let rows = self.values.chunks_exact((3 * self.lights).max(1));
        rows.map(|row| DVec3::from([0, 1, 2].map(|c| f64::from(row[c * self.lights + light])))).collect()
    }
}

/// Receivers that tune the criterion, and others that measure its error.
const TUNING: usize = 96;
const PROBES: usize = 192;

/// Limits that tuning tries at most; without success there is no hierarchy.
const TRIALS: usize = 14;

/// Share of the asked error that tuning aims at, because other receivers may fare worse.
const TARGET: f64 = 0.7;

/// Sources whose weights are multiplied at once.
const SOURCES: usize = 64;

/// Stride from one block of columns to the next: one more, because rows a page apart push each other out of the cache.
const STRIDE: usize = SOURCES + 1;

/// Groups of receivers below which threads share the sources of each.
const FEW_GROUPS: usize = 16;

/// Sources that are summed by one thread, before their sums are added.
const SOURCES_OF_A_JOB: usize = 4096;

/// Rows of a block: channels of receivers, as many as keep their sums in the 16 registers of AVX2.
const ROWS: usize = 6;

/// Lights of a block.
const COLUMNS: usize = 16;

/// A scene's transfer for lights that are not known yet.
pub struct ManyLights<'a> {
    gather: &'a Gather<'a>,
    tree: &'a SampleTree,
    receivers: &'a Receivers,
    areas: &'a [f64],
    scheme: Scheme,
    level: InstructionSet,
}

impl<'a> ManyLights<'a> {
    /// The transfer by all pairs until [`Self::tune`]; `areas` are those around the receivers.
    pub fn new(gather: &'a Gather<'a>, tree: &'a SampleTree, receivers: &'a Receivers, areas: &'a [f64]) -> Self {
        Self { gather, tree, receivers, areas, scheme: Scheme::AllPairs, level: InstructionSet::detect() }
    }

    /// The gather that computes the transfer.
    pub fn gather(&self) -> &'a Gather<'a> {
        self.gather
    }

    /// Organisation of its sums.
    pub fn scheme(&self) -> Scheme {
        self.scheme
    }

    /// The same with another organisation of its sums, such as [`Self::tune`] found.
    #[must_use]
    pub fn with_scheme(self, scheme: Scheme) -> Self {
        Self { scheme, ..self }
    }

    /// Radiosity of every receiver under one irradiance of the samples, RGB, with the same scheme.
    pub fn under(&self, irradiance: &[DVec3]) -> Vec<DVec3> {
        let lit = self.gather.light(irradiance);
        self.gather.radiosity(self.receivers, &lit, self.scheme, &crate::progress::Silent)
    }

    /// The same transfer to other receivers, and the areas around them.
    #[must_use]
    pub fn towards<'b>(&self, receivers: &'b Receivers, areas: &'b [f64]) -> ManyLights<'b>
    where
        'a: 'b,
    {
        ManyLights { gather: self.gather, tree: self.tree, receivers, areas, scheme: self.scheme, level: self.level }
    }

    /// Finds the largest limit of the criterion that keeps the asked error under every one of these lights, on some
    /// receivers; returns the error on others.
    pub fn tune(&mut self, error: f64, rows: &IrradianceRows) -> VertexError {
        let shared = &Shared::new(self, rows);
        let (subset, points) = self.receivers.probe_points(self.areas, (TUNING, 0));
        let truth = self.gathered(&subset, rows, shared, Scheme::AllPairs, &crate::progress::Silent);
        let scheme = |limit| Scheme::Hierarchical { criterion: Criterion::SolidAngle(limit) };
        let mut limit = (4.0 * error).clamp(1e-4, 1.0);
        let mut kept = None;
        for _ in 0..TRIALS {
            let found = self.gathered(&subset, rows, shared, scheme(limit), &crate::progress::Silent);
            let found = worst(&found, &truth, &points).rms;
            if found <= TARGET * error {
                kept = Some(limit);
                if found >= 0.5 * TARGET * error {
                    break;
                }
            } else if kept.is_some() {
                break;
            }
            let factor = (TARGET * error / found.max(f64::MIN_POSITIVE)).powf(0.8);
            limit *= if kept.is_some() { (0.9 * factor).clamp(1.1, 4.0) } else { (0.9 * factor).clamp(0.05, 0.7) };
        }
        let Some(limit) = kept else { return VertexError::default() };
        self.scheme = scheme(limit);
        let (subset, points) = self.receivers.probe_points(self.areas, (PROBES, 1));
        let truth = self.gathered(&subset, rows, shared, Scheme::AllPairs, &crate::progress::Silent);
        let found = self.gathered(&subset, rows, shared, self.scheme, &crate::progress::Silent);
        worst(&found, &truth, &points)
    }

    /// Radiosity of every receiver under each light. A receiver's value depends on its own group only.
    pub fn radiosity(&self, rows: &IrradianceRows, progress: &dyn Progress) -> RadiosityRows {
        progress.start("transfer", self.receivers.len() as u64);
        let result = self.radiosity_of(rows, &self.shared(rows), progress);
        progress.finish();
        result
    }

    /// What the radiosity of all receivers under some lights shares.
    pub fn shared(&self, rows: &IrradianceRows) -> Shared {
        Shared::new(self, rows)
    }

    /// [`Self::radiosity`] with what is shared by calls for other receivers.
    pub fn radiosity_of(&self, rows: &IrradianceRows, shared: &Shared, progress: &dyn Progress) -> RadiosityRows {
        self.gathered(self.receivers, rows, shared, self.scheme, progress)
    }

    fn gathered<'r>(
        &self,
        receivers: &Receivers,
        rows: &'r IrradianceRows,
        shared: &'r Shared,
        scheme: Scheme,
        progress: &dyn Progress,
    ) -> RadiosityRows {
        let (lights, columns, flux) = (rows.lights, rows.columns(), &shared.flux);
        let lit = self.gather.light(&shared.mean);
        let mut values = vec![0.0; receivers.len() * 3 * lights];
        // Sums over some sources, which are added in order: the same bits, whether threads share the groups or the sources of one.
        let of_sources = |work: &mut Work, group: Group, sources: &[Source]| {
            let members = group.run.range().len();
            work.block.begin(members, lights, rows.channels());
            let row = |source: Source| match source {
                Source::Cluster(node) => &flux[node as usize * columns..(node as usize + 1) * columns],
                Source::Patch(sample) => &rows.values[sample as usize * columns..(sample as usize + 1) * columns],
            };
            self.gather.weights(receivers, group, &lit, sources, &mut work.lists, &mut |source, weights| {
                work.block.push(weights, row(source));
                if work.block.sources == SOURCES {
                    work.block.multiply(self.level);
                }
            });
            work.block.multiply(self.level);
        };
        let of_group = |work: &mut Work, (group, out): (&Group, &mut [f32])| {
            let members = group.run.range().len();
            for some in self.gather.sources_of(receivers, *group, &lit, scheme).chunks(SOURCES_OF_A_JOB) {
                of_sources(work, *group, some);
                work.block.add_to(members, out);
            }
            progress.advance(members as u64);
        };
        if receivers.groups.len() < FEW_GROUPS {
            // The eight corners of a cube are one group.
            for (group, out) in receivers.groups.iter().zip(receivers.cut(&mut values, 3 * lights)) {
                let members = group.run.range().len();
                let of_some = |work: &mut Work, some: &[Source]| {
                    let mut sums = vec![0.0; out.len()];
                    of_sources(work, *group, some);
                    work.block.add_to(members, &mut sums);
                    sums
                };
                let sources = self.gather.sources_of(receivers, *group, &lit, scheme);
                let jobs = sources.par_chunks(SOURCES_OF_A_JOB);
                let sums: Vec<Vec<f32>> = jobs.map_init(Work::default, of_some).collect();
                sums.iter().for_each(|sums| out.iter_mut().zip(sums).for_each(|(out, sum)| *out += sum));
                progress.advance(members as u64);
            }
            return RadiosityRows { lights, values };
        }
        let jobs = receivers.groups.par_iter().zip(receivers.cut(&mut values, 3 * lights));
        jobs.for_each_init(Work::default, of_group);
        RadiosityRows { lights, values }
    }
}

/// The error under the worst light.
fn worst(found: &RadiosityRows, truth: &RadiosityRows, points: &ProbePoints) -> VertexError {
    let of_light = |light| points.error(&found.under(light), &truth.under(light));
    (0..found.lights).map(of_light).fold(VertexError::default(), VertexError::max)
}

/// Light that all receivers share.
pub struct Shared {
    /// Irradiance of every sample, the mean over the lights.
    mean: Vec<DVec3>,
    /// Flux of every node of the tree under each light.
    flux: Vec<f32>,
}

impl Shared {
    fn new(many: &ManyLights, rows: &IrradianceRows) -> Self {
        // Normals and factors of clusters are means weighted by light, which only light of one sign has.
        let (one_sign, columns) = (many.gather.has_layers(), rows.columns());
        let of_sample = |sample: usize| {
            let row = rows.values.get(sample * columns..(sample + 1) * columns).unwrap_or(&[]);
            let value = |e: &f32| f64::from(if one_sign { e.abs() } else { *e });
            let mean = |row: &[f32]| row.iter().map(value).sum::<f64>() / row.len().max(1) as f64;
            if rows.by_channel {
                DVec3::from([0, 1, 2].map(|c| mean(row.get(c * rows.lights..(c + 1) * rows.lights).unwrap_or(&[]))))
            } else {
                DVec3::splat(mean(row))
            }
        };
        Self {
            mean: (0..many.gather.patches().len()).map(of_sample).collect(),
            flux: many.tree.flux_rows(many.gather.patches(), &rows.values, columns),
        }
    }
}

/// Working memory of one thread.
#[derive(Default)]
struct Work {
    lists: super::gather::Lists,
    block: Product,
}

/// The sum over sources of weights (rows) times light (columns), both padded to whole blocks: one for all channels, whose rows are
/// receivers and channels, or where each has light of its own one for each, whose rows are receivers.
#[derive(Default)]
struct Product {
    /// Products side by side.
    parts: usize,
    /// Rows and columns of each.
    rows: usize,
    columns: usize,
    lights: usize,
    /// Weights of the sources at hand, `[source][part][row]`.
    weights: Vec<f32>,
    /// Number of sources at hand.
    sources: usize,
    /// Light of the sources at hand, `[part][block][source][column of the block]`: in place its rows lie a multiple of a page
    /// apart and would push each other out of the cache.
    light: Vec<[f32; COLUMNS]>,
    /// Sums, `[part][row][column]`.
    sums: Vec<f32>,
}

impl Product {
    fn begin(&mut self, members: usize, lights: usize, parts: usize) {
        (self.parts, self.lights) = (parts, lights);
        self.rows = (3 * members / parts.max(1)).next_multiple_of(ROWS);
        self.columns = lights.next_multiple_of(COLUMNS);
        self.sums.clear();
        self.sums.resize(parts * self.rows * self.columns, 0.0);
        self.weights.resize(SOURCES * parts * self.rows, 0.0);
        self.light.resize(STRIDE * parts * self.columns / COLUMNS, [0.0; COLUMNS]);
        self.sources = 0;
    }

    /// Adds a source: its weights for each receiver, RGB, and its light under each light.
    fn push(&mut self, weights: &[[f32; 3]], light: &[f32]) {
        let size = self.parts * self.rows;
        let slots = &mut self.weights[self.sources * size..(self.sources + 1) * size];
        if self.parts == 1 {
            let padded = weights.as_flattened().iter().chain(std::iter::repeat(&0.0));
            slots.iter_mut().zip(padded).for_each(|(slot, &w)| *slot = w);
        } else {
            for (c, slots) in slots.chunks_exact_mut(self.rows.max(1)).enumerate() {
                let padded = weights.iter().map(|w| w[c]).chain(std::iter::repeat(0.0));
                slots.iter_mut().zip(padded).for_each(|(slot, w)| *slot = w);
            }
        }
        let blocks = light.chunks(self.lights.max(1)).enumerate().flat_map(|(part, light)| {
            let first = part * self.columns / COLUMNS;
            light.chunks(COLUMNS).enumerate().map(move |(block, light)| (first + block, light))
        });
        for (block, light) in blocks {
            let packed = &mut self.light[block * STRIDE + self.sources];
            match light.first_chunk() {
                Some(light) => *packed = *light,
                None => {
                    *packed = [0.0; COLUMNS];
                    packed.iter_mut().zip(light).for_each(|(packed, light)| *packed = *light);
                }
            }
        }
        self.sources += 1;
    }

    fn multiply(&mut self, level: InstructionSet) {
        multiply(level, self);
        self.sources = 0;
    }

    /// Adds the sums to some in the layout of [`RadiosityRows`].
    fn add_to(&self, members: usize, out: &mut [f32]) {
        for (index, out) in out.chunks_exact_mut(self.lights.max(1)).enumerate().take(3 * members) {
            let row = if self.parts == 1 { index } else { index % 3 * self.rows + index / 3 };
            let at = row * self.columns;
            out.iter_mut().zip(&self.sums[at..at + self.lights]).for_each(|(out, sum)| *out += sum);
        }
    }
}

multiversion! {
    /// Adds the products of the sources at hand to the sums.
    fn multiply(product: &mut Product) => multiply_body
}

#[inline(always)]
fn multiply_body(product: &mut Product) {
    let Product { parts, rows, columns, sources, weights, light, sums, .. } = product;
    let (rows, columns, of_source) = (*rows, *columns, *parts * *rows);
    for (block, light) in light.chunks_exact(STRIDE).enumerate() {
        let (part, column) = (block * COLUMNS / columns, block * COLUMNS % columns);
        let light = &light[..*sources];
        for row in (part * rows..(part + 1) * rows).step_by(ROWS) {
            // One variable each, so that they stay in registers.
            let [mut s0, mut s1, mut s2, mut s3, mut s4, mut s5] = [[0.0f32; COLUMNS]; ROWS];
            for (light, weights) in light.iter().zip(weights.chunks_exact(of_source)) {
                let Some(&[w0, w1, w2, w3, w4, w5]) = weights.get(row..).and_then(|w| w.first_chunk()) else { return };
                add_scaled(&mut s0, w0, light);
                add_scaled(&mut s1, w1, light);
                add_scaled(&mut s2, w2, light);
                add_scaled(&mut s3, w3, light);
                add_scaled(&mut s4, w4, light);
                add_scaled(&mut s5, w5, light);
            }
            for (r, partial) in [s0, s1, s2, s3, s4, s5].iter().enumerate() {
                let sums = sums.get_mut((row + r) * columns + column..).and_then(|s| s.first_chunk_mut());
                let Some(sums) = sums else { return };
                add_scaled(sums, 1.0, partial);
            }
        }
    }
}

#[cfg(test)]
#[path = "many_lights_tests.rs"]
mod tests;
