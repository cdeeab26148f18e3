//! A profile as a table of its tail: any costly model becomes one logarithm, one exponential and a polynomial.
//!
//! With `u = ln(1 + r^2 / s_0)` the logarithm of the tail is a quintic on each cell, through its values, its exact
//! slopes `-R r dr/du / tail` and curvatures from both. R_d is the derivative of the same polynomial, so that tail and
//! reflectance belong together to rounding.

use crate::error::{Error, Result};
use crate::medium::profile::Profile;

/// Share of the whole below which tails are extrapolated.
const SMALLEST_SHARE: f64 = 1e-18;

/// Growth of `R r^2 / tail` over a factor 2 in r that distinguishes an exponential end (2) from a power (1).
const EXPONENTIAL_GROWTH: f64 = 1.3;

/// Extrapolation of the tail beyond the table.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    /// `exp(-rate r)`, in 1/mm.
    Exponential(f64),
    /// `r^-power`.
    Power(f64),
}

/// A tabulated profile of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Tabulated {
    /// s_0 in mm^2.
    scale_mm2: f64,
    step: f64,
    /// `ln tail` on each cell as a polynomial in [0, 1], lowest degree first; empty for a profile that returns nothing.
    cells: Vec<[f64; 6]>,
    last_mm: f64,
    last_tail: f64,
    end: End,
}

/// Positions of a table's knots: `r_k = scale sqrt(exp(k step) - 1)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// The distance below which knots are spread evenly in r^2, above it in ln r; any unit.
    pub scale: f64,
    /// Step in `ln(1 + r^2 / scale^2)`, positive.
    pub step: f64,
}

impl Grid {
    /// The distance of a knot, in the unit of `scale`.
    pub fn knot(&self, index: usize) -> f64 {
        self.scale * (self.step * index as f64).exp_m1().sqrt()
    }

    /// Number of knots up to a distance.
    pub fn count(&self, largest: f64) -> usize {
        ((2.0 * (largest / self.scale).ln_1p() / self.step).clamp(3.0, 10_000.0)) as usize + 1
    }
}

impl Tabulated {
    /// The table of `samples[k] = (R, tail)` at the knots of `grid`; R is in the inverse square of the grid's unit,
    /// which is `unit_mm` long.
    ///
    /// The table ends where the tail falls below 1e-18 of the whole or where a sample is not positive and falling;
    /// beyond it the tail continues as the exponential or the power of its end. Samples that start with a tail of 0 are
    /// a profile that returns nothing.
    ///
    /// # Errors
    /// Run time when fewer than four samples are usable.
    pub fn new(grid: Grid, unit_mm: f64, samples: &[(f64, f64)]) -> Result<Self> {
        let whole = samples.first().map_or(0.0, |sample| sample.1);
        if whole == 0.0 {
            let end = End::Power(1.0);
            return Ok(Self { scale_mm2: 1.0, step: 1.0, cells: Vec::new(), last_mm: 0.0, last_tail: 0.0, end });
        }
        let mut previous = f64::INFINITY;
        let usable = samples
            .iter()
            .take_while(|(reflectance, tail)| {
                let good = *reflectance > 0.0 && *tail > SMALLEST_SHARE * whole && *tail < previous;
                previous = *tail;
                good && reflectance.is_finite()
            })
            .count();
        let used = &samples[..usable];
        if usable < 4 {
            return Err(Error::runtime("a profile could not be tabulated: it vanishes within its first knots"));
        }
        // ln tail, and its slope by u times the step: ds/du = s_0 exp(u), d tail / ds = -R / 2.
        let value: Vec<f64> = used.iter().map(|sample| sample.1.ln()).collect();
        let slope: Vec<f64> = used
            .iter()
            .enumerate()
            .map(|(k, (reflectance, tail))| {
                let growth = grid.scale * grid.scale * (grid.step * k as f64).exp();
                -0.5 * reflectance / tail * growth * grid.step
            })
            .collect();
        let curvature = curvatures(&value, &slope);
        let cells = (0..usable - 1)
            .map(|k| quintic([value[k], slope[k], curvature[k]], [value[k + 1], slope[k + 1], curvature[k + 1]]))
            .collect();
        let power = |k: usize| used[k].0 * grid.knot(k).powi(2) / used[k].1;
        let (last, last_r) = (usable - 1, grid.knot(usable - 1));
        let half = (1..last).rev().find(|k| grid.knot(*k) <= 0.5 * last_r).unwrap_or(1);
        let end = if power(last) > EXPONENTIAL_GROWTH * power(half) {
            End::Exponential(power(last) / (last_r * unit_mm))
        } else {
            End::Power(power(last))
        };
        Ok(Self {
            scale_mm2: (grid.scale * unit_mm).powi(2),
            step: grid.step,
            cells,
            last_mm: last_r * unit_mm,
            last_tail: used[last].1,
            end,
        })
    }

    /// The tail and R_d together, at the cost of one.
    fn both(&self, r_mm: f64) -> (f64, f64) {
        // f64::max turns NaN into 0.
        let r_mm = r_mm.max(0.0);
        let square = r_mm * r_mm;
        let place = (square / self.scale_mm2).ln_1p() / self.step;
        if place < self.cells.len() as f64
            && let Some([c0, c1, c2, c3, c4, c5]) = self.cells.get(place as usize)
        {
            let t = place - place.floor();
            let log = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))));
            let slope = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)));
            let tail = log.exp();
            return (tail, (-2.0 * tail * slope / self.step / (self.scale_mm2 + square)).max(0.0));
        }
        if self.cells.is_empty() {
            return (0.0, 0.0);
        }
        match self.end {
            End::Exponential(rate) => {
                let tail = self.last_tail * (-rate * (r_mm - self.last_mm)).exp();
                (tail, rate * tail / r_mm)
            }
            End::Power(power) => {
                let tail = self.last_tail * (r_mm / self.last_mm).powf(-power);
                (tail, power * tail / r_mm / r_mm)
            }
        }
    }
}

/// Second derivatives in units of the step from values and slopes, to the fourth order inside and the third at the
/// ends.
fn curvatures(value: &[f64], slope: &[f64]) -> Vec<f64> {
    let n = value.len();
    let one_sided =
        |f: [f64; 3], d: [f64; 3]| 0.5 * (-23.0 * f[0] + 16.0 * f[1] + 7.0 * f[2]) - (6.0 * d[0] + 8.0 * d[1] + d[2]);
    (0..n)
        .map(|k| {
            if k == 0 {
                one_sided([value[0], value[1], value[2]], [slope[0], slope[1], slope[2]])
            } else if k == n - 1 {
                one_sided([value[k], value[k - 1], value[k - 2]], [-slope[k], -slope[k - 1], -slope[k - 2]])
            } else {
                2.0 * (value[k + 1] - 2.0 * value[k] + value[k - 1]) - 0.5 * (slope[k + 1] - slope[k - 1])
            }
        })
        .collect()
}

/// The quintic on [0, 1] with the given value, slope and curvature at both ends.
fn quintic([f, d, c]: [f64; 3], [g, e, b]: [f64; 3]) -> [f64; 6] {
    let (rise, turn, bend) = (g - f - d - 0.5 * c, e - d - c, b - c);
    [
        f,
        d,
        0.5 * c,
        10.0 * rise - 4.0 * turn + 0.5 * bend,
        -15.0 * rise + 7.0 * turn - bend,
        6.0 * rise - 3.0 * turn + 0.5 * bend,
    ]
}

impl Profile for Tabulated {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.both(r_mm).1
    }

    fn tail(&self, r_mm: f64) -> f64 {
        self.both(r_mm).0
    }
}
