//! `bake --method auto`: the request as typed and as resolved, the plan, its report.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::baking::{BakeOptions, light_kinds};
use super::console::{Console, Unitless, parse_size};
use super::output::probe;
use crate::asset::{Asset, Provenance, REQUEST};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::keys::share;
use crate::evaluate::{Model, Recipe, StageCache};
use crate::forms::gathered::uncalibrated;
use crate::import::Imported;
use crate::import::file::suffix;
use crate::io::atomic;
use crate::plan::{self, DEFAULT_MAX_RMS, Edits, Plan, Planned, Request, Setting};
use crate::report::text::percent;
use crate::scene::Scene;

/// Name of the method that stands for a plan.
pub(super) const AUTO: &str = "auto";

/// Limits that a plan keeps, beside the error and the kinds of light.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "What --method auto keeps to")]
pub(super) struct PlanOptions {
    /// Largest error of the dark part (vertices below a tenth of the mean, relative to their own mean), such as 10%
    #[arg(long, value_name = "E")]
    max_dark: Option<String>,
    /// Edits of the material that need no new bake (default: none)
    #[arg(long, value_name = "EDITS")]
    edit: Option<Edit>,
    /// Largest size for each vertex, the mesh apart, in bytes
    #[arg(long, value_name = "BYTES")]
    max_bytes_per_vertex: Option<f64>,
    /// Largest size of the file, such as 2MB or 500KiB; without a unit in bytes
    #[arg(long, value_name = "SIZE")]
    max_bytes: Option<String>,
    /// Longest time to new radiosity after a change of the light, in ms (default: a second, if anything can)
    #[arg(long, value_name = "MS")]
    max_relight_ms: Option<f64>,
    /// Longest bake, planning included, in s (default: ten minutes, if anything can)
    #[arg(long, value_name = "S")]
    max_bake_s: Option<f64>,
    /// JSON file for the plan: what was considered, measured, chosen and left out, and why
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Edit {
    /// The material may be baked in
    None,
    /// Its absorption stays free
    Absorption,
    /// All of it stays free
    Any,
}

impl PlanOptions {
    /// Refuses limits beside a method that is named: it keeps none.
    pub(super) fn refuse_for(&self, method: &str) -> Result<()> {
        let given = [
            (self.max_dark.is_some(), "--max-dark"),
            (self.edit.is_some(), "--edit"),
            (self.max_bytes_per_vertex.is_some(), "--max-bytes-per-vertex"),
            (self.max_bytes.is_some(), "--max-bytes"),
            (self.max_relight_ms.is_some(), "--max-relight-ms"),
            (self.max_bake_s.is_some(), "--max-bake-s"),
            (self.report.is_some(), "--report"),
        ];
        match given.into_iter().find(|(given, _)| *given) {
            Some((_, flag)) => Err(Error::command_line(format!(
                "{flag} is for --method auto, which chooses a method that keeps it; `{method}` is baked as it is told: leave {flag} or \
                 --method out"
            ))),
            None => Ok(()),
        }
    }

    /// The request; refuses what a plan decides itself.
    pub(super) fn resolve(&self, options: &BakeOptions, model: Model) -> Result<Request> {
        if let Some(text) = options.set.first() {
            return Err(Error::command_line(format!(
                "--set {text}: keys belong to a method, and --method auto chooses the method and its keys; name the method too"
            )));
        }
        if options.samples.is_some() {
            return Err(Error::command_line(
                "--samples: --method auto takes as many as the error needs; name a method to say how many",
            ));
        }
        let max_rms = options.max_rms.as_deref().map_or(Ok(DEFAULT_MAX_RMS), |text| share(text, "--max-rms"))?;
        let positive = |flag: &str, value: Option<f64>| match value {
            Some(value) if !(value.is_finite() && value > 0.0) => {
                Err(Error::command_line(format!("{flag} {value}: a number above 0 is needed")))
            }
            value => Ok(value),
        };
        Ok(Request {
            max_dark: self.max_dark.as_deref().map(|text| ratio(text, "--max-dark")).transpose()?,
            edit: match self.edit {
                None | Some(Edit::None) => Edits::None,
                Some(Edit::Absorption) => Edits::Absorption,
                Some(Edit::Any) => Edits::Any,
            },
            max_bytes_per_vertex: positive("--max-bytes-per-vertex", self.max_bytes_per_vertex)?,
            max_bytes: self
                .max_bytes
                .as_deref()
                .map(|text| parse_size("--max-bytes", text, Unitless::Bytes))
                .transpose()?,
            max_relight_ms: positive("--max-relight-ms", self.max_relight_ms)?,
            max_bake_s: positive("--max-bake-s", self.max_bake_s)?,
            max_rms_may_grow: options.max_rms.is_none(),
            model,
            ..Request::new(max_rms, light_kinds(&options.for_lights)?)
        })
    }

    /// Refuses a file for the plan that cannot be written, before the work rather than after it.
    pub(super) fn check_report(&self, asset: &Path) -> Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        if suffix(path) != "json" {
            return Err(Error::command_line(format!("--report {}: the name must end in .json", path.display())));
        }
        if path == asset {
            return Err(Error::command_line(format!("--report {}: that is the asset", path.display())));
        }
        probe("--report", path)
    }

    /// Writes the plan where it is asked for.
    pub(super) fn write(&self, plan: &Plan) -> Result<()> {
        let Some(path) = &self.report else { return Ok(()) };
        let text = serde_json::to_string_pretty(plan).map_err(|e| Error::runtime(format!("plan: {e}")))?;
        atomic::write(path, format!("{text}\n").as_bytes())
    }
}

/// Plans and bakes an imported model; the plan, and its asset if there is one.
pub(super) fn bake(
    request: &Request,
    imported: Imported,
    (hash, cache): (String, StageCache),
    console: &Console,
) -> Result<(Plan, Option<Asset>)> {
    let Imported { scene, origin, .. } = imported;
    let mut provenance = Provenance::from(origin);
    provenance.settings.insert(REQUEST.to_owned(), hash);
    let setting = Setting {
        registry: &console.registry,
        provenance,
        max_memory: console.free_memory(),
        foresee: &|more| {
            console.foresee_memory(more);
        },
        cache,
    };
    let Planned { mut plan, asset } = plan::bake(request, &scene, &setting, console)?;
    plan.judge_times(console.seconds());
    if let Some(default) = plan.relaxed().filter(|_| asset.is_some()) {
        let [default, reached] = [default, plan.request.max_rms].map(percent);
        console.warn(&format!(
            "nothing reaches {default} here, and {reached} was taken in its place: --max-rms says what is needed"
        ));
    }
    if request.model != Model::Dipole && plan.request.model == Model::Dipole {
        console.warn("no part is closed: all keep their dipoles, which need no volume");
    }
    for part in asset.iter().flat_map(uncalibrated) {
        console.warn(&format!("part `{part}` is not closed: it keeps its dipole, which needs no volume"));
    }
    Ok((plan, asset))
}

/// The recipe that a plan would bake first, and the most memory that this takes, bytes.
pub(super) fn choose(request: &Request, scene: &Scene, origin: Provenance, console: &Console) -> Result<(Recipe, u64)> {
    let setting = Setting {
        registry: &console.registry,
        provenance: origin,
        max_memory: console.free_memory(),
        foresee: &|more| {
            console.foresee_memory(more);
        },
        cache: StageCache::default(),
    };
    let missed = || Error::new(ExitCode::QualityNotMet, "nothing that could be baked is expected to meet the request");
    plan::choose(request, scene, &setting, console)?.ok_or_else(missed)
}

/// The verdict on a plan: an error where it misses the request.
pub(super) fn verdict(plan: &Plan) -> Result<ExitCode> {
    if plan.is_met() {
        return Ok(ExitCode::Ok);
    }
    let mut text = plan.misses.iter().chain(&plan.timings.misses).cloned().collect::<Vec<_>>().join("; ");
    if let Some(way) = &plan.would_meet {
        text = format!("{text}. What would meet it: {way}");
    }
    Err(Error::new(ExitCode::QualityNotMet, format!("the request is not met: {text}")))
}

/// An error that may be above 1, as `150%` or `1.5`.
fn ratio(text: &str, flag: &str) -> Result<f64> {
    let (digits, unit) = text.trim().strip_suffix('%').map_or((text.trim(), 1.0), |digits| (digits.trim(), 0.01));
    match digits.parse::<f64>().map(|value| value * unit) {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err(Error::command_line(format!("{flag} {text}: a share such as 10% or 0.1 is needed"))),
    }
}
