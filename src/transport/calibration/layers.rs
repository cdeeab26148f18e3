//! The two radial functions of a calibrated kernel, as factors of the dipole.
//!
//! `K(o, i) = R_d(r) (a(r) + b(r) h)`, `h = f(r) ((x_i - x_o).n_o + (x_o - x_i).n_i)`: negative across a body, zero on a
//! plane, positive across a hollow. `R_d a` is a single layer and `R_d b f` times the heights a double layer, as in a
//! boundary integral. Both are cubic B-splines of the logarithm of the distance. f is `1 / r` beyond a mean free path and
//! fades within: heights are small there, what they would tell the factors of points tell as well, and a double layer
//! that varies slowly is cheap to sum.

use crate::error::Result;
use crate::math::quadrature::{gauss_legendre_cached, integrate_with};
use crate::medium::dipole::Dipole;
use crate::medium::profile::Profile;
use crate::medium::profiles::tabulated::{Grid, Tabulated};

/// B-splines that are not zero at one distance.
pub(super) const SUPPORT: usize = 4;

/// Least share of the dipole that the single layer keeps: heights enter as a share of it.
const LEAST_SINGLE: f64 = 0.02;

/// Distance within which heights fade, over that at which the splines start.
const FADE: f64 = 4.0;

/// Step of the table of a single layer in `ln(1 + r^2 / scale^2)`.
const TABLE_STEP: f64 = 0.08;

/// Order of the rule that integrates a single layer between knots of its table.
const TABLE_ORDER: usize = 6;

/// Cubic B-splines of ln r, constant beyond both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splines {
    /// The distance at which the splines start, mm.
    pub first_mm: f64,
    /// Factor between the distances of two knots.
    pub ratio: f64,
    /// Number of intervals; there are three functions more.
    pub intervals: usize,
}

impl Splines {
    /// Splines with knots at least so far apart (a factor above 1) from one distance to another, mm.
    pub fn new(first_mm: f64, last_mm: f64, ratio: f64) -> Self {
        let octaves = (last_mm / first_mm).ln() / ratio.ln();
        let intervals = if octaves.is_finite() { octaves.clamp(1.0, 64.0) as usize } else { 1 };
        let ratio = (last_mm / first_mm).max(1.0 + 1e-6).powf(1.0 / intervals as f64);
        Self { first_mm, ratio, intervals }
    }

    /// f: the heights over the distance, faded within a mean free path, 1/mm. Even and smooth in r.
    pub(super) fn fade_per_mm(&self, r_mm: f64) -> f64 {
        let fade = self.fade_mm();
        let square = r_mm * r_mm + fade * fade;
        r_mm * r_mm / (square * square.sqrt())
    }

    /// The distance within which heights fade, mm.
    pub(super) fn fade_mm(&self) -> f64 {
        FADE * self.first_mm
    }

    /// The distance at which a function is largest, mm.
    pub(super) fn centre_mm(&self, function: usize) -> f64 {
        self.first_mm * self.ratio.powf(function as f64 - 1.0)
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        self.intervals + SUPPORT - 1
    }

    /// True if there are no functions, which is never the case.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The first function that is not zero at a distance (mm), and the values of it and the next three.
    pub(super) fn at(&self, r_mm: f64) -> (usize, [f64; SUPPORT]) {
        let place = (r_mm / self.first_mm).ln() / self.ratio.ln();
        // f64::max turns NaN into 0.
        let place = place.max(0.0).min(self.intervals as f64);
        let first = (place as usize).min(self.intervals - 1);
        let t = place - first as f64;
        let u = 1.0 - t;
        let middle = |x: f64| (3.0 * x * x * x - 6.0 * x * x + 4.0) / 6.0;
        (first, [u * u * u / 6.0, middle(t), middle(u), t * t * t / 6.0])
    }

    /// The sum of the functions times coefficients.
    pub(super) fn sum(&self, coefficients: &[f64], r_mm: f64) -> f64 {
        let (first, values) = self.at(r_mm);
        coefficients.iter().skip(first).zip(values).map(|(c, v)| c * v).sum()
    }
}

/// The layers of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    /// Functions of the distance.
    pub splines: Splines,
    /// Coefficients of a, the single layer over the dipole.
    pub single: Vec<f64>,
    /// Coefficients of b, the double layer over the dipole.
    pub double: Vec<f64>,
}

impl Layers {
    /// a at a distance, mm.
    pub fn single(&self, r_mm: f64) -> f64 {
        self.splines.sum(&self.single, r_mm).max(LEAST_SINGLE)
    }

    /// The double layer `R_d b f` of a dipole, 1/mm^3.
    pub fn double(&self, dipole: Dipole) -> impl Profile + use<> {
        DoubleProfile { layers: self.clone(), dipole }
    }

    /// The single layer `R_d a` of a dipole as a profile, up to a reach, mm.
    ///
    /// # Errors
    /// A dipole that cannot be tabulated.
    pub fn profile(&self, dipole: &dyn Profile, reach_mm: f64) -> Result<Tabulated> {
        let half = dipole.radius_containing_mm(0.1);
        let scale = if half > 0.0 && half.is_finite() { half.min(reach_mm) } else { reach_mm };
        let grid = Grid { scale, step: TABLE_STEP };
        let knots = grid.count(4.0 * reach_mm);
        let layer = |r: f64| dipole.reflectance(r) * self.single(r);
        let last = grid.knot(knots - 1);
        let mut tail = dipole.tail(last) * self.single(last);
        let mut samples = vec![(layer(last), tail)];
        for k in (0..knots - 1).rev() {
            let (from, to) = (grid.knot(k), grid.knot(k + 1));
            tail += integrate_with(gauss_legendre_cached(TABLE_ORDER), from, to, |r| layer(r) * r);
            samples.push((layer(from), tail));
        }
        samples.reverse();
        Tabulated::new(grid, 1.0, &samples)
    }
}

/// The double layer of one channel. It has no tail: what heights multiply has no integral over a plane.
struct DoubleProfile {
    layers: Layers,
    dipole: Dipole,
}

/// Step of differences, over the square of the distance.
const DIFFERENCE: f64 = 0.02;

impl Profile for DoubleProfile {
    fn reflectance(&self, r_mm: f64) -> f64 {
        let Layers { splines, double, .. } = &self.layers;
        self.dipole.reflectance(r_mm) * splines.sum(double, r_mm) * splines.fade_per_mm(r_mm)
    }

    fn tail(&self, _: f64) -> f64 {
        0.0
    }

    fn expansion(&self, s_mm2: f64) -> [f64; 3] {
        let at = |u: f64| self.reflectance((s_mm2 * (1.0 + u)).sqrt());
        let [before, here, after] = [-DIFFERENCE, 0.0, DIFFERENCE].map(at);
        let s = s_mm2.max(f64::MIN_POSITIVE);
        let first = 0.5 * (after - before) / DIFFERENCE / s;
        let second = 0.5 * (after + before - 2.0 * here) / (DIFFERENCE * DIFFERENCE) / s / s;
        [here, first, second].map(|value| if value.is_finite() { value } else { 0.0 })
    }
}
