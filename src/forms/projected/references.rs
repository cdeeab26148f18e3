//! Reference points: their spacing, and the interpolation of vertices from them.

use std::ops::Range;

use glam::DVec3;

use serde::{Deserialize, Serialize};

use crate::compress::prediction::Net;
use crate::error::{Error, Result};
use crate::forms::sampled_scene::{SampledScene, parts};
use crate::geometry::scattered::{Kriging, OrientedPoint, Weights};
use crate::math::statistics::VertexError;
use crate::parallel::*;
use crate::transport::receivers::Receivers;

/// Reference points that a vertex is interpolated from.
const SOURCES: usize = Kriging::RADIOSITY.sources;

/// Number of spacings that are tried, the first in mean free paths, and share of the allowed error from which the
/// search stops.
const TRIALS: usize = 12;
const WIDEST: f64 = 2.0;
const CLOSE: f64 = 0.7;

/// Spacings that are tried for a number of reference points.
const BISECTIONS: usize = 14;

/// Stride of the vertices that spacings are measured on.
const STRIDE: usize = 4;

/// Spacing asked of the reference points; where neither field is given, as wide as the error allows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spacing {
    /// Spacing, mm.
    pub mm: Option<f64>,
    /// Approximate number of reference points.
    pub references: Option<usize>,
}

impl Spacing {
    /// The spacing, mm, where it or the number of points is asked for.
    pub(crate) fn asked_mm(self, sampled: &SampledScene) -> Option<f64> {
        self.mm.or_else(|| self.references.map(|count| spacing_of(sampled, count)))
    }

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let fits = self.mm.is_none_or(|mm| (1e-6..=1e6).contains(&mm)) && self.references.is_none_or(|count| count > 0);
        if fits { Ok(()) } else { Err(Error::input(format!("reference points out of range: {self:?}"))) }
    }
}

/// The widest spacing, mm, or a little less, whose interpolation error is at most `error` under all of some lights.
pub(crate) fn spacing(sampled: &SampledScene, truth: &[Vec<DVec3>], error: f64) -> f64 {
    let free_path = |m: &crate::medium::material::Medium| m.properties.mean_free_path_mm().max_element();
    let widest = sampled.scene.media.iter().map(free_path).filter(|m| m.is_finite()).fold(0.0, f64::max);
    let diagonal = sampled.scene.mesh.diagonal_mm();
    let mut spacing = (WIDEST * widest).clamp(1e-3 * diagonal, 0.25 * diagonal);
    let mut kept = None;
    for _ in 0..TRIALS {
        let net = Net::new(&sampled.points, &parts(&sampled.receivers), spacing);
        let found = spatial_error(sampled, &net, spacing, truth).rms;
        if found <= error {
            kept = Some(spacing);
            if found >= CLOSE * error {
                break;
            }
        } else if kept.is_some() {
            break;
        }
        if net.point.len() == sampled.points.len() {
            return spacing;
        }
        // The error falls with the square of the spacing.
        let factor = (0.9 * error / found.max(f64::MIN_POSITIVE)).sqrt();
        spacing *= if kept.is_some() { factor.clamp(1.05, 2.0) } else { factor.clamp(0.3, 0.9) };
    }
    kept.unwrap_or(spacing)
}

/// The spacing, mm, that gives about `count` reference points.
fn spacing_of(sampled: &SampledScene, count: usize) -> f64 {
    let diagonal = sampled.scene.mesh.diagonal_mm();
    let (mut close, mut wide) = (1e-4 * diagonal, diagonal);
    let mut best = (usize::MAX, close);
    for _ in 0..BISECTIONS {
        let middle = (close * wide).sqrt();
        let found = Net::new(&sampled.points, &parts(&sampled.receivers), middle).point.len();
        if found.abs_diff(count) < best.0 {
            best = (found.abs_diff(count), middle);
        }
        match found.cmp(&count) {
            std::cmp::Ordering::Less => wide = middle,
            std::cmp::Ordering::Equal => break,
            std::cmp::Ordering::Greater => close = middle,
        }
    }
    best.1
}

/// The error of interpolation from reference points, under the worst of some lights, on some vertices.
pub(crate) fn spatial_error(sampled: &SampledScene, net: &Net, spacing_mm: f64, truth: &[Vec<DVec3>]) -> VertexError {
    let mut chosen = net.point.clone();
    chosen.sort_unstable();
    let weights = weights_of_some(&chosen, &sampled.points, &sampled.receivers, (spacing_mm, STRIDE));
    let some = parts(&sampled.receivers).into_iter().flat_map(|part| part.step_by(STRIDE).map(|i| i as u32));
    let points = sampled.probes(some.collect());
    let of_light = |values: &Vec<DVec3>| {
        let sources: Vec<[f32; 4]> =
            chosen.iter().map(|&i| values[i as usize].as_vec3().extend(0.0).to_array()).collect();
        points.error(&interpolate(&weights, &sources, points.indices.len()), &points.of(values))
    };
    truth.iter().map(of_light).fold(VertexError::default(), VertexError::max)
}

/// Rows of `size` numbers for receivers given by the rows of a net, in the order of these: `compute` takes the
/// receivers in ascending order.
pub(crate) fn in_ascending_order(
    points: &[u32],
    size: usize,
    compute: impl FnOnce(&[u32]) -> Result<Vec<f32>>,
) -> Result<Vec<f32>> {
    let order = ascending_rows(points);
    let ascending: Vec<u32> = order.iter().map(|&row| points[row as usize]).collect();
    let computed = compute(&ascending)?;
    let mut values = vec![0.0; computed.len()];
    for (row, source) in order.iter().zip(computed.chunks_exact(size.max(1))) {
        values[*row as usize * size..(*row as usize + 1) * size].copy_from_slice(source);
    }
    Ok(values)
}

/// Rows of a net in ascending order of their points.
pub(crate) fn ascending_rows(points: &[u32]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_unstable_by_key(|&row| points[row as usize]);
    order
}

/// Radiosity at some points, none negative, of a light that is `vector` over the functions of the radiosities
/// `[point][channel][function]`.
pub(crate) fn under(values: &[f32], functions: usize, vector: &[DVec3]) -> Vec<DVec3> {
    let of_point = |row: &[f32]| {
        let sum = |c: usize| row[c * functions..].iter().zip(vector).map(|(v, w)| f64::from(*v) * w[c]).sum::<f64>();
        DVec3::new(sum(0), sum(1), sum(2)).max(DVec3::ZERO)
    };
    values.chunks_exact((3 * functions).max(1)).map(of_point).collect()
}

/// Values at the rows of a net, from those in ascending order of their points.
pub(crate) fn in_order_of_rows(net: &Net, ascending: &[DVec3]) -> Vec<DVec3> {
    let mut values = vec![DVec3::ZERO; ascending.len()];
    ascending_rows(&net.point).iter().zip(ascending).for_each(|(&row, value)| values[row as usize] = *value);
    values
}

/// Weights of every receiver over the reference points, which are some of the receivers, ascending.
pub fn weights(chosen: &[u32], points: &[OrientedPoint], receivers: &Receivers, spacing_mm: f64) -> Weights {
    weights_of_some(chosen, points, receivers, (spacing_mm, 1))
}

/// The same for every `stride`-th receiver of each part.
fn weights_of_some(
    chosen: &[u32],
    points: &[OrientedPoint],
    receivers: &Receivers,
    (spacing_mm, stride): (f64, usize),
) -> Weights {
    let parts = parts(receivers);
    let every = |part: &Range<usize>| part.clone().step_by(stride).map(|i| i as u32);
    let targets: Vec<u32> = parts.iter().flat_map(every).collect();
    weights_among(points, &parts, (chosen, &targets), spacing_mm, Kriging::RADIOSITY)
}

/// Weights of the targets over sources of the same part, which are about `spacing_mm` apart. Both lie part after part,
/// in any order inside one; sources are numbered as they are given. A part without sources has weights of 0.
pub(crate) fn weights_among(
    points: &[OrientedPoint],
    parts: &[Range<usize>],
    (sources, targets): (&[u32], &[u32]),
    spacing_mm: f64,
    fit: Kriging,
) -> Weights {
    let mut result = Weights { each: fit.sources, ..Weights::default() };
    let places = |indices: &[u32]| indices.iter().map(|&i| points[i as usize]).collect::<Vec<OrientedPoint>>();
    for part in parts {
        let of_part = |indices: &[u32]| {
            let [first, end] = [part.start, part.end].map(|bound| indices.partition_point(|&i| (i as usize) < bound));
            first..end
        };
        let (mine, targets) = (of_part(sources), places(&targets[of_part(targets)]));
        let own = Weights::new(&places(&sources[mine.clone()]), &targets, spacing_mm, fit);
        let missing = targets.len() * fit.sources - own.sources.len();
        result.sources.extend(own.sources.iter().map(|&s| mine.start as u32 + s));
        result.sources.extend(std::iter::repeat_n(0, missing));
        result.values.extend(own.values);
        result.values.extend(std::iter::repeat_n(0.0, missing));
    }
    result
}

/// Values `[target][each]` interpolated at every target, clamped at 0.
pub(crate) fn interpolate(weights: &Weights, values: &[[f32; 4]], targets: usize) -> Vec<DVec3> {
    const CHUNK: usize = 2048;
    let mut result = vec![DVec3::ZERO; targets];
    result.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
        let first = chunk * CHUNK * SOURCES;
        let cells = first..first + out.len() * SOURCES;
        let (Some(sources), Some(factors)) = (weights.sources.get(cells.clone()), weights.values.get(cells)) else {
            return;
        };
        let rows = sources.chunks_exact(SOURCES).zip(factors.chunks_exact(SOURCES));
        for (out, (sources, factors)) in out.iter_mut().zip(rows) {
            let mut sum = [0.0f32; 4];
            for (&source, &factor) in sources.iter().zip(factors) {
                let value = values.get(source as usize).copied().unwrap_or_default();
                (0..4).for_each(|i| sum[i] += factor * value[i]);
            }
            *out = DVec3::new(sum[0].max(0.0).into(), sum[1].max(0.0).into(), sum[2].max(0.0).into());
        }
    });
    result
}
