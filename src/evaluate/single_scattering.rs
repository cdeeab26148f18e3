//! Single scattering at run time: the interface that evaluators offer to renderers, and the truth by rays.

use glam::DVec3;

use super::capabilities::SingleScattering as Place;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::receivers::ProbePoints;
use crate::transport::single_scattering::radiance::{DepthSampling, Path, Settings, Share, SingleScattering};
use crate::transport::single_scattering::{Coefficients, Crossings, Density, ExitPoint, Form, vertex_points};

/// A point of a surface as an eye ray sees it.
#[derive(Clone, Copy, Debug)]
pub struct SeenPoint {
    /// Exit point of the light; its normal faces the eye.
    pub exit: ExitPoint,
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric weights of the triangle's corners.
    pub weights: [f64; 3],
    /// Unit vector towards the eye.
    pub to_eye: DVec3,
    /// Number of the eye ray, the seed of its random numbers.
    pub key: u64,
    /// This ray's share of the samples of a pixel.
    pub share: Share,
}

/// Single scattering that depends on the eye.
pub trait TowardsEye: Sync {
    /// Radiance towards the eye, outside the medium, RGB.
    fn radiance(&self, seen: &SeenPoint) -> DVec3;

    /// Number of paths from lights that are followed for each pixel of `eye_rays` rays, as a measure of the cost; none
    /// where values are looked up.
    fn paths_per_pixel(&self, eye_rays: u32) -> u64;
}

/// Phase function of single scattering.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Scattering {
    /// Isotropic, with reduced coefficients.
    Isotropic,
    /// Henyey-Greenstein with the medium's g, with unreduced coefficients.
    OfMedium,
}

impl Scattering {
    /// The coefficients that it goes with.
    pub(crate) fn coefficients(self) -> Coefficients {
        match self {
            Self::Isotropic => Coefficients::Reduced,
            Self::OfMedium => Coefficients::Unreduced,
        }
    }
}

/// Settings of single scattering by rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Traced {
    /// Phase function.
    pub scattering: Scattering,
    /// Distances inside for each vertex or pixel and each directional or point light.
    pub samples: u32,
    /// The integrand.
    pub form: Form,
    /// Surfaces between the point where light enters and the light.
    pub crossings: Crossings,
}

/// Directions of a constant, area or environment light for each distance of a directional one.
pub const DIRECTIONS_PER_SAMPLE: u32 = 16;

/// Largest number of distances inside.
pub const MOST_SAMPLES: u32 = 4096;

/// Vertices at which the noise is measured.
const PROBES: usize = 192;

/// Random keys of the two independent estimates from which the noise is measured.
const HALVES: [u64; 2] = [1 << 40, 2 << 40];

/// Scene and lights of single scattering.
#[derive(Clone, Copy)]
pub struct LitScene<'a> {
    /// The scene, with the media in force.
    pub scene: &'a Scene,
    /// Its occluders.
    pub bvh: &'a Bvh,
    /// Lights in force.
    pub lights: &'a [Light],
}

impl Traced {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        match self.samples {
            1..=MOST_SAMPLES => Ok(()),
            other => Err(Error::input(format!("{other} samples of single scattering, not 1 to {MOST_SAMPLES}"))),
        }
    }

    /// Settings with the physical form, light that crosses further surfaces being lost.
    pub const fn new(scattering: Scattering, samples: u32) -> Self {
        Self { scattering, samples, form: Form::Physical, crossings: Crossings::Occluded }
    }

    /// Returns whether a value per vertex exists: exit radiance depends on the eye unless the phase function is
    /// isotropic.
    pub fn is_per_vertex(self, scene: &Scene) -> bool {
        let used = scene.parts.parts.iter().filter_map(|p| scene.media.get(p.medium? as usize));
        self.scattering == Scattering::Isotropic || used.into_iter().all(|m| m.properties.g == 0.0)
    }

    /// See [`Evaluator::single_scattering_is`](super::evaluator::Evaluator::single_scattering_is).
    pub fn is(self, scene: &Scene) -> Place {
        match self.is_per_vertex(scene) {
            true => Place::PerVertex,
            false => Place::TracedTowardsEye,
        }
    }

    fn settings(self) -> Settings {
        Settings {
            coefficients: self.scattering.coefficients(),
            depths: DepthSampling::Random(self.samples, Density::Channels),
            directions: self.samples.saturating_mul(DIRECTIONS_PER_SAMPLE),
            form: self.form,
            crossings: self.crossings,
        }
    }

    fn prepared<'a>(self, lit: LitScene<'a>) -> Result<SingleScattering<'a>> {
        SingleScattering::new(lit.scene.domain(), lit.bvh, lit.lights, self.settings())
    }

    /// `s = pi C L1 / F_t` along the inverse normal of every source vertex, RGB; equal for welded vertices, 0 where
    /// there is no transferring area. None where it depends on the eye.
    ///
    /// # Errors
    /// As [`SingleScattering::new`].
    pub fn per_vertex(self, lit: LitScene, progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        if !self.is_per_vertex(lit.scene) {
            return Ok(None);
        }
        let places = Places::new(lit.scene);
        let values = self.prepared(lit)?.per_numbered_points(&places.points, progress);
        let of = |place: &Option<u32>| place.and_then(|p| values.get(p as usize)).copied().unwrap_or(DVec3::ZERO);
        Ok(Some(places.of_vertex.iter().map(of).collect()))
    }

    /// [`Self::per_vertex`] of some points with the keys of their random numbers, in their order.
    ///
    /// # Errors
    /// As [`SingleScattering::new`].
    pub(crate) fn at_points(self, lit: LitScene, points: &[(u64, ExitPoint)]) -> Result<Vec<DVec3>> {
        Ok(self.prepared(lit)?.per_numbered_points(points, &Silent))
    }

    /// Single scattering towards any eye, along the refracted direction.
    ///
    /// # Errors
    /// As [`SingleScattering::new`].
    pub fn towards_eye<'a>(self, lit: LitScene<'a>) -> Result<Box<dyn TowardsEye + 'a>> {
        let of = |light: &Light| match light {
            Light::Directional { .. } | Light::Point { .. } | Light::Spot { .. } => self.samples,
            Light::Constant { .. } | Light::Area { .. } | Light::Environment { .. } => {
                self.samples.saturating_mul(DIRECTIONS_PER_SAMPLE)
            }
        };
        let paths_of_lights = lit.lights.iter().map(of).collect();
        Ok(Box::new(TracedTowardsEye { single: self.prepared(lit)?, paths_of_lights }))
    }

    /// Enters the noise into a ledger: half the difference of two estimates, each with half of the samples and its own
    /// random numbers, at some vertices. Random errors fall with the root of the number of samples or faster, so it is
    /// not below the noise.
    ///
    /// # Errors
    /// As [`SingleScattering::new`].
    pub fn enter_noise(self, lit: LitScene, ledger: &mut Ledger) -> Result<()> {
        let places = Places::new(lit.scene);
        let all = places.points.len();
        let step = all.div_ceil(PROBES).max(1);
        let probes = ProbePoints::new((step / 2..all).step_by(step).map(|p| p as u32).collect(), &places.areas_mm2);
        let points = probes.of(&places.points);
        let per_vertex = self.is_per_vertex(lit.scene);
        let half = (self.samples / 2).max(1);
        let single = Self { samples: half, ..self }.prepared(lit)?;
        // Half way to the horizon, where directions inside are as oblique as outside.
        let aslant = |n: DVec3| (n + n.any_orthonormal_vector()).normalize_or_zero();
        let [one, other] = HALVES.map(|keys| -> Vec<DVec3> {
            let of = |(key, p): (u64, ExitPoint)| match per_vertex {
                true => single.per_point(&p, key + keys),
                false => single.radiance(&p, aslant(p.normal), Path::Refracted, key + keys),
            };
            points.par_iter().map(|&point| of(point)).collect()
        });
        let mean: Vec<DVec3> = one.iter().zip(&other).map(|(a, b)| 0.5 * (*a + *b)).collect();
        let towards = if per_vertex { "" } else { ", towards an eye" };
        let note = format!(
            "noise, from two halves of the samples, relative to single scattering alone{towards}; more --set single-samples lower it"
        );
        // A single sample has no half.
        let factor = (2.0 * f64::from(half) / f64::from(self.samples.max(1))).sqrt().max(1.0);
        ledger.add("single scattering", probes.error(&one, &mean).scaled(factor), note);
        Ok(())
    }
}

struct TracedTowardsEye<'a> {
    single: SingleScattering<'a>,
    paths_of_lights: Vec<u32>,
}

impl TowardsEye for TracedTowardsEye<'_> {
    fn radiance(&self, seen: &SeenPoint) -> DVec3 {
        self.single.share_of_radiance(&seen.exit, seen.to_eye, Path::Refracted, seen.key, seen.share)
    }

    fn paths_per_pixel(&self, eye_rays: u32) -> u64 {
        // Every eye ray has as many.
        let of = |paths: &u32| u64::from(*paths).next_multiple_of(u64::from(eye_rays.max(1)));
        self.paths_of_lights.iter().map(of).sum()
    }
}

/// One place for each welded vertex that transfers.
struct Places {
    /// Exit points, each with the number of a source vertex.
    points: Vec<(u64, ExitPoint)>,
    /// A third of the transferring area around each, mm^2.
    areas_mm2: Vec<f64>,
    /// Index into `points` for each source vertex.
    of_vertex: Vec<Option<u32>>,
}

impl Places {
    fn new(scene: &Scene) -> Self {
        let exits = vertex_points(scene.domain());
        let areas = scene.vertex_areas_mm2();
        let mut of_weld: Vec<Option<u32>> = vec![None; exits.len()];
        let mut result = Self { points: Vec::new(), areas_mm2: Vec::new(), of_vertex: Vec::with_capacity(exits.len()) };
        for (vertex, exit) in exits.into_iter().enumerate() {
            if exit.normal == DVec3::ZERO {
                result.of_vertex.push(None);
                continue;
            }
            let weld = scene.mesh.weld.get(vertex).map_or(vertex, |&w| w as usize);
            let next = result.points.len() as u32;
            let place = of_weld.get_mut(weld).map_or(next, |known| *known.get_or_insert(next));
            if place == next {
                result.points.push((vertex as u64, exit));
                result.areas_mm2.push(0.0);
            }
            result.areas_mm2[place as usize] += areas.get(vertex).copied().unwrap_or(0.0);
            result.of_vertex.push(Some(place));
        }
        result
    }
}
