//! The quality that keeps an asked error on a surface: the errors of interpolation and of discs depend on the roughness
//! of the surface and on the shape of its samples, so they are measured, against all pairs.

use glam::DVec3;

use super::surface::MOST_SOFTENING;
use super::{Quality, SurfaceNets};
use crate::progress::Silent;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_rule::{NearField, NearRule};
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers that errors are measured on.
const PROBES: usize = 192;

/// Share of the asked error that is aimed at: other receivers and lights may fare worse.
const TARGET: f64 = 0.8;

/// Softening that is tried first, over that of [`Quality::for_error`], which rough surfaces need.
const SMOOTHEST: f64 = 0.72;

/// Factors from one trial to the next on the softening, and on the distances of the near rule.
const SOFTER: f64 = 1.15;
const NEARER: f64 = 1.35;

/// Trials at most, each in both ways.
const TRIALS: usize = 10;

/// Distance over radius at most below which samples are integrated by points.
const MOST_NEAR: f64 = 24.0;

impl Quality {
    /// The coarsest quality of a few that keeps a relative error, RMS over receivers weighted by `areas`, in each set
    /// of media and under each light (irradiance of every sample and pieces of uneven ones); the last one tried where
    /// none keeps it.
    pub fn tuned(
        (surface, media): (&Surface, &[Vec<MediumKernel>]),
        (receivers, areas): (&Receivers, &[f64]),
        lights: &[(Vec<DVec3>, Pieces)],
        error: f64,
    ) -> Self {
        let (subset, points) = receivers.probe_points(areas, (PROBES, 0));
        let tree = SampleTree::default();
        let truths_in = |kernels: &Vec<MediumKernel>| -> Vec<Vec<DVec3>> {
            let gather = Gather::with_kernels(surface, &tree, kernels.clone(), NearField::REFERENCE);
            let truth = |(irradiance, pieces): &(Vec<DVec3>, Pieces)| {
                gather.radiosity(&subset, &gather.light_with_pieces(irradiance, pieces), Scheme::AllPairs, &Silent)
            };
            lights.iter().map(truth).collect()
        };
        let truths: Vec<Vec<Vec<DVec3>>> = media.iter().map(truths_in).collect();
        let guess = Self::for_error(error);
        let mut quality = Self { softening: SMOOTHEST * guess.softening, ..guess };
        let mut nets = SurfaceNets::new(surface, receivers, quality);
        let mut measured = |quality: Self| {
            nets.set_quality(surface, receivers, quality);
            let in_media = |(kernels, truths): (&Vec<MediumKernel>, &Vec<Vec<DVec3>>)| {
                let tables = nets.tables(kernels);
                let of_light = |((irradiance, pieces), truth): (&(Vec<DVec3>, Pieces), &Vec<DVec3>)| {
                    let all = nets.radiosity(surface, &tables, (irradiance, pieces), receivers.len());
                    points.error(&points.of(&all), truth).rms
                };
                lights.iter().zip(truths).map(of_light).fold(0.0, f64::max)
            };
            media.iter().zip(&truths).map(in_media).fold(0.0, f64::max)
        };
        let mut found = measured(quality);
        for _ in 0..TRIALS {
            if found <= TARGET * error {
                break;
            }
            let [softer, nearer] = [quality.softer(), quality.nearer()];
            let both = [measured(softer), measured(nearer)];
            // The softening costs more, so it has to bring more.
            (quality, found) = if both[0] < 0.95 * both[1] { (softer, both[0]) } else { (nearer, both[1]) };
            if quality.softening >= MOST_SOFTENING && quality.near.facets_below >= MOST_NEAR {
                break;
            }
        }
        quality
    }

    fn softer(self) -> Self {
        Self { softening: (SOFTER * self.softening).min(MOST_SOFTENING), ..self }
    }

    fn nearer(self) -> Self {
        let NearRule { facets_below, pieces_below } = self.near;
        let near = NearRule {
            facets_below: (NEARER * facets_below).min(MOST_NEAR),
            pieces_below: (NEARER * pieces_below).min(MOST_NEAR),
        };
        Self { near, ..self }
    }
}
