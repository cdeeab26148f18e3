//! Transfer of a material and a size that change: functions of the vertex, whose weights follow the light, the absorption and the size.
//!
//! Under light of the harmonics `L_l` ([`super::harmonics`]) a channel of the radiosity is `B(v) = Sum_l T_l(v; a, s) L_l`, where `a` is by how
//! much the absorption is multiplied, channel by channel, and `s` the size. `T_l` is smooth in `ln a` and `ln s`, so that it is known all over a
//! rectangle from its values at few points: those of Chebyshev and Lobatto, between which polynomials of Lagrange interpolate (Trefethen 2013,
//! chapters 2 and 5). The columns at all points, of all harmonics and channels, have their leading left vectors in common:
//!
//! ```text
//! B(v) = Sum_k u_k(v) w_k,   w_k = Sum_ij p_i(ln a) q_j(ln s) Sum_l M_kijl L_l
//! ```
//!
//! so that a vertex holds the `u_k`, and what a light or an edit costs does not depend on the mesh: the `w_k`, RGB, are all that changes.
//! Nothing is assumed of how the asset transports light, only that it takes other materials.

use std::ops::RangeInclusive;

use glam::DVec3;
use serde_json::{Value, json};

use super::VertexData;
use super::functions::{LeadingFunctions, product};
use super::harmonics::{SMOOTH_SKY, lights_of, smooth_sky};
use crate::error::{Error, Result};
use crate::evaluate::{Evaluator, MaterialEdit};
use crate::io::gltf::written::Column;
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::medium::material::Medium;
use crate::progress::{Progress, Silent};

/// Most that the absorption and the size are multiplied by, and divided.
pub const FACTORS: RangeInclusive<f64> = 1.0..=16.0;

/// Points along the logarithms of absorption and size.
const POINTS: [usize; 2] = [4, 3];

/// Coefficients of a light.
const HARMONICS: usize = SMOOTH_SKY.len();

/// Most functions over the vertices: attributes of 16, beside those of the mesh.
const MOST_FUNCTIONS: usize = 32;

/// Part of the squares that functions may leave out, relative to radiosity under light from everywhere: 0.5 % RMS.
const LEFT_OUT: f64 = 0.005 * 0.005;

/// Bytes of a sample that evaluators keep, at most: irradiance under two lights for each harmonic, and the kernels of a few materials.
const OF_A_SAMPLE: u64 = 2 * HARMONICS as u64 * 24 + 4 * 400;

/// Bytes of the tables of calibrated kernels that evaluators remember of a medium: four of some 30 MB (bunny_3k in marble: 107 MB in all).
const OF_A_MEDIUM: u64 = 4 * (30 << 20);

/// A change of material and size, as factors of what the asset has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edit {
    /// By how much the absorption coefficients are multiplied, RGB.
    pub absorption: DVec3,
    /// By how much the object is larger, of the same materials.
    pub size: f64,
}

impl Edit {
    /// A medium after the edit, for the object in its old size: what is twice as large as its mean free paths has coefficients that are
    /// twice as large.
    ///
    /// # Errors
    /// As [`OpticalProperties::validated`](crate::medium::material::OpticalProperties::validated).
    pub fn of(&self, medium: &Medium) -> Result<Medium> {
        let mut properties = medium.properties;
        properties.sigma_s_reduced_per_mm *= self.size;
        properties.sigma_a_per_mm *= self.absorption * self.size;
        Ok(Medium { name: medium.name.clone(), properties: properties.validated().map_err(|e| e.at(&medium.name))? })
    }
}

/// Transfer of every source vertex for a range of edits.
pub struct Basis {
    /// Factors of absorption and of size at which it is known, ascending.
    points: [Vec<f64>; 2],
    /// Functions of each vertex, beside each other, in fours.
    rows: Vec<f32>,
    functions: usize,
    /// For each function, point of the absorption, point of the size and channel: nine factors of the light.
    weights: Vec<[f32; HARMONICS]>,
}

impl Basis {
    /// Bytes of memory for a number of vertices, of samples of the evaluator, and of media.
    pub fn memory(vertices: usize, samples: usize, media: usize) -> u64 {
        let columns = 3 * HARMONICS * POINTS[0] * POINTS[1];
        let of_vertices = (vertices as u64).saturating_mul((4 * columns + 8 * MOST_FUNCTIONS * 2) as u64);
        let of_samples = (samples as u64).saturating_mul(OF_A_SAMPLE);
        of_vertices.saturating_add(of_samples).saturating_add((media as u64).saturating_mul(OF_A_MEDIUM))
    }

    /// Lights an evaluator with each harmonic, in the materials of each point; `most` are the largest factors of absorption and size, whose
    /// inverses are the least. The evaluator has its own materials afterwards.
    ///
    /// # Errors
    /// Unsupported: an asset whose materials are baked in, or that takes no environments. Failures of the work.
    pub fn new(evaluator: &mut dyn Evaluator, most: [f64; 2], progress: &dyn Progress) -> Result<Self> {
        if evaluator.capabilities().material != MaterialEdit::Any {
            return Err(Error::unsupported(
                "the materials are baked into this asset, so that nothing is known of others; one of `bake --edit any` takes them",
            ));
        }
        let points = [points(most[0], POINTS[0]), points(most[1], POINTS[1])];
        let media = evaluator.scene().media.clone();
        let lights: Vec<Vec<(Light, f64)>> = (0..HARMONICS).map(lights_of).collect::<Result<_>>()?;
        let lights: Vec<(usize, &Light, f64)> = lights
            .iter()
            .enumerate()
            .flat_map(|(l, of)| of.iter().map(move |(light, sign)| (l, light, *sign)))
            .collect();
        let edits = points[0].len() * points[1].len();
        progress.start("light in other materials", (edits * lights.len()) as u64);
        evaluator.remember_lights(lights.len());
        let mut columns: Vec<Vec<f32>> = vec![vec![0.0; evaluator.scene().mesh.local_mm.len()]; 3 * HARMONICS * edits];
        // Walks are reused where the absorption alone changes.
        for (j, &size) in points[1].iter().enumerate() {
            for (i, &absorption) in points[0].iter().enumerate() {
                let edit = Edit { absorption: DVec3::splat(absorption), size };
                evaluator.set_media(media.iter().map(|medium| edit.of(medium)).collect::<Result<_>>()?)?;
                for &(l, light, sign) in &lights {
                    evaluator.set_lights(vec![light.clone()], &Silent)?;
                    let radiosity = evaluator.radiosity(&Silent)?;
                    for c in 0..3 {
                        let column = &mut columns[((i * points[1].len() + j) * 3 + c) * HARMONICS + l];
                        column.iter_mut().zip(&radiosity).for_each(|(sum, b)| *sum += (sign * b[c]) as f32);
                    }
                    progress.advance(1);
                }
            }
        }
        evaluator.remember_lights(1);
        progress.finish();
        evaluator.set_media(media)?;
        if columns.iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::runtime("transfer is beyond single precision"));
        }
        let areas = evaluator.scene().vertex_areas_mm2();
        // Errors are relative to what a channel has under light from everywhere.
        let everywhere = |of: &[Vec<f32>]| product(&of[0], &of[0], &areas).sqrt();
        let scale = |root: f64| if root > 0.0 { root.recip() } else { 0.0 };
        let scales: Vec<f64> =
            columns.chunks(HARMONICS).flat_map(|of| std::iter::repeat_n(scale(everywhere(of)), HARMONICS)).collect();
        let LeadingFunctions { functions, factors } =
            LeadingFunctions::new(&columns, &scales, &areas, (MOST_FUNCTIONS, LEFT_OUT))?;
        let padded = functions.len().next_multiple_of(4);
        let value = |k: usize, v: usize| functions.get(k).map_or(0.0, |of| of[v] as f32);
        let rows = (0..areas.len()).flat_map(|v| (0..padded).map(move |k| (k, v))).map(|(k, v)| value(k, v)).collect();
        let weights = factors.iter().flat_map(|of| of.as_chunks().0).map(|of| of.map(|x: f64| x as f32)).collect();
        Ok(Self { points, rows, functions: functions.len(), weights })
    }

    /// Number of functions.
    pub fn functions(&self) -> usize {
        self.functions
    }

    /// Factors of the absorption and of the size at which transfer was computed.
    pub fn points(&self) -> &[Vec<f64>; 2] {
        &self.points
    }

    /// The weights of the functions under light of these coefficients, RGB. Edits beyond the points are those of the last.
    pub fn weights(&self, edit: &Edit, light: &[DVec3; HARMONICS]) -> Vec<DVec3> {
        let of_size = lagrange(&self.points[1], edit.size);
        let of_absorption = edit.absorption.to_array().map(|a| lagrange(&self.points[0], a));
        let each = self.points[0].len() * self.points[1].len() * 3;
        let weight = |of: &[[f32; HARMONICS]]| {
            let mut sum = DVec3::ZERO;
            for (at, factors) in of.iter().enumerate() {
                let (c, j, i) = (at % 3, at / 3 % of_size.len(), at / 3 / of_size.len());
                let lit: f64 = factors.iter().zip(light).map(|(factor, l)| f64::from(*factor) * l[c]).sum();
                sum[c] += of_absorption[c][i] * of_size[j] * lit;
            }
            sum
        };
        self.weights.chunks_exact(each.max(1)).map(weight).collect()
    }

    /// Radiosity for weights of the functions, as shaders compute it, but for the cut of negative values.
    pub fn radiosity(&self, weights: &[DVec3]) -> Vec<DVec3> {
        let of = |row: &[f32]| row.iter().zip(weights).map(|(u, weight)| f64::from(*u) * *weight).sum();
        self.rows.chunks_exact(self.functions.next_multiple_of(4).max(1)).map(of).collect()
    }

    /// How far some edits between the points are from the asset that has their materials, under a smooth sky; `most` as in [`Self::new`].
    ///
    /// # Errors
    /// Failures of the work.
    pub fn errors(
        &self,
        evaluator: &mut dyn Evaluator,
        most: [f64; 2],
        progress: &dyn Progress,
    ) -> Result<Vec<EditError>> {
        let media = evaluator.scene().media.clone();
        let areas = evaluator.scene().vertex_areas_mm2();
        let edits = unseen(most);
        evaluator.set_lights(vec![smooth_sky()?], progress)?;
        let mut errors = Vec::new();
        for [absorption, size] in edits {
            let edit = Edit { absorption: DVec3::splat(absorption), size };
            evaluator.set_media(media.iter().map(|medium| edit.of(medium)).collect::<Result<_>>()?)?;
            let asset = evaluator.radiosity(progress)?;
            let found = self.radiosity(&self.weights(&edit, &SMOOTH_SKY.map(DVec3::splat)));
            let found: Vec<DVec3> = found.iter().map(|b| b.max(DVec3::ZERO)).collect();
            let VertexError { rms, worst, .. } = vertex_error(&found, &asset, &areas);
            errors.push(EditError { absorption, size, rms, worst });
        }
        evaluator.set_media(media)?;
        Ok(errors)
    }

    /// The table from which an engine makes weights: see `docs/export.md`.
    pub fn table(&self) -> Value {
        // As short as single precision is written.
        let short = |x: &f32| x.to_string().parse::<f64>().unwrap_or_default();
        json!({
            "functions": self.functions,
            "absorption": self.points[0],
            "size": self.points[1],
            "weights": self.weights.iter().flatten().map(short).collect::<Vec<f64>>(),
        })
    }

    /// `_TLX_U0` and on, four functions each.
    pub fn into_data(self) -> VertexData {
        let columns = (0..self.functions.div_ceil(4)).map(|k| Column::new(format!("_TLX_U{k}"), 4)).collect();
        VertexData { columns, rows: self.rows }
    }
}

/// Points of Chebyshev and Lobatto along the logarithm, from the inverse of the largest factor to itself; one where it is 1.
fn points(most: f64, count: usize) -> Vec<f64> {
    if most <= 1.0 {
        return vec![1.0];
    }
    let last = (count - 1) as f64;
    // The middle is the asset itself.
    let at = |i: usize| if 2 * i + 1 == count { 0.0 } else { -(std::f64::consts::PI * i as f64 / last).cos() };
    (0..count).map(|i| (most.ln() * at(i)).exp()).collect()
}

/// The polynomials of Lagrange over the logarithms of points, at a factor that is no further out than these.
fn lagrange(points: &[f64], factor: f64) -> Vec<f64> {
    let [first, .., last] = points else { return vec![1.0; points.len()] };
    let x = factor.clamp(*first, *last).ln();
    let of = |i: usize| {
        let others = points.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, b)| (x - b.ln()) / (points[i].ln() - b.ln())).product()
    };
    (0..points.len()).map(of).collect()
}

/// How far edits are from the asset with the same materials.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EditError {
    /// By how much the absorption was multiplied.
    pub absorption: f64,
    /// By how much the size was multiplied.
    pub size: f64,
    /// RMS of the worst channel over the asset's, weighted by area, under a sky of three bands.
    pub rms: f64,
    /// The worst vertex, in the same unit.
    pub worst: f64,
}

/// Edits between the points, with the largest factors of absorption and size.
fn unseen([absorption, size]: [f64; 2]) -> Vec<[f64; 2]> {
    let mut all: Vec<[f64; 2]> = [[-0.8, -0.8], [-0.8, 0.8], [0.3, -0.4], [0.8, 0.8], [-0.3, 0.4], [0.8, -0.8]]
        .map(|[a, s]: [f64; 2]| [absorption.powf(a), size.powf(s)])
        .into();
    all.dedup();
    all
}
