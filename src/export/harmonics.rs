//! Transfer as spherical harmonics of the light: what engines multiply with the harmonics of their sky.
//!
//! Radiosity is linear in the light. With `L(w)` its radiance, a vertex has `B = Int t(w) L(w) dw`, and with orthonormal real harmonics
//! `y_k` of the bands 0 to `order`, `B` is about `Sum_k T_k L_k`, where `T_k = Int t y_k dw` is what is stored and `L_k = Int L y_k dw` the
//! light's (Sloan, Kautz and Snyder 2002; Ramamoorthi and Hanrahan 2001 for two bands). `T_k` is the radiosity under a light of radiance
//! `y_k`: the difference of those under its positive and its negative part, each an environment. An offset in place of the two parts would
//! subtract large numbers from each other, and directions at the points of a quadrature would give shadows of points.

use std::sync::Arc;

use glam::DVec3;

use super::VertexData;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::io::gltf::written::Column;
use crate::light::Light;
use crate::light::environment::{EnvironmentMap, direction_of};
use crate::light::quantised::vector::distant;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::Progress;

/// Pixels of the maps of harmonics: 1.4 degrees, whose means differ from the centres by 1e-4.
const SIZE: [usize; 2] = [256, 128];

/// How many bands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Bands 0 and 1: four coefficients.
    One,
    /// Bands 0 to 2: nine coefficients.
    Two,
}

impl Order {
    /// Number of coefficients of a channel.
    pub const fn coefficients(self) -> usize {
        match self {
            Self::One => 4,
            Self::Two => 9,
        }
    }
}

/// The nine harmonics of a unit direction in the axes of a glTF file, +Y up: orthonormal, all signs positive, in the order of bands.
pub fn basis(DVec3 { x, y, z }: DVec3) -> [f64; 9] {
    [
        0.282_094_791_773_878_14,
        0.488_602_511_902_919_92 * y,
        0.488_602_511_902_919_92 * z,
        0.488_602_511_902_919_92 * x,
        1.092_548_430_592_079_2 * x * y,
        1.092_548_430_592_079_2 * y * z,
        0.315_391_565_252_520_05 * (3.0 * z * z - 1.0),
        1.092_548_430_592_079_2 * x * z,
        0.546_274_215_296_039_6 * (x * x - y * y),
    ]
}

/// Coefficients of the radiance of a light that is far away, `Int L(w) y_k(w) dw`, RGB.
///
/// # Errors
/// Unsupported: a light that is not far away.
pub fn of_light(light: &Light) -> Result<[DVec3; 9]> {
    let mut sums = [DVec3::ZERO; 9];
    if let Light::Constant { radiance } = light {
        sums[0] = *radiance * (4.0 * std::f64::consts::PI * basis(DVec3::Y)[0]);
        return Ok(sums);
    }
    for (direction, irradiance) in distant(light)? {
        let at = basis(direction.normalize_or_zero());
        sums.iter_mut().zip(at).for_each(|(sum, y)| *sum += y * irradiance);
    }
    Ok(sums)
}

/// Transfer of every source vertex.
pub struct Transfer {
    order: Order,
    /// For each vertex its coefficients, RGB each.
    rows: Vec<f32>,
}

impl Transfer {
    /// Lights an evaluator with each harmonic.
    ///
    /// # Errors
    /// Unsupported: an asset that takes no environments. Failures of the work.
    pub fn new(evaluator: &mut dyn Evaluator, order: Order, progress: &dyn Progress) -> Result<Self> {
        let count = order.coefficients();
        let mut rows = vec![0.0_f32; evaluator.scene().mesh.local_mm.len() * 3 * count];
        for k in 0..count {
            for (values, row) in of_harmonic(evaluator, k, progress)?.iter().zip(rows.chunks_exact_mut(3 * count)) {
                row[3 * k..3 * k + 3].copy_from_slice(&values.as_vec3().to_array());
            }
        }
        Ok(Self { order, rows })
    }

    /// Radiosity under coefficients of light, as shaders compute it, but for the cut of negative values.
    pub fn radiosity(&self, light: &[DVec3; 9]) -> Vec<DVec3> {
        let of = |row: &[f32]| {
            let each = row.as_chunks::<3>().0.iter().zip(light);
            each.map(|(t, l)| DVec3::from_array(t.map(f64::from)) * *l).sum()
        };
        self.rows.chunks_exact(3 * self.order.coefficients()).map(of).collect()
    }

    /// `_TLX_SH0` and on, three floats each.
    pub fn into_data(self) -> VertexData {
        let columns = (0..self.order.coefficients()).map(|k| Column::new(format!("_TLX_SH{k}"), 3)).collect();
        VertexData { columns, rows: self.rows }
    }
}

/// Radiosity under light of one harmonic.
fn of_harmonic(evaluator: &mut dyn Evaluator, k: usize, progress: &dyn Progress) -> Result<Vec<DVec3>> {
    let mut sum = Vec::new();
    for (light, sign) in lights_of(k)? {
        evaluator.set_lights(vec![light], progress)?;
        let radiosity = evaluator.radiosity(progress)?;
        sum.resize(radiosity.len(), DVec3::ZERO);
        sum.iter_mut().zip(radiosity).for_each(|(sum, b)| *sum += sign * b);
    }
    Ok(sum)
}

/// Lights whose sum, with these signs, has the radiance of a harmonic.
pub(super) fn lights_of(k: usize) -> Result<Vec<(Light, f64)>> {
    match k {
        0 => Ok(vec![(Light::constant(DVec3::splat(basis(DVec3::Y)[0]))?, 1.0)]),
        _ => Ok(vec![(part(k, 1.0)?, 1.0), (part(k, -1.0)?, -1.0)]),
    }
}

/// The part of a harmonic that has a sign, as light.
fn part(k: usize, sign: f64) -> Result<Light> {
    sky(|at| sign * at[k])
}

/// Coefficients of a sky that nine harmonics hold: from above, a little from the sides, nowhere dark.
pub const SMOOTH_SKY: [f64; 9] = [3.6, 1.0, -0.4, 0.6, 0.2, 0.0, -0.1, 0.15, -0.25];

/// The light of [`SMOOTH_SKY`].
///
/// # Errors
/// As [`Light::environment`].
pub fn smooth_sky() -> Result<Light> {
    sky(|at| at.iter().zip(SMOOTH_SKY).map(|(y, c)| y * c).sum())
}

/// Light from all around whose radiance follows from the harmonics of the direction, 0 where it would be negative.
fn sky(radiance: impl Fn([f64; 9]) -> f64) -> Result<Light> {
    let [width, height] = SIZE;
    let at = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        [radiance(basis(direction_of((x + 0.5) / width as f64, (y + 0.5) / height as f64))).max(0.0) as f32; 3]
    };
    let map = EnvironmentMap::new(width, height, (0..width * height).map(at).collect())?;
    Light::environment(Arc::new(map), 0.0, DVec3::ONE)
}

/// How far transfer in harmonics is from the asset that it was made of, under some light.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Flattening {
    /// Error of what a shader shows, negative values cut to 0, against the asset.
    pub error: VertexError,
    /// The same without the cut.
    pub uncut: VertexError,
    /// Share of the area where a channel is negative before the cut: ringing.
    pub negative_share: f64,
    /// The most negative value over the mean of its channel in the asset; 0 where nothing is negative.
    pub lowest: f64,
}

impl Flattening {
    /// Compares with what the asset gives under the same light; `areas` are weights of the vertices.
    ///
    /// # Errors
    /// Invalid input: under this light there is nothing to compare, all is black.
    pub fn new(flattened: &[DVec3], asset: &[DVec3], areas: &[f64]) -> Result<Self> {
        if asset.iter().all(|b| *b == DVec3::ZERO) {
            return Err(Error::input("no light arrives: there is nothing that harmonics could be compared with"));
        }
        let total: f64 = areas.iter().sum();
        let mean = asset.iter().zip(areas).map(|(b, area)| *b * *area).sum::<DVec3>() / total;
        let cut: Vec<DVec3> = flattened.iter().map(|b| b.max(DVec3::ZERO)).collect();
        let seen = || flattened.iter().zip(areas).filter(|(_, area)| **area > 0.0);
        let negative = seen().filter(|(b, _)| b.min_element() < 0.0).fold(0.0, |sum, (_, area)| sum + area);
        let least = seen().fold(DVec3::ZERO, |least, (b, _)| least.min(*b));
        let over = |c: usize| if mean[c] > 0.0 { least[c] / mean[c] } else { 0.0 };
        Ok(Self {
            error: vertex_error(&cut, asset, areas),
            uncut: vertex_error(flattened, asset, areas),
            negative_share: negative / total,
            lowest: (0..3).map(over).fold(0.0, f64::min),
        })
    }
}
