//! Unpolarised Fresnel transmission through a smooth dielectric surface, its hemispherical averages, and sampling by
//! it.
//!
//! `eta` is the refractive index inside the medium over the one outside. Cosines are with the normal, in [0, 1] on the
//! side in their names.

use crate::math::quadrature::{gauss_legendre_cached, integrate, integrate_with};
use crate::math::simd::multiversion;

/// Computation of the diffuse reflection at the boundary, and so of the dipole's `A`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BoundaryFit {
    /// The published polynomial fits, with which measured materials were fitted.
    #[default]
    Published,
    /// Quadrature of the Fresnel equations.
    Exact,
}

/// Range of eta where the published fits of the internal diffuse reflectance stay within 0.033 of the exact one; beyond it
/// they leave [0, 1].
pub const PUBLISHED_FIT_RANGE: std::ops::RangeInclusive<f64> = 0.4..=3.0;

/// Absolute tolerance of the hemispherical averages.
const AVERAGE_TOLERANCE: f64 = 1e-15;

/// Cosine inside of light that comes from outside, none where it is totally reflected (only for eta < 1) or where
/// `cos_outside` is not positive.
pub fn refracted_cosine(eta_inside_over_outside: f64, cos_outside: f64) -> Option<f64> {
    // Written so that NaN fails as well.
    if !(cos_outside > 0.0 && eta_inside_over_outside > 0.0) {
        return None;
    }
    let cos_outside = cos_outside.min(1.0);
    if eta_inside_over_outside == 1.0 {
        return Some(cos_outside);
    }
    let eta = eta_inside_over_outside;
    // eta^2 - 1 as a product keeps grazing directions accurate for eta close to 1.
    let scaled_square = cos_outside * cos_outside + (eta - 1.0) * (eta + 1.0);
    (scaled_square > 0.0).then(|| (scaled_square.sqrt() / eta).min(1.0))
}

/// Fraction of unpolarised light from outside at `cos_outside` that enters the medium, F_t(eta, w).
///
/// `cos_outside` above 1 counts as 1; where it is not positive, and under total reflection, nothing enters.
pub fn transmittance(eta_inside_over_outside: f64, cos_outside: f64) -> f64 {
    if eta_inside_over_outside > 0.0 { transmitted(eta_inside_over_outside, cos_outside) } else { 0.0 }
}

/// [`transmittance`] of a positive refractive index, with selections in the place of branches: many at once.
#[inline(always)]
fn transmitted(eta: f64, cosine: f64) -> f64 {
    let cos_outside = cosine.min(1.0);
    let scaled_square = cos_outside * cos_outside + (eta - 1.0) * (eta + 1.0);
    let cos_inside = (scaled_square.max(0.0).sqrt() / eta).min(1.0);
    let product = 4.0 * eta * cos_outside * cos_inside;
    let perpendicular = cos_outside + eta * cos_inside;
    let parallel = eta * cos_outside + cos_inside;
    let value = 0.5 * (product / (perpendicular * perpendicular) + product / (parallel * parallel));
    // No number is not below infinity: both directions grazing at once (eta within rounding of 1) leaves 0 / 0.
    let enters = (cosine > 0.0) & ((scaled_square > 0.0) & (value < f64::INFINITY) | (eta == 1.0));
    let value = if eta == 1.0 { 1.0 } else { value.min(1.0) };
    if enters { value } else { 0.0 }
}

#[inline(always)]
fn entering_body(eta_inside_over_outside: f64, cosines: &mut [f64]) {
    for cosine in cosines {
        *cosine = if *cosine > 0.0 { transmitted(eta_inside_over_outside, *cosine) * *cosine } else { 0.0 };
    }
}

multiversion! {
    /// Turns cosines of directions outside into cosine times [`transmittance`], for a positive refractive index.
    pub(crate) fn entering(eta_inside_over_outside: f64, cosines: &mut [f64]) => entering_body
}

/// Fraction of unpolarised light inside the medium at `cos_inside` that the surface sends back into it; 1 where
/// `cos_inside` is not positive.
pub fn reflectance_inside(eta_inside_over_outside: f64, cos_inside: f64) -> f64 {
    1.0 - transmittance(1.0 / eta_inside_over_outside, cos_inside)
}

/// `C = 2 Int_0^1 F_t(eta, mu) mu dmu`: the fraction of diffuse light from outside that enters. Exact to 1e-13.
pub fn diffuse_transmittance(eta_inside_over_outside: f64) -> f64 {
    let eta = eta_inside_over_outside;
    if !(eta > 0.0 && eta.is_finite()) {
        return 0.0;
    }
    if eta < 1.0 {
        // Reciprocity: F_t(eta, mu) mu dmu = eta^2 F_t(1/eta, mu') mu' dmu' with mu' the refracted cosine.
        return eta * eta * diffuse_transmittance(1.0 / eta);
    }
    let k = ((eta - 1.0) * (eta + 1.0)).sqrt();
    if k == 0.0 {
        return 1.0;
    }
    // mu = k sinh u makes eta cos_inside = k cosh u: no branch point near the path, however close eta is to 1.
    let integrand = |u: f64| {
        let mu = k * u.sinh();
        transmittance(eta, mu) * mu * k * u.cosh()
    };
    (2.0 * integrate(integrand, 0.0, (1.0 / k).asinh(), AVERAGE_TOLERANCE)).min(1.0)
}

/// F_dr: the fraction of diffuse light inside that the surface sends back into the medium.
///
/// [`BoundaryFit::Published`] is Egan and Hilgeman's fit for eta > 1 and its counterpart for eta < 1 (Jensen et al.
/// 2001; Donner and Jensen 2005), 0 at eta = 1, and the exact value outside [`PUBLISHED_FIT_RANGE`].
pub fn internal_diffuse_reflectance(eta_inside_over_outside: f64, fit: BoundaryFit) -> f64 {
    let eta = eta_inside_over_outside;
    if eta == 1.0 {
        return 0.0;
    }
    match fit {
        BoundaryFit::Published if PUBLISHED_FIT_RANGE.contains(&eta) => published_fit(eta),
        // Reciprocity again: what leaves is C(eta) / eta^2 = C(1 / eta).
        _ => (1.0 - diffuse_transmittance(1.0 / eta)).clamp(0.0, 1.0),
    }
}

fn published_fit(eta: f64) -> f64 {
    let inverse = 1.0 / eta;
    if eta > 1.0 {
        inverse * (0.710 - 1.440 * inverse) + 0.668 + 0.0636 * eta
    } else {
        -0.4399 + inverse * (0.7099 + inverse * (-0.3319 + 0.0636 * inverse))
    }
}

/// `A = (1 + F_dr) / (1 - F_dr)` of the dipole's boundary condition; 1 for matched indices.
pub fn boundary_a(eta_inside_over_outside: f64, fit: BoundaryFit) -> f64 {
    let f_dr = internal_diffuse_reflectance(eta_inside_over_outside, fit);
    (1.0 + f_dr) / (1.0 - f_dr).max(f64::EPSILON)
}

/// Number of cells of the table of [`CosineTransmittance`].
const CELLS: usize = 128;

/// Nodes of a cell, at which its polynomial is `F_t mu`: with 128 cells the integral is exact to 1e-11 of the whole.
const NODES: usize = 8;

/// Step of Newton's method, over the width of a cell, below which the iteration ends: its square is below rounding.
const LAST_STEP: f64 = 1e-8;

/// Entrance cosines with a density proportional to `F_t(eta, mu) mu`: constant light that is sampled by it has
/// the same weight for every sample.
#[derive(Clone, Debug)]
pub struct CosineTransmittance {
    eta: f64,
    /// Cells of the cosine on the side of the smaller index, from 0 to 1.
    cells: Vec<Cell>,
}

/// Cosines from `left` on, `t` in [0, 1] over a width.
#[derive(Clone, Copy, Debug)]
struct Cell {
    left: f64,
    width: f64,
    /// `Int_0^mu F_t mu dmu` at both ends.
    below: f64,
    above: f64,
    /// Coefficients of `F_t mu dmu/dt`, a polynomial in `t` from its constant on.
    density: [f64; NODES],
    /// Those of its integral from 0 to `t` over `t`.
    integral: [f64; NODES],
}

impl Cell {
    fn new(dense: f64, left: f64, right: f64, below: f64) -> Self {
        let width = right - left;
        let slope = |mu: f64| transmittance(dense, mu) * mu;
        let mut density = interpolated(|t| width * slope(left + width * t));
        if left == 0.0 {
            // Nothing enters at grazing angles, and the smallest targets lie there.
            density[0] = 0.0;
        }
        let mut integral = density;
        integral.iter_mut().enumerate().for_each(|(power, coefficient)| *coefficient /= (power + 1) as f64);
        let above = below + integrate_with(gauss_legendre_cached(16), left, right, slope);
        Self { left, width, below, above, density, integral }
    }

    /// The cosine below which the integral is `target`, by Newton's method inside a bracket.
    fn cosine(&self, target: f64) -> f64 {
        let wanted = (target - self.below).max(0.0);
        // The start takes the density for linear in the cell.
        let (first, last) = (self.density[0].max(0.0), polynomial(&self.density, 1.0));
        let root = (first * first + 2.0 * (last - first) * wanted).max(0.0).sqrt();
        let mut t = (2.0 * wanted / (first + root).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let excess = t * polynomial(&self.integral, t) - wanted;
            if excess > 0.0 {
                high = t;
            } else {
                low = t;
            }
            let newton = t - excess / polynomial(&self.density, t).max(f64::MIN_POSITIVE);
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            let step = (next - t).abs();
            t = next;
            if step <= LAST_STEP * t {
                break;
            }
        }
        self.left + self.width * t
    }
}

/// A polynomial, its constant first.
#[inline(always)]
fn polynomial(coefficients: &[f64; NODES], t: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * t + coefficient)
}

/// The polynomial on [0, 1] that has the values of a function at the Chebyshev nodes.
fn interpolated(function: impl Fn(f64) -> f64) -> [f64; NODES] {
    let node = |i: usize| 0.5 - 0.5 * (std::f64::consts::PI * (i as f64 + 0.5) / NODES as f64).cos();
    let nodes: [f64; NODES] = std::array::from_fn(node);
    let mut divided = nodes.map(function);
    for order in 1..NODES {
        for i in (order..NODES).rev() {
            divided[i] = (divided[i] - divided[i - 1]) / (nodes[i] - nodes[i - order]);
        }
    }
    // Horner's rule over Newton's form, in coefficients.
    let mut coefficients = [0.0; NODES];
    for i in (0..NODES).rev() {
        for power in (1..NODES).rev() {
            coefficients[power] = coefficients[power - 1] - nodes[i] * coefficients[power];
        }
        coefficients[0] = divided[i] - nodes[i] * coefficients[0];
    }
    coefficients
}

impl CosineTransmittance {
    /// Tabulates the distribution for one eta > 0; any other value counts as 1.
    pub fn new(eta_inside_over_outside: f64) -> Self {
        let valid = eta_inside_over_outside > 0.0 && eta_inside_over_outside.is_finite();
        let eta = if valid { eta_inside_over_outside } else { 1.0 };
        let dense = if eta < 1.0 { 1.0 / eta } else { eta };
        let k = ((dense - 1.0) * (dense + 1.0)).sqrt();
        let mut cells: Vec<Cell> = Vec::new();
        if k > 0.0 {
            let span = (1.0 / k).asinh();
            for cell in 1..=CELLS {
                let (left, below) = cells.last().map_or((0.0, 0.0), |last| (last.left + last.width, last.above));
                let fraction = cell as f64 / CELLS as f64;
                let right = if cell == CELLS { 1.0 } else { (k * (span * fraction).sinh()).min(1.0) };
                cells.push(Cell::new(dense, left, right, below));
            }
        } else {
            cells.push(Cell::new(1.0, 0.0, 1.0, 0.0));
        }
        Self { eta, cells }
    }

    /// The index ratio of the table.
    pub fn eta_inside_over_outside(&self) -> f64 {
        self.eta
    }

    /// Index ratio on the side where it is at least 1; the table is in that side's cosine.
    fn dense(&self) -> f64 {
        if self.eta < 1.0 { 1.0 / self.eta } else { self.eta }
    }

    /// `Int_0^1 F_t mu dmu` of the dense side.
    fn half(&self) -> f64 {
        self.cells.last().map_or(0.5, |cell| cell.above)
    }

    /// `C = 2 Int_0^1 F_t(eta, mu) mu dmu`, as [`diffuse_transmittance`].
    pub fn diffuse_transmittance(&self) -> f64 {
        let reciprocal = if self.eta < 1.0 { self.eta * self.eta } else { 1.0 };
        (2.0 * self.half() * reciprocal).min(1.0)
    }

    /// The cosine outside, in [0, 1], below which the fraction `xi` of the distribution lies. The density of the result
    /// is `2 F_t mu / C` to 1e-10.
    pub fn sample_entrance_cosine(&self, xi: f64) -> f64 {
        let xi = if xi > 0.0 { xi.min(1.0) } else { 0.0 };
        let dense = self.dense_cosine(xi * self.half());
        if self.eta < 1.0 {
            // Back through Snell's law; nothing enters below the critical cosine.
            let sin = self.eta * ((1.0 - dense) * (1.0 + dense)).sqrt();
            ((1.0 - sin) * (1.0 + sin)).sqrt()
        } else {
            dense
        }
    }

    /// Solves `Int_0^mu F_t mu dmu = target` on the dense side.
    fn dense_cosine(&self, target: f64) -> f64 {
        if self.dense() == 1.0 {
            return (2.0 * target).sqrt().min(1.0);
        }
        let cell = self.cells.partition_point(|cell| cell.above < target).min(self.cells.len() - 1);
        let cell = &self.cells[cell];
        if target >= cell.above { cell.left + cell.width } else { cell.cosine(target).min(1.0) }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::simd::InstructionSet;

    const ETAS: [f64; 12] = [0.4, 0.5, 1.0 / 1.33, 0.9, 0.999, 1.0, 1.0 + 1e-9, 1.01, 1.3, 1.5, 2.4, 3.0];

    fn cosines() -> impl Iterator<Item = f64> {
        (1..=200).map(|i| f64::from(i) / 200.0).chain([1e-12, 1e-6, 1e-3])
    }

    /// The cosine outside below which light is totally reflected; 0 if there is none.
    fn critical(eta: f64) -> f64 {
        ((1.0 - eta) * (1.0 + eta)).max(0.0).sqrt()
    }

    /// `Int_a^b f` over pieces that grow from `a` by factors of 10.
    fn pieces(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
        let border = |i: i32| if i == 0 { a } else { a + (b - a) * 10.0_f64.powi(i - 8) };
        (0..8).map(|i| integrate(&f, border(i), border(i + 1), 1e-13)).sum()
    }

    /// External diffuse reflectance of a denser dielectric in closed form (Walsh 1926; Duntley 1942).
    fn walsh(n: f64) -> f64 {
        let (n2, n4) = (n * n, n.powi(4));
        0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) * (n + 1.0))
            + n2 * (n2 - 1.0).powi(2) / (n2 + 1.0).powi(3) * ((n - 1.0) / (n + 1.0)).ln()
            - 2.0 * n.powi(3) * (n2 + 2.0 * n - 1.0) / ((n2 + 1.0) * (n4 - 1.0))
            + 8.0 * n4 * (n4 + 1.0) / ((n2 + 1.0) * (n4 - 1.0).powi(2)) * n.ln()
    }

    #[test]
    fn transmittance_is_what_optics_says_at_normal_incidence_and_at_brewsters_angle() {
        for eta in ETAS {
            let normal = ((eta - 1.0) / (eta + 1.0)).powi(2);
            assert!((transmittance(eta, 1.0) - (1.0 - normal)).abs() < 1e-14, "{eta}");
            // At Brewster's angle only the perpendicular polarisation reflects.
            let brewster = 1.0 / (1.0 + eta * eta).sqrt();
            let perpendicular = ((1.0 - eta * eta) / (1.0 + eta * eta)).powi(2);
            assert!((transmittance(eta, brewster) - (1.0 - 0.5 * perpendicular)).abs() < 1e-12, "{eta}");
        }
    }

    #[test]
    fn many_cosines_enter_as_single_ones_do() {
        for eta in ETAS {
            let all: Vec<f64> = cosines().chain([-1.0, -1e-300, 0.0, 1e-300, 1.0 + 1e-15, f64::NAN]).collect();
            for level in InstructionSet::available() {
                let mut entering = all.clone();
                super::entering(level, eta, &mut entering);
                for (cosine, entering) in all.iter().zip(&entering) {
                    let expected = if *cosine > 0.0 { transmittance(eta, *cosine) * cosine } else { 0.0 };
                    assert!((entering - expected).abs() <= 1e-15 * expected, "{eta} {cosine}: {entering} {expected}");
                }
            }
        }
    }

    #[test]
    fn transmittance_is_reciprocal() {
        for eta in ETAS {
            for cos_outside in cosines() {
                let into = transmittance(eta, cos_outside);
                match refracted_cosine(eta, cos_outside) {
                    Some(cos_inside) => {
                        // The way back loses accuracy only through the refracted cosine near grazing.
                        let out = transmittance(1.0 / eta, cos_inside);
                        assert!((into - out).abs() < 1e-6, "{eta} {cos_outside} {into} {out}");
                        if cos_inside > 0.05 && cos_outside > 0.05 {
                            assert!((into - out).abs() < 1e-12, "{eta} {cos_outside} {into} {out}");
                        }
                        assert!((reflectance_inside(eta, cos_inside) - (1.0 - into)).abs() < 1e-6);
                    }
                    None => assert_eq!(into, 0.0),
                }
            }
        }
    }

    #[test]
    fn transmittance_is_defined_everywhere() {
        assert_eq!(transmittance(1.0, 1e-300), 1.0);
        assert_eq!(transmittance(1.5, 7.0), transmittance(1.5, 1.0));
        for eta in ETAS {
            for cos in [0.0, -0.0, -0.5, f64::NAN, f64::NEG_INFINITY] {
                assert_eq!(transmittance(eta, cos), 0.0);
                assert_eq!(refracted_cosine(eta, cos), None);
                assert_eq!(reflectance_inside(eta, cos), 1.0);
            }
            for cos in cosines().chain([1e-300, f64::MIN_POSITIVE, f64::INFINITY]) {
                assert!((0.0..=1.0).contains(&transmittance(eta, cos)), "{eta} {cos}");
            }
        }
        for eta in [0.0, -1.0, f64::NAN] {
            assert_eq!(transmittance(eta, 0.5), 0.0);
        }
        // Total reflection from outside, below the critical cosine of eta = 0.8.
        assert_eq!(transmittance(0.8, 0.59), 0.0);
        assert!(transmittance(0.8, 0.61) > 0.0);
    }

    #[test]
    fn diffuse_transmittance_agrees_with_the_closed_form() {
        for i in 0..60 {
            let n = 1.05 + 0.05 * f64::from(i);
            assert!((diffuse_transmittance(n) - (1.0 - walsh(n))).abs() < 1e-10, "{n}");
            assert!((diffuse_transmittance(1.0 / n) - (1.0 - walsh(n)) / (n * n)).abs() < 1e-10, "{n}");
        }
        assert_eq!(diffuse_transmittance(1.0), 1.0);
        assert_eq!(diffuse_transmittance(f64::NAN), 0.0);
        // Continuous through matched indices.
        assert!((diffuse_transmittance(1.0 + 1e-12) - 1.0).abs() < 1e-6);
        assert!((diffuse_transmittance(1.0 - 1e-12) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn diffuse_averages_agree_with_plain_quadrature() {
        for eta in ETAS {
            // The pieces keep the layer at grazing angles, thin for eta near 1, from falling between the nodes.
            let plain = pieces(|mu| 2.0 * transmittance(eta, mu) * mu, critical(eta), 1.0);
            assert!((diffuse_transmittance(eta) - plain).abs() < 1e-10, "{eta}");
            let totally_reflected = critical(1.0 / eta).powi(2);
            let inside =
                totally_reflected + pieces(|mu| 2.0 * reflectance_inside(eta, mu) * mu, critical(1.0 / eta), 1.0);
            let exact = internal_diffuse_reflectance(eta, BoundaryFit::Exact);
            assert!((exact - inside).abs() < 1e-10, "{eta} {exact} {inside}");
        }
    }

    #[test]
    fn published_fits_stay_within_their_documented_error() {
        let mut worst = 0.0_f64;
        for i in 0..=2600 {
            let eta = (0.4 + f64::from(i) * 0.001).min(3.0);
            let fit = internal_diffuse_reflectance(eta, BoundaryFit::Published);
            let error = (fit - internal_diffuse_reflectance(eta, BoundaryFit::Exact)).abs();
            worst = worst.max(error);
            if (0.7..=1.6).contains(&eta) {
                assert!(error < 0.005, "{eta} {error}");
            }
        }
        assert!((0.0165..0.033).contains(&worst), "{worst}");
    }

    #[test]
    fn boundary_a_is_the_published_number_and_one_for_matched_indices() {
        let f_dr = |eta: f64| -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
        for eta in [1.3, 1.5] {
            let expected = (1.0 + f_dr(eta)) / (1.0 - f_dr(eta));
            assert!((boundary_a(eta, BoundaryFit::Published) - expected).abs() < 1e-12);
        }
        assert!((f_dr(1.0) - 0.0016).abs() < 1e-12);
        assert!((boundary_a(1.3, BoundaryFit::Published) - 2.602).abs() < 0.001);
        for fit in [BoundaryFit::Published, BoundaryFit::Exact] {
            assert_eq!(boundary_a(1.0, fit), 1.0);
            for eta in [1e-3, 0.25, 0.4, 0.8, 3.0, 4.0, 100.0, 1e9] {
                let a = boundary_a(eta, fit);
                assert!(a >= 1.0 && a.is_finite(), "{eta} {a}");
            }
        }
    }

    #[test]
    fn entrance_cosine_inverts_the_distribution() {
        for eta in ETAS {
            let table = CosineTransmittance::new(eta);
            assert!((table.diffuse_transmittance() - diffuse_transmittance(eta)).abs() < 1e-12, "{eta}");
            for i in 0..=40 {
                let xi = f64::from(i) / 40.0;
                let mu = table.sample_entrance_cosine(xi);
                let below =
                    pieces(|x| 2.0 * transmittance(eta, x) * x, critical(eta), mu) / table.diffuse_transmittance();
                assert!((below - xi).abs() < 1e-9, "{eta} {xi} {mu} {below}");
            }
        }
    }

    #[test]
    fn entrance_cosine_never_leaves_the_unit_interval() {
        for eta in ETAS.into_iter().chain([0.0, f64::NAN, -2.0, f64::INFINITY]) {
            let table = CosineTransmittance::new(eta);
            let mut previous = 0.0;
            for xi in [0.0, 1e-300, 1e-15, 1e-9, 1e-3, 0.5, 0.999_999, 1.0 - 1e-16, 1.0] {
                let mu = table.sample_entrance_cosine(xi);
                assert!((previous..=1.0).contains(&mu), "{eta} {xi} {mu}");
                previous = mu;
            }
            assert!(table.sample_entrance_cosine(f64::NAN) >= 0.0);
            assert_eq!(table.sample_entrance_cosine(2.0), table.sample_entrance_cosine(1.0));
            assert!((table.sample_entrance_cosine(1.0) - 1.0).abs() < 1e-7);
        }
    }
}
