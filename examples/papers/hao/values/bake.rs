//! What these encodings precompute: the values of all vertices under every light, and what is kept of them.

use glam::DVec3;
use translux_format::coefficients::encode;
use translux_format::quantised_values::{Encoding as Layout, QuantisedValues as File, tags};

use super::super::settings::VertexValues;
use super::super::settings::{Encoding, Integral};
use super::codes::{self, Table};
use super::evaluate::{Values, interpolation};
use super::exact;
use super::harmonics::{self, Projection};
use super::matrix::{Cells, Matrix};
use super::prediction::Earlier;
use super::references::{self, Recipe};
use super::{CHANNELS, Topology};
use crate::hao::harmonic_fit::undershoot;
use translux::compress::ledger::Ledger;
use translux::error::{Error, Result};
use translux::evaluate::{AssetParts, BakeSettings};
use translux::forms::density;
use translux::forms::projected::lights::LightSet;
use translux::forms::projected::lights::{LightSetSettings, TUNING, chosen};
use translux::forms::sampled_scene::SampledScene;
use translux::light::Light;
use translux::light::quantised::interpolation::default_order;
use translux::math::statistics::{VertexError, vertex_error};
use translux::progress::Progress;
use translux::scene::Scene;
use translux::transport::many_lights::ManyLights;
use translux::transport::near_rule::NearField;

/// Directions unless they are asked for: the paper's.
const DIRECTIONS: usize = 200;

/// Harmonics of order n take at least n^2 / 0.6 directions.
const HARMONICS_PER_DIRECTION: f64 = 0.6;

/// The paper's orders, where no light says which: of harmonics alone, and of differences.
const ORDER: usize = 7;
const ORDER_OF_DIFFERENCES: usize = 3;

/// Shares of the asked error.
const HIERARCHY: f64 = 0.1;
const HARMONICS: f64 = 0.8;
const REFERENCES: f64 = 0.4;

/// Share of the vertices that are reference points at first, and at most; how often another share is tried.
const FIRST_SHARE: f64 = 0.03;
const LARGEST_SHARE: f64 = 0.5;
const TRIALS: usize = 6;

/// Receivers on which orders are compared.
const SOME: usize = 3000;

/// Directions under which undershoots are looked for, at most.
const LOOKED_AT: usize = 50;

/// Bytes at work for each value beside the value itself: codes, integers, residuals.
const WORK: u64 = 6;

fn directions(form: &VertexValues) -> usize {
    let order = form.order.unwrap_or(0) as f64;
    form.lights.directions.unwrap_or_else(|| DIRECTIONS.max((order * order / HARMONICS_PER_DIRECTION).ceil() as usize))
}

fn planes(form: &VertexValues) -> usize {
    if form.integral == Integral::Vector { 3 * CHANNELS } else { CHANNELS }
}

pub(crate) fn memory(form: &VertexValues, scene: &Scene, settings: &BakeSettings) -> u64 {
    let samples = form.density.count(scene, settings.samples);
    let lights = directions(form) * (form.lights.shells + 1);
    let values = (scene.mesh.local_mm.len() * planes(form) * lights) as u64;
    density::memory(samples, scene, settings.model) + values * (4 + WORK) + (samples * 64 * 4 * 2) as u64
}

/// What the stages share.
pub(super) struct Work<'a> {
    pub(super) sampled: &'a SampledScene<'a>,
    pub(super) transfer: &'a ManyLights<'a>,
    pub(super) set: &'a LightSet,
    pub(super) topology: &'a Topology,
    /// Values as computed.
    pub(super) exact: &'a Values,
    pub(super) form: &'a VertexValues,
    pub(super) max_rms: f64,
    /// Lights that choices look at.
    pub(super) tuning: &'a [Light],
}

pub(crate) fn bake(
    form: &VertexValues,
    scene: &Scene,
    settings: &BakeSettings,
    progress: &dyn Progress,
) -> Result<AssetParts> {
    progress.start("samples", 0);
    let sampled = SampledScene::new(scene, form.density.count(scene, settings.samples));
    progress.finish();
    if sampled.receivers.is_empty() {
        return Err(Error::input("no surface that light enters: every part is opaque"));
    }
    sampled.with_transfer(NearField::for_error(settings.max_rms), |mut transfer| {
        progress.start("tuning", 0);
        let tuning = chosen(&settings.probes.tuning, TUNING);
        let hierarchy = transfer.tune(HIERARCHY * settings.max_rms, &sampled.irradiance(&tuning)?);
        progress.finish();
        let lights = LightSetSettings { scheme: interpolation(form.encoding, form.lights.scheme), ..form.lights };
        let set = LightSet::planned(scene, directions(form), &lights)?;
        let matrix = exact::values(&sampled, &transfer, &set, form.integral, progress)?;
        let mut file = File {
            directions: set.lights.directions.count() as u32,
            shells: set.lights.shells.inverse().to_vec(),
            samples: sampled.samples.len() as u32,
            planes: matrix.planes as u8,
            ..File::default()
        };
        let mut ledger = Ledger::default();
        ledger.add("hierarchy", hierarchy, "against all pairs, on vertices that no tuning saw");
        let topology = Topology::new(scene, &sampled.receivers);
        let tuning = served(&set, &tuning);
        let work = Work {
            sampled: &sampled,
            transfer: &transfer,
            set: &set,
            topology: &topology,
            exact: &Values::exact(matrix),
            form,
            max_rms: settings.max_rms,
            tuning: &tuning,
        };
        progress.start("coding", 0);
        let note = work.encode(&mut file)?;
        progress.finish();
        work.measure(&file, &settings.probes.unseen, &note, &mut ledger, progress)?;
        let sections = file.to_sections().map_err(|e| Error::runtime(format!("asset: {e}")))?;
        Ok(AssetParts::without_samples(scene, ledger, sections))
    })
}

/// Lights that the set carries.
fn served(set: &LightSet, lights: &[Light]) -> Vec<Light> {
    let parallel = set.lights.shells.inverse().len() == 1;
    let carried = |l: &&Light| !(parallel && matches!(l, Light::Point { .. } | Light::Area { .. }));
    lights.iter().filter(carried).cloned().collect()
}

impl Work<'_> {
    fn matrix(&self) -> Result<(&Matrix, &[f32])> {
        self.exact.floats().ok_or_else(|| Error::runtime("no values to encode"))
    }

    fn shells(&self) -> usize {
        self.set.lights.shells.inverse().len()
    }

    /// Fills the file; says what people should know of the encoding.
    pub(super) fn encode(&self, file: &mut File) -> Result<String> {
        let (matrix, cells) = self.matrix()?;
        match self.form.encoding {
            Encoding::Raw => {
                (file.encoding, file.raw) = (Layout::Raw, cells.to_vec());
                Ok("floats".to_owned())
            }
            encoding @ (Encoding::Uniform8 | Encoding::Lloyd8) => {
                let table = if encoding == Encoding::Lloyd8 { Table::Lloyd } else { Table::Uniform };
                let coded = codes::quantised(cells, matrix.planes, matrix.columns, table)?;
                let earlier = Earlier::new(matrix.rows(), &self.topology.triangles);
                file.encoding = Layout::Codes;
                (file.tables, file.codes) = codes::write(&coded.matrix, &earlier)?;
                Ok(format!("one byte a value, {:.2} dB of signal over noise", coded.signal_to_noise_db))
            }
            Encoding::Harmonics => self.harmonics(file, cells),
            Encoding::ReferencePoints => self.references(file, cells),
        }
    }

    fn harmonics(&self, file: &mut File, cells: &[f32]) -> Result<String> {
        let order = match self.form.order {
            Some(order) => order,
            None => self.order(cells)?,
        };
        let coefficients = self.project(cells, order)?;
        let columns = CHANNELS * self.shells() * order * order;
        (file.encoding, file.order) = (Layout::Harmonics, order as u8);
        file.scales = harmonics::scales(&coefficients, columns, f32::from(i16::MAX));
        let integers = harmonics::integers(&coefficients, &file.scales, f32::from(i16::MAX));
        let rows = integers.len() / columns.max(1);
        let earlier = Earlier::new(rows, &self.topology.triangles);
        let residuals = earlier.residuals(&integers, columns);
        let coded = encode(tags::HARMONICS, rows, columns, &residuals, Some(&earlier.similar(1)));
        file.harmonics = coded.map_err(|e| Error::runtime(format!("asset: {e}")))?;
        let stored = Values::read(file, self.topology)?;
        Ok(format!(
            "order {order}, {} coefficients of 16 bits; undershoots by {:.2} % of full scale",
            order * order,
            100.0 * self.undershoot(&stored)?
        ))
    }

    /// Coefficients `[row][channel][shell][coefficient]` of values `[row][channel][light]`.
    fn project(&self, cells: &[f32], order: usize) -> Result<Vec<f32>> {
        use rayon::prelude::*;
        let projection = Projection::new(&self.set.lights.directions, order, self.form.window)?;
        let (size, columns) = (CHANNELS * self.set.lights.count(), CHANNELS * self.shells() * order * order);
        let mut coefficients = vec![0.0f32; cells.len() / size.max(1) * columns];
        let rows = coefficients.par_chunks_exact_mut(columns.max(1)).zip(cells.par_chunks_exact(size.max(1)));
        rows.for_each(|(out, row)| projection.apply(row, out));
        Ok(coefficients)
    }

    /// The lowest order that keeps the error under the tuning lights, on some receivers, or the best one.
    fn order(&self, cells: &[f32]) -> Result<usize> {
        if self.tuning.is_empty() {
            return Ok(ORDER);
        }
        let size = CHANNELS * self.set.lights.count();
        let step = (cells.len() / size.max(1)).div_ceil(SOME).max(1);
        let some: Vec<f32> = cells.chunks_exact(size).step_by(step).flatten().copied().collect();
        let areas: Vec<f64> = self.sampled.areas.iter().step_by(step).copied().collect();
        let truth = self.tuning.iter().map(|light| {
            let irradiance = exact::irradiance(self.sampled, light, self.sampled.sampling)?;
            Ok(self.transfer.under(&irradiance).into_iter().step_by(step).collect::<Vec<DVec3>>())
        });
        let truth: Vec<Vec<DVec3>> = truth.collect::<Result<_>>()?;
        let mut best = (ORDER, f64::INFINITY);
        for order in 1..=default_order(self.set.lights.directions.count()) {
            let columns = self.shells() * order * order;
            let cells = Cells::Floats(self.project(&some, order)?);
            let matrix = Matrix { planes: CHANNELS, columns, cells };
            let mut worst = 0.0f64;
            for (light, truth) in self.tuning.iter().zip(&truth) {
                let pieces = self.set.pieces(std::slice::from_ref(light))?;
                let found = matrix.products(&harmonics::weights(order, &pieces, &vec![1.0; CHANNELS * columns]));
                let clamp = |v: &[f32; 4]| DVec3::new(v[0].into(), v[1].into(), v[2].into()).max(DVec3::ZERO);
                let found: Vec<DVec3> = found.iter().map(clamp).collect();
                worst = worst.max(vertex_error(&found, truth, &areas).or_none().rms);
            }
            if worst < best.1 {
                best = (order, worst);
            }
            if worst <= HARMONICS * self.max_rms {
                break;
            }
        }
        Ok(best.0)
    }

    fn references(&self, file: &mut File, cells: &[f32]) -> Result<String> {
        let form = self.form;
        let receivers = self.topology.positions.len();
        let first = ((FIRST_SHARE * receivers as f64).ceil() as usize).max(4);
        let mut recipe = Recipe {
            count: form.references.unwrap_or(first),
            order: form.order.unwrap_or(ORDER_OF_DIFFERENCES),
            chosen_by: form.chosen_by,
            weights: form.weights,
        };
        file.encoding = Layout::References;
        let (directions, shells) = (&self.set.lights.directions, self.shells());
        let values = references::Values { cells, directions, shells };
        let write = |file: &mut File, recipe: &Recipe| references::write(self.topology, &values, recipe, file);
        let mut signal_to_noise_db = write(file, &recipe)?;
        let goal = REFERENCES * self.max_rms;
        if form.references.is_none() && !self.tuning.is_empty() {
            let mut kept: Option<(usize, File, f64)> = None;
            for trial in 0..TRIALS {
                let found = self.added(file, self.tuning)?.rms;
                if found <= goal {
                    kept = Some((recipe.count, file.clone(), signal_to_noise_db));
                }
                let at_most = (LARGEST_SHARE * receivers as f64) as usize;
                let close = found <= goal && found >= 0.8 * goal;
                if close || trial + 1 == TRIALS || (found > goal && (kept.is_some() || recipe.count >= at_most)) {
                    break;
                }
                // The error falls with the number, or a little faster.
                let factor = (found / (0.9 * goal).max(f64::MIN_POSITIVE)).clamp(0.2, 4.0);
                let next = ((recipe.count as f64 * factor) as usize).clamp(4, at_most.max(4));
                if next == recipe.count {
                    break;
                }
                recipe.count = next;
                signal_to_noise_db = write(file, &recipe)?;
            }
            if let Some((_, best, snr)) = kept {
                (*file, signal_to_noise_db) = (best, snr);
            }
        }
        let stored = Values::read(file, self.topology)?;
        Ok(format!(
            "{} of {receivers} vertices, {signal_to_noise_db:.2} dB there, differences of order {}; undershoots by {:.2} % of full scale",
            stored.references(),
            file.order,
            100.0 * self.undershoot(&stored)?
        ))
    }

    /// What an encoding changes under the worst of some lights.
    fn added(&self, file: &File, lights: &[Light]) -> Result<VertexError> {
        let stored = Values::read(file, self.topology)?;
        let mut worst = VertexError::default();
        for light in lights {
            let one = std::slice::from_ref(light);
            let exact = self.exact.at_receivers(&self.exact.light(self.set, one)?);
            let found = stored.at_receivers(&stored.light(self.set, one)?);
            worst = worst.max(vertex_error(&found, &exact, &self.sampled.areas).or_none());
        }
        Ok(worst)
    }

    /// How far values fall below 0 under parallel lights of the set, as a share of the largest.
    fn undershoot(&self, stored: &Values) -> Result<f64> {
        let directions = self.set.lights.directions.directions();
        let mut all = Vec::new();
        for from in directions.iter().step_by(directions.len().div_ceil(LOOKED_AT).max(1)) {
            let light = Light::Directional { from: *from, irradiance: DVec3::ONE };
            let values = stored.unclamped(&stored.light(self.set, &[light])?);
            let range =
                values.iter().flat_map(|v| &v[..CHANNELS]).fold((0.0f32, 0.0f32), |(a, b), v| (a.min(*v), b.max(*v)));
            all.extend([f64::from(range.0), f64::from(range.1)]);
        }
        Ok(undershoot(all))
    }

    /// Enters what each stage loses under lights that no choice saw.
    fn measure(
        &self,
        file: &File,
        unseen: &[Light],
        note: &str,
        ledger: &mut Ledger,
        progress: &dyn Progress,
    ) -> Result<()> {
        let unseen = served(self.set, unseen);
        progress.start("errors", unseen.len() as u64);
        let stored = Values::read(file, self.topology)?;
        let encoding = self.form.encoding;
        let mut errors = [VertexError::default(); 2];
        for light in &unseen {
            let one = std::slice::from_ref(light);
            let truth = self.transfer.under(&exact::irradiance(self.sampled, light, self.sampled.sampling)?);
            let found = stored.at_receivers(&stored.light(self.set, one)?);
            let between = match encoding {
                // Harmonics do not go by way of the lights.
                Encoding::Harmonics => truth.clone(),
                _ => self.exact.at_receivers(&self.exact.light(self.set, one)?),
            };
            errors[0] = errors[0].max(vertex_error(&between, &truth, &self.sampled.areas).or_none());
            errors[1] = errors[1].max(vertex_error(&found, &between, &self.sampled.areas).or_none());
            progress.advance(1);
        }
        progress.finish();
        let count = self.set.lights.directions.count();
        if encoding != Encoding::Harmonics {
            let note = format!("interpolation between {count} directions, under lights that no choice saw");
            ledger.add("lights", errors[0], note);
        }
        let stage = match encoding {
            Encoding::Raw => return Ok(()),
            Encoding::Uniform8 | Encoding::Lloyd8 => "quantiser",
            Encoding::Harmonics => "harmonics",
            Encoding::ReferencePoints => "reference points",
        };
        ledger.add(stage, errors[1], format!("{note}; under lights that no choice saw"));
        Ok(())
    }
}
