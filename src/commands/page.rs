//! The page of `translux export A.tlux -o turn.html`: a light that turns, a camera that moves.

use std::f64::consts::PI;
use std::path::Path;

use clap::Args;
use glam::DVec3;
use serde_json::json;

use super::console::{Console, in_range};
use super::lights::{ResolvedLights, warn_of_places};
use super::view::CameraArgs;
use crate::asset::Provenance;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::export::colours::Exposed;
use crate::export::page::{DIRECTION_COUNTS, DIRECTIONS, Turned, html};
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::measure::probes::{Half, constant, directional};
use crate::render::camera::{Resolution, xyz};
use crate::render::film::{Exposure, MAX_STOPS};
use crate::render::specular::Roughness;
use crate::report::export::PageReport;

/// Where the light comes from and its irradiance where no light was given, and the radiance from everywhere.
const FROM: DVec3 = DVec3::new(-0.6, 0.7, 0.6);
const IRRADIANCE: f64 = 3.0;
const AMBIENT: f64 = 0.05;

/// The picture that the first view frames the object for.
const FRAMED: usize = 1024;

/// How a page starts, and how much it knows.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Page")]
pub(super) struct PageArgs {
    #[command(flatten)]
    camera: CameraArgs,
    #[arg(long, value_name = "N", help = format!("Directions from which the asset is lit: more are nearer to it [default: {DIRECTIONS}]"))]
    directions: Option<usize>,
}

/// The lights of a page.
struct Parts {
    from: DVec3,
    irradiance: DVec3,
    ambient: DVec3,
    others: Vec<(Light, String)>,
}

impl Parts {
    /// The first directional light turns, constant ones are the ambient, all others stay.
    fn of(lights: &ResolvedLights, is_default: bool) -> Self {
        let from = FROM.normalize();
        if is_default {
            let (irradiance, ambient) = (DVec3::splat(IRRADIANCE), DVec3::splat(AMBIENT));
            return Self { from, irradiance, ambient, others: Vec::new() };
        }
        let mut parts = Self { from, irradiance: DVec3::ZERO, ambient: DVec3::ZERO, others: Vec::new() };
        let mut turns = false;
        for (light, text) in lights.lights.iter().zip(&lights.text) {
            match light {
                Light::Directional { from, irradiance } if !turns => {
                    (parts.from, parts.irradiance, turns) = (*from, *irradiance, true);
                }
                Light::Constant { radiance } => parts.ambient += *radiance,
                other => parts.others.push((other.clone(), text.clone())),
            }
        }
        parts
    }
}

impl PageArgs {
    /// Refuses what does not go together, before any work.
    pub(super) fn check(&self, is_page: bool) -> Result<()> {
        let given = self.camera.given().or(self.directions.map(|_| "--directions"));
        if let Some(option) = given.filter(|_| !is_page) {
            return Err(Error::command_line(format!("{option}: is of a page (-o FILE.html)")));
        }
        let [least, most] = DIRECTION_COUNTS;
        in_range("--directions", self.directions.unwrap_or(DIRECTIONS), least..=most)?;
        self.camera.spec().map(|_| ())
    }

    /// Lights an asset from all around and makes the page of it.
    pub(super) fn make(
        &self,
        evaluator: &mut dyn Evaluator,
        (asset, provenance): (&Path, &Provenance),
        (lights, is_default): (&ResolvedLights, bool),
        exposure: Exposure,
        console: &Console,
    ) -> Result<(Vec<u8>, PageReport)> {
        let Parts { from, irradiance, ambient, others } = Parts::of(lights, is_default);
        let mesh = &evaluator.scene().mesh;
        let camera = self.camera.spec()?.resolve(mesh, Resolution::new(FRAMED, FRAMED)?)?;
        let (directions, vertices) = (self.directions.unwrap_or(DIRECTIONS), mesh.local_mm.len());
        console.check_memory(Turned::memory(vertices, directions), "use fewer --directions, or raise --max-memory")?;
        let fixed: Vec<Light> = others.iter().map(|(light, _)| light.clone()).collect();
        warn_of_places(evaluator.scene(), &fixed, evaluator.cost().samples, console);
        let turned = Turned::new(evaluator, directions, console).map_err(|e| e.at("a light that turns"))?;
        let areas = evaluator.scene().vertex_areas_mm2();
        let mut under = |lights: Vec<Light>| {
            evaluator.set_lights(lights, console)?;
            evaluator.radiosity(console)
        };
        let error = |weights: &[DVec3], asset: &[DVec3]| -> Option<VertexError> {
            let is_lit = asset.iter().any(|b| *b != DVec3::ZERO);
            is_lit.then(|| vertex_error(&turned.radiosity(weights), asset, &areas))
        };
        let mut probes = Vec::new();
        for light in directional(Half::Figures) {
            let Light::Directional { from, .. } = light else { continue };
            probes.extend(error(&turned.under(from), &under(vec![light])?));
        }
        let everywhere = under(vec![constant()])?;
        let ambient_weights = turned.fitted(&everywhere);
        let still = if fixed.is_empty() { vec![DVec3::ZERO; vertices] } else { under(fixed)? };
        let fixed_weights = turned.fitted(&still);
        let first = under(vec![Light::Directional { from, irradiance: DVec3::ONE }])?;
        let sum: Vec<DVec3> =
            first.iter().zip(&everywhere).zip(&still).map(|((b, a), f)| *b * irradiance + *a * ambient + *f).collect();
        let factor = Exposed::new(exposure, &sum, &areas).factor * PI;
        // What a person types again.
        let stops = ((factor.log2() * 100.0).round() / 100.0).clamp(-MAX_STOPS, MAX_STOPS) + 0.0;
        let mean = |errors: &[VertexError]| errors.iter().map(|e| e.rms).sum::<f64>() / errors.len().max(1) as f64;
        let asset = asset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let mut words = Vec::new();
        if irradiance != DVec3::ZERO {
            words.push(format!("--light directional:from={}:irradiance={}", xyz(from), xyz(irradiance)));
        }
        if ambient != DVec3::ZERO {
            words.push(format!("--light constant:radiance={}", xyz(ambient)));
        }
        let others: Vec<String> = others.into_iter().map(|(_, text)| text).collect();
        words.extend(others.iter().map(|text| format!("--light {text}")));
        // A page is linear between vertices, whatever the mesh.
        words.push(format!("--camera {camera} --exposure {stops} --background 0 --exitance vertices"));
        let mut report = PageReport {
            bytes: 0,
            directions,
            functions: turned.functions(),
            mean_rms: mean(&probes),
            worst_rms: probes.iter().map(|e| e.rms).fold(0.0, f64::max),
            worst_vertex: probes.iter().map(|e| e.worst).fold(0.0, f64::max),
            probes: probes.len(),
            first_rms: error(&turned.under(from), &first).map(|e| e.rms),
            ambient_rms: error(&ambient_weights, &everywhere).map(|e| e.rms),
            fixed_rms: error(&fixed_weights, &still).map(|e| e.rms),
            render: words.join(" "),
        };
        let materials: Vec<&str> = evaluator.scene().media.iter().map(|medium| medium.name.as_str()).collect();
        let diagonal = crate::report::text::significant(evaluator.scene().mesh.diagonal_mm());
        let (at, look, up) = (camera.at_mm(), camera.look_mm(), camera.up());
        let mut bytes = Vec::new();
        // The number of bytes is in them: twice is enough, as its digits stay as many.
        for _ in 0..3 {
            let mut says = vec![format!(
                "{}, {diagonal} mm, {vertices} vertices, method {}",
                materials.join(", "),
                provenance.method
            )];
            says.extend(report.lines().into_iter().map(|line| line.replacen("PAGE ", "", 1)));
            says.push("Highlights, and light on opaque parts, have no shadows here. The error is that of the light below the surface.".to_owned());
            let about = json!({
                "title": asset, "asset": asset, "says": says, "others": others,
                "alpha": Roughness::default().alpha(),
                "start": {
                    "light": from.to_array(), "irradiance": irradiance.to_array(), "ambient": ambient.to_array(), "fixed": 1.0,
                    "at": at.to_array(), "look": look.to_array(), "up": up.to_array(), "fov": camera.fov_degrees(),
                    "exposure": stops, "gloss": 1.0,
                },
            });
            bytes =
                console.stage("page", || html(&turned, evaluator.scene(), (&ambient_weights, &fixed_weights), &about));
            if report.bytes == bytes.len() {
                break;
            }
            report.bytes = bytes.len();
        }
        Ok((bytes, report))
    }
}
