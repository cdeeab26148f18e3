//! The paper's Figure 5: single scattering by four ways.

use std::time::Instant;

use glam::DVec3;
use translux::error::Result;
use translux::geometry::bvh::Bvh;
use translux::light::cube_light::CubeLight;
use translux::medium::material::OpticalProperties;
use translux::render::single::Single;
use translux::transport::single_scattering::radiance::{DepthSampling, Path, Settings};
use translux::transport::single_scattering::vectors::{Sharing, VectorBaker, VectorSettings};
use translux::transport::single_scattering::{radiosity_factor, vertex_points};

use crate::bench::percent;
use crate::common::bench::{Context, met, properties, table};
use crate::common::runner::summary;
use crate::common::sheet;
use crate::single::{Picture, Rays, SIDE, SYNTHETIC, Stand, sums, sun_and_sky};

/// Side of a picture.
const PIXELS: usize = 200;
const FEW_PIXELS: usize = 96;

/// Directions towards an environment.
const DIRECTIONS: u32 = 1024;
const FEW_DIRECTIONS: u32 = 256;

/// Random numbers of the second picture of the truth, whose difference from the first is its noise.
const OTHER: u64 = 1 << 40;

/// RMS over vertices that shared samples may add.
const WANTED_SHARED: f64 = 0.01;

/// Every how many vertices have unshared samples as well.
const STEP: usize = 499;

/// Cube maps of a vertex where many are asked for.
const MANY: u32 = 64;

/// A sun at the centre of a texel: face, column, row.
const SUN: [usize; 3] = [0, 9, 9];

/// A material with its properties, isotropic.
fn materials() -> Result<[(&'static str, OpticalProperties); 2]> {
    let [sigma_s_reduced_per_mm, sigma_a_per_mm] = SYNTHETIC;
    let synthetic = OpticalProperties { sigma_s_reduced_per_mm, sigma_a_per_mm, g: 0.0, eta_inside_over_outside: 1.3 };
    Ok([("the paper's synthetic", synthetic), ("skin1", properties("skin1")?)])
}

/// The figure.
pub(crate) fn run(context: &Context) -> Result<String> {
    let side = if context.quick { FEW_PIXELS } else { PIXELS };
    let directions = if context.quick { FEW_DIRECTIONS } else { DIRECTIONS };
    let lights = sun_and_sky(context, SUN)?;
    let cubes: Vec<CubeLight> = lights.iter().map(|(_, light)| CubeLight::new(light, SIDE)).collect::<Result<_>>()?;
    let (mut sheets, mut rows, mut text) = (Vec::new(), Vec::new(), String::new());
    let mut worst_shared = 0.0f64;
    for (material, properties) in context.some(&materials()?, 1) {
        let mut scene = context.scene(context.model(), "skin1")?;
        scene.media.iter_mut().for_each(|m| m.properties = properties);
        let bvh = Bvh::new(&scene.mesh);
        let stand = Stand::new(&scene, side)?;
        let points = vertex_points(scene.domain());
        let start = Instant::now();
        let baker = VectorBaker::new(scene.domain(), &bvh, VectorSettings::DEFAULT)?;
        let baked = sums(&baker, &points, &cubes);
        let seconds = start.elapsed().as_secs_f64();
        let paper = VectorSettings { sharing: Sharing::PAPER, ..VectorSettings::DEFAULT };
        let some: Vec<_> = points.iter().copied().step_by(STEP).collect();
        let unshared = sums(&VectorBaker::new(scene.domain(), &bvh, paper)?, &some, &cubes);
        let many = VectorSettings { sharing: Sharing::None { depths: MANY }, ..VectorSettings::DEFAULT };
        let many = sums(&VectorBaker::new(scene.domain(), &bvh, many)?, &some, &cubes);
        let some_baked: Vec<Vec<DVec3>> = baked.iter().map(|b| b.iter().copied().step_by(STEP).collect()).collect();
        let between =
            |a: &[Vec<DVec3>], b: &[Vec<DVec3>]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| relative(a, b)).collect() };
        let shared = between(&some_baked, &unshared);
        let percents = |errors: &[f64]| {
            let of = |i: usize| percent(errors.get(i).copied().unwrap_or(0.0));
            format!("{} under a sun, {} under Uffizi", of(0), of(1))
        };
        worst_shared = worst_shared.max(shared.iter().copied().fold(0.0, f64::max));
        text.push_str(&format!(
            "{material}: vectors of all {} vertices in {seconds:.0} s; at {} of them, relative RMS: shared samples against the paper's \
             16 cube maps each {}; shared samples against {MANY} cube maps {}; 16 cube maps against {MANY} {}.\n\n",
            points.len(),
            some.len(),
            percents(&shared),
            percents(&between(&some_baked, &many)),
            percents(&between(&unshared, &many)),
        ));
        context.say(&format!("figure 5: {material}: vectors in {seconds:.0} s"));
        let factor = radiosity_factor(properties.eta_inside_over_outside);
        for ((name, light), baked) in lights.iter().zip(&baked) {
            let settings = Settings { directions, ..Settings::REFERENCE };
            let deterministic = Settings { depths: DepthSampling::Deterministic(16), ..settings };
            let by = |settings, path, key| stand.traced((&scene, &bvh), light, Rays { settings, path, key });
            let truth = by(settings, Path::Refracted, 0)?;
            let again = by(settings, Path::Refracted, OTHER)?;
            let normal = by(settings, Path::InverseNormal, OTHER)?;
            let fixed = by(deterministic, Path::InverseNormal, OTHER)?;
            let per_vertex: Vec<DVec3> = baked.iter().map(|s| factor * *s).collect();
            let vectors = stand.picture(Single::PerVertex(&per_vertex))?;
            let rms = |a: &Picture, b: &Picture| format!("{:.1}", 1e3 * a.error(b).rms);
            rows.push(vec![
                material.to_owned(),
                (*name).to_owned(),
                rms(&again, &truth),
                rms(&normal, &truth),
                rms(&fixed, &truth),
                rms(&vectors, &truth),
                rms(&fixed, &normal),
                rms(&vectors, &normal),
            ]);
            let white = truth.exposure();
            sheets.push([truth, normal, fixed, vectors].map(|p| p.shown(white)).to_vec());
            context.say(&format!("figure 5: {material}, {name}"));
        }
    }
    let file = "all_frequency_figure5.png";
    translux::io::atomic::write(&context.pictures.join(file), &sheet::png(side, &sheets)?)?;
    let head = ["material", "light", "(a) again", "(b) to (a)", "(c) to (a)", "(d) to (a)", "(c) to (b)", "(d) to (b)"];
    let line = summary(
        "single scattering, shared samples against unshared, relative RMS over vertices, a sun and an environment",
        "named as future work",
        "<= 1 %",
        &format!("worst {}; {}", percent(worst_shared), met(worst_shared <= WANTED_SHARED)),
    );
    Ok(format!(
        "{line}![Single scattering by four ways](pictures/all_frequency_figure5.jpg)\n\n@figure5@\n\n{}\n{text}",
        table(&head, &rows)
    ))
}

/// Relative RMS, worst channel.
fn relative(some: &[DVec3], truth: &[DVec3]) -> f64 {
    let (mut error, mut unit) = (DVec3::ZERO, DVec3::ZERO);
    for (a, b) in some.iter().zip(truth) {
        error += (*a - *b) * (*a - *b);
        unit += *b * *b;
    }
    let worst = (error / unit).max_element();
    if worst.is_finite() { worst.sqrt() } else { 0.0 }
}
