//! Inter-reflection outside the medium, when it is asked for: what leaves the surface and falls on it again is transferred
//! again, `B = T(E + K B')` with the `B'` of one time less.

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

/// Receivers that measure the noise.
const PROBES: usize = 384;

/// Two halves are a single draw, and where a few creases send most of the light there is little to average over: what is
/// stated is this many times half of their difference. On small heads and a bunny, half of it alone is 0.5 to 2 times the error.
const MARGIN: f64 = 2.0;

/// How light that leaves the surface is followed from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Outside {
    /// Times that light falls on the surface again, at least 1.
    pub times: u32,
    /// Rays of a sample that look for it, a power of two.
    pub rays: u32,
}

/// Bytes that it takes at run time at most.
pub fn memory(outside: Option<Outside>, samples: usize, scene: &Scene) -> u64 {
    outside.map_or(0, |o| InterReflection::most_bytes(samples, o.rays, scene.mesh.triangles.len()))
}

/// Irradiance with what comes back from outside.
#[derive(Clone, Debug)]
pub(crate) struct Returned {
    /// Irradiance of every sample, RGB: that of the lights and what came back.
    pub(crate) irradiance: Vec<DVec3>,
    /// Radiosity of every receiver whose light came back last.
    outgoing: Vec<DVec3>,
}

/// What light is transferred by, and where to.
#[derive(Clone, Copy)]
pub(crate) struct Transfer<'a> {
    pub(crate) gather: &'a Gather<'a>,
    pub(crate) receivers: &'a Receivers,
    pub(crate) scheme: Scheme,
}

/// Times at most; of what is sent out a hundredth comes back 16 times only where almost nothing is absorbed or escapes.
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

    /// Adds what comes back to the irradiance of the lights.
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
    /// Flux into the samples over that of the lights alone, of the channel where it is largest; at least 1.
    pub(crate) fn gain(&self, direct: &[DVec3], surface: &Surface) -> f64 {
        let flux = |irradiance: &[DVec3]| -> DVec3 {
            surface.patches.iter().zip(irradiance).map(|(patch, e)| patch.area_mm2 * *e).sum()
        };
        let (with, without) = (flux(&self.irradiance), flux(direct));
        let of = |c: usize| if without[c] > 0.0 { with[c] / without[c] } else { 1.0 };
        (0..3).map(of).filter(|gain| gain.is_finite()).fold(1.0, f64::max)
    }

    /// The noise of the rays, with a margin, from half of the difference that two halves of the rays make to the radiosity
    /// of some receivers, relative to all of it. `areas` are those around the receivers, mm^2.
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
