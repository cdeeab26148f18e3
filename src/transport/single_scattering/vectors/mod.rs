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
//! casts some thousands ([`Sharing::Adaptive`]):
//!
//! - along the normal, Gauss points in place of the midpoint rule: four of them are nearer to the integral than 16
//!   deterministic samples (see [`super::depths::gauss`]);
//! - over directions, rays at the corners of cells of an eighth of a face (11 degrees), later of parts of them; what the
//!   rays meet, a plane and whether the light is free, is interpolated over the cell, and refraction, attenuation and channels
//!   are worked out for each texel, so that a flat surface is exact however large cells are; cells with a shadow boundary,
//!   and those over which the plane turns or shifts, are cut in four, down to single texels whose corners are shared with
//!   their neighbours.
//!
//! No vertex depends on another, so that ranges and threads change nothing.
//!
//! # Measured
//!
//! Closed bunny of 69,666 triangles, 30 mm, faces of 32 texels, 64 vertices spread over it, against rays that are not shared with 64
//! deterministic samples. Relative RMS over vertices (worst channel, worst of three turns) of [`Sharing::DEFAULT`] after the
//! projection on harmonics of order 24, marble and skin1: constant light 0.3 and 0.3 %; Pisa and Potsdamer Platz 0.4 and 0.5 %; Uffizi 0.9 and
//! 1.0 %; St. Peter's square at night 1.3 and 1.0 %; Grace cathedral 2.9 and 2.6 %; a sky with a bare sun 5.6 and 3.4 %; a sun 2.3 % in the mean of
//! 32, 4.7 % at most. The paper's 16 deterministic samples, unshared: 0.3 to 0.5 % under maps, 0.5 and 0.8 % under suns.
//! Four depths are 0.3 % worse under most maps and take 0.7 of the time.
//!
//! What remains is roughness along the path under a small light: each of six Gauss points meets another facet, fold or shadow.
//! Ways to lessen it that were tried, marble, Grace cathedral, the sky with a sun, mean of the suns: 12 depths and a tolerance of
//! 0.1, 2.5 times as long: 2.5, 5, 1.6 %; 8 depths, 1.3 times as long: 3.0, 5.4, 2.1 %; a tolerance of 0.1, 1.5 times as long:
//! 2.4, 4.8, 1.6 %. Before the projection, each of 16 suns as large as a texel, against 64 unshared samples: 3.1 %; 12 and 24 depths
//! with a tolerance of 0.02, 7 and 12 times as long: 1.7 and 1.3 %; the paper's 16: 1.2 %. Texels cut in four where their corners
//! disagree, 1.7 times as long: 2.8 % (a sky with a bare sun 3.0 to 1.7 %, which harmonics do not resolve). Shadow boundaries
//! found between two depths by halving: no change, as one depth in 25 has one next to it.
//! Single scattering is a fifteenth (marble) to a fifth (skin1) of all light, so that 5 % of it are 0.3 to 1 % of what is seen.
//!
//! Sixteen harmonics (g 0.3, a body 6 mm wide of mean free paths of 1 mm, constant light, from aslant): 2.8 % against traced
//! light, 1.5 % with six depths and a tolerance of 0.05; light from behind matters more to a forward phase function than the
//! tolerance knows.
//!
//! # What was tried
//!
//! Interpolating gain and path length over cells in place of planes: 1 to 5 % too dark, as both are concave. The cosine
//! of the mean normal in place of the mean cosine: 1.2 % too bright on facets. Interpolated vertex normals in place of those of
//! the facets: constant light 1.9 % in place of 0.4 % off under marble, whose light enters beside the vertex, suns hardly
//! better. Eight depths: suns 4 % to 2.2 % under skin1 for twice the time.

mod adaptive;
mod every;
mod shade;

use std::ops::Range;

use glam::{DVec3, Vec3};

use self::adaptive::Adaptive;
use self::every::every_direction;
use super::depths::{self, Density, Depth};
use super::interface::{Entry, Form};
use super::interior::{Coefficients, Crossings, ExitPoint, Interior, Optics};
use crate::error::{Error, Result};
use crate::geometry::bvh::{Bvh, Hit, Ray};
use crate::math::cube_map::{FACES, solid_angles_sr};
use crate::math::simd::Level;
use crate::medium::phase::LightTerms;
use crate::transport::domain::Domain;

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
    /// See the figures of the module.
    pub const DEFAULT: Self = Self::Adaptive { depths: 6, tolerance: 0.3 };
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

/// What one ray meets: where it leaves the body, and what is between there and the light.
#[derive(Clone, Copy, Debug, Default)]
struct Probe {
    /// Outward unit normal where the light enters.
    normal: Vec3,
    /// Distance from the point inside to the plane of that place, mm.
    height_mm: f32,
    /// What other bodies let through; 0 where nothing arrives.
    through: [f32; 3],
    /// What the direction contributes at most in any channel, before the phase function and the solid angle.
    value: f32,
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
    /// Extinction of the clearest channel.
    least_per_mm: f64,
    /// The largest weight of a depth.
    worth: f64,
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
    pub fn new(domain: Domain<'a>, bvh: &'a Bvh, settings: VectorSettings) -> Result<Self> {
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
        let interior = Interior::new(domain, bvh, settings.form, settings.crossings, settings.coefficients);
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
        let least_per_mm = optics.sigma_t_per_mm.min_element();
        let weights = depths.iter().map(|d| d.weight.max_element() * (-least_per_mm * d.s_mm).exp());
        let worth = weights.fold(0.0, f64::max);
        (worth > 0.0).then_some(Line { point, optics, start, dense, depths, least_per_mm, worth })
    }

    /// Looks in some directions, one probe each.
    fn trace(&self, line: &Line, requests: &[Request], tracer: &mut Tracer, probes: &mut Vec<Probe>) {
        let first = probes.len();
        probes.resize(first + requests.len(), Probe::default());
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
        for (i, request) in requests.iter().enumerate() {
            let Some(depth) = line.depths.get(request.depth as usize) else { continue };
            let (normal, height_mm, beyond) = if line.dense {
                let beyond = self.interior.beyond_flat(line.point, request.direction, f64::INFINITY);
                (line.point.normal, depth.s_mm, beyond)
            } else {
                let leaving = self.interior.leaving(&tracer.rays[i], tracer.hits[i], line.point.part);
                let Some(leaving) = leaving else { continue };
                let height_mm = leaving.distance_mm * leaving.normal.dot(request.direction);
                (leaving.normal, height_mm, self.interior.beyond(&leaving, f64::INFINITY))
            };
            let Some(value) = self.value(line, depth, normal, height_mm, request.direction) else { continue };
            let probe = &mut probes[first + i];
            *probe = Probe { normal: normal.as_vec3(), height_mm: height_mm as f32, through: [0.0; 3], value };
            if f64::from(value) > NEGLIGIBLE * line.worth {
                tracer.shadow_rays.push(beyond.0);
                tracer.skips.push(beyond.1);
                tracer.of_shadow.push((first + i) as u32);
            } else {
                probe.value = 0.0;
            }
        }
        self.shadows(tracer, probes);
    }

    /// What light through a plane contributes at most in any channel; none where no light enters.
    fn value(&self, line: &Line, depth: &Depth, normal: DVec3, height_mm: f64, direction: DVec3) -> Option<f32> {
        let cosine = normal.dot(direction);
        let entry = Entry::new(self.settings.form, line.optics.eta_inside_over_outside, cosine)?;
        let path_mm = height_mm / cosine * entry.stretch;
        Some((depth.weight.max_element() * entry.gain * (-line.least_per_mm * path_mm).exp()) as f32)
    }

    /// Fills what comes through.
    fn shadows(&self, tracer: &mut Tracer, probes: &mut [Probe]) {
        let mut set = |i: u32, through: [f32; 3]| {
            let probe = &mut probes[i as usize];
            probe.through = through;
            probe.value *= through.iter().fold(0.0f32, |m, t| m.max(*t));
        };
        if self.interior.crossings() == Crossings::Attenuated {
            for ((ray, &skip), &i) in tracer.shadow_rays.iter().zip(&tracer.skips).zip(&tracer.of_shadow) {
                set(i, self.interior.transmitted(ray, skip).as_vec3().to_array());
            }
            return;
        }
        tracer.occluded.clear();
        tracer.occluded.resize(tracer.shadow_rays.len(), false);
        self.interior.bvh.occluded_many(&tracer.shadow_rays, &tracer.skips, &mut tracer.occluded);
        for (&occluded, &i) in tracer.occluded.iter().zip(&tracer.of_shadow) {
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

/// Memory of one thread.
struct Work {
    tracer: Tracer,
    requests: Vec<Request>,
    probes: Vec<Probe>,
    adaptive: adaptive::Memory,
}

impl Work {
    fn new() -> Self {
        Self {
            tracer: Tracer::default(),
            requests: Vec::new(),
            probes: Vec::new(),
            adaptive: adaptive::Memory::default(),
        }
    }
}
