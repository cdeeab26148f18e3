//! The map: what is expected of the error at every vertex.

use glam::DVec3;

use super::between::Between;
use super::exact::{Exact, Subject, Which};
use super::thickness::thickness;
use crate::compress::ledger::ENVIRONMENT_STAGES;
use crate::error::{Error, ExitCode, Result};
use crate::forms::gathered::{Bound, Far};
use crate::light::{Light, LightKind};
use crate::math::statistics::{VertexError, units, vertex_error};
use crate::measure::exact_sums::{is_soft, true_samples};
use crate::measure::probes::{Half, directional, environments, points, points_between};
use crate::progress::{Progress, Silent};
use crate::scene::Scene;

/// Pairs of samples and vertices, of all lights together, up to which exact sums are over all pairs; beyond it they go through the hierarchy.
const MOST_PAIRS: f64 = 5e8;

/// Pairs of the asset's own samples up to which its stages are told apart.
pub(super) const MOST_OWN_PAIRS: f64 = 2e9;

/// Error asked of that hierarchy, and its share of the error that was asked of the asset at most.
const HIERARCHY_ERROR: f64 = 1e-3;
const SHARE_OF_ASKED: f64 = 0.1;

/// Error that an asset was asked for that does not say so.
const ASKED: f64 = 0.01;

/// Setting of assets whose samples of light are the texels of a texture, and the most of these along an edge where it does not say.
pub(super) const RESOLUTION: &str = "resolution";
const MOST_TEXELS: f64 = 2048.0;

/// Triangles beyond which only every other probe light is tried.
const MANY_TRIANGLES: usize = 50_000;

/// Lights under which the error between vertices is looked at.
const LIGHTS_BETWEEN: usize = 2;

/// Least local radiosity that errors are relative to, in the unit of the channel: what is darker counts as this.
const LOCAL_FLOOR: f64 = 1e-3;

/// Exact radiosity above which a radiosity of 0 was cut off there, in the unit of the channel. Below it cuts are far smaller than any error
/// that is asked for: the bodies of most assets have some.
const CUT_ABOVE: f64 = 1e-3;

/// Whether a channel is cut off at 0 where it is not.
pub(super) fn is_cut(radiosity: DVec3, exact: DVec3, unit: DVec3) -> bool {
    (0..3).any(|c| radiosity[c] == 0.0 && exact[c] > CUT_ABOVE * unit[c])
}

/// What is expected of the radiosity of a vertex. Errors are shares of the RMS of the exact radiosity of a channel over the surface, but the
/// local one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VertexTrust {
    /// Mean over the lights of the absolute error, RGB.
    pub error: DVec3,
    /// The same, relative to the mean of the vertex's own exact radiosity; the worst channel.
    pub local: f64,
    /// Largest error, of any channel, under any of the lights.
    pub worst: f64,
    /// Index of the light with that error.
    pub worst_light: u32,
    /// Unit vector from the vertex towards that light; zero where it comes from all around.
    pub from: DVec3,
    /// Whether a channel is cut off at 0 under one of the lights, where the exact radiosity is above 0.1 % of its RMS.
    pub clamped: bool,
    /// Error of what is drawn around the vertex, linear over each triangle, at centroids and mid-edges; the worst channel.
    pub between: f64,
    /// Distance through the body along the inverse normal, in mean free paths of the channel where these are longest.
    pub thickness: f64,
}

/// Errors of the stages at a vertex, each as the mean over the lights of its absolute value, the worst channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stages {
    /// All pairs of the asset's own samples against the truth.
    pub sampling: f64,
    /// Stored irradiance of environments against rays, under lights that it serves.
    pub environment: f64,
    /// The asset against all pairs of its own samples: transport, functions of the light and coding together.
    pub transport: f64,
}

/// The sums that errors are measured against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sums {
    /// Samples under sharp lights.
    pub samples: usize,
    /// Error that was asked of their hierarchy; none where they are over all pairs.
    pub hierarchy: Option<f64>,
    /// Their own error under the first light, RMS of the worst channel.
    pub error: f64,
}

/// The map of an asset.
#[derive(Clone, Debug)]
pub struct Trust {
    /// Lights that were tried, none of the half for figures: those that the asset is made for and serves.
    pub lights: Vec<Light>,
    /// One entry for each source vertex; zeros for those without transferring area.
    pub vertices: Vec<VertexTrust>,
    /// Stages of each source vertex; none where all pairs of so many samples and vertices are too many, so that they are not told apart.
    pub stages: Option<Vec<Stages>>,
    /// Whether there is stored irradiance whose error is told.
    pub stores_environment: bool,
    /// What was measured against.
    pub sums: Sums,
    /// Error over all vertices, the worst light.
    pub total: VertexError,
}

/// Absolute errors and exact radiosity of a vertex, summed over lights, RGB. Sums of squares tell less of other lights, since one that errs
/// much at a place hides the rest: rank correlations of 0.83 in place of 0.93 (`two_pass` on suzanne).
#[derive(Clone, Copy, Default)]
struct Absolute {
    error: DVec3,
    exact: DVec3,
    sampling: DVec3,
    environment: DVec3,
    transport: DVec3,
}

/// Measures an asset at every vertex.
///
/// # Errors
/// Failures of the work; `Unsupported` where the asset serves none of the lights.
pub fn trust(mut subject: Subject, progress: &dyn Progress) -> Result<Trust> {
    let lights = probe_lights(&mut subject)?;
    let cost = subject.evaluator.cost();
    let asked = asked_rms(&subject);
    let scene = subject.evaluator.scene().clone();
    let samples = true_samples(&scene, asked, cost.samples);
    let all = (cost.receivers.max(1) * lights.len()) as f64;
    let far = if all * samples as f64 <= MOST_PAIRS {
        Far::AllPairs
    } else {
        Far::Hierarchical { error: HIERARCHY_ERROR.min(SHARE_OF_ASKED * asked), bound: Bound::SolidAngle }
    };
    let apart = all * own_samples(&subject) <= MOST_OWN_PAIRS;
    measure(subject, (lights, scene), (samples, far, apart), progress)
}

/// [`trust`] under some lights, against so many samples through a hierarchy or over all pairs, with the stages apart or not.
pub(super) fn measure(
    mut subject: Subject,
    (lights, scene): (Vec<Light>, Scene),
    (samples, far, apart): (usize, Far, bool),
    progress: &dyn Progress,
) -> Result<Trust> {
    let mut exact = Exact::new(&subject, Which::Finer(samples), far);
    let mut own = environment_is_stored(&subject).then(|| Exact::new(&subject, Which::Own, Far::AllPairs));
    let areas = scene.vertex_areas_mm2();
    let count = areas.len();
    let (mut vertices, mut sums) = (vec![VertexTrust::default(); count], vec![Absolute::default(); count]);
    let mut between = Between::new(&scene);
    let between_each = lights.iter().filter(|light| !is_soft(light)).count().div_ceil(LIGHTS_BETWEEN).max(1);
    let (mut total, mut own_error) = (VertexError::default(), 0.0);
    progress.start("trust", lights.len() as u64);
    for (index, light) in lights.iter().enumerate() {
        let served = subject.served(light, apart)?;
        let mut lit = exact.under(light, &Silent)?;
        let truth = lit.at_vertices(&Silent)?;
        let unit = units(&truth, &areas);
        if index == 0 {
            own_error = lit.own_error(&Silent)?;
        }
        if unit.min_element() <= 0.0 {
            // Black: nothing is relative to it.
            progress.advance(1);
            continue;
        }
        if !is_soft(light) && index % between_each == 0 {
            between.enter(&scene, (&mut lit, &truth, unit), &Silent)?;
        }
        total = total.max(vertex_error(&served.radiosity, &truth, &areas).or_none());
        let by_rays = match own.as_mut().filter(|_| apart && is_soft(light)) {
            Some(own) => Some(own.under(light, &Silent)?.at_vertices(&Silent)?),
            None => None,
        };
        for (v, area) in areas.iter().enumerate() {
            if *area <= 0.0 {
                continue;
            }
            let (b, t, sum, vertex) = (served.radiosity[v], truth[v], &mut sums[v], &mut vertices[v]);
            let error = ((b - t) / unit).abs();
            sum.error += error;
            sum.exact += t / unit;
            vertex.clamped |= is_cut(b, t, unit);
            let worst = error.max_element();
            if worst > vertex.worst {
                (vertex.worst, vertex.worst_light) = (worst, index as u32);
                vertex.from = towards(light, scene.mesh.position_mm(v as u32));
            }
            if let Some(pairs) = served.all_pairs.get(v) {
                let sampled = by_rays.as_ref().map_or(*pairs, |rays| rays[v]);
                sum.sampling += ((sampled - t) / unit).abs();
                sum.environment += ((*pairs - sampled) / unit).abs();
                sum.transport += ((b - *pairs) / unit).abs();
            }
        }
        progress.advance(1);
    }
    let depths = thickness(&scene, subject.evaluator.bvh());
    let between = between.at_vertices();
    let n = lights.len().max(1) as f64;
    for (v, vertex) in vertices.iter_mut().enumerate().filter(|(v, _)| areas[*v] > 0.0) {
        let Absolute { error, exact, .. } = sums[v];
        vertex.error = error / n;
        vertex.local = (error / exact.max(DVec3::splat(n * LOCAL_FLOOR))).max_element();
        (vertex.between, vertex.thickness) = (between[v], depths[v]);
    }
    progress.finish();
    let mean = |sum: DVec3| (sum / n).max_element();
    let stages = |sum: &Absolute| Stages {
        sampling: mean(sum.sampling),
        environment: mean(sum.environment),
        transport: mean(sum.transport),
    };
    let hierarchy = match far {
        Far::AllPairs => None,
        Far::Hierarchical { error, .. } => Some(error),
    };
    Ok(Trust {
        lights,
        vertices,
        stages: apart.then(|| sums.iter().map(stages).collect()),
        stores_environment: own.is_some(),
        sums: Sums { samples, hierarchy, error: own_error },
        total,
    })
}

/// Radiosity of an asset under a light.
pub(super) struct Served {
    /// Of every source vertex, RGB.
    pub(super) radiosity: Vec<DVec3>,
    /// The same from all pairs of the asset's own samples; empty where they are not summed.
    pub(super) all_pairs: Vec<DVec3>,
}

impl Subject<'_> {
    /// Radiosity under a light, all pairs as well or not.
    pub(super) fn served(&mut self, light: &Light, with_pairs: bool) -> Result<Served> {
        self.evaluator.set_lights(vec![light.clone()], &Silent)?;
        let radiosity = self.evaluator.radiosity(&Silent)?;
        let all_pairs = if with_pairs { self.evaluator.all_pairs(&Silent)? } else { Vec::new() };
        Ok(Served { radiosity, all_pairs })
    }
}

/// Samples that all pairs of an asset's own are over, at most: the texels of a texture, where it has one.
pub(super) fn own_samples(subject: &Subject) -> f64 {
    let side = subject.asset.provenance.settings.get(RESOLUTION);
    let side = side.map(|text| text.parse::<u32>().map_or(MOST_TEXELS, f64::from));
    side.map_or(subject.evaluator.cost().samples as f64, |side| side * side)
}

/// The error that was asked of an asset.
pub(super) fn asked_rms(subject: &Subject) -> f64 {
    let asked = subject.asset.provenance.settings.get("max-rms").and_then(|text| text.parse::<f64>().ok());
    asked.filter(|asked| asked.is_finite() && *asked > 0.0).unwrap_or(ASKED)
}

/// Whether an asset has stored irradiance of its own samples for environments, whose error its ledger tells.
pub(super) fn environment_is_stored(subject: &Subject) -> bool {
    let entries = &subject.asset.ledger.entries;
    !subject.asset.samples.is_empty() && entries.iter().any(|e| ENVIRONMENT_STAGES.contains(&e.stage.as_str()))
}

/// The lights that a map is made under.
pub(super) fn probe_lights(subject: &mut Subject) -> Result<Vec<Light>> {
    let lights = made_for(subject);
    only_served(subject, lights)
}

/// Probe lights of the tuning half, and points that neither half has, of the kinds that an asset is made for.
fn made_for(subject: &Subject) -> Vec<Light> {
    let mesh = &subject.evaluator.scene().mesh;
    let kinds = subject.asset.provenance.settings.get("for-lights").map_or("", String::as_str);
    let asked = |kind: LightKind| kinds.is_empty() || kinds.split(',').any(|name| name == kind.name());
    let each = if mesh.triangles.len() > MANY_TRIANGLES { 2 } else { 1 };
    let mut lights = Vec::new();
    let points = points(mesh, Half::Tuning).into_iter().chain(points_between(mesh)).collect();
    for set in [directional(Half::Tuning), points, environments(Half::Tuning)] {
        lights.extend(set.into_iter().step_by(each).filter(|light| asked(light.kind())));
    }
    if lights.is_empty() {
        lights = directional(Half::Tuning);
    }
    lights
}

/// Unit vector from a place towards a light; zero where it comes from all around.
fn towards(light: &Light, at_mm: DVec3) -> DVec3 {
    match light {
        Light::Directional { from, .. } => *from,
        Light::Point { at_mm: place, .. } | Light::Spot { at_mm: place, .. } | Light::Area { at_mm: place, .. } => {
            (*place - at_mm).normalize_or_zero()
        }
        Light::Constant { .. } | Light::Environment { .. } => DVec3::ZERO,
    }
}

/// Leaves out the lights that an asset does not carry.
fn only_served(subject: &mut Subject, lights: Vec<Light>) -> Result<Vec<Light>> {
    let mut kept = Vec::new();
    let mut refused = None;
    for light in lights {
        match subject.evaluator.set_lights(vec![light.clone()], &Silent) {
            Ok(()) => kept.push(light),
            Err(error) if error.code() == ExitCode::Unsupported => refused = Some(error),
            Err(error) => return Err(error),
        }
    }
    match (kept.is_empty(), refused) {
        (true, Some(error)) => Err(error.at("probe lights")),
        (true, None) => Err(Error::unsupported("probe lights: the asset serves none of them")),
        (false, _) => Ok(kept),
    }
}
