//! Light on the samples, on its way to the receivers.

use glam::DVec3;

use super::balanced_tree::power_of_two_near;
use super::irradiance::Pieces;
use crate::geometry::samples::Patch;
use crate::parallel::*;

/// Irradiance of every sample, RGB, and of the pieces of those that are not lit evenly, brought into the range of single precision.
///
/// All sums over samples take light from here and give radiosity back through [`SampleLight::radiosity`]. Factors for
/// each point of the surface belong to these two ends: of a sample on its irradiance, of a receiver on its sum.
#[derive(Clone, Copy)]
pub struct SampleLight<'a> {
    irradiance: &'a [DVec3],
    pieces: &'a Pieces,
    /// Factors on the irradiance of the samples, RGB; empty where there are none.
    factors: &'a [DVec3],
    /// A power of two that brings the brightest irradiance near 1.
    scale: f64,
}

/// Pieces of light that is even on every sample.
static NO_PIECES: Pieces = Pieces::NONE;

impl<'a> SampleLight<'a> {
    /// Light that is even on every sample.
    pub fn even(irradiance: &'a [DVec3]) -> Self {
        Self::new(irradiance, &NO_PIECES)
    }

    /// Irradiance of every sample and the pieces of the same light, or none.
    pub fn new(irradiance: &'a [DVec3], pieces: &'a Pieces) -> Self {
        const TASK: usize = 1 << 13;
        let brightest = |light: &[DVec3]| light.iter().map(|e| e.max_element()).fold(0.0, f64::max);
        let brightest = irradiance.par_chunks(TASK).map(brightest).reduce(|| 0.0, f64::max);
        Self::with_brightest(irradiance, pieces, brightest)
    }

    /// [`Self::new`] where the largest irradiance is known.
    pub fn with_brightest(irradiance: &'a [DVec3], pieces: &'a Pieces, brightest: f64) -> Self {
        Self { irradiance, pieces, factors: &[], scale: power_of_two_near(brightest).recip() }
    }

    /// The same light with a factor on the irradiance of every sample, RGB.
    #[must_use]
    pub fn with_factors(self, factors: &'a [DVec3]) -> Self {
        Self { factors, ..self }
    }

    /// The factor of a sample times the scale.
    #[inline(always)]
    fn gain(&self, sample: usize) -> DVec3 {
        self.factors.get(sample).map_or(DVec3::splat(self.scale), |factor| *factor * self.scale)
    }

    /// Irradiance of a sample, scaled.
    #[inline(always)]
    pub fn irradiance(&self, sample: usize) -> DVec3 {
        self.irradiance[sample] * self.gain(sample)
    }

    /// Irradiance times area, scaled.
    #[inline(always)]
    pub fn flux(&self, sample: usize, patch: &Patch) -> DVec3 {
        self.irradiance[sample] * (self.gain(sample) * patch.area_mm2)
    }

    /// Flux of many samples, scaled.
    pub fn scaled(&self, flux: DVec3) -> DVec3 {
        flux * self.scale
    }

    /// True if a sample has pieces.
    #[inline(always)]
    pub fn is_uneven(&self, sample: usize) -> bool {
        self.pieces.is_uneven(sample)
    }

    /// For each piece of an uneven sample, its irradiance less the sample's, scaled, and its corners relative to the
    /// sample's centroid, mm.
    pub fn pieces(&self, sample: usize) -> Option<impl Iterator<Item = (DVec3, &'a [[f32; 3]; 3])> + use<'a>> {
        let gain = self.gain(sample);
        self.pieces.of(sample).map(|pieces| pieces.map(move |(deviation, corners)| (deviation * gain, corners)))
    }

    /// Pieces of an uneven sample at most.
    pub fn most_pieces(&self) -> usize {
        self.pieces.count()
    }

    /// Value of a scaled 1 in the unit of the light.
    pub fn unit(&self) -> f64 {
        self.scale.recip()
    }

    /// Radiosity of a receiver in the unit of the light, from its scaled sum.
    #[inline(always)]
    pub fn radiosity(&self, sum: DVec3) -> DVec3 {
        sum / self.scale
    }
}
