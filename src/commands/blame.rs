//! `translux blame A.tlux --light L --vertex I`.

use std::str::FromStr;

use clap::Args;

use super::console::Console;
use super::evaluate::TOO_MUCH;
use super::lights::{LightArgs, warn_of_places};
use super::opening::AssetArgs;
use super::view::CameraArgs;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::measure::trust::{Place, Subject, blame};
use crate::render::camera::Resolution;
use crate::render::centres::centre;
use crate::report::blame::BlameReport;
use crate::report::radiosity_ply::model_of;

#[derive(Clone, Debug, Args)]
pub(super) struct BlameArgs {
    #[command(flatten)]
    asset: AssetArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// Vertex to look at, from 0 in the order of the model
    #[arg(long, value_name = "I", required_unless_present = "pixel", conflicts_with = "pixel")]
    vertex: Option<u32>,
    /// Pixel to look at, from the left and from the top, in the picture that render makes with the same camera and resolution
    #[arg(long, value_name = "X,Y")]
    pixel: Option<Pixel>,
    #[command(flatten)]
    seen: SeenArgs,
}

/// The picture that pixels are of.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Picture")]
struct SeenArgs {
    #[command(flatten)]
    camera: CameraArgs,
    /// Pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1024x1024")]
    resolution: Resolution,
}

/// A pixel, from the left and from the top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Pixel([u32; 2]);

impl FromStr for Pixel {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once(',').and_then(|(x, y)| Some([x.trim().parse().ok()?, y.trim().parse().ok()?]));
        numbers.map(Self).ok_or_else(|| "two whole numbers are needed, as in 512,300".to_owned())
    }
}

pub(super) fn run(args: &BlameArgs, console: &Console) -> Result<ExitCode> {
    args.seen.camera.spec()?;
    let lights = args.lights.load(console)?;
    let (mut opened, asset) = args.asset.open_beside(console)?;
    let evaluator = opened.evaluator.as_mut();
    let place = args.place(evaluator)?;
    let scene = evaluator.scene();
    warn_of_places(scene, &lights.lights, evaluator.cost().samples, console);
    let part = scene.parts.triangle_part.get(place.point.triangle as usize);
    let part = part.and_then(|&part| scene.parts.parts.get(part as usize)).map(|part| part.name.clone());
    let materials = scene.media.iter().map(|medium| medium.name.clone()).collect();
    let admit = |more: u64| console.check_memory(more, TOO_MUCH);
    let subject = Subject { evaluator, asset: &asset, profile: args.asset.loaded_profile()?, admit: &admit };
    let found = blame(subject, &lights.lights, place, console)?;
    let report = BlameReport {
        method: opened.provenance.method.clone(),
        model: model_of(&opened.provenance).to_owned(),
        materials,
        lights: lights.text,
        inputs: lights.inputs,
        part: part.unwrap_or_default(),
        pixel: args.pixel.map(|Pixel(pixel)| pixel),
        blame: found,
    };
    console.show("blame", &report)
}

impl BlameArgs {
    /// The place that is asked for.
    fn place(&self, evaluator: &dyn Evaluator) -> Result<Place> {
        match (self.vertex, self.pixel) {
            (Some(vertex), _) => {
                Place::vertex(evaluator.scene(), vertex).map_err(|e| e.at(format!("--vertex {vertex}")))
            }
            (None, Some(pixel)) => {
                let Pixel([x, y]) = pixel;
                self.seen.place(evaluator, pixel).map_err(|e| e.at(format!("--pixel {x},{y}")))
            }
            (None, None) => Err(Error::command_line("--vertex or --pixel is needed")),
        }
    }
}

impl SeenArgs {
    /// What the camera sees in the middle of a pixel.
    fn place(&self, evaluator: &dyn Evaluator, Pixel([x, y]): Pixel) -> Result<Place> {
        let Resolution { width, height, .. } = self.resolution;
        if x as usize >= width || y as usize >= height {
            return Err(Error::command_line(format!(
                "the picture has {width}x{height} pixels, from 0,0 at the top left"
            )));
        }
        let scene = evaluator.scene();
        let camera = self.camera.spec()?.resolve(&scene.mesh, self.resolution)?;
        let point = centre((scene, evaluator.bvh()), (&camera, self.resolution), [x, y].map(|k| k as usize));
        Place::point(scene, point.ok_or_else(|| Error::command_line("the camera does not see the object there"))?)
    }
}
