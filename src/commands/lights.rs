//! `--light`, repeatable, and the sky where there is none.

use clap::Args;
use glam::DVec3;

use super::console::Console;
use crate::error::Result;
use crate::import::file::Input;
use crate::io::environment::load_light;
use crate::light::Light;
use crate::light::parse::{LightSpec, MapSource, examples, parse};
use crate::measure::light_places::{Doubt, doubtful};
use crate::report::text::significant;
use crate::scene::Scene;

/// Lights of a command.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Light")]
pub(super) struct LightArgs {
    /// A light; repeatable. constant, directional, point, spot, area, env, sky or a bare path of an EXR or HDR picture
    #[arg(long = "light", value_name = "LIGHT", long_help = long_help("Without any, the built-in sky."))]
    pub(super) light: Vec<String>,
}

/// Help on lights; `without` tells what shines where there are none.
pub(super) fn long_help(without: &str) -> String {
    let forms: Vec<&str> = examples().collect();
    format!(
        "A light; repeatable, their light adds up. {without} Lengths in mm, values a number or R,G,B:\n  {}\n\
         A bare path is an environment. A spot's angle is the full angle of its cone in degrees, its blend the share of the half angle, from \
         the edge inwards, over which it falls to nothing (0.15). An area light with field=32 goes through a source radiance field of 32 x 32 points on each of its \
         spheres, without rays: for assets of `editable` with rows for environments.",
        forms.join("\n  ")
    )
}

/// Warns of lights that shine past the scene, inside a body, on its surface, or too near to it for the samples.
pub(super) fn warn_of_places(scene: &Scene, lights: &[Light], samples: usize, console: &Console) {
    let place = |p: DVec3| p.to_array().map(significant).join(", ");
    for found in doubtful(scene, lights, samples) {
        let (part, distance) = (&found.part, significant(found.distance_mm));
        let what = match found.doubt {
            Doubt::Misses => format!(
                "shines past the object and adds nothing: the object's centre is at {}, {distance} mm away",
                place(found.nearest_mm)
            ),
            Doubt::Inside => format!(
                "is inside the part '{part}', {distance} mm from its surface at {}: light that starts within a body is not modelled and \
                 adds nothing",
                place(found.nearest_mm)
            ),
            Doubt::OnSurface => format!(
                "is on the surface of the part '{part}', which sees it edge-on and gets nothing, where half of its light would fall a \
                 little farther out: move it away"
            ),
            Doubt::Near => format!(
                "is {distance} mm from the surface of the part '{part}' at {}, and samples lie {} mm apart: its light is kept, and where \
                 it falls is not resolved; use more --samples, or move it away",
                place(found.nearest_mm),
                significant(found.spacing_mm)
            ),
            Doubt::Narrow => format!(
                "is {distance} mm wide where it falls, and samples of the part '{part}' lie {} mm apart: what falls on it is kept to a \
                 few of them, and its edge is not resolved; use more --samples, or a wider angle",
                significant(found.spacing_mm)
            ),
        };
        let light = lights.get(found.light).map(Light::to_string).unwrap_or_default();
        console.fault(&format!("light {} ({light}), with {} mm, {what}", found.light + 1, place(found.at_mm)));
    }
}

/// Lights ready to use, and the files they were made from.
pub(super) struct ResolvedLights {
    pub(super) lights: Vec<Light>,
    pub(super) text: Vec<String>,
    pub(super) inputs: Vec<Input>,
}

impl LightArgs {
    /// Reads the text forms of the lights and their pictures.
    pub(super) fn load(&self, console: &Console) -> Result<ResolvedLights> {
        let sky = ["sky".to_owned()];
        let texts = if self.light.is_empty() { &sky } else { self.light.as_slice() };
        let specs: Vec<LightSpec> = texts.iter().map(|t| parse(t)).collect::<Result<_>>()?;
        let mut resolved = ResolvedLights { lights: Vec::new(), text: Vec::new(), inputs: Vec::new() };
        for spec in &specs {
            let loaded = load_light(spec)?;
            loaded.warnings.iter().for_each(|w| console.warn(w));
            resolved.lights.push(loaded.value);
            if let LightSpec::Environment { source: MapSource::File(path), .. } = spec {
                resolved.inputs.push(Input::read(path)?);
            }
            resolved.text.push(spec.to_string());
        }
        Ok(resolved)
    }
}
