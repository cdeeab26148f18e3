//! What the parts share: bakes, the truth, times, pictures.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::Result;
use translux::evaluate::Evaluator;
use translux::geometry::samples::Samples;
use translux::light::{Light, LightKind};
use translux::math::statistics::vertex_error;
use translux::medium::material::Medium;
use translux::methods;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, DEFAULT_FOV_DEGREES, Resolution};
use translux::render::film::Exposure;
use translux::render::frame::{Frame, RenderSettings, Specular, render};
use translux::scene::Scene;

use crate::common::bench::{Context, Recipe, bake_for, parallel, properties};

/// Samples of the truth, and rays at each.
const TRUTH_SAMPLES: usize = 262_144;
const QUICK_TRUTH_SAMPLES: usize = 32_768;

/// Materials that are edited one into the other: another refractive index would also change what enters at the samples.
const EDITED: [&str; 2] = ["skin1", "skin2"];

/// Times of which the median is taken.
const REPEATS: usize = 7;

/// Eye rays of a pixel.
const EYE_RAYS: u32 = 9;

/// A sun from above.
pub(crate) fn sun() -> Light {
    parallel(DVec3::new(0.4, 0.7, 0.6))
}

/// An asset of `editable` for lights that cast rays, and the seconds that it took.
pub(crate) fn bake(scene: &Scene, recipe: &Recipe) -> Result<(Asset, f64)> {
    let start = Instant::now();
    let asset = bake_for(LightKind::Directional, methods::built_in().method("editable")?, scene, recipe, &Silent)?;
    Ok((asset, start.elapsed().as_secs_f64()))
}

/// At run time.
pub(crate) fn open(asset: Asset) -> Result<Box<dyn Evaluator>> {
    methods::built_in().open(Arc::new(asset))
}

/// The media of a scene with a preset in the place of each.
pub(crate) fn media(scene: &Scene, material: &str) -> Result<Vec<Medium>> {
    let properties = properties(material)?;
    Ok(vec![Medium { name: material.to_owned(), properties }; scene.media.len()])
}

/// Radiosity of every vertex.
pub(crate) fn under(evaluator: &mut dyn Evaluator, material: &str, lights: &[Light]) -> Result<Vec<DVec3>> {
    evaluator.set_media(media(evaluator.scene(), material)?)?;
    evaluator.set_lights(lights.to_vec(), &Silent)?;
    evaluator.radiosity(&Silent)
}

/// `reference`, whose samples are more and of their own.
pub(crate) fn truth(context: &Context, scene: &Scene) -> Result<Box<dyn Evaluator>> {
    let samples = if context.quick { QUICK_TRUTH_SAMPLES } else { TRUTH_SAMPLES };
    let method = methods::built_in().method("reference")?;
    let recipe = Recipe { samples: Some(samples), max_rms: method.default_max_rms(), set: &[] };
    methods::built_in().open(Arc::new(bake_for(LightKind::Directional, method, scene, &recipe, &Silent)?))
}

/// Relative RMS, worst channel.
pub(crate) fn rms(scene: &Scene, found: &[DVec3], expected: &[DVec3]) -> f64 {
    vertex_error(found, expected, &scene.vertex_areas_mm2()).rms
}

/// Median milliseconds of a new light and of a new material.
pub(crate) fn times_ms(evaluator: &mut dyn Evaluator) -> Result<(f64, f64)> {
    let both = [media(evaluator.scene(), EDITED[0])?, media(evaluator.scene(), EDITED[1])?];
    evaluator.set_media(both[1].clone())?;
    let (mut lights, mut edits) = (Vec::new(), Vec::new());
    for turn in 0..REPEATS {
        let light = parallel(DVec3::new(0.4, 0.7, 0.6 + 0.05 * turn as f64));
        let start = Instant::now();
        evaluator.set_lights(vec![light], &Silent)?;
        evaluator.radiosity(&Silent)?;
        lights.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        evaluator.set_media(both[turn % 2].clone())?;
        evaluator.radiosity(&Silent)?;
        edits.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok((median(lights), median(edits)))
}

/// Median milliseconds of a new light and a material that was not in force before.
pub(crate) fn both_ms(evaluator: &mut dyn Evaluator, material: &str) -> Result<f64> {
    let (before, after) = (media(evaluator.scene(), EDITED[0])?, media(evaluator.scene(), material)?);
    let mut times = Vec::new();
    for turn in 0..REPEATS {
        evaluator.set_media(before.clone())?;
        let light = parallel(DVec3::new(0.4, 0.7, 0.6 + 0.05 * turn as f64));
        let start = Instant::now();
        evaluator.set_media(after.clone())?;
        evaluator.set_lights(vec![light], &Silent)?;
        evaluator.radiosity(&Silent)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(median(times))
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Where a picture is seen from, and what is up in it.
#[derive(Clone, Copy)]
pub(crate) struct View {
    pub(crate) from: DVec3,
    pub(crate) up: DVec3,
}

/// The diffuse picture of some radiosity, from the default eye where none is given.
pub(crate) fn picture(
    evaluator: &dyn Evaluator,
    radiosity: &[DVec3],
    (side, view): (usize, Option<View>),
) -> Result<Frame> {
    let resolution = Resolution::new(side, side)?;
    let mesh = &evaluator.scene().mesh;
    let camera = match view {
        None => Camera::framing(mesh, resolution)?,
        Some(View { from, up }) => {
            let look = Camera::framing(mesh, resolution)?.look_mm();
            Camera::framing_from(mesh, resolution, from.normalize(), look, up, DEFAULT_FOV_DEGREES)?
        }
    };
    let mut settings = RenderSettings::new(camera, resolution);
    settings.samples_per_pixel = EYE_RAYS;
    settings.specular = Specular::Off;
    settings.background = Background::None;
    render(evaluator, &radiosity.to_vec(), &[], &settings, &Silent)
}

/// As it is shown beside others of the same exposure: on white, sRGB left to the encoder.
pub(crate) fn shown(frame: &Frame, factor: f64) -> Vec<[f32; 3]> {
    let pixel = |p: &translux::render::frame::Pixel| {
        p.diffuse.map(|c| (f64::from(c) * factor + f64::from(1.0 - p.coverage)).clamp(0.0, 1.0) as f32)
    };
    frame.pixels.iter().map(pixel).collect()
}

/// What makes a picture bright enough.
pub(crate) fn exposure(frame: &Frame) -> f64 {
    Exposure::Auto.factor(frame)
}

/// A share in percent, with the digits that it is worth.
pub(crate) fn percent(share: f64) -> String {
    match 100.0 * share {
        v if v >= 9.95 => format!("{v:.0} %"),
        v if v >= 0.995 => format!("{v:.1} %"),
        v if v >= 0.0995 => format!("{v:.2} %"),
        v => format!("{v:.3} %"),
    }
}

/// Bytes of the method's sections and of the samples in a file, for each vertex.
pub(crate) fn bytes_per_vertex(asset: &Asset) -> Result<f64> {
    let mut without = asset.clone();
    without.sections.clear();
    without.samples = Samples {
        patch_offsets: vec![0],
        part_offsets: vec![0; asset.samples.part_offsets.len()],
        ..Samples::default()
    };
    let bytes = asset.to_bytes()?.len() - without.to_bytes()?.len();
    Ok(bytes as f64 / asset.scene.mesh.local_mm.len() as f64)
}
