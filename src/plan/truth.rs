//! Brute-force truth at a few points of a surface, and what assets are off it there.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use translux_format::RawSection;

use super::request::Request;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::exitance::MeshPoint;
use crate::evaluate::{BakeSettings, Evaluator, Form, Model, ModelWalks};
use crate::forms::density;
use crate::forms::gathered::{Bound, Far, Gathered, GatheredEvaluator};
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::measure::between_vertices::between_vertices;
use crate::measure::exact_sums::{ALL_PAIRS, FINER_BEYOND, MOST_SAMPLES, is_soft, true_samples, under_soft_light};
use crate::medium::material::Medium;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::irradiance::LightSampling;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;

/// Error of clusters of triangles under soft light over that under sharp light, at most, where it is not measured: 6 on bunny_closed under an
/// area light, 1.5 on horse.
const CLUSTERS_UNDER_SOFT_LIGHT: f64 = 3.0;

/// Samples beyond which the error of soft light costs too much to measure: that of samples which are no clusters of triangles falls, with their
/// inverse number, of which the root is counted.
const MOST_UNDER_SOFT_LIGHT: usize = 1 << 13;

/// Number of samples of the truth of a choice. Of dipoles it tells the error of a few for each triangle, which drops where samples are
/// clusters of triangles no more. Where light moves, errors are those of where it first scatters, which is finer than triangles or coarser:
/// that of one number of samples is measured, and others follow ([`over_measured`]).
pub(super) fn samples_of_a_choice(scene: &Scene, max_rms: f64, model: Model) -> usize {
    const MEASURED: usize = 1 << 14;
    match model {
        Model::Dipole => true_samples(scene, max_rms, (scene.mesh.triangles.len() / 2 * 3).max(MEASURED)),
        Model::Calibrated(_) => FINER_BEYOND * MEASURED,
    }
}

/// [`true_samples`] at least, where a truth is there already.
fn least_samples(scene: &Scene, max_rms: f64, judged: usize) -> usize {
    true_samples(scene, max_rms, 0).max(FINER_BEYOND * judged).min(MOST_SAMPLES)
}

/// Most bytes that the sums take which tell the error of so many samples.
pub(super) fn memory(scene: &Scene, (max_rms, judged): (f64, usize), model: Model) -> u64 {
    let samples = true_samples(scene, max_rms, judged);
    let (under_soft, _) = under_soft_light(scene, samples, max_rms);
    let apart = (under_soft != samples).then(|| density::memory(under_soft, scene, model));
    density::memory(samples, scene, model) + apart.unwrap_or(0)
}

/// True if the error under soft light is measured: where the truth has samples enough for many triangles, its rays cost too much.
fn measures_soft_light(scene: &Scene, model: Model) -> bool {
    scene.mesh.triangles.len() <= MOST_UNDER_SOFT_LIGHT || model != Model::Dipole
}

/// The lights of a choice that tell the error of sampling: where there are many triangles, few sharp lights are enough work.
pub(super) fn telling(lights: Vec<Light>, scene: &Scene, model: Model) -> Vec<Light> {
    const MANY: usize = 50_000;
    const OF_A_KIND: usize = 2;
    let triangles = scene.mesh.triangles.len();
    let any_sharp = lights.iter().any(|light| !is_soft(light));
    if measures_soft_light(scene, model) || !any_sharp {
        return lights;
    }
    let mut sharp: Vec<Light> = lights.into_iter().filter(|light| !is_soft(light)).collect();
    if triangles > MANY {
        let mut counts = BTreeMap::new();
        sharp.retain(|light| {
            let count: &mut usize = counts.entry(light.kind()).or_default();
            *count += 1;
            *count <= OF_A_KIND
        });
    }
    sharp
}

/// Some points of the surface, with the area that each stands for.
pub(super) struct Places {
    /// The vertices among them, which come first.
    pub(super) vertices: Vec<u32>,
    points: Vec<MeshPoint>,
    areas_mm2: Vec<f64>,
}

/// Error between vertices from which on vertices alone say nothing of a surface.
const WORTH_JUDGING: f64 = 0.1;

/// The error of what is drawn between vertices, where these are few and that is much: 68 % on a cube of 12 triangles, whose corners
/// are like nothing else of it.
///
/// # Errors
/// Failures of the work.
pub(super) fn between_few_vertices(scene: &Scene, few: usize, progress: &dyn Progress) -> Result<Option<VertexError>> {
    if scene.mesh.local_mm.len() >= few {
        return Ok(None);
    }
    Ok(Some(between_vertices(scene, progress)?).filter(|error| error.rms > WORTH_JUDGING))
}

impl Places {
    /// About `count` vertices spread over the translucent parts, one here and one there, since neighbours err alike; different phases
    /// (0 to 2) are disjoint unless there are very few.
    pub(super) fn new(scene: &Scene, count: usize, phase: usize) -> Self {
        const GROUP: usize = 8;
        const PHASES: usize = 3;
        const VERY_FEW: usize = 24;
        let Scene { mesh, parts, .. } = scene;
        let receivers = Receivers::new(mesh, parts, GROUP);
        let areas = receivers.areas_mm2(mesh);
        let all = receivers.len();
        let step = (all / count.max(1)).max(if all < VERY_FEW { 1 } else { PHASES });
        let first = if all < VERY_FEW { 0 } else { phase * step / PHASES };
        // Neighbours are near one another in the order of the receivers.
        let mut wanted: BTreeMap<u32, f64> =
            (first..all).step_by(step).map(|i| (i as u32, areas.get(i).copied().unwrap_or_default())).collect();
        let mut places = Self { vertices: Vec::new(), points: Vec::new(), areas_mm2: Vec::new() };
        for (index, corners) in mesh.triangles.iter().enumerate() {
            if wanted.is_empty() || !parts.transfers(index as u32) {
                continue;
            }
            for (corner, &vertex) in corners.iter().enumerate() {
                let receiver = receivers.of_vertex.get(vertex as usize).copied().unwrap_or(u32::MAX);
                let Some(area) = wanted.remove(&receiver) else { continue };
                let barycentric = [0, 1, 2].map(|k| if k == corner { 1.0 } else { 0.0 });
                if let Some(point) = MeshPoint::new(mesh, index as u32, barycentric) {
                    places.vertices.push(vertex);
                    places.points.push(point);
                    places.areas_mm2.push(area);
                }
            }
        }
        places
    }

    /// The same with points between the vertices, so that there are `count` in all: at even steps of the area, each for as much of it.
    pub(super) fn between(scene: &Scene, count: usize, phase: usize) -> Self {
        // Weyl sequences of the plastic number fill a triangle evenly, whichever of them come to it.
        const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];
        let mut places = Self::new(scene, count, phase);
        let translucent: Vec<u32> =
            (0..scene.mesh.triangles.len() as u32).filter(|&t| scene.parts.transfers(t)).collect();
        let total: f64 = translucent.iter().map(|&t| scene.mesh.area_mm2(t)).sum();
        let more = count.saturating_sub(places.points.len());
        let (mut passed, mut placed) = (0.0, 0);
        for triangle in translucent {
            passed += scene.mesh.area_mm2(triangle);
            while placed < more && passed > (placed as f64 + 0.5) * total / more as f64 {
                let [u, v] = STEPS.map(|step| (0.5 + (phase * count + placed) as f64 * step).fract());
                let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
                places.points.extend(MeshPoint::new(&scene.mesh, triangle, [1.0 - u - v, u, v]));
                placed += 1;
            }
        }
        let each = total / places.points.len().max(1) as f64;
        places.areas_mm2 = vec![each; places.points.len()];
        places
    }

    #[cfg(test)]
    pub(super) fn parts(&self) -> (&[MeshPoint], &[f64]) {
        (&self.points, &self.areas_mm2)
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// What an evaluator gives there under the lights in force.
    ///
    /// # Errors
    /// Failures of the work; points between vertices where the evaluator serves none.
    pub(super) fn exitance(&self, evaluator: &mut dyn Evaluator) -> Result<Vec<DVec3>> {
        if self.vertices.len() == self.points.len() {
            return evaluator.radiosity_of(&self.vertices, &Silent);
        }
        at_points(evaluator, &self.points)
    }

    /// Error of values at the places; none where the truth is black.
    pub(super) fn error(&self, values: &[DVec3], truth: &[DVec3]) -> VertexError {
        vertex_error(values, truth, &self.areas_mm2).or_none()
    }
}

/// Exitance at some points under the lights in force.
fn at_points(evaluator: &mut dyn Evaluator, points: &[MeshPoint]) -> Result<Vec<DVec3>> {
    evaluator.prepare_points(&Silent)?;
    let missing = || Error::runtime("an evaluator that serves points gives none");
    Ok(evaluator.exitance_at_points().ok_or_else(missing)?.at_each(points, &Silent))
}

/// Sums through the hierarchy, as good as tells the error of a model: means over 256 places, a few percent off.
const OF_A_MODEL: Gathered = Gathered {
    sampling: LightSampling::FAST,
    near: NearField { exact_below: 1.5, three_points_below: 3.0 },
    far: Far::Hierarchical { error: 0.04, bound: Bound::SolidAngle },
    ..ALL_PAIRS
};

/// Samples of those sums.
const SAMPLES_OF_A_MODEL: usize = 1 << 15;

/// Sums over some samples at any place, without nets.
pub(super) struct Sums {
    evaluator: GatheredEvaluator,
    samples: usize,
}

impl Sums {
    /// `kernels` are the sections of calibrated kernels, where the model is not the dipole.
    fn new(scene: &Scene, samples: usize, form: &Gathered, kernels: &[RawSection]) -> Result<Self> {
        let asset = Asset::of_scene(scene.clone(), Samples::new(&scene.mesh, &scene.parts, samples), kernels.to_vec());
        let evaluator = GatheredEvaluator::new(Arc::new(asset), form.gathering(None)).with_model()?;
        Ok(Self { evaluator, samples })
    }

    /// Others over the same samples with the same kernels.
    fn of_form(self, form: &Gathered) -> Self {
        Self { evaluator: self.evaluator.with_gathering(form.gathering(None)), ..self }
    }

    fn at(&mut self, light: &Light, places: &Places) -> Result<Vec<DVec3>> {
        self.evaluator.set_lights(vec![light.clone()], &Silent)?;
        at_points(&mut self.evaluator, &places.points)
    }
}

/// What there is of a model before any asset: nothing where it is the dipole.
#[derive(Default)]
pub(super) struct Inside {
    /// Sections of the kernels.
    pub(super) kernels: Vec<RawSection>,
    /// Walks that tell the error of the model, unless a part lets light out.
    pub(super) walks: Option<Arc<ModelWalks>>,
    /// That error.
    pub(super) error: Option<VertexError>,
    /// What has told it.
    pub(super) sums: Option<Sums>,
}

impl Inside {
    pub(super) fn new(model: Model, scene: &Scene, progress: &dyn Progress) -> Result<Self> {
        let Model::Calibrated(calibration) = model else { return Ok(Self::default()) };
        let settings = BakeSettings { model, samples: Some(1), ..BakeSettings::new(1.0) };
        let kernels = Form::bake(&ALL_PAIRS, scene, &settings, progress)?.sections;
        let walks = ModelWalks::new(scene, calibration.photons, progress)?.map(Arc::new);
        let (error, sums) = match &walks {
            Some(walks) => {
                let mut sums = Sums::new(scene, SAMPLES_OF_A_MODEL, &OF_A_MODEL, &kernels)?;
                (Some(walks.error(&mut sums.evaluator, progress)?), Some(sums))
            }
            None => (None, None),
        };
        Ok(Self { kernels, walks, error, sums })
    }
}

/// Exact sums over all pairs at any place, made for the lights that are asked for.
pub(super) struct TrueSums {
    scene: Scene,
    /// The error that rays towards soft light are made for.
    max_rms: f64,
    pub(super) samples: usize,
    /// Sections of calibrated kernels, where the model is not the dipole.
    kernels: Vec<RawSection>,
    /// Under sharp lights and under soft ones, if these take other samples.
    sums: [Option<Sums>; 2],
    /// Others of the same scene and kernels, in whose place these may be made.
    spare: Option<Sums>,
}

impl TrueSums {
    pub(super) fn new(
        scene: &Scene,
        (samples, max_rms): (usize, f64),
        (kernels, spare): (Vec<RawSection>, Option<Sums>),
    ) -> Self {
        Self { scene: scene.clone(), max_rms, samples, kernels, sums: [None, None], spare }
    }

    /// Returns whether these sums tell the error of that many samples of the same kernels, where so much is asked for.
    pub(super) fn judge(&self, max_rms: f64, judged: usize, kernels: &[RawSection]) -> bool {
        self.samples >= least_samples(&self.scene, max_rms, judged) && self.kernels == kernels
    }

    /// Exitance at some places under a light.
    fn at(&mut self, light: &Light, places: &Places) -> Result<Vec<DVec3>> {
        let (under_soft, rays) = under_soft_light(&self.scene, self.samples, self.max_rms);
        // As many samples serve both: sharp lights take none of the rays of soft ones.
        let apart = is_soft(light) && under_soft != self.samples;
        let of_kind = &mut self.sums[usize::from(apart)];
        let sums = match of_kind {
            Some(sums) => sums,
            None => {
                let samples = if apart { under_soft } else { self.samples };
                let form = Gathered { sampling: rays, ..ALL_PAIRS };
                of_kind.insert(match self.spare.take_if(|spare| spare.samples == samples) {
                    Some(spare) => spare.of_form(&form),
                    None => Sums::new(&self.scene, samples, &form, &self.kernels)?,
                })
            }
        };
        sums.at(light, places)
    }
}

/// True exitance at some places under some lights.
pub(super) struct Truth {
    pub(super) places: Places,
    pub(super) lights: Vec<Light>,
    values: Vec<Vec<DVec3>>,
    /// Number of its samples under sharp light.
    samples: usize,
    /// Whether light moves to where it first scatters.
    calibrated: bool,
}

impl Truth {
    pub(super) fn new(
        sums: &mut TrueSums,
        (lights, places): (Vec<Light>, Places),
        progress: &dyn Progress,
    ) -> Result<Self> {
        let mut values = Vec::with_capacity(lights.len());
        progress.start("truth of a plan", lights.len() as u64);
        for light in &lights {
            values.push(sums.at(light, &places)?);
            progress.advance(1);
        }
        progress.finish();
        Ok(Self { places, lights, values, samples: sums.samples, calibrated: !sums.kernels.is_empty() })
    }

    /// Error of exitance at the places under the light of an index, which comes from so many samples.
    pub(super) fn error(&self, light: usize, radiosity: &[DVec3], (scene, samples): (&Scene, usize)) -> VertexError {
        let told = self.places.error(radiosity, &self.values[light]);
        let moves = self.calibrated && self.lights[light].is_sharp();
        if moves { told.scaled(understated(scene, samples, self.samples)) } else { told }
    }
}

/// The error of sampling as a function of the number of samples, the worst light, measured where it is asked for.
pub(super) struct Sampling<'a> {
    scene: &'a Scene,
    kernels: &'a [RawSection],
    model: Model,
    truth: Truth,
    /// Whether soft light is asked for, measured or not.
    soft_is_asked: bool,
    /// Number of samples up to which the truth tells errors.
    most: usize,
    /// By number of samples: under sharp lights and under soft ones.
    known: [BTreeMap<usize, VertexError>; 2],
}

/// The error of some samples over that of those that were measured: that of more is at most what falls with the root of their number, that
/// of fewer grows faster. On bunny_3k in skin1 it goes with the power 0.76 from 1,024 to 8,192, of bunny_closed in marble with 0.5 beyond.
fn over_measured(samples: usize, measured: usize) -> f64 {
    let ratio = measured as f64 / samples.max(1) as f64;
    ratio.powf(if ratio > 1.0 { 0.75 } else { 0.5 })
}

/// What errors of moved light are over those that a truth of so many samples tells. Where samples are wider than the free paths that light
/// moves by, those of the truth miss in part what these miss. Measured errors over told ones: on bunny_3k in cream at 44 mm, samples 2.8, 2.0 and 1.4
/// free paths apart, 1.9, 1.6 and 1.4 with twice as many samples in the truth, 1.4, 1.3 and 1.1 with four times as many; on bunny_closed in marble
/// at 30 mm, 0.66 and 0.47 free paths apart, 1.10 and 1.03 with four times as many.
fn understated(scene: &Scene, samples: usize, of_truth: usize) -> f64 {
    const MOST: f64 = 2.0;
    const RESOLVED: f64 = 0.5;
    let apart_mm = (scene.parts.parts.iter().filter(|p| p.transfers()).map(|p| p.area_mm2).sum::<f64>()
        / samples.max(1) as f64)
        .sqrt();
    let longest = |medium: &Medium| medium.properties.mean_free_path_mm().max_element();
    let paths = scene.media.iter().map(|medium| apart_mm / longest(medium)).fold(0.0, f64::max);
    let share = (samples as f64 / of_truth.max(1) as f64).min(1.0);
    (1.0 + share * (paths - RESOLVED).max(0.0)).min(MOST)
}

impl<'a> Sampling<'a> {
    /// `samples` is their number in the truth, `kernels` as in the truth.
    pub(super) fn new(
        scene: &'a Scene,
        kernels: &'a [RawSection],
        (truth, samples): (Truth, usize),
        request: &Request,
    ) -> Self {
        let soft_is_asked = request.for_lights.iter().any(|kind| !kind.is_sharp());
        Self {
            soft_is_asked,
            scene,
            kernels,
            model: request.model,
            truth,
            most: samples / FINER_BEYOND,
            known: [BTreeMap::new(), BTreeMap::new()],
        }
    }

    /// What has been measured, by the number of samples.
    pub(super) fn known(&self) -> Vec<(usize, VertexError)> {
        let [sharp, soft] = &self.known;
        let mut all = sharp.clone();
        soft.iter().for_each(|(samples, error)| {
            all.entry(*samples).and_modify(|known| *known = known.max(*error)).or_insert(*error);
        });
        all.into_iter().collect()
    }

    /// The error of that many samples under sharp lights alone, which is less work.
    pub(super) fn error_under_sharp_lights(&mut self, samples: usize) -> Result<VertexError> {
        self.extrapolated(samples, self.most, false)
    }

    /// The error of that many samples from that of what is measured: themselves, up to a number. Where light moves that number alone is,
    /// since the error of few samples, each wider than a free path, says little about any other.
    fn extrapolated(&mut self, samples: usize, most: usize, soft: bool) -> Result<VertexError> {
        let measured = if self.model == Model::Dipole { samples.min(most) } else { most };
        Ok(self.under(measured, soft)?.scaled(over_measured(samples, measured)))
    }

    /// The error of that many samples.
    pub(super) fn error(&mut self, samples: usize) -> Result<VertexError> {
        let sharp = self.error_under_sharp_lights(samples)?;
        let any_sharp = self.truth.lights.iter().any(|light| !is_soft(light));
        if measures_soft_light(self.scene, self.model) {
            return Ok(sharp.max(self.extrapolated(samples, MOST_UNDER_SOFT_LIGHT, true)?));
        }
        // Many samples take many rays to measure; what sharp light tells must do.
        let clusters = samples < self.scene.mesh.triangles.len();
        match (any_sharp, clusters) {
            (true, true) if self.soft_is_asked => Ok(sharp.scaled(CLUSTERS_UNDER_SOFT_LIGHT)),
            (true, _) => Ok(sharp),
            (false, _) => self.under(samples, true),
        }
    }

    fn under(&mut self, samples: usize, soft: bool) -> Result<VertexError> {
        if let Some(error) = self.known[usize::from(soft)].get(&samples) {
            return Ok(*error);
        }
        let mut worst = VertexError::default();
        let chosen: Vec<usize> =
            (0..self.truth.lights.len()).filter(|&i| is_soft(&self.truth.lights[i]) == soft).collect();
        if !chosen.is_empty() {
            let form = Gathered { sampling: LightSampling::FAST, ..ALL_PAIRS };
            let mut sums = Sums::new(self.scene, samples, &form, self.kernels)?;
            for light in chosen {
                let values = sums.at(&self.truth.lights[light], &self.truth.places)?;
                worst = worst.max(self.truth.error(light, &values, (self.scene, samples)));
            }
        }
        self.known[usize::from(soft)].insert(samples, worst);
        Ok(worst)
    }
}
