//! Entry of light where it first scatters.
//!
//! Light that enters at `y` along a refracted direction scatters for the first time a free path further on. A kernel
//! that was calibrated with diffuse entry knows the mean of that; under a lone direction the irradiance is moved by the
//! tangential part of the step: the place of the first collision is brought back to the surface along the outward normal
//! of the entrance. Where that meets no surface of the body, the light stays. No light is lost.
//!
//! Moved light is fetched, not thrown: each sample takes the irradiance of the places that steps of a few fixed lengths come from, which
//! is as smooth as the irradiance itself. What is thrown from the same samples with the same lengths says how much light there is of which
//! a neighbourhood has its share: where normals converge it gathers, and the fetched light is brought to that, over cells that are wide
//! enough to hold many samples.

use glam::DVec3;
use rayon::prelude::*;

use super::domain::Domain;
use super::irradiance::{Illumination, LightSampling, Pieces};
use super::surface::Surface;
use crate::error::Result;
use crate::geometry::bvh::Ray;
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::{Facet, bisect};
use crate::light::Light;
use crate::medium::fresnel::refracted_cosine;
use crate::progress::Progress;

/// Steps of each sample.
const STEPS: usize = 6;

/// Edge of the cells in mean free paths, and the least in distances between samples.
const CELL: f64 = 3.0;
const CELL_SAMPLES: f64 = 4.0;

/// Bounds of the factor of a cell; what is more is light that fetching does not find, and is spread over the cell.
const LEAST_FACTOR: f64 = 0.5;
const MOST_FACTOR: f64 = 2.0;

/// Steps shorter than this share of the radius of a sample stay in it.
const SHORT: f64 = 0.25;

/// Cosine towards the light below which samples look for none.
const TURNED_AWAY: f64 = -0.5;

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

/// Steps of light in a medium: their lengths, mm, and the share of the light of each channel that takes them.
#[derive(Clone, Copy)]
struct Steps {
    eta: f64,
    lengths_mm: [f64; STEPS],
    shares: [DVec3; STEPS],
}

impl Steps {
    /// Strata of equal shares of the mean distribution of all channels, and the mean lengths in them; none without free paths.
    fn new(eta: f64, paths_mm: DVec3) -> Option<Self> {
        if !(paths_mm.min_element() > 0.0 && paths_mm.max_element().is_finite()) {
            return None;
        }
        // Shares and mean lengths of the channels beyond a length.
        let beyond = |length: f64| (-length / paths_mm).exp();
        let moment = |length: f64| (paths_mm + length) * beyond(length);
        let mean = |v: DVec3| v.element_sum() / 3.0;
        let edge = |share: f64| {
            let (mut low, mut high) = (0.0, -paths_mm.max_element() * share.ln());
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if mean(beyond(middle)) > share { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        let (mut lengths_mm, mut shares) = ([0.0; STEPS], [DVec3::ZERO; STEPS]);
        let (mut share, mut length) = (DVec3::ONE, paths_mm);
        for k in 0..STEPS {
            let (next_share, next_length) = if k + 1 == STEPS {
                (DVec3::ZERO, DVec3::ZERO)
            } else {
                let end = edge(1.0 - (k + 1) as f64 / STEPS as f64);
                (beyond(end), moment(end))
            };
            shares[k] = share - next_share;
            lengths_mm[k] = mean(length - next_length) / mean(shares[k]);
            (share, length) = (next_share, next_length);
        }
        Some(Self { eta, lengths_mm, shares })
    }
}

/// Cells of a grid around the samples of a part; samples share in the eight nearest.
struct Cells {
    /// Eight cells of each sample, and the place between them.
    of_sample: Vec<([u32; 8], [f32; 3])>,
    count: usize,
}

impl Cells {
    /// Cells of the samples, whose edges depend on the part.
    fn new(surface: &Surface, edge_mm: impl Fn(usize) -> Option<f64>) -> Self {
        let mut keys: Vec<[i32; 4]> = Vec::new();
        let mut of_sample = Vec::new();
        let corners = |[part, x, y, z]: [i32; 4]| -> [[i32; 4]; 8] {
            std::array::from_fn(|i| [part, x + (i & 1) as i32, y + (i >> 1 & 1) as i32, z + (i >> 2) as i32])
        };
        let mut bases = vec![([i32::MIN; 4], [0.0; 3]); surface.samples.len()];
        for part in 0..surface.domain.parts.parts.len() {
            let Some(edge) = edge_mm(part) else { continue };
            for sample in surface.samples.part(part) {
                let at = surface.patches[sample].centre_mm / edge;
                let base = at.floor();
                bases[sample] =
                    ([part as i32, base.x as i32, base.y as i32, base.z as i32], (at - base).as_vec3().to_array());
                keys.extend(corners(bases[sample].0));
            }
        }
        keys.sort_unstable();
        keys.dedup();
        for (base, at) in bases {
            let found = |key: [i32; 4]| keys.binary_search(&key).map_or(u32::MAX, |found| found as u32);
            of_sample.push((if base[0] == i32::MIN { [u32::MAX; 8] } else { corners(base).map(found) }, at));
        }
        Self { of_sample, count: keys.len() }
    }

    /// Cells of a sample and its shares in them.
    fn shares(&self, sample: usize) -> impl Iterator<Item = (usize, f64)> {
        let (cells, at) = &self.of_sample[sample];
        let share = |i: usize| {
            let of = |axis: usize| if i >> axis & 1 == 1 { at[axis] } else { 1.0 - at[axis] };
            f64::from(of(0) * of(1) * of(2))
        };
        cells.iter().enumerate().filter(|(_, cell)| **cell != u32::MAX).map(move |(i, cell)| (*cell as usize, share(i)))
    }

    /// Sums over the cells of values of the samples.
    fn sums(&self, values: impl Iterator<Item = DVec3>) -> Vec<DVec3> {
        let mut sums = vec![DVec3::ZERO; self.count];
        for (sample, value) in values.enumerate() {
            if value != DVec3::ZERO {
                self.shares(sample).for_each(|(cell, share)| sums[cell] += share * value);
            }
        }
        sums
    }

    /// Means at a sample of values of the cells.
    fn mean(&self, sample: usize, values: &[DVec3]) -> DVec3 {
        self.shares(sample).map(|(cell, share)| share * values[cell]).sum()
    }
}

/// What the moving of light needs of a surface, whatever the light.
pub struct MovedEntry {
    facets: Facets,
    cells: Cells,
    /// Steps of each part; none of parts whose light stays.
    steps: Vec<Option<Steps>>,
    /// Part of each sample.
    part: Vec<u32>,
    /// Area of the samples in each cell, mm^2.
    areas_mm2: Vec<DVec3>,
}

impl MovedEntry {
    /// The samples of a surface, on parts whose light moves.
    pub fn new(surface: &Surface, moves: impl Fn(usize) -> bool) -> Self {
        let Domain { parts, media, .. } = surface.domain;
        let of_part = |(part, entry): (usize, &crate::geometry::part_table::PartEntry)| {
            let medium = media.get(entry.medium? as usize)?.properties;
            Steps::new(medium.eta_inside_over_outside, medium.mean_free_path_mm()).filter(|_| moves(part))
        };
        let steps: Vec<Option<Steps>> = parts.parts.iter().enumerate().map(of_part).collect();
        let edge = |part: usize| {
            let medium = media.get(parts.parts[part].medium? as usize)?.properties;
            let spacing = (parts.parts[part].area_mm2 / surface.samples.part(part).len().max(1) as f64).sqrt();
            steps[part].map(|_| (CELL * medium.mean_free_path_mm().max_element()).max(CELL_SAMPLES * spacing))
        };
        let cells = Cells::new(surface, edge);
        let areas_mm2 = cells.sums(surface.patches.iter().map(|patch| DVec3::splat(patch.area_mm2)));
        let mut part = vec![0; surface.samples.len()];
        for p in 0..parts.parts.len() {
            part[surface.samples.part(p)].fill(p as u32);
        }
        Self { facets: Facets::new(surface), cells, steps, part, areas_mm2 }
    }

    /// Irradiance of every sample under lights, RGB, and of the pieces of samples that are lit unevenly: that of lights of one direction
    /// moved, and of the others, if there are any, as a function tells it. `etas` are the indices of the media, inside over outside.
    ///
    /// # Errors
    /// As [`Illumination::new`]; those of the function.
    pub fn entered(
        &self,
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
            irradiance.iter_mut().zip(self.moved(surface, light, &of_light)).for_each(|(sum, e)| *sum += e);
        }
        Ok((irradiance, pieces))
    }

    /// [`Self::entered`] with rays towards all lights.
    ///
    /// # Errors
    /// As [`Illumination::new`].
    pub fn entered_by_rays(
        &self,
        surface: &Surface,
        lights: &[Light],
        (etas, sampling): (&[f64], LightSampling),
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        let rays = |others: &[Light]| Ok(Illumination::new(surface, others, etas, sampling)?.all_with_pieces(progress));
        self.entered(surface, lights, (etas, sampling), rays, progress)
    }

    /// Moves the irradiance of one light, RGB for each sample. Light of many directions at once stays, as diffuse entry does.
    pub fn moved(&self, surface: &Surface, light: &Light, irradiance: &[DVec3]) -> Vec<DVec3> {
        let origin = surface.domain.mesh.origin_mm;
        let towards = |at: DVec3| match light {
            Light::Directional { from, .. } => Some(*from),
            Light::Point { at_mm, .. } => Some((*at_mm - origin - at).normalize_or_zero()),
            Light::Constant { .. } | Light::Area { .. } | Light::Environment { .. } => None,
        };
        if towards(DVec3::ZERO).is_none() {
            return irradiance.to_vec();
        }
        // Irradiance that is fetched or stays, and where it was thrown.
        let of_sample = |sample: usize| {
            let patch = &surface.patches[sample];
            let mut thrown = [u32::MAX; STEPS];
            let Some(steps) = &self.steps[self.part[sample] as usize] else { return (irradiance[sample], thrown) };
            let normal = patch.cross_mm2.normalize_or_zero();
            let towards = towards(patch.centre_mm).unwrap_or_default();
            let cosine = towards.dot(normal);
            let mut sum = DVec3::ZERO;
            for k in 0..STEPS {
                let (length, share) = (steps.lengths_mm[k], steps.shares[k]);
                if irradiance[sample] != DVec3::ZERO {
                    thrown[k] = self.target(surface, sample, (length, steps.eta), towards).unwrap_or(u32::MAX);
                    if thrown[k] == u32::MAX {
                        sum += share * irradiance[sample];
                    }
                }
                if cosine > TURNED_AWAY
                    && let Some(from) = self.source(surface, (sample, normal), (length, steps.eta), towards)
                {
                    sum += share * irradiance[from as usize];
                }
            }
            (sum, thrown)
        };
        let fetched: Vec<(DVec3, [u32; STEPS])> = (0..irradiance.len()).into_par_iter().map(of_sample).collect();
        let mut flux = vec![DVec3::ZERO; irradiance.len()];
        for (sample, (_, thrown)) in fetched.iter().enumerate() {
            let own = irradiance[sample] * surface.patches[sample].area_mm2;
            let Some(steps) = self.steps[self.part[sample] as usize].filter(|_| own != DVec3::ZERO) else { continue };
            for (at, share) in thrown.iter().zip(steps.shares) {
                flux[if *at == u32::MAX { sample } else { *at as usize }] += own * share;
            }
        }
        let there = self.cells.sums(fetched.iter().zip(surface.patches).map(|((e, _), patch)| *e * patch.area_mm2));
        let wanted = self.cells.sums(flux.into_iter());
        // Factors of the cells, and irradiance that fetching does not find.
        let (mut factors, mut missing) = (vec![DVec3::ONE; self.cells.count], vec![DVec3::ZERO; self.cells.count]);
        for cell in 0..self.cells.count {
            for c in 0..3 {
                let (wanted, there) = (wanted[cell][c], there[cell][c]);
                if there > 0.0 {
                    factors[cell][c] = (wanted / there).clamp(LEAST_FACTOR, MOST_FACTOR);
                }
                missing[cell][c] =
                    (wanted - factors[cell][c] * there).max(0.0) / self.areas_mm2[cell].x.max(f64::MIN_POSITIVE);
            }
        }
        let mut result: Vec<DVec3> = fetched.iter().map(|(e, _)| *e).collect();
        result.par_iter_mut().enumerate().for_each(|(sample, e)| {
            if self.steps[self.part[sample] as usize].is_some() {
                *e = *e * self.cells.mean(sample, &factors) + self.cells.mean(sample, &missing);
            }
        });
        self.keep_flux(surface, irradiance, &mut result);
        result
    }

    /// Scales the irradiance of each part to the flux that it had.
    fn keep_flux(&self, surface: &Surface, before: &[DVec3], after: &mut [DVec3]) {
        for part in 0..surface.domain.parts.parts.len() {
            let range = surface.samples.part(part);
            let flux =
                |values: &[DVec3]| -> DVec3 { range.clone().map(|i| values[i] * surface.patches[i].area_mm2).sum() };
            let (before, there) = (flux(before), flux(after));
            for c in (0..3).filter(|&c| there[c] > 0.0) {
                let factor = before[c] / there[c];
                range.clone().for_each(|i| after[i][c] *= factor);
            }
        }
    }

    /// The sample that a step of a sample's light ends at.
    fn target(&self, surface: &Surface, sample: usize, (length, eta): (f64, f64), towards: DVec3) -> Option<u32> {
        let patch = &surface.patches[sample];
        let normal = patch.cross_mm2.normalize_or_zero();
        let cosine = towards.dot(normal);
        let inside = refracted_cosine(eta, cosine)?;
        if cosine <= 0.0 {
            return None;
        }
        let tangential = (towards - cosine * normal) / eta;
        if length * tangential.length() < SHORT * patch.radius_mm {
            return Some(sample as u32);
        }
        let depth = length * inside;
        self.first(surface, sample, (patch.centre_mm - length * tangential - depth * normal, normal), 2.0 * depth)
    }

    /// The sample that light of a step that ends at a sample comes from.
    fn source(
        &self,
        surface: &Surface,
        (sample, normal): (usize, DVec3),
        (length, eta): (f64, f64),
        towards: DVec3,
    ) -> Option<u32> {
        let patch = &surface.patches[sample];
        let cosine = towards.dot(normal);
        let mut tangential = (towards - cosine * normal) / eta;
        if cosine < 0.0 {
            // Light that grazes comes over the horizon.
            tangential = tangential.normalize_or_zero() / eta;
        }
        let far = length * tangential.length();
        if far < SHORT * patch.radius_mm {
            return Some(sample as u32);
        }
        let depth = length * (1.0 - tangential.length_squared()).max(0.0).sqrt();
        self.first(surface, sample, (patch.centre_mm + length * tangential - depth * normal, normal), 2.0 * depth)
    }

    /// The sample that a ray from inside the body of a sample leaves it through.
    fn first(&self, surface: &Surface, sample: usize, (from, along): (DVec3, DVec3), far: f64) -> Option<u32> {
        let mesh = surface.domain.mesh;
        if !(far.is_finite() && from.is_finite()) {
            return None;
        }
        let ray = Ray { origin: from.as_vec3(), direction: along.as_vec3(), t_min: 0.0, t_max: far as f32 };
        let hit = surface.bvh.closest(&ray)?;
        if surface.domain.parts.triangle_part.get(hit.triangle as usize) != Some(&self.part[sample])
            || mesh.normal(hit.triangle).dot(along) <= 0.0
        {
            return None;
        }
        let point = ray.origin.as_dvec3() + f64::from(hit.t) * along;
        self.facets.at(mesh, hit.triangle, point)
    }
}

/// True if the light of a kind enters from one direction at each point, and is moved.
fn moves(light: &Light) -> bool {
    matches!(light, Light::Directional { .. } | Light::Point { .. })
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
        let after = MovedEntry::new(&surface, |_| true).moved(&surface, &light, &before);
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
        let entry = MovedEntry::new(&surface, |_| true);
        let after = entry.moved(&surface, &point, &before);
        assert!((flux(&after) - flux(&before)).abs().max_element() < 1e-9 * flux(&before).x && after != before);
        assert_eq!(entry.moved(&surface, &Light::Constant { radiance: DVec3::ONE }, &before), before);
    }
}
