//! `auto`: chooses a method and its settings for a request, bakes, and measures the asset from end to end.
//!
//! The choice rests on forecasts of the forms ([`Forecast`](crate::evaluate::Forecast)), which follow from numbers of the scene, and on one
//! measurement, the error of sampling at a few vertices. No clock decides: the same scene and request give the same asset anywhere.
//! What was chosen is baked, and judged by lights and vertices that the choice did not see; what misses the request is baked anew with
//! finer settings, or with the next method.

mod candidates;
mod choice;
mod lights;
mod record;
mod request;
#[cfg(test)]
mod tests;
mod truth;
mod verdict;

use std::sync::Arc;
use std::time::Instant;

use translux_format::RawSection;

use self::candidates::{Candidate, Candidates};
use self::choice::Choice;
use self::lights::{Purpose, lights};
pub use self::record::{Attempt, Considered, Expected, Left, Plan, SCHEMA, Timings};
pub use self::request::{DEFAULT_MAX_RMS, Edits, Request};
use self::truth::{Inside, Places, Sampling, TrueSums, Truth, between_few_vertices, samples_of_a_choice, telling};
use self::verdict::{Verdict, misses};
use crate::asset::{Asset, Provenance};
use crate::error::Result;
use crate::evaluate::forecast::Body;
use crate::evaluate::{Model, Recipe, Registry, StageCache};
use crate::geometry::samples::Samples;
use crate::measure::probes::for_bake;
use crate::progress::Progress;
use crate::report::inspection::PLAN;
use crate::report::sizes::{Sizes, sizes};
use crate::report::text::{percent, significant};
use crate::scene::Scene;
use crate::transport::calibration::any_is_closed;

/// Places at which the choice measures.
const PLACES: usize = 128;

/// Bakes at most: what was expected to meet the request and did not is replaced so often.
const BAKES: usize = 4;

/// Samples of an asset that is made for the size of its mesh alone.
const FEWEST: usize = 1;

/// A plan, and the asset that came of it: the one that meets the request, else the one that comes nearest, or none where nothing could.
pub struct Planned {
    /// What was considered, measured and chosen.
    pub plan: Plan,
    /// The asset, with the plan in sentences among the notes of its provenance; see [`Plan::is_met`].
    pub asset: Option<Asset>,
}

/// What a plan may use, and where an asset comes from.
pub struct Setting<'a> {
    /// Methods and forms.
    pub registry: &'a Registry,
    /// Files, unit and repairs of the scene.
    pub provenance: Provenance,
    /// Memory that a bake may take, bytes.
    pub max_memory: u64,
    /// Is told of each bake, before it is made, what it is expected to take of that.
    pub foresee: &'a (dyn Fn(u64) + Sync),
    /// Results of stages of earlier bakes.
    pub cache: StageCache,
}

/// Chooses, bakes and measures.
///
/// # Errors
/// Failures of the work. A request that cannot be met is none: the plan says so.
pub fn bake(request: &Request, scene: &Scene, setting: &Setting, progress: &dyn Progress) -> Result<Planned> {
    let started = Instant::now();
    let Prepared { all, families, mut plan, kernels, between, truth, mut sums } =
        prepared(request, scene, setting, progress)?;
    let request = &plan.request.clone();
    let mut sampling = Sampling::new(scene, &kernels, (truth, sums.samples), request);
    let mut choice = Choice::new(&all, request, families);
    let mut verdict: Option<Verdict> = None;
    let mut kept: Option<(Asset, f64)> = None;
    let mut met = false;
    plan.timings.choice_s = started.elapsed().as_secs_f64();
    while plan.attempts.len() < BAKES && !met {
        let choosing = Instant::now();
        let next = choice.next(&mut plan.considered, &mut sampling)?;
        plan.timings.choice_s += choosing.elapsed().as_secs_f64();
        plan.request.max_rms = choice.max_rms();
        let Some(candidate) = next.and_then(|index| all.get(index)) else { break };
        (setting.foresee)(candidate.memory);
        let baking = Instant::now();
        let (asset, evaluator) = candidate.recipe.bake_and_open(scene.clone(), setting.provenance.clone(), progress)?;
        plan.timings.bake_s += baking.elapsed().as_secs_f64();

        let judging = Instant::now();
        let judge = match verdict.take().filter(|verdict| verdict.suits(candidate)) {
            Some(verdict) => verdict,
            None => Verdict::new(&mut sums, (scene, request, between), candidate, &asset, progress)?,
        };
        let sizes = sizes(&asset.to_bytes()?)?;
        let evaluator = evaluator.map_or_else(|| setting.registry.open(Arc::new(asset.clone())), Ok)?;
        let (attempt, relight_ms) = judge.judge(evaluator, (candidate, &sizes), &plan.request, progress)?;
        verdict = Some(judge);
        plan.timings.verdict_s += judging.elapsed().as_secs_f64();
        choice.learn(candidate, &attempt, &mut plan.considered, &mut sampling)?;
        let missed = excess(&plan.request, &attempt);
        if kept.as_ref().is_none_or(|(_, least)| missed < *least) {
            kept = Some((asset, missed));
            plan.timings.relight_ms = relight_ms;
            plan.kept = Some(plan.attempts.len());
        }
        met = attempt.misses.is_empty();
        plan.attempts.push(attempt);
    }
    plan.sampling = sampling.known();
    conclude(&mut plan, &choice, &mut sampling, scene)?;
    let mut asset = kept.map(|(asset, _)| asset);
    if let Some(asset) = &mut asset {
        asset.provenance.origin.notes.extend(plan.sentences().into_iter().map(|line| format!("{PLAN}{line}")));
        sized(&mut plan, &sizes(&asset.to_bytes()?)?, asset.scene.mesh.local_mm.len());
    }
    Ok(Planned { plan, asset })
}

/// The recipe that [`bake`] would bake first, and the most memory that this takes, bytes; none where nothing is expected to meet the request.
///
/// # Errors
/// Failures of the work.
pub fn choose(
    request: &Request,
    scene: &Scene,
    setting: &Setting,
    progress: &dyn Progress,
) -> Result<Option<(Recipe, u64)>> {
    let Prepared { all, families, mut plan, kernels, truth, sums, .. } = prepared(request, scene, setting, progress)?;
    let request = &plan.request.clone();
    let mut sampling = Sampling::new(scene, &kernels, (truth, sums.samples), request);
    let next = Choice::new(&all, request, families).next(&mut plan.considered, &mut sampling)?;
    let chosen = next.and_then(|index| all.into_iter().nth(index));
    Ok(chosen.map(|Candidate { recipe, memory, .. }| (recipe, memory)))
}

/// What a choice is made among, and the truth that it measures by.
struct Prepared {
    all: Vec<Candidate>,
    families: usize,
    plan: Plan,
    kernels: Vec<RawSection>,
    /// Whether vertices alone say nothing of the surface.
    between: bool,
    truth: Truth,
    sums: TrueSums,
}

fn prepared(request: &Request, scene: &Scene, setting: &Setting, progress: &dyn Progress) -> Result<Prepared> {
    // What no walk could calibrate is planned as what it will be.
    let has_volume = request.model != Model::Dipole && any_is_closed(scene.domain());
    let model = if has_volume { request.model } else { Model::Dipole };
    let Inside { kernels, walks, error, sums: spare } = Inside::new(model, scene, progress)?;
    let request = &Request { model, ..request.beside(error) };
    let between = between_few_vertices(scene, PLACES, progress)?;
    let costs = (mesh_bytes(scene)?, setting.max_memory);
    let found = Candidates::new(setting.registry, request, (scene, between), costs);
    let Candidates { mut all, considered, families } = found;
    let plan = Plan::new(request, (Body::of(scene), error), considered);
    let mut probes = for_bake(scene);
    for lights in [&mut probes.tuning, &mut probes.unseen] {
        lights.retain(|light| request.for_lights.contains(&light.kind()));
    }
    let seen = telling(lights(scene, &request.for_lights, Purpose::Choice)?, scene, request.model);
    let between = between.is_some();
    let places = if between { Places::between(scene, PLACES, 0) } else { Places::new(scene, PLACES, 0) };
    let samples = samples_of_a_choice(scene, request.max_rms, request.model);
    for candidate in &mut all {
        candidate.recipe.settings.probes.clone_from(&probes);
        candidate.recipe.settings.kernels.clone_from(&kernels);
        candidate.recipe.settings.walks.clone_from(&walks);
        candidate.recipe.settings.cache = setting.cache.clone();
    }
    let mut sums = TrueSums::new(scene, (samples, request.max_rms), (kernels.clone(), spare));
    let truth = Truth::new(&mut sums, (seen, places), progress)?;
    Ok(Prepared { all, families: families.len(), plan, kernels, between, truth, sums })
}

/// What the mesh takes in a file, bytes: nothing that a method adds.
///
/// # Errors
/// A mesh that no file holds.
pub fn mesh_bytes(scene: &Scene) -> Result<u64> {
    let asset = Asset::of_scene(scene.clone(), Samples::new(&scene.mesh, &scene.parts, FEWEST), Vec::new());
    let sizes = sizes(&asset.to_bytes()?)?;
    Ok(sizes.file - sizes.stored_without_mesh)
}

/// How far an asset is beyond a request: the largest of what it has over what is allowed.
fn excess(request: &Request, attempt: &Attempt) -> f64 {
    let over = |found: f64, most: Option<f64>| most.map_or(0.0, |most| found / most);
    let shares = [
        over(attempt.error.rms, Some(request.max_rms)),
        over(attempt.error.dark, request.max_dark),
        over(attempt.bytes_per_vertex, request.max_bytes_per_vertex),
        over(attempt.bytes as f64, request.max_bytes.map(|most| most as f64)),
    ];
    shares.into_iter().fold(0.0, f64::max)
}

/// Enters what came of the attempts: what is missed, what would meet it, and what the scene does not need.
fn conclude(plan: &mut Plan, choice: &Choice, sampling: &mut Sampling, scene: &Scene) -> Result<()> {
    if let Some(attempt) =
        plan.kept.and_then(|index| plan.attempts.get_mut(index)).filter(|attempt| !attempt.misses.is_empty())
    {
        // What was measured may be the best there is; where nobody asked for less it will do.
        if let Some(larger) = plan.request.relaxed(attempt.error.rms) {
            plan.request.max_rms = larger;
            attempt.misses = misses(&plan.request, attempt);
        }
    }
    let kept = plan.kept.and_then(|index| plan.attempts.get(index)).cloned();
    plan.misses = match &kept {
        Some(attempt) => attempt.misses.clone(),
        None => vec!["nothing that could be baked is expected to meet it".to_owned()],
    };
    if !plan.misses.is_empty() {
        plan.would_meet = Some(choice.would_meet(&plan.considered, sampling)?);
    }
    let Some(chosen) = kept.and_then(|attempt| plan.considered.get(attempt.considered)).cloned() else { return Ok(()) };
    if let Some(samples) = chosen.samples {
        let error = sampling.error(samples)?;
        plan.dropped.push(format!("more than {samples} samples: these are {} off", percent(error.rms)));
    }
    if chosen.by_rays {
        plan.dropped.push("irradiance of environments for each sample: rays bring it in the time allowed".to_owned());
    }
    let unused = crate::light::LightKind::STORABLE.iter().filter(|kind| !plan.request.for_lights.contains(kind));
    let unused: Vec<&str> = unused.map(|kind| kind.name()).collect();
    if !unused.is_empty() {
        plan.dropped.push(format!("errors and data of light that was not asked for: {}", unused.join(", ")));
    }
    for (index, medium) in scene.media.iter().enumerate() {
        if !scene.parts.parts.iter().any(|part| part.medium == Some(index as u32)) {
            plan.dropped
                .push(format!("the medium {}, which no part is made of, has no say in any choice", medium.name));
        }
        let properties = &medium.properties;
        let grey = |v: glam::DVec3| v.x == v.y && v.y == v.z;
        if grey(properties.sigma_s_reduced_per_mm) && grey(properties.sigma_a_per_mm) {
            plan.dropped.push(format!(
                "nothing of two channels of {}, although all three are equal: no form stores one alone",
                medium.name
            ));
        }
    }
    Ok(())
}

/// Enters the final size of the file, which holds the plan itself, and judges it.
fn sized(plan: &mut Plan, sizes: &Sizes, vertices: usize) {
    let Some(attempt) = plan.kept.and_then(|index| plan.attempts.get_mut(index)) else { return };
    attempt.bytes = sizes.file;
    attempt.bytes_per_vertex = (sizes.stored_without_mesh + sizes.stored_environment) as f64 / vertices.max(1) as f64;
    attempt.misses = misses(&plan.request, attempt);
    plan.misses.clone_from(&attempt.misses);
}

impl Plan {
    /// Judges the times of this run, where they were asked for; `seconds` is what the whole bake took. The asset does not hold this
    /// part of the verdict, which depends on the machine.
    pub fn judge_times(&mut self, seconds: f64) {
        self.timings.total_s = seconds;
        let over = |found: f64, most: Option<f64>| most.filter(|most| found > *most);
        if let Some(most) = over(seconds, self.request.max_bake_s) {
            let [found, most] = [seconds, most].map(significant);
            self.timings.misses.push(format!("the bake took {found} s on this machine, more than {most} s"));
        }
        if let Some((found, most)) =
            self.timings.relight_ms.and_then(|found| Some((found, over(found, self.request.max_relight_ms)?)))
        {
            let [found, most] = [found, most].map(significant);
            self.timings.misses.push(format!("a new light takes {found} ms on this machine, more than {most} ms"));
        }
    }
}
