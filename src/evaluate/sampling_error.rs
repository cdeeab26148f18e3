//! The error of sampling: that of a sample set and its shadow rays, extrapolated from a second set, and that of stored
//! irradiance in place of the rays.

use glam::DVec3;

use super::stages;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::geometry::part_table::PartTable;
use crate::geometry::samples::{self, Samples};
use crate::light::Light;
use crate::math::statistics::VertexError;
use crate::progress::{Progress, Silent};
use crate::transport::calibration::Calibrated;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{ProbePoints, Receivers};
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Number of receivers at which the error is measured; they belong to the third that no tuning sees (see
/// [`Receivers::subset`]). Where there are few all are taken: what a shadow boundary does to one of them may be most of the error.
const PROBES: usize = 384;
const ALL_OF_FEW: usize = 1024;

/// An error that is worth a second look at twice as many samples: half as many may be off by far more than twice the error where they are
/// the first that are too coarse for a shape.
const WORTH_MORE: f64 = 0.004;

/// A lit sample set.
pub struct Sampled<'a> {
    /// The samples.
    pub surface: Surface<'a>,
    /// Kernels of the media, where they differ from the dipole's.
    pub kernels: Option<&'a [MediumKernel]>,
    /// Calibrated kernels in place of these.
    pub calibrated: Option<&'a Calibrated>,
    /// Lights in force.
    pub lights: &'a [Light],
    /// Irradiance of each sample by rays, RGB, and of the pieces of unevenly lit samples.
    pub irradiance: (&'a [DVec3], &'a Pieces),
    /// Irradiance of each sample, RGB, from stored rows, where they replaced the rays.
    pub stored: Option<&'a [DVec3]>,
    /// Settings of the light sampling.
    pub sampling: LightSampling,
    /// The near-field rule.
    pub near: NearField,
    /// Points where radiosity is gathered.
    pub receivers: &'a Receivers,
    /// Area around each receiver, mm^2.
    pub areas: &'a [f64],
}

impl Sampled<'_> {
    /// Radiosity of some receivers from these samples or others under an irradiance, over all pairs, with the media or the
    /// kernels in force.
    pub fn radiosity(&self, surface: &Surface, lit: (&[DVec3], &Pieces), receivers: &Receivers) -> Vec<DVec3> {
        self.with_near(self.near, surface, lit, receivers)
    }

    fn with_near(
        &self,
        near: NearField,
        surface: &Surface,
        (irradiance, pieces): (&[DVec3], &Pieces),
        receivers: &Receivers,
    ) -> Vec<DVec3> {
        // All pairs need no tree.
        let tree = SampleTree::default();
        let factors = self.calibrated.map_or_else(Vec::new, |calibrated| calibrated.of_samples(surface));
        let gather = match (self.calibrated, self.kernels) {
            (Some(calibrated), _) => Gather::calibrated(surface, &tree, (&calibrated.kernels, &factors), near),
            (None, Some(kernels)) => Gather::with_kernels(surface, &tree, kernels.to_vec(), near),
            (None, None) => Gather::new(surface, &tree, surface.domain.media, near),
        };
        let lit = gather.light_with_pieces(irradiance, pieces);
        gather.radiosity(receivers, &lit, Scheme::AllPairs, &Silent)
    }

    /// Enters the error of sampling and of the near-field rule into the ledger, and that of stored rows, which has an entry of its own. The
    /// error of sampling is taken to fall in proportion to 1 over the number of samples.
    ///
    /// # Errors
    /// As [`Illumination::new`].
    pub fn enter(&self, ledger: &mut Ledger, progress: &dyn Progress) -> Result<()> {
        let (subset, points) = self.receivers.all_or_probe_points(self.areas, ALL_OF_FEW, (PROBES, 2));
        let ours = self.radiosity(&self.surface, self.irradiance, &subset);
        let (samples, parts) = (self.surface.samples.len(), self.surface.domain.parts);
        let mut count = comparison_count(samples, parts);
        let (mut error, mut others) = self.against(count, (&subset, &points), &ours, progress)?;
        if count < samples && error.rms > WORTH_MORE {
            count = 2 * samples;
            (error, others) = self.against(count, (&subset, &points), &ours, progress)?;
        }
        let note = format!("and the near field; extrapolated from {others} samples, on vertices of their own");
        ledger.add("sampling", error, note);
        if let Some(stored) = self.stored {
            let note = "stored rows (cube map, truncation, quantiser; fields of area lights) against rays";
            ledger.add("environment", self.stored_error(stored), note);
        }
        Ok(())
    }

    /// The error of radiosity of some receivers, extrapolated from a set of about `count` samples; their number.
    fn against(
        &self,
        count: usize,
        (subset, points): (&Receivers, &ProbePoints),
        ours: &[DVec3],
        progress: &dyn Progress,
    ) -> Result<(VertexError, usize)> {
        let (samples, domain) = (self.surface.samples, self.surface.domain);
        let other = Samples::new(domain.mesh, domain.parts, count);
        let patches = samples::patches(domain.mesh, &other);
        let surface = Surface { domain, bvh: self.surface.bvh, samples: &other, patches: &patches };
        // Other shadow rays too: patches that both sets share would agree on the errors of theirs.
        let points_per_patch = 4 * self.sampling.points_per_patch;
        let sampling = LightSampling { points_per_patch, ..self.sampling };
        let etas: Vec<f64> = domain.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let irradiance = match self.calibrated {
            Some(calibrated) => {
                calibrated.entry(&surface).entered_by_rays(&surface, self.lights, (&etas, sampling), progress)?
            }
            None => Illumination::new(&surface, self.lights, &etas, sampling)?.all_with_pieces(progress),
        };
        // With the near field of the truth: what the rule in force misses is one-sided, and no other stage has it.
        let theirs = self.with_near(NearField::REFERENCE, &surface, (&irradiance.0, &irradiance.1), subset);
        // Samples without pieces err at the edges of shadows, where others that have them do not: the difference from twice as many is all of it.
        let has_pieces = |pieces: &Pieces| !pieces.deviations().is_empty();
        let is_plain = has_pieces(&irradiance.1) && !has_pieces(self.irradiance.1);
        let factor =
            if is_plain && other.len() > samples.len() { 1.0 } else { extrapolation(samples.len(), other.len()) };
        Ok((points.error(&theirs, ours).scaled(factor), other.len()))
    }

    /// Error that stored irradiance, compared with that of the rays, causes in the radiosity.
    fn stored_error(&self, stored: &[DVec3]) -> VertexError {
        let (subset, points) = stages::probe_points(self.receivers, self.areas);
        let sum = |e: &[DVec3]| self.radiosity(&self.surface, (e, &Pieces::NONE), &subset);
        points.error(&sum(stored), &sum(self.irradiance.0))
    }
}

/// The error of one sample set over the difference between two sets, where the error is e(N) = k / N, so that the
/// difference is |k / M - k / N|. For sets of equal size it is 1.
fn extrapolation(samples: usize, others: usize) -> f64 {
    if samples == others { 1.0 } else { others as f64 / samples.abs_diff(others) as f64 }
}

/// Number of samples of the set that is compared with one of `count`: half as many; one for each triangle where that is
/// near, since clusters of triangles err in another way; twice as many where there cannot be fewer, or where
/// fewer would be clusters and these are not.
fn comparison_count(count: usize, parts: &PartTable) -> usize {
    let transferring = parts.parts.iter().filter(|p| p.transfers());
    let (parts, triangles) = transferring.fold((0, 0), |(n, t), p| (n + 1, t + p.triangle_count));
    let clusters_alone = (count / 4 * 3 + 1..=count).contains(&triangles);
    if count < 2 * parts || clusters_alone {
        2 * count
    } else if (count / 2..=count / 4 * 3).contains(&triangles) {
        triangles
    } else {
        count / 2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_in_proportion_to_one_over_the_samples_are_found_from_any_other_set() {
        for (samples, others) in [(1000usize, 500usize), (1000, 2000), (1000, 640), (3, 7), (131_072, 65_536)] {
            let error = |count: usize| 0.37 / count as f64;
            let difference = (error(others) - error(samples)).abs();
            let found = extrapolation(samples, others) * difference;
            assert!((found - error(samples)).abs() < 1e-12 * found, "{samples} and {others}: {found}");
        }
        assert_eq!(extrapolation(10, 10), 1.0);
    }
}
