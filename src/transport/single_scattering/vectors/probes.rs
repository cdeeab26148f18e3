//! Probes: rays from the path below a point through the surface, and the light that reaches their exit points.

use glam::{DVec3, Vec3};

use super::super::depths::{self, Density, Depth};
use super::super::interface::{Refraction, inside_direction};
use super::super::interior::{Crossings, ExitPoint, Interior, Optics};
use super::settings::{Sharing, VectorSettings};
use crate::geometry::bvh::{Bvh, Hit, Ray};
use crate::math::cube_map::{FACES, direction, solid_angles_sr};
use crate::math::simd::InstructionSet;
use crate::transport::domain::Domain;

/// The body, the settings and the tables that the probes of all points share.
pub(super) struct Prober<'a> {
    pub(super) interior: Interior<'a>,
    pub(super) settings: VectorSettings,
    /// Solid angles of a face's texels, sr.
    pub(super) angles: Vec<f32>,
    /// The instructions that the processor has.
    pub(super) level: InstructionSet,
}

/// The answer of one ray: the plane where it leaves the body, and the light that reaches that place.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Probe {
    /// Outward unit normal where the light enters.
    pub(super) normal: Vec3,
    /// Distance from the point inside to the plane of the surface there, mm.
    pub(super) height_mm: f32,
    /// The share that other bodies let through, RGB; 0 where no light arrives.
    pub(super) through: [f32; 3],
    /// The most that the direction contributes in any channel, before the phase function and the solid angle.
    pub(super) value: f32,
}

/// A direction that a ray takes from a depth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Request {
    pub(super) depth: u32,
    pub(super) direction: DVec3,
}

/// A point with the path below it, along its inverse normal.
pub(super) struct Line<'a> {
    pub(super) point: &'a ExitPoint,
    pub(super) optics: &'a Optics,
    /// The start of the path, relative to the mesh's origin, mm.
    start: DVec3,
    /// True if the medium is too dense for rays, so that the surface counts as flat.
    dense: bool,
    pub(super) depths: Vec<Depth>,
    /// Extinction of the clearest channel, 1/mm.
    pub(super) least_per_mm: f64,
    /// The largest weight of a depth, attenuated back along the path.
    worth: f64,
}

/// Contribution over [`Line::worth`] above which a probe is worth a shadow ray.
const NEGLIGIBLE: f64 = 2e-4;

/// Rays of some probes, their hits and their shadow rays.
#[derive(Default)]
struct TracedRays {
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    shadow_rays: Vec<Ray>,
    skips: Vec<u32>,
    /// The probe of each shadow ray.
    of_shadow: Vec<u32>,
    occluded: Vec<bool>,
}

/// Memory of one thread: the directions that are asked, and the probe of each.
#[derive(Default)]
pub(super) struct ProbeMemory {
    pub(super) requests: Vec<Request>,
    pub(super) probes: Vec<Probe>,
    traced: TracedRays,
}

impl<'a> Prober<'a> {
    pub(super) fn new(domain: Domain<'a>, bvh: &'a Bvh, settings: VectorSettings) -> Self {
        let interior = Interior::new(domain, bvh, settings.form, settings.crossings, settings.coefficients);
        let angles = solid_angles_sr(settings.side).into_iter().map(|a| a as f32).collect();
        Self { interior, settings, angles, level: InstructionSet::detect() }
    }

    /// Texels of a cube map.
    pub(super) fn texels(&self) -> usize {
        FACES * self.settings.side * self.settings.side
    }

    /// The path below a point; none if it has no normal, no medium, or no scattering.
    pub(super) fn line<'b>(&'b self, point: &'b ExitPoint) -> Option<Line<'b>> {
        if !point.at_mm.is_finite() || !point.normal.is_finite() || point.normal == DVec3::ZERO {
            return None;
        }
        let optics = self.interior.optics(point.part)?;
        let start = self.interior.start(point);
        let dense = self.interior.is_dense(optics);
        let reach = if dense { f64::INFINITY } else { self.interior.reach(start, -point.normal, point.part) };
        let depths = match self.settings.sharing {
            Sharing::None { depths } => depths::deterministic(optics, reach, Density::Luminance, depths),
            Sharing::Adaptive { depths, .. } => depths::gauss(optics, reach, depths),
        };
        let least_per_mm = optics.sigma_t_per_mm.min_element();
        let weights = depths.iter().map(|d| d.weight.max_element() * (-least_per_mm * d.s_mm).exp());
        let worth = weights.fold(0.0, f64::max);
        (worth > 0.0).then_some(Line { point, optics, start, dense, depths, least_per_mm, worth })
    }

    /// Traces a ray for each request; appends their probes.
    pub(super) fn trace(&self, line: &Line, memory: &mut ProbeMemory) {
        let ProbeMemory { requests, probes, traced } = memory;
        let first = probes.len();
        probes.resize(first + requests.len(), Probe::default());
        traced.rays.clear();
        if !line.dense {
            traced.rays.extend(requests.iter().map(|r| self.interior.ray(line.at(r.depth), r.direction)));
        }
        traced.hits.clear();
        traced.hits.resize(traced.rays.len(), None);
        self.interior.bvh.closest_many(&traced.rays, &mut traced.hits);
        traced.shadow_rays.clear();
        traced.skips.clear();
        traced.of_shadow.clear();
        for (i, request) in requests.iter().enumerate() {
            let Some(depth) = line.depths.get(request.depth as usize) else { continue };
            let (normal, height_mm, beyond) = if line.dense {
                let beyond = self.interior.beyond_flat(line.point, request.direction, f64::INFINITY);
                (line.point.normal, depth.s_mm, beyond)
            } else {
                let leaving = self.interior.leaving(&traced.rays[i], traced.hits[i], line.point.part);
                let Some(leaving) = leaving else { continue };
                let height_mm = leaving.distance_mm * leaving.normal.dot(request.direction);
                (leaving.normal, height_mm, self.interior.beyond(&leaving, f64::INFINITY))
            };
            let Some(value) = self.value(line, depth, normal, height_mm, request.direction) else { continue };
            let probe = &mut probes[first + i];
            *probe = Probe { normal: normal.as_vec3(), height_mm: height_mm as f32, through: [0.0; 3], value };
            if f64::from(value) > NEGLIGIBLE * line.worth {
                traced.shadow_rays.push(beyond.0);
                traced.skips.push(beyond.1);
                traced.of_shadow.push((first + i) as u32);
            } else {
                probe.value = 0.0;
            }
        }
        self.shadows(traced, probes);
    }

    /// The most that light through a plane contributes in any channel; none where no light enters.
    fn value(&self, line: &Line, depth: &Depth, normal: DVec3, height_mm: f64, direction: DVec3) -> Option<f32> {
        let cosine = normal.dot(direction);
        let refraction = Refraction::new(self.settings.form, line.optics.eta_inside_over_outside, cosine)?;
        let path_mm = height_mm / cosine * refraction.stretch;
        Some((depth.weight.max_element() * refraction.gain * (-line.least_per_mm * path_mm).exp()) as f32)
    }

    /// Sets the light that reaches the probes with shadow rays.
    fn shadows(&self, traced: &mut TracedRays, probes: &mut [Probe]) {
        let mut set = |i: u32, through: [f32; 3]| {
            let probe = &mut probes[i as usize];
            probe.through = through;
            probe.value *= through.iter().fold(0.0f32, |m, t| m.max(*t));
        };
        if self.interior.crossings == Crossings::Attenuated {
            for ((ray, &skip), &i) in traced.shadow_rays.iter().zip(&traced.skips).zip(&traced.of_shadow) {
                set(i, self.interior.transmitted(ray, skip).as_vec3().to_array());
            }
            return;
        }
        traced.occluded.clear();
        traced.occluded.resize(traced.shadow_rays.len(), false);
        self.interior.bvh.occluded_many(&traced.shadow_rays, &traced.skips, &mut traced.occluded);
        for (&occluded, &i) in traced.occluded.iter().zip(&traced.of_shadow) {
            set(i, [f32::from(u8::from(!occluded)); 3]);
        }
    }
}

impl Line<'_> {
    fn at(&self, depth: u32) -> DVec3 {
        let s = self.depths.get(depth as usize).map_or(0.0, |d| d.s_mm);
        self.start - s * self.point.normal
    }
}

/// Adds the vector of a point to `out` by a ray through every sub-texel from every depth: slow and plain, the truth that shared rays
/// are measured against.
pub(super) fn every_direction(prober: &Prober, line: &Line, memory: &mut ProbeMemory, out: &mut [f32]) {
    let side = prober.settings.side;
    let (count, texels) = (prober.settings.phase.count(), prober.texels());
    let (extinction, eta) = (line.optics.sigma_t_per_mm, line.optics.eta_inside_over_outside);
    let mut terms = vec![0.0; count];
    for (index, depth) in line.depths.iter().enumerate() {
        for at in 0..FACES * side {
            let (face, row) = (at / side, at % side);
            memory.requests.clear();
            memory.probes.clear();
            for sub in 0..4 * side {
                let (x, y) = (sub % (2 * side), 2 * row + sub / (2 * side));
                memory.requests.push(Request { depth: index as u32, direction: direction(2 * side, face, x, y) });
            }
            prober.trace(line, memory);
            for (sub, (probe, request)) in memory.probes.iter().zip(&memory.requests).enumerate() {
                let texel = at * side + sub % (2 * side) / 2;
                let angle = f64::from(prober.angles[texel % (side * side)]);
                let cosine = probe.normal.as_dvec3().dot(request.direction);
                let Some(refraction) = Refraction::new(prober.settings.form, eta, cosine) else { continue };
                let normal = probe.normal.as_dvec3();
                let inside = inside_direction(eta, request.direction, normal, cosine, refraction.cos_inside);
                prober.settings.phase.evaluate(inside, &mut terms);
                let path_mm = f64::from(probe.height_mm) / cosine * refraction.stretch;
                for channel in 0..3 {
                    let attenuated = (-extinction[channel] * path_mm).exp();
                    let arriving = refraction.gain * f64::from(probe.through[channel]);
                    let value = depth.weight[channel] * attenuated * arriving * (0.25 * angle);
                    for (k, g) in terms.iter().enumerate() {
                        out[(k * 3 + channel) * texels + texel] += (value * g) as f32;
                    }
                }
            }
        }
    }
}
