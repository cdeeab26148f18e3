//! Errors of samples, nets and hierarchy against all pairs, and the tuning that follows from them.

use glam::DVec3;

use super::lit_samples::GatheredEvaluator;
use super::settings::{Bound, Far};
use crate::compress::ledger::Ledger;
use crate::evaluate::inter_reflection::Transfer;
use crate::evaluate::stages::probe_points;
use crate::math::statistics::VertexError;
use crate::progress::Silent;
use crate::transport::gather::Scheme;
use crate::transport::irradiance::Pieces;
use crate::transport::multilevel::{SurfaceNets, SurfaceTables};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{ProbePoints, Receivers};
use crate::transport::surface::Surface;

/// Receivers that tune the hierarchy.
const TUNING_PROBES: usize = 96;

/// Places that tune it for points anywhere, where a mesh has fewer vertices than tuning needs: the corners of a cube say nothing of its
/// faces.
const TUNING_PLACES: usize = 48;

/// Limits that tuning tries at most; without success the hierarchy is left out.
const TRIALS: usize = 12;

/// Share of the asked error that tuning aims at, because other receivers may fare worse.
const TARGET: f64 = 0.7;

/// Share of the target from which on a larger limit would not pay.
const CLOSE: f64 = 0.6;

impl GatheredEvaluator {
    /// Calls `work` with a function from a limit of the criterion to the error of the hierarchy against all pairs, at some
    /// receivers.
    fn against_all_pairs<T>(
        &self,
        irradiance: &[DVec3],
        bound: Bound,
        (subset, points): &(Receivers, ProbePoints),
        work: impl FnOnce(&dyn Fn(f64) -> VertexError) -> T,
    ) -> T {
        let surface = self.surface();
        let gather = self.gather(&surface, self.gathering.near);
        let lit = gather.light(irradiance);
        let truth = gather.radiosity(subset, &lit, Scheme::AllPairs, &Silent);
        work(&|limit| {
            let scheme = Scheme::Hierarchical { criterion: bound.criterion(limit) };
            points.error(&gather.radiosity(subset, &lit, scheme, &Silent), &truth)
        })
    }

    /// Finds the largest limit of the criterion that keeps the asked error on some receivers.
    pub(super) fn tune(&mut self, error: f64, bound: Bound) {
        let probes = self.receivers.probe_points(&self.areas, (TUNING_PROBES, 0));
        self.limit = Some(self.limit_at(error, bound, &probes));
    }

    /// The same for points anywhere.
    pub(super) fn tune_for_points(&mut self, error: f64, bound: Bound) {
        if self.receivers.len() < TUNING_PROBES {
            self.limit_at_points = Some(self.limit_at(error, bound, &self.places(TUNING_PLACES)));
            return;
        }
        self.tuned_scheme();
        self.limit_at_points = self.limit;
    }

    /// Samples at even steps of the area as receivers.
    fn places(&self, most: usize) -> (Receivers, ProbePoints) {
        let Surface { samples, patches, .. } = self.surface();
        let count = most.min(patches.len());
        let chosen = (0..count).map(|i| (2 * i + 1) * patches.len() / (2 * count));
        let part = |sample: usize| {
            samples.part_offsets.partition_point(|first| *first as usize <= sample).saturating_sub(1) as u32
        };
        let place = |sample: usize| {
            (Some((part(sample), patches[sample].centre_mm)), patches[sample].cross_mm2.normalize_or_zero())
        };
        let (places, normals): (Vec<_>, Vec<_>) = chosen.map(place).unzip();
        let receivers = Receivers::oriented(&places, &normals, 1);
        let all = (0..receivers.len() as u32).collect();
        let points = ProbePoints::new(all, &vec![1.0; receivers.len()]);
        (receivers, points)
    }

    fn limit_at(&self, error: f64, bound: Bound, probes: &(Receivers, ProbePoints)) -> f64 {
        let limit = self.against_all_pairs(self.lit().0, bound, probes, |error_of| {
            let mut limit = bound.first_limit(error);
            let mut kept = None;
            for _ in 0..TRIALS {
                let found = error_of(limit).rms;
                if found <= TARGET * error {
                    kept = Some(limit);
                    if found >= CLOSE * TARGET * error {
                        break;
                    }
                } else if kept.is_some() {
                    break;
                }
                // The error grows a little faster than the limit.
                let factor = (TARGET * error / found.max(f64::MIN_POSITIVE)).powf(0.8);
                limit *= if kept.is_some() { (0.9 * factor).clamp(1.1, 4.0) } else { (0.9 * factor).clamp(0.05, 0.7) };
            }
            kept
        });
        limit.unwrap_or(0.0)
    }

    /// The error of multilevel summation, near field included, against all pairs.
    fn nets_error(&self, (nets, tables): (&SurfaceNets, &SurfaceTables), lit: (&[DVec3], &Pieces)) -> VertexError {
        let surface = self.surface();
        let gather = self.gather(&surface, NearField::REFERENCE);
        let (subset, points) = probe_points(&self.receivers, &self.areas);
        let truth = gather.radiosity(&subset, &gather.light_with_pieces(lit.0, lit.1), Scheme::AllPairs, &Silent);
        let asked = (&self.receivers, Some(points.indices.as_slice()));
        let found = nets.radiosity(&surface, tables, self.sample_light(lit), asked);
        points.error(&points.of(&found), &truth)
    }

    /// Name of the transfer in force in a ledger; `None` where it is all pairs.
    pub(super) fn transfer(&self) -> Option<&'static str> {
        let hierarchy = matches!(self.gathering.far, Far::Hierarchical { .. }) && self.limit.is_some();
        if self.nets().is_some() { Some("multilevel") } else { hierarchy.then_some("hierarchy") }
    }

    /// The error of the transfer in force against all pairs, at receivers that no tuning saw.
    pub(super) fn transfer_error(&self, lit: (&[DVec3], &Pieces)) -> VertexError {
        match (self.nets(), self.gathering.far, self.limit) {
            (Some(nets), ..) => self.nets_error(nets, lit),
            (None, Far::Hierarchical { bound, .. }, Some(limit)) => {
                let probes = probe_points(&self.receivers, &self.areas);
                self.against_all_pairs(lit.0, bound, &probes, |error_of| error_of(limit))
            }
            _ => VertexError::default(),
        }
    }

    /// Enters the noise of inter-reflection, and scales the errors of earlier stages by the gain of the light that
    /// returns. Returns this gain: errors of the transfer return with the light, at most in proportion.
    pub(super) fn enter_inter_reflection(&self, ledger: &mut Ledger) -> f64 {
        let (Some(outside), Some(returned), Some(matrix)) = (self.outside, &self.returned, &self.matrix) else {
            return 1.0;
        };
        let surface = self.surface();
        let gain = returned.gain(self.direct().0, &surface);
        ledger.entries.iter_mut().for_each(|entry| entry.error = entry.error.scaled(gain));
        let gather = self.gather(&surface, self.gathering.near);
        let transfer = Transfer { gather: &gather, receivers: &self.receivers, scheme: Scheme::AllPairs };
        let noise = returned.noise(matrix, transfer, self.direct(), &self.areas);
        let repeated = if outside.times > 1 { gain } else { 1.0 };
        let note = "noise, from two halves of the rays; more --set inter-reflection-rays lower it";
        ledger.add("inter-reflection", noise.scaled(repeated), note);
        gain
    }
}
