//! Error of another method's radiosity against the walk's exitance: the model's own error.

use glam::DVec3;

use super::exitance::Exitance;
use super::tally::Hats;
use crate::error::{Error, Result};
use crate::geometry::cluster::{self, Run};
use crate::math::statistics::{VertexError, vertex_error};
use crate::transport::domain::Domain;

/// The difference between a method and the walk, with the walk's noise taken out. Shares of the walk's RMS, by channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ModelError {
    /// RMS of the difference over the surface, less the noise: `sqrt(max(0, mean((b - mc)^2) - mean(se^2)))`.
    pub rms: [f64; 3],
    /// Standard error of `rms` (the errors of vertices taken for independent).
    pub rms_error: [f64; 3],
    /// Mean of the difference, signed: positive where the method is brighter.
    pub bias: [f64; 3],
    /// The noise that was taken out: RMS of the standard errors.
    pub noise: [f64; 3],
    /// Standard error of `bias` (the errors of vertices taken for independent).
    pub bias_error: [f64; 3],
}

impl ModelError {
    /// RMS of the worst channel, and its standard error.
    pub fn worst(&self) -> [f64; 2] {
        let channels = self.rms.iter().zip(&self.rms_error).map(|(&rms, &error)| [rms, error]);
        channels.fold([0.0; 2], |worst, channel| if channel[0] > worst[0] { channel } else { worst })
    }
}

/// Radiosity that is linear between vertices, projected on the hat functions as the walk's exitance is:
/// `Int b hat / Int hat`, by slot.
///
/// # Errors
/// As many values as source vertices are needed.
pub fn project(hats: &Hats, radiosity: &[DVec3]) -> Result<Vec<DVec3>> {
    if radiosity.len() != hats.of_vertex.len() {
        let (values, vertices) = (radiosity.len(), hats.of_vertex.len());
        return Err(Error::input(format!("{values} values of radiosity for {vertices} vertices")));
    }
    let nodal: Vec<DVec3> =
        hats.vertex.iter().map(|&v| radiosity.get(v as usize).copied().unwrap_or_default()).collect();
    let mut sums = vec![DVec3::ZERO; hats.len()];
    for (corners, area) in hats.corners.iter().zip(&hats.triangle_area_mm2) {
        let values = corners.map(|c| nodal.get(c as usize).copied().unwrap_or_default());
        let all: DVec3 = values.iter().sum();
        for (&corner, &value) in corners.iter().zip(&values) {
            if let Some(sum) = sums.get_mut(corner as usize) {
                *sum += (area / 12.0) * (all + value);
            }
        }
    }
    let divided = sums.iter().zip(&hats.mass_mm2);
    Ok(divided.map(|(sum, &mass)| if mass > 0.0 { *sum / mass } else { DVec3::ZERO }).collect())
}

/// Barycentric coordinates of `cuts * cuts` points of a triangle, each for the same share of its area: the middles of equal pieces.
pub fn points_of_a_triangle(cuts: u32) -> impl Iterator<Item = [f64; 3]> {
    let third = 1.0 / f64::from(3 * cuts.max(1));
    let of = move |i: u32, j: u32, shift: f64| {
        let [u, v] = [i, j].map(|k| third * (3.0 * f64::from(k) + shift));
        [1.0 - u - v, u, v]
    };
    let row = move |i: u32| {
        let upright = (0..cuts - i).map(move |j| of(i, j, 1.0));
        upright.chain((0..(cuts - i).saturating_sub(1)).map(move |j| of(i, j, 2.0)))
    };
    (0..cuts).flat_map(row)
}

/// [`project`] of radiosity that is known at the [`points_of_a_triangle`] of every triangle, one triangle after the other.
pub fn project_points(hats: &Hats, cuts: u32, radiosity: &[DVec3]) -> Vec<DVec3> {
    let weights: Vec<[f64; 3]> = points_of_a_triangle(cuts).collect();
    let mut sums = vec![DVec3::ZERO; hats.len()];
    let triangles = hats.corners.iter().zip(&hats.triangle_area_mm2).zip(radiosity.chunks(weights.len().max(1)));
    for ((corners, area), values) in triangles {
        for (weights, value) in weights.iter().zip(values) {
            for (corner, weight) in corners.iter().zip(weights) {
                if let Some(sum) = sums.get_mut(*corner as usize) {
                    *sum += (area * weight / values.len() as f64) * *value;
                }
            }
        }
    }
    let divided = sums.iter().zip(&hats.mass_mm2);
    divided.map(|(sum, &mass)| if mass > 0.0 { *sum / mass } else { DVec3::ZERO }).collect()
}

/// Error of radiosity over so many places of a surface against two independent walks, whose noise the product of the differences from
/// either takes out; relative to the RMS of the walks. Places are groups of vertices. The other figures are those of the
/// places, with the noise of both walks. Radiosity is given by its projection on the hat functions ([`project`], [`project_points`]).
pub fn over_places(domain: Domain, walks: [&Exitance; 2], projected: &[DVec3], places: usize) -> VertexError {
    let [first, second] = walks;
    let hats = &first.hats;
    let at: Vec<DVec3> = hats.vertex.iter().map(|&v| domain.mesh.local_mm[v as usize].as_dvec3()).collect();
    let mut order: Vec<u32> = (0..hats.len() as u32).filter(|&slot| hats.mass_mm2[slot as usize] > 0.0).collect();
    let capacity = order.len().div_ceil(places.max(1));
    let runs = cluster::groups(&mut order, &at, capacity);
    let mean = |of: &[DVec3], run: &Run| {
        let slots = order[run.range()].iter().map(|&slot| slot as usize);
        let (sum, mass) = slots.fold((DVec3::ZERO, 0.0), |(sum, mass), slot| {
            (sum + hats.mass_mm2[slot] * of[slot], mass + hats.mass_mm2[slot])
        });
        (sum / mass, mass)
    };
    let [mut product, mut square] = [DVec3::ZERO; 2];
    let (mut values, mut truth, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    for run in &runs {
        let ((b, mass), (a, _), (c, _)) = (mean(projected, run), mean(&first.total, run), mean(&second.total, run));
        product += mass * (b - a) * (b - c);
        square += mass * a * c;
        values.push(b);
        truth.push(0.5 * (a + c));
        areas.push(mass);
    }
    let share = |c: usize| if square[c] > 0.0 { (product[c] / square[c]).max(0.0).sqrt() } else { 0.0 };
    let rms = (0..3).map(share).fold(0.0, f64::max);
    VertexError { rms, ..vertex_error(&values, &truth, &areas).or_none() }
}

/// Compares the radiosity of every source vertex with a walk.
///
/// # Errors
/// As [`project`].
pub fn compare(walk: &Exitance, radiosity: &[DVec3]) -> Result<ModelError> {
    let projected = project(&walk.hats, radiosity)?;
    let area: f64 = walk.hats.mass_mm2.iter().sum();
    if area <= 0.0 {
        return Ok(ModelError::default());
    }
    let [mut squares, mut sums, mut noise, mut bias_error, mut variance] = [DVec3::ZERO; 5];
    let values = projected.iter().zip(&walk.total).zip(&walk.standard_error).zip(&walk.hats.mass_mm2);
    for (((&b, &mc), &error), &mass) in values {
        let (share, difference) = (mass / area, b - mc);
        squares += share * difference * difference;
        sums += share * difference;
        noise += share * error * error;
        bias_error += share * share * error * error;
        // Of a normal deviate added to a true difference d: Var (d + e)^2 = 4 d^2 <e^2> + 2 <e^2>^2.
        let true_square = (difference * difference - error * error).max(DVec3::ZERO);
        variance += share * share * (4.0 * true_square + 2.0 * error * error) * error * error;
    }
    let rms = (squares - noise).max(DVec3::ZERO).map(f64::sqrt);
    // The root of a mean square m with standard error s: s / (2 sqrt m), or sqrt s where m is lost in the noise.
    let deviation = variance.map(f64::sqrt);
    let steep = DVec3::select(rms.cmpgt(DVec3::ZERO), deviation / (2.0 * rms), DVec3::INFINITY);
    let unit = walk.unit();
    let relative = |v: DVec3| DVec3::select(unit.cmpgt(DVec3::ZERO), v / unit, DVec3::ZERO).to_array();
    Ok(ModelError {
        rms: relative(rms),
        rms_error: relative(steep.min(deviation.map(f64::sqrt))),
        bias: relative(sums),
        noise: relative(noise.map(f64::sqrt)),
        bias_error: relative(bias_error.map(f64::sqrt)),
    })
}
