//! `translux relight A.tlux`: a window; with `--headless --frames N --out DIR`, pictures of a turn of the lights.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;

use super::console::{Console, in_range};
use super::lights::{LightArgs, ResolvedLights, warn_of_places};
use super::opening::{AssetArgs, Opened};
use super::view::{ViewArgs, check_memory};
use crate::asset::Asset;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::finer::Finer;
use crate::evaluate::summed::Summed;
use crate::evaluate::{Evaluator, Registry, SingleScattering};
use crate::measure::between_vertices::too_coarse;
use crate::measure::refine::{Goal, RefinedScene, refine_until};
use crate::progress::Progress;
use crate::relight::choice::{DeviceChoice, place};
use crate::relight::headless::{self, Animation, MAX_FRAMES, SAMPLES_PER_PIXEL};
use crate::relight::timings::{Stages, Timings};
use crate::render::camera::Resolution;
use crate::render::frame::RenderSettings;
use crate::report::text::percent;

/// Size of the pictures of an animation.
const HEADLESS_RESOLUTION: Resolution = Resolution { width: 1024, height: 1024 };
/// Size of the window.
#[cfg(feature = "gui")]
const WINDOW_RESOLUTION: Resolution = Resolution { width: 1024, height: 700 };

#[derive(Clone, Debug, Args)]
pub(super) struct RelightArgs {
    #[command(flatten)]
    asset: AssetArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// Where to compute and draw
    #[arg(long, value_enum, default_value = "auto")]
    device: DeviceChoice,
    #[command(flatten)]
    view: ViewArgs,
    /// Pixels (default: 1024x1024, the window 1024x700)
    #[arg(long, value_name = "WIDTHxHEIGHT")]
    resolution: Option<Resolution>,
    /// Keep what moving lights leave from frame to frame: faster, and a little less right (texture_space: shadows)
    #[arg(long)]
    reuse: bool,
    /// No window: pictures of one turn of the lights about the object, and their timings
    #[arg(long, help_heading = "Without a window")]
    headless: bool,
    /// Pictures of the turn
    #[arg(long, value_name = "N", help_heading = "Without a window")]
    frames: Option<usize>,
    /// Folder for frame_0000.png ... and timings.json
    #[arg(long, value_name = "DIR", help_heading = "Without a window")]
    out: Option<PathBuf>,
    /// Start with the lights turning
    #[arg(long, help_heading = "Window")]
    turn: bool,
    /// Close the window after this many seconds and report how fast it was
    #[arg(long, value_name = "SECONDS", help_heading = "Window")]
    quit_after: Option<f64>,
}

/// Report of an animation.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct AnimationReport<'a> {
    #[serde(serialize_with = "crate::report::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    folder: &'a std::path::Path,
    /// The same as the file of timings.
    animation: &'a Timings,
}

/// Runs on the main thread, as a window must; work goes to `pool`.
pub(super) fn run(args: &RelightArgs, console: &Console, pool: Arc<rayon::ThreadPool>) -> Result<ExitCode> {
    // Told before the asset is read.
    args.view.specular()?;
    match (args.headless, args.frames, &args.out) {
        (true, Some(frames), Some(out)) => {
            if args.turn || args.quit_after.is_some() {
                return Err(Error::command_line("--turn and --quit-after are for the window; leave them out"));
            }
            in_range("--frames", frames, 1..=MAX_FRAMES)?;
            pool.install(|| animate(args, frames, out, console))
        }
        (true, ..) => Err(Error::command_line("--headless needs --frames N and --out DIR")),
        (false, None, None) => window(args, console, pool),
        (false, ..) => Err(Error::command_line("--frames and --out go with --headless; add it, or leave them out")),
    }
}

/// A mesh that is shown in place of a coarse one.
type Shown = Option<Arc<RefinedScene>>;

/// What is shown of an asset whose mesh is too coarse for its material; none where the mesh is fine, where light ends at its vertices or
/// depends on the eye, and on a device that was asked for, whose sums are those of the asset's own vertices.
fn finer(
    evaluator: &dyn Evaluator,
    asset: &Asset,
    args: (&Registry, DeviceChoice),
    progress: &dyn Progress,
) -> Result<Shown> {
    let (registry, device) = args;
    let keeps_single = matches!(evaluator.single_scattering_is(), SingleScattering::None | SingleScattering::PerVertex);
    if device == DeviceChoice::Gpu || !keeps_single || !registry.form(asset)?.serves_points() {
        return Ok(None);
    }
    Ok(refine_until(evaluator.scene(), Goal::SHOWN, progress)?.map(Arc::new))
}

/// Tells what is shown of a coarse mesh.
fn tell(shown: &Shown, evaluator: &dyn Evaluator, console: &Console) -> Result<()> {
    let scene = evaluator.scene();
    match shown {
        Some(refined) => console.note(&format!(
            "{} triangles are shown as {}, since light between the vertices of the asset is not linear; a bake with --refine auto has \
             faster frames",
            scene.mesh.triangles.len(),
            refined.scene.mesh.triangles.len()
        )),
        None => {
            if let Some(error) = too_coarse(scene, Some(evaluator.bvh()), console)? {
                console.warn(&format!(
                    "what is drawn between vertices is {} off, under a few probe lights: bake with --refine auto",
                    percent(error.rms)
                ));
            }
        }
    }
    Ok(())
}

/// An evaluator on the mesh that is shown.
fn on(shown: &Shown, evaluator: Box<dyn Evaluator>) -> Box<dyn Evaluator> {
    match shown {
        Some(refined) => Finer::of(evaluator, refined.scene.clone(), &refined.of_triangle),
        None => evaluator,
    }
}

/// The evaluator as frames show it, with single scattering added to the radiosity.
fn drawn(evaluator: Box<dyn Evaluator>, console: &Console) -> Box<dyn Evaluator> {
    let evaluator = Summed::of(evaluator);
    if evaluator.single_scattering_is() == SingleScattering::TracedTowardsEye {
        console.note(
            "single scattering is traced towards the eye here (phase-terms=rays, or g from 0.55 on): `translux render` has it, frames \
             do not",
        );
    }
    evaluator
}

fn animate(args: &RelightArgs, frames: usize, out: &std::path::Path, console: &Console) -> Result<ExitCode> {
    let ResolvedLights { lights, .. } = args.lights.load(console)?;
    let of_asset = args.asset.for_frames();
    let (Opened { provenance, evaluator }, asset) = of_asset.open_beside(console)?;
    let view = args.view.with_texture(args.view.texture(of_asset.base_colours()));
    warn_of_places(evaluator.scene(), &lights, evaluator.cost().samples, console);
    let shown = finer(evaluator.as_ref(), &asset, (&console.registry, args.device), console)?;
    drop(asset);
    tell(&shown, evaluator.as_ref(), console)?;
    let evaluator = drawn(on(&shown, evaluator), console);
    let resolution = args.resolution.unwrap_or(HEADLESS_RESOLUTION);
    check_memory(resolution, 1, console)?;
    let settings = RenderSettings {
        samples_per_pixel: SAMPLES_PER_PIXEL,
        ..args.view.settings(&evaluator.scene().mesh, resolution)?
    };
    let texture = view.load_texture(&evaluator.scene().mesh, console)?;
    let again = || Ok(Summed::of(on(&shown, of_asset.open(console)?.evaluator)));
    let (place, note) = place(args.device, evaluator, &again)?;
    note.iter().for_each(|note| console.note(note));
    let animation = Animation {
        frames,
        folder: out.to_owned(),
        settings,
        exposure: args.view.exposure,
        texture,
        reuse: args.reuse,
        lights,
        method: provenance.method,
    };
    let timings = headless::run(place, &animation, console)?;
    let drawn = timings.adapter.as_ref().map_or("CPU", |a| a.name.as_str());
    let Stages { total_ms, light_ms, transport_ms, draw_ms } = &timings.summary;
    let [total, light, transport, draw] = [total_ms, light_ms, transport_ms, draw_ms].map(|times| times.median);
    let (folder, place) = (out.display(), &timings.transport);
    console.note(&format!(
        "{frames} frames in {folder} | transport on {place}, drawn by {drawn} | median {total:.1} ms: light {light:.1}, \
         transport {transport:.1}, draw {draw:.1}"
    ));
    console.report("relight", &AnimationReport { folder: out, animation: &timings })
}

#[cfg(not(feature = "gui"))]
fn window(_: &RelightArgs, _: &Console, _: Arc<rayon::ThreadPool>) -> Result<ExitCode> {
    Err(Error::unsupported(
        "this build has no window (cargo feature `gui`); use --headless --frames N --out DIR, or `translux render`",
    ))
}

/// Report of a window's run.
#[cfg(feature = "gui")]
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct WindowRun<'a> {
    method: &'a str,
    lights: &'a [String],
    window: &'a crate::relight::timings::WindowReport,
}

#[cfg(feature = "gui")]
fn window(args: &RelightArgs, console: &Console, pool: Arc<rayon::ThreadPool>) -> Result<ExitCode> {
    use crate::medium::profiles::model::LoadedProfile;
    use crate::progress::Silent;
    use crate::relight::window::{Session, Settings, run};
    let quit_after_s = args.quit_after.map(|seconds| in_range("--quit-after", seconds, 0.0..=1e6)).transpose()?;
    let of_asset = args.asset.for_frames();
    let (lights, opened, shown) = pool.install(|| -> Result<_> {
        let (lights, (opened, asset)) = (args.lights.load(console)?, of_asset.open_beside(console)?);
        let shown = finer(opened.evaluator.as_ref(), &asset, (&console.registry, args.device), console)?;
        tell(&shown, opened.evaluator.as_ref(), console)?;
        Ok((lights, opened, shown))
    })?;
    // Told before a window opens.
    warn_of_places(opened.evaluator.scene(), &lights.lights, opened.evaluator.cost().samples, console);
    let texture = args.view.texture(of_asset.base_colours());
    args.view.with_texture(texture.clone()).load_texture(&opened.evaluator.scene().mesh, console)?;
    let (again, registry, device) = (of_asset, console.registry.clone(), args.device);
    let evaluator = drawn(on(&shown, opened.evaluator), console);
    let open = move |path: &std::path::Path, profile: Option<&LoadedProfile>| {
        let (evaluator, asset) = again.again(&registry, path, profile)?;
        // The same mesh as at first, whatever the media in force, so that vertices have the same numbers.
        let shown = match path == again.asset {
            true => shown.clone(),
            false => finer(evaluator.as_ref(), &asset, (&registry, device), &Silent)?,
        };
        Ok(Summed::of(on(&shown, evaluator)))
    };
    let session = Session {
        model: args.asset.asset.clone(),
        evaluator,
        profile: args.asset.profile()?,
        open: Arc::new(open),
        lights: lights.lights,
        resolution: args.resolution.unwrap_or(WINDOW_RESOLUTION),
        exposure: args.view.exposure,
        specular: args.view.specular()?,
        background: args.view.background,
        turning: args.turn,
        settings: Settings {
            choice: args.device,
            camera: args.view.camera()?,
            texture,
            reuse: args.reuse,
            quit_after_s,
            pool: Arc::clone(&pool),
        },
    };
    let shown = run(session)?;
    console.note(&format!(
        "{:.1} frames and {:.1} light updates a second | transport on {}, drawn by {}",
        shown.frames_per_second, shown.light_updates_per_second, shown.transport, shown.adapter.name
    ));
    let run = WindowRun { method: &opened.provenance.method, lights: &lights.text, window: &shown };
    pool.install(|| console.report("relight", &run))
}
