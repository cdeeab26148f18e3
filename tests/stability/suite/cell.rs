//! One method under one light of a case: what was promised, what is measured, and the verdict.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use translux::Imported;
use translux::asset::Asset;
use translux::compress::ledger::{Ledger, SUN_ALONE};
use translux::error::{Error, ExitCode, Result};
use translux::evaluate::{BakeSettings, Evaluator, Model, StageCache};
use translux::light::LightKind;
use translux::math::statistics::VertexError;
use translux::measure::between_vertices::between_vertices;
use translux::measure::light_places::{Doubt, doubtful};
use translux::measure::probes;
use translux::measure::sample_spacing::too_far_apart;
use translux::methods;
use translux::plan::{self, DEFAULT_MAX_RMS, Planned, Request, Setting};
use translux::progress::Silent;
use translux::report::sizes::sizes;
use translux::scene::Scene;

use super::lamps::Lamp;
use super::truth::Truth;
use super::{By, Case, Way};

/// Errors below this, and below the truth's own, are none.
const FLOOR: f64 = 1e-3;

/// What an RMS over some of the vertices may differ by from that over others.
const SUBSET: f64 = 1.02;

/// An error between vertices that the import warns of.
const BETWEEN: f64 = 0.05;

/// Radiosity below this share of the mean that is set to 0 is not counted as clamped.
const CLAMPED: f64 = 1e-3;

/// How a cell ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// The error is between half of the promised one and that, or both are below what the truth can tell.
    Passed,
    /// Refused with a reason.
    Refused,
    /// The error is above the promised one, and a warning names a fault of the mesh or of the light's place.
    Warned,
    /// Less than half of the promised error.
    Pessimistic,
    /// The error is above the promised one, and nothing says so.
    Unannounced,
    /// Values that are not finite, or more negative than the promised worst error lets them be.
    Broken,
    /// No result within the time.
    Unfinished,
}

/// A method under a light of a case.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cell {
    pub case: String,
    pub light: String,
    pub way: String,
    pub verdict: Verdict,
    pub promised: VertexError,
    pub measured: VertexError,
    /// Error of the truth itself.
    pub truth: f64,
    /// Error between vertices, of the mesh under probe lights; 0 where it is fine enough not to be looked at.
    pub between: f64,
    /// Share of values that are 0 where the truth is not.
    pub clamped: f64,
    pub bytes_per_vertex: f64,
    /// Warnings, or the reason of a refusal.
    pub says: Vec<String>,
}

/// A case with its scene and its truth, which all methods share.
pub struct Session<'a> {
    case: &'a Case,
    imported: Result<Imported>,
    /// Faults of the mesh, and other warnings of the import, which stand on sound meshes too.
    faults: Vec<String>,
    warnings: Vec<String>,
    between: f64,
    /// By whether the kernels are dipoles.
    truths: BTreeMap<bool, Truth>,
    /// True radiosity and its own error, by light and by whether it is that of dipoles.
    known: BTreeMap<(String, bool), (Vec<DVec3>, f64)>,
    /// RMS radiosity under the first light.
    brightest: Option<f64>,
}

impl<'a> Session<'a> {
    pub fn new(case: &'a Case) -> Self {
        let imported = case.imported();
        let (mut faults, mut warnings, mut between) = (Vec::new(), Vec::new(), 0.0);
        if let Ok(Imported { scene, check, .. }) = &imported {
            faults = check.faults();
            warnings = check.warnings();
            if scene.may_be_coarse() {
                between = between_vertices(scene, &Silent).map_or(0.0, |error| error.rms);
                if between > BETWEEN {
                    warnings.push(format!("{:.0} % off between vertices", 100.0 * between));
                }
            }
        }
        let (truths, known) = (BTreeMap::new(), BTreeMap::new());
        Self { case, imported, faults, warnings, between, truths, known, brightest: None }
    }

    /// Runs a way on all lights of the case.
    pub fn run(&mut self, way: &Way) -> Vec<Cell> {
        let case = self.case;
        let of_all = |why: &Error| case.lamps.iter().map(|lamp| refused(case, *lamp, way, why)).collect();
        let opened = match &self.imported {
            Ok(imported) => opened(case, way, imported.clone()),
            Err(why) => return of_all(why),
        };
        let mut opened = match opened {
            Ok(opened) => opened,
            Err(why) => return of_all(&why),
        };
        let stored = opened.is_stored(case);
        let mut cells = Vec::new();
        for lamp in &case.lamps {
            let cell = self.under(*lamp, way, &mut opened);
            cells.push(cell.unwrap_or_else(|why| refused(case, *lamp, way, &why)));
        }
        // What an asset promises holds for every light: its worst one says whether it is too much.
        let told = opened.asked.map(|(_, found)| found.rms);
        let near = |cell: &Cell| {
            let promised = told.unwrap_or(cell.promised.rms);
            cell.measured.rms >= 0.5 * promised && promised > 0.0
        };
        if stored && cells.iter().any(near) {
            let pessimistic = cells.iter_mut().filter(|cell| cell.verdict == Verdict::Pessimistic);
            pessimistic.for_each(|cell| cell.verdict = Verdict::Passed);
        }
        cells
    }

    /// What a way promises, by stage: the ledger of an asset that holds transport, else what `--measure` tells under each light.
    pub fn stages(&self, way: &Way) -> Result<Vec<(String, Ledger)>> {
        let mut opened = opened(self.case, way, self.imported.clone()?)?;
        if opened.is_stored(self.case) {
            return Ok(vec![("ledger".to_owned(), opened.asset.ledger)]);
        }
        let under = |lamp: &Lamp| {
            opened.evaluator.set_lights(vec![lamp.light(&opened.shown)?], &Silent)?;
            Ok((lamp.name(), probes::by_stage(opened.evaluator.as_mut(), &Silent)?))
        };
        self.case.lamps.iter().map(under).collect()
    }

    /// The cell of one light.
    fn under(&mut self, lamp: Lamp, way: &Way, opened: &mut Opened) -> Result<Cell> {
        let Opened { asset, evaluator, shown, model, .. } = &mut *opened;
        let light = lamp.light(shown)?;
        let mut says = self.faults.clone();
        says.extend(doubtful(shown, std::slice::from_ref(&light), evaluator.cost().samples).iter().map(|found| {
            let what = match found.doubt {
                Doubt::Misses => "aimed past the object",
                Doubt::Inside => "inside the body",
                Doubt::OnSurface => "on the surface",
                Doubt::Near => "nearer to the surface than samples lie apart",
                Doubt::Narrow => "narrower than samples lie apart",
            };
            format!("the light is {what}")
        }));
        says.extend(too_far_apart(shown, asset.samples.len()));
        let excused = !says.is_empty();
        says.extend(self.warnings.iter().cloned());
        evaluator.set_lights(vec![light.clone()], &Silent)?;
        let all = evaluator.radiosity(&Silent)?;
        let dipoles = *model == Model::Dipole;
        let truth = self.truths.entry(dipoles).or_insert_with(|| match model {
            Model::Dipole => Truth::new(shown, self.case.samples.is_none()),
            Model::Calibrated(_) => Truth::of_asset(shown, *model, asset),
        });
        let (expected, own) = match self.known.entry((lamp.name(), dipoles)) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(free) => free.insert(truth.under(shown, &light)?),
        };
        let values = truth.places.of(&all);
        let black = expected.iter().chain(&values).all(|b| *b == DVec3::ZERO);
        let rms = |values: &[DVec3]| {
            (values.iter().map(|b| b.length_squared()).sum::<f64>() / values.len().max(1) as f64).sqrt()
        };
        let brightest = *self.brightest.get_or_insert_with(|| rms(expected));
        let measured = if expected.iter().all(|b| *b == DVec3::ZERO) && brightest > 0.0 {
            // Nothing is relative to black: light where there is none is told by what the first light of the row brings.
            let grey = DVec3::splat(brightest / 3f64.sqrt());
            let lit: Vec<DVec3> = values.iter().map(|b| *b + grey).collect();
            finite(truth.places.error(&lit, &vec![grey; values.len()]))
        } else {
            finite(truth.places.error(&values, expected))
        };
        let [promised, least] = match opened.asked {
            // An asset is made for a request; what it is told to be is what the planner found.
            Some((asked, found)) => [VertexError { rms: asked, ..finite(found) }, finite(found)],
            None => [finite(opened.promise(self.case, lamp)?); 2],
        };
        let floor = own.max(FLOOR);
        // What is measured has the error of the truth in it, and what is promised was measured at other vertices.
        let most = SUBSET * promised.rms.hypot(*own) + 0.1 * floor;
        // Negative values are errors like others: as large as was promised.
        let mean_square = expected.iter().map(|b| *b * *b).sum::<DVec3>() / expected.len().max(1) as f64;
        let bound = -promised.worst.max(floor) * mean_square.max_element().sqrt();
        let sound = all.iter().all(|b| b.is_finite() && b.min_element() >= bound);
        let verdict = match measured.rms {
            _ if !sound => Verdict::Broken,
            _ if black => Verdict::Passed,
            rms if rms <= floor && promised.rms <= 4.0 * floor => Verdict::Passed,
            rms if rms > most && !excused => Verdict::Unannounced,
            rms if rms > most => Verdict::Warned,
            rms if rms < 0.5 * least.rms => Verdict::Pessimistic,
            _ => Verdict::Passed,
        };
        Ok(Cell {
            promised,
            measured,
            truth: *own,
            between: self.between,
            clamped: clamped(&values, expected),
            bytes_per_vertex: opened.bytes_per_vertex,
            ..Cell::without_figures(self.case, lamp, way.name, verdict, says)
        })
    }
}

impl Cell {
    /// A cell that nothing was measured for.
    pub fn without_figures(case: &Case, lamp: Lamp, way: &str, verdict: Verdict, says: Vec<String>) -> Self {
        Self {
            case: case.name.to_owned(),
            light: lamp.name(),
            way: way.to_owned(),
            verdict,
            promised: VertexError::default(),
            measured: VertexError::default(),
            truth: 0.0,
            between: 0.0,
            clamped: 0.0,
            bytes_per_vertex: 0.0,
            says,
        }
    }
}

/// The cell of a refusal; one without a reason passes for none.
fn refused(case: &Case, lamp: Lamp, way: &Way, why: &Error) -> Cell {
    let verdict = if why.message().is_empty() { Verdict::Unannounced } else { Verdict::Refused };
    Cell::without_figures(case, lamp, way.name, verdict, vec![why.message().to_owned()])
}

/// What was asked of a planned asset, and the error that the planner found.
type Asked = (f64, VertexError);

/// An asset, ready.
struct Opened {
    asset: Asset,
    bytes_per_vertex: f64,
    model: Model,
    asked: Option<Asked>,
    evaluator: Box<dyn Evaluator>,
    /// The scene with the media in force.
    shown: Scene,
}

fn opened(case: &Case, way: &Way, imported: Imported) -> Result<Opened> {
    let mut shown = imported.scene.clone();
    let (asset, model, asked) = match way.by {
        By::Method(method, set) => (baked(case, (method, set), imported)?, Model::Dipole, None),
        By::Planner(model) => {
            let (asset, model, asked) = planned(case, model, imported)?;
            (asset, model, Some(asked))
        }
    };
    let sizes = sizes(&asset.to_bytes()?)?;
    let bytes = (sizes.stored_without_mesh + sizes.stored_environment) as f64;
    let bytes_per_vertex = bytes / asset.scene.mesh.local_mm.len().max(1) as f64;
    let mut evaluator = methods::built_in().open(Arc::new(asset.clone()))?;
    if let Some(edited) = case.edited {
        shown.media.iter_mut().for_each(|medium| medium.properties = edited);
        evaluator.set_media(shown.media.clone())?;
    }
    Ok(Opened { asset, bytes_per_vertex, model, asked, evaluator, shown })
}

/// The kinds of light of a case.
fn kinds(case: &Case) -> BTreeSet<LightKind> {
    case.lamps.iter().map(|lamp| lamp.kind()).collect()
}

/// The asset of a method.
fn baked(case: &Case, (name, set): (&str, &[(&'static str, &'static str)]), imported: Imported) -> Result<Asset> {
    let registry = methods::built_in();
    let method = registry.method(name)?;
    let own = case.set.iter().filter(|(method, _, _)| *method == name).map(|&(_, key, value)| (key, value));
    let given: Vec<(String, String)> =
        set.iter().copied().chain(own).map(|(k, v)| (k.to_owned(), v.to_owned())).collect();
    let settings = BakeSettings {
        samples: case.samples,
        for_lights: kinds(case),
        probes: probes::for_bake(&imported.scene),
        ..BakeSettings::new(method.default_max_rms())
    };
    method.recipe(&given, settings)?.bake(imported.scene, imported.origin.into(), &Silent)
}

/// The asset of the planner, its model, what was asked of it and what it is told to be; an error where the request is missed.
fn planned(case: &Case, model: Model, imported: Imported) -> Result<(Asset, Model, Asked)> {
    const MEMORY: u64 = 4 << 30;
    let registry = methods::built_in();
    let setting = Setting {
        registry: &registry,
        provenance: imported.origin.into(),
        max_memory: MEMORY,
        foresee: &|_| (),
        cache: StageCache::default(),
    };
    let request = Request { max_rms_may_grow: true, model, ..Request::new(DEFAULT_MAX_RMS, kinds(case)) };
    let Planned { plan, asset } = plan::bake(&request, &imported.scene, &setting, &Silent)?;
    let found = plan.kept.and_then(|index| plan.attempts.get(index)).map(|attempt| attempt.error);
    match (asset, found) {
        (Some(asset), Some(found)) if plan.is_met() => Ok((asset, plan.request.model, (plan.request.max_rms, found))),
        _ => Err(Error::new(ExitCode::QualityNotMet, plan.misses.join("; "))),
    }
}

impl Opened {
    /// Whether the ledger of the asset makes the promise.
    fn is_stored(&self, case: &Case) -> bool {
        self.asked.is_some() || self.asset.ledger.total_rms_without_environment() > 0.0 && case.edited.is_none()
    }

    /// What was promised: the ledger of an asset that holds transport, else what `--measure` tells.
    fn promise(&mut self, case: &Case, lamp: Lamp) -> Result<VertexError> {
        let Self { asset, evaluator, .. } = &*self;
        if self.is_stored(case) {
            let far = lamp.kind() == LightKind::Environment;
            let ledger = &asset.ledger;
            let rms = if far { ledger.total_rms() } else { ledger.total_rms_without_environment() };
            let all = VertexError { rms, ..summed(ledger) };
            // Of an environment with a sun in it some methods say apart what they are worth.
            let sun = ledger.entries.iter().find(|entry| entry.stage == SUN_ALONE && lamp.is_sun_of_environment());
            return Ok(sun.map_or(all, |sun| all.max(sun.error)));
        }
        if evaluator.scene().parts.parts.iter().all(|part| !part.transfers()) {
            return Ok(VertexError::default());
        }
        let ledger = probes::by_stage(self.evaluator.as_mut(), &Silent)?;
        Ok(VertexError { rms: ledger.total_rms(), ..summed(&ledger) })
    }
}

/// Figures that files of text can hold.
fn finite(error: VertexError) -> VertexError {
    let cut = |v: f64| if v.is_finite() { v.clamp(-1e9, 1e9) } else { 1e9 };
    let VertexError { rms, bias, p999, worst, dark } = error;
    VertexError { rms: cut(rms), bias: cut(bias), p999: cut(p999), worst: cut(worst), dark: cut(dark) }
}

/// The figures of the stages together, as their RMS.
fn summed(ledger: &Ledger) -> VertexError {
    ledger.of_radiosity().fold(VertexError::default(), |sum, entry| VertexError {
        rms: sum.rms + entry.error.rms,
        bias: sum.bias + entry.error.bias,
        p999: sum.p999 + entry.error.p999,
        worst: sum.worst + entry.error.worst,
        dark: sum.dark + entry.error.dark,
    })
}

/// Share of values that are 0 where the truth is not.
fn clamped(values: &[DVec3], truth: &[DVec3]) -> f64 {
    let mean = truth.iter().map(|b| b.element_sum()).sum::<f64>() / (3 * truth.len()).max(1) as f64;
    let of = |(v, t): (&DVec3, &DVec3)| (0..3).filter(|&c| v[c] <= 0.0 && t[c] > CLAMPED * mean).count();
    values.iter().zip(truth).map(of).sum::<usize>() as f64 / (3 * values.len()).max(1) as f64
}
