//! Inter-reflection outside the medium, optional: light that leaves the surface and falls on it again is transferred
//! again, `B = T(E + K B')`, `B'` being the radiosity with one bounce less.

use glam::DVec3;

use crate::error::{Error, Result};
use crate::math::statistics::VertexError;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::interreflection::{InterReflection, LEAST_RAYS, MOST_RAYS, Rays};
use crate::transport::irradiance::Pieces;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;

/// Receivers at which the noise is measured.
const PROBES: usize = 384;

/// Factor on half the difference of the two halves of the rays, which gives the stated noise: the halves are a single
/// draw, and where a few creases send most of the light there is little to average over. On small heads and a bunny,
/// half of the difference alone is 0.5 to 2 times the error.
const MARGIN: f64 = 2.0;

/// Settings of inter-reflection outside the medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Outside {
    /// Number of bounces, times that light falls on the surface again, at least 1.
    pub times: u32,
    /// Rays of each sample, a power of two.
    pub rays: u32,
}

/// Largest number of bytes that inter-reflection takes at run time.
pub fn memory(outside: Option<Outside>, samples: usize, scene: &Scene) -> u64 {
    outside.map_or(0, |o| InterReflection::most_bytes(samples, o.rays, scene.mesh.triangles.len()))
}

/// Irradiance with the light that returns from outside.
#[derive(Clone, Debug)]
pub(crate) struct Returned {
    /// Irradiance of every sample, RGB, from the lights and from returned light.
    pub(crate) irradiance: Vec<DVec3>,
    /// Radiosity of every receiver in the last bounce.
    outgoing: Vec<DVec3>,
}

/// The gather that transfers light, its receivers and its scheme.
#[derive(Clone, Copy)]
pub(crate) struct Transfer<'a> {
    pub(crate) gather: &'a Gather<'a>,
    pub(crate) receivers: &'a Receivers,
    pub(crate) scheme: Scheme,
}

/// Largest number of bounces; after 16, a hundredth of the light is left only where almost nothing is absorbed or
/// escapes.
pub const MOST_TIMES: u32 = 16;

impl Outside {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let Self { times, rays } = *self;
        let fits = (LEAST_RAYS..=MOST_RAYS).contains(&rays) && rays.is_power_of_two();
        if !(fits && (1..=MOST_TIMES).contains(&times)) {
            return Err(Error::input(format!("{rays} rays that follow light outside {times} times")));
        }
        Ok(())
    }

    /// Casts the rays of every sample.
    pub(crate) fn matrix(self, surface: &Surface, receivers: &Receivers, progress: &dyn Progress) -> InterReflection {
        let etas: Vec<f64> = surface.domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        InterReflection::new(surface, &etas, self.rays, progress).of_receivers(&receivers.of_vertex)
    }

    /// Adds the returned light to the irradiance of the lights.
    pub(crate) fn returned(
        self,
        matrix: &InterReflection,
        transfer: Transfer,
        (direct, pieces): (&[DVec3], &Pieces),
        progress: &dyn Progress,
    ) -> Returned {
        let mut result = Returned { irradiance: direct.to_vec(), outgoing: Vec::new() };
        let times = if matrix.is_empty() { 0 } else { self.times };
        for _ in 0..times {
            let Transfer { gather, receivers, scheme } = transfer;
            let lit = gather.light_with_pieces(&result.irradiance, pieces);
            result.outgoing = gather.radiosity(receivers, &lit, scheme, progress);
            result.irradiance = sum(direct, &matrix.apply(&result.outgoing, Rays::All));
        }
        result
    }
}

fn sum(a: &[DVec3], b: &[DVec3]) -> Vec<DVec3> {
    a.iter().zip(b).map(|(a, b)| *a + *b).collect()
}

impl Returned {
    /// Total flux into the samples over the flux of the lights alone, in the channel where the ratio is largest; at
    /// least 1.
    pub(crate) fn gain(&self, direct: &[DVec3], surface: &Surface) -> f64 {
        let flux = |irradiance: &[DVec3]| -> DVec3 {
            surface.patches.iter().zip(irradiance).map(|(patch, e)| patch.area_mm2 * *e).sum()
        };
        let (with, without) = (flux(&self.irradiance), flux(direct));
        let of = |c: usize| if without[c] > 0.0 { with[c] / without[c] } else { 1.0 };
        (0..3).map(of).filter(|gain| gain.is_finite()).fold(1.0, f64::max)
    }

    /// The noise of the rays, with [`MARGIN`]: from half of the difference between the radiosities of some receivers by
    /// either half of the rays, relative to their whole radiosity. `areas` are those around the receivers, mm^2.
    pub(crate) fn noise(
        &self,
        matrix: &InterReflection,
        transfer: Transfer,
        (direct, pieces): (&[DVec3], &Pieces),
        areas: &[f64],
    ) -> VertexError {
        let (subset, points) = transfer.receivers.probe_points(areas, (PROBES, 2));
        let radiosity = |irradiance: &[DVec3]| {
            let lit = transfer.gather.light_with_pieces(irradiance, pieces);
            transfer.gather.radiosity(&subset, &lit, Scheme::AllPairs, &Silent)
        };
        let half = sum(direct, &matrix.apply(&self.outgoing, Rays::FirstHalf));
        points.error(&radiosity(&half), &radiosity(&self.irradiance)).scaled(MARGIN)
    }
}
