//! Entry of light where it first scatters.
//!
//! Light that enters at `x` along a refracted direction scatters for the first time a free path further on. A kernel
//! that was calibrated with diffuse entry knows the mean of that; under a lone direction the irradiance is moved by the
//! tangential part of the step: the place of the first collision is brought back to the surface along the outward normal
//! of the entrance. Where that meets no surface of the body, the light stays. No light is lost.

use glam::DVec3;
use rayon::prelude::*;

use super::irradiance::{Illumination, LightSampling, Pieces};
use super::surface::Surface;
use crate::error::Result;
use crate::geometry::bvh::Ray;
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{Facet, bisect};
use crate::light::Light;
use crate::math::random::{radical_inverse_2, uniform};
use crate::medium::fresnel::refracted_cosine;
use crate::progress::Progress;

/// Steps of each sample; channels share the depths in free paths.
const STEPS: usize = 4;

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
pub fn moves(light: &Light) -> bool {
    matches!(light, Light::Directional { .. } | Light::Point { .. })
}

/// Irradiance of every sample by lights that move, RGB; `etas` are the indices of the media, inside over outside.
///
/// # Errors
/// As [`Illumination::new`].
pub fn entered(
    surface: &Surface,
    lights: &[Light],
    (etas, sampling): (&[f64], LightSampling),
    progress: &dyn Progress,
) -> Result<Vec<DVec3>> {
    let mut sum = vec![DVec3::ZERO; surface.samples.len()];
    for light in lights {
        let of_light = Illumination::new(surface, std::slice::from_ref(light), etas, sampling)?.all(progress);
        sum.iter_mut().zip(moved(surface, light, &of_light)).for_each(|(sum, e)| *sum += e);
    }
    Ok(sum)
}

/// Irradiance of every sample under lights, RGB, that of lights of one direction moved, and of the pieces of samples that the
/// others light unevenly.
///
/// # Errors
/// As [`Illumination::new`].
pub fn entered_with_pieces(
    surface: &Surface,
    lights: &[Light],
    (etas, sampling): (&[f64], LightSampling),
    progress: &dyn Progress,
) -> Result<(Vec<DVec3>, Pieces)> {
    let (moving, others): (Vec<Light>, Vec<Light>) = lights.iter().cloned().partition(moves);
    let mut irradiance = entered(surface, &moving, (etas, sampling), progress)?;
    if others.is_empty() {
        return Ok((irradiance, Pieces::NONE));
    }
    let (of_others, pieces) = Illumination::new(surface, &others, etas, sampling)?.all_with_pieces(progress);
    irradiance.iter_mut().zip(of_others).for_each(|(sum, e)| *sum += e);
    Ok((irradiance, pieces))
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
        let mut deposits: Vec<(u32, DVec3)> = Vec::with_capacity(range.len() * 4);
        for sample in range {
            let patch = &surface.patches[sample];
            let flux = irradiance[sample] * patch.area_mm2;
            if flux == DVec3::ZERO {
                continue;
            }
            let step = |c: usize, k: usize| {
                let at = target(surface, &facets, sample, (c, k), towards(patch.centre_mm)?)?;
                Some((at, flux[c] / STEPS as f64))
            };
            for c in 0..3 {
                let mut one = DVec3::ZERO;
                for k in 0..STEPS {
                    let (at, share) = step(c, k).unwrap_or((sample as u32, flux[c] / STEPS as f64));
                    one[c] = share;
                    deposits.push((at, one));
                }
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
    let of = |(sum, patch): (&mut DVec3, &crate::geometry::samples::Patch)| {
        *sum = if patch.area_mm2 > 0.0 { *sum / patch.area_mm2 } else { DVec3::ZERO };
    };
    result.iter_mut().zip(surface.patches).for_each(of);
    result
}

/// The sample that a step of a sample's light ends at.
fn target(
    surface: &Surface,
    facets: &Facets,
    sample: usize,
    (channel, step): (usize, usize),
    towards: DVec3,
) -> Option<u32> {
    let mesh = surface.domain.mesh;
    // Samples whose indices are near lie together: the depths of any 2^k in a row are spread evenly.
    let index = (sample * STEPS + step) as u32;
    // A point of the sample, so that the whole of it is moved and not its middle alone.
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
    let free_path = medium.properties.mean_free_path_mm()[channel];
    let length = -free_path * (1.0 - radical_inverse_2(index) - LEAST).max(LEAST).ln();
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
