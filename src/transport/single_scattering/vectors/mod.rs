//! Single scattering vectors: for each texel of a cube map, what light from there adds to a point, for each term of the phase
//! function and each channel.
//!
//! `T_k(x_o, w) = sigma_s Int_0^dm exp(-s sigma_t) tau_k(x_p(s), w) ds` along the inverse normal (equations 10 and 11 of Wang, Tran
//! and Luebke 2005), as the mean over a texel times its solid angle: `L1 = F_t(w_o) Sum_k h_k(w_o') T_k . L`. For an isotropic
//! phase function `s = pi C T_0 . L` is in the unit of radiosity and may be added to the vectors of multiple scattering.
//!
//! # Samples that are shared
//!
//! The paper renders 16 cube maps of twice the resolution for each vertex: 393,216 rays and as many shadows. Here a point
//! casts some 3,000 ([`Sharing::Adaptive`]):
//!
//! - along the normal, Gauss points in place of the midpoint rule: four of them are nearer to the integral than 16
//!   deterministic samples (see [`super::depths::gauss`]);
//! - over directions, rays at the corners of cells of up to 4 texels; what they bring (where the light enters, how long its
//!   way inside is) is interpolated over the cell, attenuation and channels are worked out for each texel; cells over which
//!   the contribution varies by more than a tolerance, at shadow boundaries and where the surface bends away, are cut in
//!   four, down to single texels whose corners are shared with their neighbours.
//!
//! No vertex depends on another, so that ranges and threads change nothing. Sharing between vertices was weighed and left:
//! points at the same depth under neighbouring vertices have distances to the surface that differ as much as the surface bends,
//! which is what is to be found out; interpolated attenuation needed vertices closer than a third of a mean free path.

mod adaptive;
mod every;
mod shade;

use std::ops::Range;

use glam::DVec3;

use self::adaptive::Adaptive;
use self::every::every_direction;
use super::depths::{self, Density, Depth};
use super::interface::Form;
use super::interior::{Coefficients, Crossings, ExitPoint, Interior, Optics};
use crate::error::{Error, Result};
use crate::geometry::bvh::{Bvh, Hit, Ray};
use crate::math::cube_map::{FACES, solid_angles_sr};
use crate::medium::phase::LightTerms;
use crate::transport::scene::Scene;
use crate::transport::simd::Level;

/// How rays are shared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sharing {
    /// Not at all: the paper's deterministic samples, so many, each with a ray through every one of 2 x 2 sub-texels.
    None {
        /// Distances along the normal.
        depths: u32,
    },
    /// See the module.
    Adaptive {
        /// Gauss points along the normal, for each group of channels of similar extinction.
        depths: usize,
        /// Cells whose corners differ by more than this share of the largest contribution are cut.
        tolerance: f64,
    },
}

impl Sharing {
    /// The paper's.
    pub const PAPER: Self = Self::None { depths: 16 };
    /// See the measured errors of the tests.
    pub const DEFAULT: Self = Self::Adaptive { depths: 4, tolerance: 0.3 };
}

/// What vectors are made of.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorSettings {
    /// Texels along an edge of a face: 8, 16, 32, 64 or 128.
    pub side: usize,
    /// The integrand.
    pub form: Form,
    /// Surfaces between the point where light enters and the light.
    pub crossings: Crossings,
    /// Coefficients of the medium: reduced for an isotropic phase function.
    pub coefficients: Coefficients,
    /// Light side of the phase function.
    pub phase: LightTerms,
    /// Rays.
    pub sharing: Sharing,
}

impl VectorSettings {
    /// Faces of 32 texels, isotropic.
    pub const DEFAULT: Self = Self {
        side: 32,
        form: Form::Physical,
        crossings: Crossings::Occluded,
        coefficients: Coefficients::Reduced,
        phase: LightTerms::Isotropic,
        sharing: Sharing::DEFAULT,
    };
}

/// Everything that the vectors of all points share.
pub struct VectorBaker<'a> {
    interior: Interior<'a>,
    settings: VectorSettings,
    /// Solid angles of a face's texels, sr.
    angles: Vec<f32>,
    level: Level,
    grid: adaptive::Grid,
}

/// What one ray brings: the light of its direction at a point inside, before attenuation.
#[derive(Clone, Copy, Debug, Default)]
struct Probe {
    /// F_t, refraction, solid angle aside; 0 where nothing arrives.
    gain: f32,
    /// `s_i'`, mm.
    path_mm: f32,
    /// What other bodies let through.
    through: [f32; 3],
}

/// A direction to be looked at from a depth.
#[derive(Clone, Copy, Debug)]
struct Request {
    depth: u32,
    direction: DVec3,
}

/// A point with its path.
struct Line<'a> {
    point: &'a ExitPoint,
    optics: &'a Optics,
    start: DVec3,
    dense: bool,
    depths: Vec<Depth>,
}

/// Largest factor between a contribution that is worth a shadow ray and the largest one.
const NEGLIGIBLE: f64 = 2e-4;

/// Memory of one thread.
#[derive(Default)]
struct Tracer {
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    shadow_rays: Vec<Ray>,
    skips: Vec<u32>,
    of_shadow: Vec<u32>,
    occluded: Vec<bool>,
}

impl<'a> VectorBaker<'a> {
    /// Prepares tables.
    ///
    /// # Errors
    /// Another side than 8 to 128, no sample along the normal, a tolerance that is not positive (exit 3).
    pub fn new(scene: &'a Scene, bvh: &'a Bvh, settings: VectorSettings) -> Result<Self> {
        let side = settings.side;
        if !side.is_power_of_two() || !(8..=128).contains(&side) {
            return Err(Error::input(format!("cube map faces of {side} texels: 8, 16, 32, 64 and 128 are possible")));
        }
        let sensible = match settings.sharing {
            Sharing::None { depths } => depths > 0,
            Sharing::Adaptive { depths, tolerance } => depths > 0 && tolerance > 0.0,
        };
        if !sensible {
            return Err(Error::input(
                "single scattering vectors need at least one sample along the normal and a positive tolerance",
            ));
        }
        let interior = Interior::new(scene, bvh, settings.form, settings.crossings, settings.coefficients);
        let angles = solid_angles_sr(side).into_iter().map(|a| a as f32).collect();
        Ok(Self { interior, grid: adaptive::Grid::new(side), settings, angles, level: Level::detect() })
    }

    /// Numbers of one vector: `[term][channel][face][row][column]`.
    pub fn len(&self) -> usize {
        self.settings.phase.count() * 3 * self.texels()
    }

    /// Never: a cube map has texels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Texels of a cube map.
    pub fn texels(&self) -> usize {
        FACES * self.settings.side * self.settings.side
    }

    /// What the vectors are made of.
    pub fn settings(&self) -> &VectorSettings {
        &self.settings
    }

    /// Vectors of some of the points, on one thread; `each` gets the number of a point and its vector, in ascending order. They do
    /// not depend on how ranges are cut. A point without a normal or a medium has a vector of zeros; so has one past the end.
    pub fn range(&self, points: &[ExitPoint], range: Range<usize>, mut each: impl FnMut(usize, &[f32])) {
        let mut out = vec![0.0f32; self.len()];
        let mut work = Work::new();
        for index in range {
            out.fill(0.0);
            if let Some(point) = points.get(index) {
                self.vector(point, &mut work, &mut out);
            }
            each(index, &out);
        }
    }

    fn vector(&self, point: &ExitPoint, work: &mut Work, out: &mut [f32]) {
        let Some(line) = self.line(point) else { return };
        match self.settings.sharing {
            Sharing::None { .. } => every_direction(self, &line, work, out),
            Sharing::Adaptive { tolerance, .. } => Adaptive { baker: self, line: &line, tolerance }.run(work, out),
        }
    }

    fn line<'b>(&'b self, point: &'b ExitPoint) -> Option<Line<'b>> {
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
        (!depths.is_empty()).then_some(Line { point, optics, start, dense, depths })
    }

    /// What arrives from each of some directions; `terms` gets the light side of the phase function after each.
    fn trace(
        &self,
        line: &Line,
        requests: &[Request],
        tracer: &mut Tracer,
        probes: &mut Vec<Probe>,
        terms: &mut Vec<f32>,
    ) {
        let count = self.settings.phase.count();
        let first = probes.len();
        probes.resize(first + requests.len(), Probe::default());
        terms.resize((first + requests.len()) * count, 0.0);
        tracer.rays.clear();
        if !line.dense {
            tracer.rays.extend(requests.iter().map(|r| self.interior.ray(line.at(r.depth), r.direction)));
        }
        tracer.hits.clear();
        tracer.hits.resize(tracer.rays.len(), None);
        self.interior.bvh.closest_many(&tracer.rays, &mut tracer.hits);
        tracer.shadow_rays.clear();
        tracer.skips.clear();
        tracer.of_shadow.clear();
        let least = line.optics.sigma_t_per_mm.min_element();
        let eta = line.optics.eta_inside_over_outside;
        let worth = line.depths.iter().map(|d| d.weight.max_element() * (-least * d.s_mm).exp()).fold(0.0, f64::max);
        let mut values = [0.0f64; crate::medium::phase::MOST_TERMS];
        for (i, request) in requests.iter().enumerate() {
            let Some(depth) = line.depths.get(request.depth as usize) else { continue };
            let found = if line.dense {
                let cosine = line.point.normal.dot(request.direction);
                (cosine > 0.0).then(|| {
                    let incident =
                        self.interior.incident_at(depth.s_mm / cosine, line.point.normal, request.direction, eta);
                    (incident, self.interior.beyond_flat(line.point, request.direction, f64::INFINITY))
                })
            } else {
                self.interior.leaving(&tracer.rays[i], tracer.hits[i], line.point.part).map(|leaving| {
                    let incident = self.interior.incident(&leaving, request.direction, eta);
                    (incident, self.interior.beyond(&leaving, f64::INFINITY))
                })
            };
            let Some((Some(incident), (ray, skip))) = found else { continue };
            let most = depth.weight.max_element() * incident.gain * (-least * incident.path_mm).exp();
            let probe = &mut probes[first + i];
            probe.gain = incident.gain as f32;
            probe.path_mm = incident.path_mm as f32;
            self.settings.phase.evaluate(incident.inside, &mut values);
            let terms = &mut terms[(first + i) * count..][..count];
            terms.iter_mut().zip(&values).for_each(|(out, v)| *out = *v as f32);
            if most > NEGLIGIBLE * worth {
                tracer.shadow_rays.push(ray);
                tracer.skips.push(skip);
                tracer.of_shadow.push((first + i) as u32);
            }
        }
        if self.interior.crossings() == Crossings::Attenuated {
            for ((ray, &skip), &i) in tracer.shadow_rays.iter().zip(&tracer.skips).zip(&tracer.of_shadow) {
                let through = self.interior.transmitted(ray, skip);
                probes[i as usize].through = through.as_vec3().to_array();
            }
            return;
        }
        tracer.occluded.clear();
        tracer.occluded.resize(tracer.shadow_rays.len(), false);
        self.interior.bvh.occluded_many(&tracer.shadow_rays, &tracer.skips, &mut tracer.occluded);
        for (&occluded, &i) in tracer.occluded.iter().zip(&tracer.of_shadow) {
            probes[i as usize].through = [f32::from(u8::from(!occluded)); 3];
        }
    }
}

impl Line<'_> {
    fn at(&self, depth: u32) -> DVec3 {
        let s = self.depths.get(depth as usize).map_or(0.0, |d| d.s_mm);
        self.start - s * self.point.normal
    }
}

/// Memory of one thread.
struct Work {
    tracer: Tracer,
    requests: Vec<Request>,
    probes: Vec<Probe>,
    terms: Vec<f32>,
    adaptive: adaptive::Memory,
}

impl Work {
    fn new() -> Self {
        Self {
            tracer: Tracer::default(),
            requests: Vec::new(),
            probes: Vec::new(),
            terms: Vec::new(),
            adaptive: adaptive::Memory::default(),
        }
    }
}
