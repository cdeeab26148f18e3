//! Number of terms that the phase functions of media need.

use crate::forms::distant::{Single, Terms};
use crate::scene::Scene;

/// Relative L2 error of a phase function over the asked error; under light from a hemisphere it shrinks.
const PHASE: f64 = 20.0;

/// Resolves automatic terms to those that the media need; isotropic where g is 0 in every medium.
pub(super) fn resolved(single: Single, scene: &Scene, max_rms: f64) -> Single {
    let Single::Phase(terms) = single else { return single };
    let g = largest_g(scene);
    let fits = |terms: &&usize| missing(g, **terms) <= PHASE * max_rms;
    match terms {
        Terms::Auto if g == 0.0 => Single::Isotropic,
        Terms::Auto => Single::Phase([1, 4, 9, 16].iter().find(fits).map_or(Terms::Rays, |k| Terms::Stored(*k))),
        Terms::Stored(_) | Terms::Rays => single,
    }
}

/// The largest |g| of the media in use.
pub(super) fn largest_g(scene: &Scene) -> f64 {
    let media = scene.parts.parts.iter().filter_map(|part| scene.media.get(part.medium? as usize));
    media.map(|m| m.properties.g.abs()).fold(0.0, f64::max)
}

/// Relative L2 error of Henyey and Greenstein's function cut to whole bands.
pub(super) fn missing(g: f64, terms: usize) -> f64 {
    let square = g * g;
    let energy = |l: usize| (2 * l + 1) as f64 * square.powi(l as i32);
    let kept: f64 = (0..terms.isqrt()).map(energy).sum();
    let all = (1.0 + square) / (1.0 - square).powi(2).max(f64::MIN_POSITIVE);
    (1.0 - kept / all).max(0.0).sqrt()
}
