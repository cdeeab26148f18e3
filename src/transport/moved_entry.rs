//! Entry of light where it first scatters.
//!
//! Light that enters at `x` along a refracted direction scatters for the first time a free path further on. A kernel
//! that was calibrated with diffuse entry knows the mean of that; under a lone direction the irradiance is moved by the
//! tangential part of the step: the place of the first collision is brought back to the surface along the outward normal
//! of the entrance. Where that meets no surface of the body, the light stays. No light is lost.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::domain::Domain;
use super::irradiance::{Illumination, LightSampling, Pieces};
use super::surface::Surface;
use crate::error::Result;
use crate::geometry::bvh::Ray;
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{Facet, Patch, bisect};
use crate::light::Light;
use crate::math::random::{radical_inverse_2, uniform};
use crate::medium::fresnel::refracted_cosine;
use crate::progress::Progress;

/// Steps of each sample.
const STEPS: usize = 8;

/// Numbers of samples next to each other whose light is evened, and the least cosine between their normals.
const NEIGHBOURS: [usize; 2] = [16, 4];
const FLAT: f64 = 0.7;

/// Share of the light that goes farther than any step.
const LEAST: f64 = 1e-10;

/// Steps of a sequence that fills the square evenly: powers of the inverse of the plastic number (Roberts 2018, "The unreasonable
/// effectiveness of quasirandom sequences").
const PLASTIC: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Stage of the random numbers.
const STAGE: u64 = 0x656e_7472;

/// Samples of one task.
const TASK: usize = 256;

/// Facets of every triangle, by their paths.
struct Facets {
    offsets: Vec<u32>,
    /// Path and sample.
    of: Vec<(u32, u32)>,
}

impl Facets {
    fn new(surface: &Surface) -> Self {
        let mut all: Vec<(u32, u32, u32)> = (0..surface.samples.len())
            .flat_map(|i| surface.samples.patch(i).iter().map(move |f| (f.triangle, f.path, i as u32)))
            .collect();
        all.sort_unstable();
        let count = surface.domain.mesh.triangles.len() as u32;
        let offsets = (0..=count).map(|t| all.partition_point(|f| f.0 < t) as u32).collect();
        Self { offsets, of: all.into_iter().map(|(_, path, sample)| (path, sample)).collect() }
    }

    /// The sample around a point of a triangle.
    fn at(&self, mesh: &Mesh, triangle: u32, point: DVec3) -> Option<u32> {
        let (from, to) = (*self.offsets.get(triangle as usize)?, *self.offsets.get(triangle as usize + 1)?);
        let of = self.of.get(from as usize..to as usize)?;
        let mut facet = Facet::whole(triangle);
        let mut corners = mesh.corners_local_mm(triangle);
        loop {
            if let Ok(found) = of.binary_search_by_key(&facet.path, |f| f.0) {
                return Some(of[found].1);
            }
            let [left, right] = facet.halves()?;
            let halves = bisect(corners);
            // The cut runs from the middle of the longest edge to the corner that both halves end with.
            let [first, middle, apex] = halves[0];
            let across = (middle - apex).cross((first - middle).cross(apex - middle));
            let is_left = (point - middle).dot(across) * (first - middle).dot(across) >= 0.0;
            (facet, corners) = if is_left { (left, halves[0]) } else { (right, halves[1]) };
        }
    }
}

/// True if the light of a kind enters from one direction at each point, and is moved.
fn moves(light: &Light) -> bool {
    matches!(light, Light::Directional { .. } | Light::Point { .. })
}

/// Irradiance of every sample under lights, RGB, and of the pieces of samples that are lit unevenly: that of lights of one direction
/// moved, and of the others, if there are any, as a function tells it. `etas` are the indices of the media, inside over outside.
///
/// # Errors
/// As [`Illumination::new`]; those of the function.
pub fn entered(
    surface: &Surface,
    lights: &[Light],
    (etas, sampling): (&[f64], LightSampling),
    of_others: impl FnOnce(&[Light]) -> Result<(Vec<DVec3>, Pieces)>,
    progress: &dyn Progress,
) -> Result<(Vec<DVec3>, Pieces)> {
    let (moving, others): (Vec<Light>, Vec<Light>) = lights.iter().cloned().partition(moves);
    let (mut irradiance, pieces) = match others.as_slice() {
        [] => (vec![DVec3::ZERO; surface.samples.len()], Pieces::NONE),
        others => of_others(others)?,
    };
    for light in &moving {
        let of_light = Illumination::new(surface, std::slice::from_ref(light), etas, sampling)?.all(progress);
        irradiance.iter_mut().zip(moved(surface, light, &of_light)).for_each(|(sum, e)| *sum += e);
    }
    Ok((irradiance, pieces))
}

/// [`entered`] with rays towards all lights.
///
/// # Errors
/// As [`Illumination::new`].
pub fn entered_by_rays(
    surface: &Surface,
    lights: &[Light],
    (etas, sampling): (&[f64], LightSampling),
    progress: &dyn Progress,
) -> Result<(Vec<DVec3>, Pieces)> {
    let rays = |others: &[Light]| Ok(Illumination::new(surface, others, etas, sampling)?.all_with_pieces(progress));
    entered(surface, lights, (etas, sampling), rays, progress)
}

/// Moves the irradiance of one light, RGB for each sample. Light of many directions at once stays, as diffuse entry does.
pub fn moved(surface: &Surface, light: &Light, irradiance: &[DVec3]) -> Vec<DVec3> {
    let origin = surface.domain.mesh.origin_mm;
    let towards = |at: DVec3| match light {
        Light::Directional { from, .. } => Some(*from),
        Light::Point { at_mm, .. } => Some((*at_mm - origin - at).normalize_or_zero()),
        Light::Constant { .. } | Light::Area { .. } | Light::Environment { .. } => None,
    };
    if towards(DVec3::ZERO).is_none() {
        return irradiance.to_vec();
    }
    let facets = Facets::new(surface);
    let of_task = |task: usize| {
        let range = task * TASK..((task + 1) * TASK).min(irradiance.len());
        let mut deposits: Vec<(u32, DVec3)> = Vec::with_capacity(range.len() * STEPS);
        for sample in range {
            let patch = &surface.patches[sample];
            let flux = irradiance[sample] * patch.area_mm2;
            if flux == DVec3::ZERO {
                continue;
            }
            let (lengths, shares) = steps(sample, free_paths_mm(surface, sample));
            let towards = towards(patch.centre_mm).unwrap_or_default();
            for (k, (length, share)) in lengths.into_iter().zip(shares).enumerate() {
                let at = target(surface, &facets, (sample, k), length, towards).unwrap_or(sample as u32);
                deposits.push((at, flux * share));
            }
        }
        deposits
    };
    let tasks: Vec<Vec<(u32, DVec3)>> = (0..irradiance.len().div_ceil(TASK)).into_par_iter().map(of_task).collect();
    let mut result = vec![DVec3::ZERO; irradiance.len()];
    for (at, flux) in tasks.into_iter().flatten() {
        if let Some(sum) = result.get_mut(at as usize) {
            *sum += flux;
        }
    }
    evened(surface, &mut result);
    result
}

/// Mean free paths of the medium of a sample, RGB, mm; zero where it has none.
fn free_paths_mm(surface: &Surface, sample: usize) -> DVec3 {
    let Domain { parts, media, .. } = surface.domain;
    let of = || {
        let triangle = surface.samples.patch(sample).first()?.triangle;
        let part = parts.parts.get(*parts.triangle_part.get(triangle as usize)? as usize)?;
        Some(media.get(part.medium? as usize)?.properties.mean_free_path_mm())
    };
    of().unwrap_or_default()
}

/// Lengths of the steps of a sample, mm, and the share of the light of each channel that takes them. All channels take the same
/// steps, those of the one with the longest paths, and shorter ones more often.
fn steps(sample: usize, paths: DVec3) -> ([f64; STEPS], [DVec3; STEPS]) {
    let longest = paths.to_array().into_iter().filter(|path| path.is_finite()).fold(0.0, f64::max);
    // Samples whose indices are near lie together: the depths of any 2^k in a row are spread evenly.
    let index = |step: usize| (sample * STEPS + step) as u32;
    let depths: [f64; STEPS] =
        std::array::from_fn(|step| -(1.0 - radical_inverse_2(index(step)) - LEAST).max(LEAST).ln());
    let weights = depths.map(|depth| paths.map(|path| longest / path * (depth - depth * longest / path).exp()));
    let sum: DVec3 = weights.iter().sum();
    let even = DVec3::splat(1.0 / STEPS as f64);
    let shares = weights.map(|weight| {
        let share = (weight / sum).to_array();
        DVec3::from_array([0, 1, 2].map(|c| if share[c].is_finite() { share[c] } else { even[c] }))
    });
    (depths.map(|depth| longest * depth), shares)
}

/// Turns the flux of the samples into irradiance, that of a few neighbours together where they are within a mean free path: what
/// moves lands on single samples, whose light would be grainy.
fn evened(surface: &Surface, flux: &mut [DVec3]) {
    for part in 0..surface.domain.parts.parts.len() {
        let range = surface.samples.part(part);
        let within = range.clone().next().map_or(0.0, |first| free_paths_mm(surface, first).min_element());
        even_out((surface.patches, range, within), &NEIGHBOURS, flux);
    }
}

/// Evens blocks of a number of samples of a range, or where they are not neighbours within a distance (mm) smaller ones.
fn even_out((patches, range, within): (&[Patch], Range<usize>, f64), sizes: &[usize], flux: &mut [DVec3]) {
    let (size, smaller) = sizes.split_first().map_or((1, &[][..]), |(size, smaller)| (*size, smaller));
    for start in range.clone().step_by(size) {
        let block = start..(start + size).min(range.end);
        let first = &patches[start];
        let is_near =
            |patch: &Patch| patch.centre_mm.distance(first.centre_mm) < within && patch.normal.dot(first.normal) > FLAT;
        if size > 1 && !patches[block.clone()].iter().all(is_near) {
            even_out((patches, block, within), smaller, flux);
            continue;
        }
        let area: f64 = patches[block.clone()].iter().map(|patch| patch.area_mm2).sum();
        let sum: DVec3 = flux[block.clone()].iter().sum();
        flux[block].fill(if area > 0.0 { sum / area } else { DVec3::ZERO });
    }
}

/// The sample that a step of a sample's light ends at.
fn target(
    surface: &Surface,
    facets: &Facets,
    (sample, step): (usize, usize),
    length: f64,
    towards: DVec3,
) -> Option<u32> {
    let mesh = surface.domain.mesh;
    // A point of the sample, so that the whole of it is moved and not its middle alone.
    let index = (sample * STEPS + step) as u32;
    let own = surface.samples.patch(sample);
    let facet = own.get((uniform(STAGE, index.into(), 0) * own.len() as f64) as usize)?;
    let [a, b, c] = facet.corners_local_mm(mesh);
    let [r, s] = PLASTIC.map(|ratio| (f64::from(index) * ratio).fract());
    let r = r.sqrt();
    let at = a * (1.0 - r) + b * (r * (1.0 - s)) + c * (r * s);
    let normal = mesh.normal(facet.triangle);
    let part = *surface.domain.parts.triangle_part.get(facet.triangle as usize)?;
    let medium = surface.domain.media.get(surface.domain.parts.parts.get(part as usize)?.medium? as usize)?;
    let eta = medium.properties.eta_inside_over_outside;
    let cosine = towards.dot(normal);
    let inside = refracted_cosine(eta, cosine)?;
    let direction = -((towards - cosine * normal) / eta + inside * normal).normalize_or_zero();
    let depth = length * inside;
    if !(depth.is_finite() && cosine > 0.0) {
        return None;
    }
    let ray = Ray {
        origin: (at + length * direction).as_vec3(),
        direction: normal.as_vec3(),
        t_min: 0.0,
        t_max: (2.0 * depth) as f32,
    };
    let hit = surface.bvh.closest(&ray)?;
    if surface.domain.parts.triangle_part.get(hit.triangle as usize) != Some(&part)
        || mesh.normal(hit.triangle).dot(normal) <= 0.0
    {
        return None;
    }
    let point = ray.origin.as_dvec3() + f64::from(hit.t) * normal;
    facets.at(mesh, hit.triangle, point)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::transport::test_scene::{Fixture, named};

    #[test]
    fn light_on_a_plane_moves_by_the_tangential_part_of_a_free_path() {
        let fixture = Fixture::new(shapes::plane(40.0, 40.0, 7), named("marble"), 20_000);
        let surface = fixture.surface();
        let light = Light::Directional { from: DVec3::new(0.8, 0.6, 0.0), irradiance: DVec3::ONE };
        let spot = |at: DVec3| if at.x.abs() < 2.0 && at.z.abs() < 2.0 { DVec3::ONE } else { DVec3::ZERO };
        let before: Vec<DVec3> = surface.patches.iter().map(|p| spot(p.centre_mm)).collect();
        let after = moved(&surface, &light, &before);
        let properties = named("marble");
        let sine = 0.8 / properties.eta_inside_over_outside;
        for c in 0..3 {
            let sums = |values: &[DVec3]| {
                let of = values.iter().zip(surface.patches).map(|(e, p)| (e[c] * p.area_mm2, p.centre_mm));
                of.fold((0.0, DVec3::ZERO), |(sum, moment), (flux, at)| (sum + flux, moment + flux * at))
            };
            let ((flux, from), (there, to)) = (sums(&before), sums(&after));
            assert!((there / flux - 1.0).abs() < 1e-12);
            let shift = (to - from) / flux;
            let expected = -sine * properties.mean_free_path_mm()[c];
            assert!((shift.x / expected - 1.0).abs() < 0.05 && shift.z.abs() < 0.02, "{c}: {shift} {expected}");
        }
    }

    #[test]
    fn light_that_finds_no_surface_stays_and_light_from_all_around_too() {
        let fixture = Fixture::new(shapes::bumpy_head(10.0, 2), named("skin1"), 700);
        let surface = fixture.surface();
        let before: Vec<DVec3> = (0..surface.samples.len()).map(|i| DVec3::splat(f64::from(i as u32 % 5))).collect();
        let point = Light::Point { at_mm: DVec3::new(3.0, 20.0, 1.0), intensity: DVec3::ONE };
        let flux = |values: &[DVec3]| values.iter().zip(surface.patches).map(|(e, p)| *e * p.area_mm2).sum::<DVec3>();
        let after = moved(&surface, &point, &before);
        assert!((flux(&after) - flux(&before)).abs().max_element() < 1e-9 * flux(&before).x && after != before);
        assert_eq!(moved(&surface, &Light::Constant { radiance: DVec3::ONE }, &before), before);
    }
}
