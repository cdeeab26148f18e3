//! Lights at single points as plain numbers, for shaders that cast the same rays as [`Illumination::at_points`](super::Illumination).

use std::f64::consts::PI;

use glam::DVec3;

use super::{CANDIDATES, CONSTANT_SAVES, LightSampling, STAGE_AREA, STAGE_CONSTANT, STAGE_ENVIRONMENT, rays_of};
use crate::error::Result;
use crate::light::cone::ConeFalloff;
use crate::light::strata::{Candidate, StrataSettings};
use crate::light::{Light, refuse_fields};
use crate::math::random::{bits, mix, uniform};
use crate::medium::fresnel::CosineTransmittance;
use crate::transport::prepared_light::Prepared;

/// A light, places relative to the mesh's origin (mm).
pub enum PackedLight {
    /// The direction that it comes from, and its irradiance.
    Directional(DVec3, DVec3),
    /// Its place and intensity, and its cone.
    Point(DVec3, DVec3, ConeFalloff),
    /// Its radiance; and directions from each point.
    Constant(DVec3, u32),
    /// A rectangle.
    Area(PackedRectangle),
    /// Of each stratum, `CANDIDATES` of which a point takes number `shift ^ turn`, `turn` the first bits of its index
    /// in reverse.
    Environment(Vec<PackedStratum>),
}

/// A one-sided area light; `side * side` rays from each point.
pub struct PackedRectangle {
    /// Corner.
    pub corner: DVec3,
    /// Unit vectors along its edges, and its normal.
    pub axes: [DVec3; 3],
    /// Lengths of its edges, mm.
    pub size_mm: [f64; 2],
    /// Radiance.
    pub radiance: DVec3,
    /// Cells along each edge.
    pub side: u32,
    /// Key of its random numbers, see [`bits`].
    pub key: u64,
}

/// Directions of one stratum of an environment.
pub struct PackedStratum {
    /// Directions, and radiance times solid angle.
    pub candidates: Vec<(DVec3, DVec3)>,
    /// See [`PackedLight::Environment`].
    pub shift: u32,
}

/// Lights for points of a mesh with this origin, whose rays `sampling` sets.
///
/// # Errors
/// A sampling that environments do not take; a light that asks for a source radiance field (exit 5).
pub fn packed(lights: &[Light], origin_mm: DVec3, sampling: LightSampling) -> Result<Vec<PackedLight>> {
    refuse_fields(lights)?;
    let cut = StrataSettings { strata: sampling.directions as usize, candidates: CANDIDATES };
    let pack = |light: &Light| {
        Ok(match Prepared::new(light, origin_mm, cut, rays_of)? {
            Prepared::Directional { from, irradiance } => PackedLight::Directional(from, irradiance),
            Prepared::Point { at, intensity, falloff } => PackedLight::Point(at, intensity, falloff),
            Prepared::Constant { radiance } => {
                PackedLight::Constant(radiance, sampling.directions.div_ceil(CONSTANT_SAVES))
            }
            Prepared::Area(light) => {
                let (corner, [u, v], normal) = (light.corner, light.axes, light.normal);
                let (size_mm, radiance, side) = (light.size_mm, light.radiance, sampling.area_side);
                PackedLight::Area(PackedRectangle {
                    corner,
                    axes: [u, v, normal],
                    size_mm,
                    radiance,
                    side,
                    key: mix(STAGE_AREA),
                })
            }
            Prepared::Environment(strata) => {
                let stratum = |(index, rays): (u64, super::StratumRays)| PackedStratum {
                    candidates: rays
                        .candidates
                        .iter()
                        .map(|Candidate { direction, weight }| (*direction, *weight))
                        .collect(),
                    shift: bits(STAGE_ENVIRONMENT, index, 0) as u32 & (CANDIDATES as u32 - 1),
                };
                PackedLight::Environment((0u64..).zip(strata).map(stratum).collect())
            }
        })
    };
    lights.iter().map(pack).collect()
}

/// Numbers in [0, 1) that turn the directions towards a constant light at a point.
pub fn turns(point: usize) -> [f32; 2] {
    [0, 1].map(|dimension| uniform(STAGE_CONSTANT, point as u64, dimension) as f32)
}

/// Steps of [`Entrance::cosines`].
pub const ENTRANCE_STEPS: usize = 4096;

/// How light enters a medium.
pub struct Entrance {
    /// Relative index of refraction.
    pub eta: f64,
    /// `Int F_t cos` over the half space.
    pub whole: f64,
    /// [`CosineTransmittance::sample_entrance_cosine`] at equal steps of the cube root of its number, with which it is smooth.
    pub cosines: Vec<f32>,
}

impl Entrance {
    /// The entrance of a medium with this relative index of refraction.
    pub fn new(eta: f64) -> Self {
        let entrance = CosineTransmittance::new(eta);
        let cosine =
            |step: usize| entrance.sample_entrance_cosine((step as f64 / ENTRANCE_STEPS as f64).powi(3)) as f32;
        let cosines = (0..=ENTRANCE_STEPS).map(cosine).collect();
        Self { eta, whole: PI * entrance.diffuse_transmittance(), cosines }
    }
}

/// Candidates of each stratum, a power of two.
pub const OF_STRATUM: usize = CANDIDATES;
