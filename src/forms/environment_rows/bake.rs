//! Irradiance rows of an asset, and their errors under environments that no choice saw.

use std::ops::Range;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;
use translux_format::RawSection;

use super::settings::{EnvironmentRows, TERMS};
use super::stored::{IN_ROWS, StoredRows};
use crate::compress::ledger::Ledger;
use crate::compress::rows::Rows;
use crate::error::Result;
use crate::evaluate::form::write_error;
use crate::evaluate::stages::{of_kinds, probe_points, worst};
use crate::geometry::samples::{self, Samples};
use crate::light::cube_light::CubeLight;
use crate::light::sky::sky_with_sun;
use crate::light::suns::apart;
use crate::light::{Light, LightKind};
use crate::math::cube_map::{self, FACES};
use crate::math::statistics::VertexError;
use crate::medium::entrance_basis::EntranceBasis;
use crate::progress::{Progress, Silent};
use crate::transport::balanced_tree::in_tree_order;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::irradiance_rows::RowBaker;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;
use crate::transport::visibility::{self, Observer, Occluders};

/// Samples of an asset for each sample of the coarser set that errors are measured on.
const COARSER: usize = 8;

/// Rays of a sample that stand for the native resolution of an environment.
const NATIVE_DIRECTIONS: u32 = 1024;

/// Samples whose visibility is checked with one ray for each sub-texel.
const CHECKED: usize = 32;

/// Sections of the rows of every sample, which lie in the order of their tree; their errors are entered into the ledger.
///
/// # Errors
/// Media whose refractive index the rows do not serve; lights that do not fit a cube map.
pub fn bake(
    (surface, receivers): (&Surface, &Receivers),
    how: (EnvironmentRows, LightSampling, NearField),
    unseen: &[Light],
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<Vec<RawSection>> {
    let rows = rows(surface, how.0, progress)?;
    measure(surface, receivers, how, unseen, ledger, progress)?;
    rows.into_data().to_sections().map_err(write_error)
}

/// Rows of every sample, in blocks.
fn rows(surface: &Surface, settings: EnvironmentRows, progress: &dyn Progress) -> Result<Rows> {
    RowBaker::new(surface, settings.of_rows(settings.coefficients as usize))?.in_blocks(progress)
}

/// Enters the errors of visibility, cube map and row truncation under environments, on a coarser set of samples.
fn measure(
    full: &Surface,
    receivers: &Receivers,
    (settings, sampling, near): (EnvironmentRows, LightSampling, NearField),
    unseen: &[Light],
    ledger: &mut Ledger,
    progress: &dyn Progress,
) -> Result<()> {
    let domain = full.domain;
    let mut lights = of_kinds(unseen, &IN_ROWS);
    if let Some(Light::Environment { rotate_degrees, .. }) = lights.iter().rfind(|l| l.kind() == LightKind::Environment)
    {
        let (map, rotate_degrees) = (Arc::new(sky_with_sun()), *rotate_degrees);
        lights.push(Light::Environment { map, rotate_degrees, scale: DVec3::ONE });
    }
    let entrance = EntranceBasis::new(TERMS);
    let etas: Vec<f64> = domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    if lights.is_empty() || etas.iter().any(|&eta| entrance.project(eta).is_err()) {
        return Ok(());
    }
    progress.start("environment errors", 2 + lights.len() as u64);
    let unordered = Samples::new(domain.mesh, domain.parts, full.samples.len().div_ceil(COARSER));
    let samples = in_tree_order(&unordered, &samples::patches(domain.mesh, &unordered));
    let patches = samples::patches(domain.mesh, &samples);
    let surface = Surface { domain, bvh: full.bvh, samples: &samples, patches: &patches };
    let visibility = visibility_error(&surface, settings);
    progress.advance(1);
    let stored = StoredRows::new(rows(&surface, settings, &Silent)?);
    let side = settings.side as usize;
    let everything = RowBaker::new(&surface, settings.of_rows(6 * side * side))?;
    progress.advance(1);

    let (subset, points) = probe_points(receivers, &receivers.areas_mm2(domain.mesh));
    let tree = SampleTree::default();
    let gather = Gather::new(&surface, &tree, domain.media, near);
    let radiosity = |e: &[DVec3]| gather.radiosity(&subset, &gather.light(e), Scheme::AllPairs, &Silent);
    // Suns go by rays, as they do at run time.
    let parts: Vec<Vec<Light>> = lights.iter().map(|light| apart(std::slice::from_ref(light), |_| true)).collect();
    let maps: Vec<Light> = parts.iter().map(|part| part[0].clone()).collect();
    let unabridged = full_resolution(&everything, &surface, &maps, side)?;
    let native_sampling = LightSampling { directions: NATIVE_DIRECTIONS, ..sampling };
    let [cube_map, truncation] = worst(lights.chunks(1).zip(&parts).zip(unabridged), |((light, part), mut full)| {
        let native = Illumination::new(&surface, light, &etas, native_sampling)?.all(&Silent);
        let mut kept = vec![DVec3::ZERO; samples.len()];
        stored.add(&part[..1], domain, &samples, &mut kept)?;
        let suns = Illumination::new(&surface, &part[1..], &etas, sampling)?.all(&Silent);
        for (sum, sun) in full.iter_mut().chain(&mut kept).zip(suns.iter().cycle()) {
            *sum += *sun;
        }
        let [native, full, kept] = [native, full, kept].map(|e| radiosity(&e));
        progress.advance(1);
        Ok([points.error(&full, &native), points.error(&kept, &full)])
    })?;
    progress.finish();
    let note = format!("the worst of {} environments, on {} samples of their own", lights.len(), samples.len());
    ledger.add(
        "visibility",
        visibility.0,
        format!("{} of {} sub-texels decided otherwise", visibility.1, visibility.2),
    );
    ledger.add("cube map", cube_map, format!("against {NATIVE_DIRECTIONS} rays into the native map; {note}"));
    ledger.add("row truncation", truncation, format!("quantiser included; {note}"));
    Ok(())
}

/// Irradiance under each light from rows of which nothing is dropped, chunk by chunk.
fn full_resolution(baker: &RowBaker, surface: &Surface, lights: &[Light], side: usize) -> Result<Vec<Vec<DVec3>>> {
    let lights: Vec<CubeLight> = lights.iter().map(|light| CubeLight::new(light, side)).collect::<Result<_>>()?;
    let entrance = EntranceBasis::new(TERMS);
    let (samples, domain) = (surface.samples, surface.domain);
    let project = |patch: usize| {
        let part = samples.part_offsets.partition_point(|&first| first as usize <= patch) - 1;
        let medium = domain.parts.parts[part].medium.and_then(|m| domain.media.get(m as usize));
        let projection = medium.and_then(|m| entrance.project(m.properties.eta_inside_over_outside).ok());
        projection.map_or_else(Default::default, |p| p.coefficients)
    };
    let chunk = |range: Range<usize>| -> Result<Vec<Vec<DVec3>>> {
        let rows = Rows::new(baker.range(range.clone()), &[0, range.len() as u32])?;
        let of_light = |light| rows.irradiance_range(0..range.len(), light, |i| project(range.start + i));
        lights.iter().map(of_light).collect()
    };
    let count = samples.len();
    let ranges: Vec<Range<usize>> =
        (0..count).step_by(visibility::GROUP).map(|a| a..count.min(a + visibility::GROUP)).collect();
    let parts: Vec<Vec<Vec<DVec3>>> = ranges.into_par_iter().map(chunk).collect::<Result<_>>()?;
    Ok((0..lights.len()).map(|light| parts.iter().flat_map(|part| part[light].iter().copied()).collect()).collect())
}

/// Error of the irradiance under a constant light by visibility decisions that differ from one ray each, over some samples; how
/// many differ, and of how many.
fn visibility_error(surface: &Surface, settings: EnvironmentRows) -> (VertexError, u64, u64) {
    let resolution = settings.of_rows(6).resolution;
    let step = surface.samples.len().div_ceil(CHECKED).max(1);
    let mesh = surface.domain.mesh;
    let observers: Vec<Observer> =
        (0..surface.samples.len()).step_by(step).map(|i| Observer::of(mesh, surface.samples.patch(i))).collect();
    let occluders = Occluders::new(mesh);
    let (mut wrong, mut all, mut error2, mut mean2) = (0, 0, 0.0, 0.0);
    visibility::visit(&occluders, surface.bvh, &observers, resolution, |i, visible| {
        let (mut signed, mut seen) = (0i64, 0i64);
        let side = resolution.side();
        for index in 0..FACES * side * side {
            let (face, y, x) = (index / (side * side), index / side % side, index % side);
            if !visible.bit(&visible.above, face, x, y) {
                continue;
            }
            let ray = observers[i].ray(cube_map::direction(side, face, x, y));
            let by_ray = !surface.bvh.occluded(&ray, observers[i].triangle);
            let decided = visible.bit(&visible.seen, face, x, y);
            wrong += u64::from(by_ray != decided);
            signed += i64::from(decided) - i64::from(by_ray);
            seen += i64::from(by_ray);
            all += 1;
        }
        error2 += (signed * signed) as f64;
        mean2 += (seen * seen) as f64;
    });
    let rms = if mean2 > 0.0 { (error2 / mean2).sqrt() } else { 0.0 };
    (VertexError { rms, bias: 0.0, p999: rms, worst: rms, dark: 0.0 }, wrong, all)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::forms::test_scene::scene;
    use crate::geometry::bvh::Bvh;
    use crate::geometry::shapes;

    /// A sun in a map is lit like a directional light: with its shadows, and at its place.
    #[test]
    fn suns_of_an_environment_go_past_the_rows() {
        let pair =
            [(shapes::bumpy_head(10.0, 3), DVec3::ZERO), (shapes::icosphere(4.0, 3), DVec3::new(6.0, 9.0, 12.0))];
        let scene = scene(shapes::compose(&pair), "skin1");
        let bvh = Bvh::new(&scene.mesh);
        let samples = Samples::new(&scene.mesh, &scene.parts, 3000);
        let samples = in_tree_order(&samples, &samples::patches(&scene.mesh, &samples));
        let patches = samples::patches(&scene.mesh, &samples);
        let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
        let settings = EnvironmentRows { side: 32, coefficients: 64 };
        let stored = StoredRows::new(rows(&surface, settings, &Silent).unwrap());
        let light = [Light::environment(Arc::new(sky_with_sun()), 40.0, DVec3::ONE).unwrap()];
        let native = LightSampling { directions: 2048, ..LightSampling::REFERENCE };
        let etas = [scene.media[0].properties.eta_inside_over_outside];
        let truth = Illumination::new(&surface, &light, &etas, native).unwrap().all(&Silent);
        let error = |values: &[DVec3]| {
            let areas: Vec<f64> = patches.iter().map(|p| p.area_mm2).collect();
            crate::math::statistics::vertex_error(values, &truth, &areas)
        };
        let mut whole = vec![DVec3::ZERO; samples.len()];
        stored.add(&light, scene.domain(), &samples, &mut whole).unwrap();
        let sampling = LightSampling::FAST;
        let (split, _) = StoredRows::illuminate(Some(&stored), &surface, (&light, sampling), &Silent).unwrap();
        let (split, whole) = (error(&split), error(&whole));
        println!("irradiance under a sun and a sky: {split:?}; through the rows alone: {whole:?}");
        // What is left is the rows' error of the sky and the noise of the rays, sample by sample; scattering averages over both.
        assert!(split.rms < 0.03 && split.dark < 0.35, "{split:?}");
        assert!(whole.rms > 2.5 * split.rms && whole.dark > 2.5 * split.dark, "{whole:?}");
    }
}
