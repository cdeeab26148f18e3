//! Complex numbers and the modified Bessel functions K_0 and K_1, as far as an inverse Hankel transform needs them.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A complex number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Complex {
    pub re: f64,
    pub im: f64,
}

impl Complex {
    pub(super) const ZERO: Self = Self { re: 0.0, im: 0.0 };
    pub(super) const ONE: Self = Self { re: 1.0, im: 0.0 };

    pub(super) fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    pub(super) fn scale(self, factor: f64) -> Self {
        Self::new(self.re * factor, self.im * factor)
    }

    pub(super) fn abs(self) -> f64 {
        self.re.hypot(self.im)
    }

    pub(super) fn exp(self) -> Self {
        let (sin, cos) = self.im.sin_cos();
        let size = self.re.exp();
        Self::new(size * cos, size * sin)
    }

    /// The logarithm with its argument in (-pi, pi].
    pub(super) fn ln(self) -> Self {
        Self::new(self.abs().ln(), self.im.atan2(self.re))
    }

    /// The root with a real part that is not negative.
    pub(super) fn sqrt(self) -> Self {
        let size = self.abs();
        if size == 0.0 {
            return Self::ZERO;
        }
        let larger = (0.5 * (size + self.re.abs())).sqrt();
        let smaller = 0.5 * self.im / larger;
        if self.re >= 0.0 {
            Self::new(larger, smaller)
        } else {
            Self::new(smaller.abs(), if self.im < 0.0 { -larger } else { larger })
        }
    }

    /// `1 - exp(-z)` without cancellation near 0.
    pub(super) fn one_minus_decay(self) -> Self {
        if self.abs() > 0.1 {
            return Self::ONE - (-self).exp();
        }
        // Horner's scheme of z - z^2/2! + z^3/3! - ...
        let mut sum = Self::ONE;
        for k in (2..=12).rev() {
            sum = Self::ONE - self * sum.scale(1.0 / f64::from(k));
        }
        self * sum
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.re + other.re, self.im + other.im)
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.re - other.re, self.im - other.im)
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.re, -self.im)
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self::new(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)
    }
}

impl Div for Complex {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        // Scaled, so that no square overflows.
        let size = other.abs();
        let (c, d) = (other.re / size, other.im / size);
        Self::new((self.re * c + self.im * d) / size, (self.im * c - self.re * d) / size)
    }
}

/// Euler's constant.
const GAMMA: f64 = 0.577_215_664_901_532_9;

/// Largest step of the trapezoidal rule of [`bessel_k`]: its error is exp(-pi^2 / (2 step)) of the whole for |arg z| <=
/// pi / 4.
const LARGEST_STEP: f64 = 0.15;

/// Step over the root of |z|, used where it is smaller: the integrand is a Gaussian of that width then.
const STEP_OF_WIDTH: f64 = 0.5;

/// K_0(z) and K_1(z) for Re z > 0 and |arg z| <= pi / 4 to 1e-11 of their size.
pub(super) fn bessel_k(z: Complex) -> [Complex; 2] {
    let size = z.abs();
    if size < 1.0 { by_series(z) } else { by_integral(z, size) }
}

/// Power series (Abramowitz and Stegun 9.6.13 and 9.6.11).
fn by_series(z: Complex) -> [Complex; 2] {
    let quarter = (z * z).scale(0.25);
    let log = z.scale(0.5).ln();
    let (mut term_0, mut term_1) = (Complex::ONE, Complex::ONE);
    let (mut k_0, mut k_1) = (Complex::ZERO, Complex::ZERO);
    let (mut digamma_0, mut digamma_1) = (-GAMMA, 1.0 - GAMMA);
    for k in 0..14 {
        k_0 = k_0 + term_0 * (Complex::new(digamma_0, 0.0) - log);
        k_1 = k_1 + term_1 * (log - Complex::new(0.5 * (digamma_0 + digamma_1), 0.0));
        let next = f64::from(k + 1);
        term_0 = term_0 * quarter.scale(1.0 / (next * next));
        term_1 = term_1 * quarter.scale(1.0 / (next * (next + 1.0)));
        digamma_0 += 1.0 / next;
        digamma_1 += 1.0 / (next + 1.0);
    }
    [k_0, Complex::ONE / z + k_1 * z.scale(0.5)]
}

/// `K_n(z) = Int_0^inf exp(-z cosh t) cosh(n t) dt`.
fn by_integral(z: Complex, size: f64) -> [Complex; 2] {
    let (mut k_0, mut k_1) = (Complex::new(0.5, 0.0), Complex::new(0.5, 0.0));
    let step = LARGEST_STEP.min(STEP_OF_WIDTH / size.sqrt());
    let growth = step.exp();
    let mut forward = 1.0;
    // Re z is at least 0.7 |z|: the last term is exp(-36) of the first.
    let steps = ((1.0 + 36.0 * std::f64::consts::SQRT_2 / size).acosh() / step).ceil() as usize;
    for _ in 0..steps {
        forward *= growth;
        let cosh = 0.5 * (forward + 1.0 / forward);
        let value = (-z.scale(cosh - 1.0)).exp();
        k_0 = k_0 + value;
        k_1 = k_1 + value.scale(cosh);
    }
    let fade = (-z).exp().scale(step);
    [k_0 * fade, k_1 * fade]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::integrate;

    #[test]
    fn bessel_functions_agree_with_published_values_and_with_quadrature() {
        // Abramowitz and Stegun, tables 9.8 and 9.11.
        for (x, k_0, k_1) in [
            (0.1, 2.427_069_024_702_017, 9.853_844_780_870_606),
            (1.0, 0.421_024_438_240_708_3, 0.601_907_230_197_234_6),
            (5.0, 0.003_691_098_334_042_594_3, 0.004_044_613_445_452_164),
        ] {
            let [a, b] = bessel_k(Complex::new(x, 0.0));
            assert!((a.re / k_0 - 1.0).abs() < 1e-11 && a.im.abs() < 1e-14, "{x} {a:?}");
            assert!((b.re / k_1 - 1.0).abs() < 1e-11 && b.im.abs() < 1e-14, "{x} {b:?}");
        }
        for size in [1e-6, 0.01, 0.5, 0.99, 1.01, 3.0, 20.0, 60.0] {
            for angle in [0.0, -0.3, -std::f64::consts::FRAC_PI_4] {
                let z = Complex::new(size * f64::cos(angle), size * f64::sin(angle));
                let part = |order: f64, of: fn(Complex) -> f64| {
                    let f = |t: f64| of((-z.scale(t.cosh() - 1.0)).exp().scale((order * t).cosh()));
                    (0..25).map(|i| integrate(f, f64::from(i), f64::from(i + 1), 1e-14)).sum::<f64>()
                };
                // Both without the factor exp(-z).
                for (order, got) in bessel_k(z).map(|k| k * z.exp()).into_iter().enumerate() {
                    let want = Complex::new(part(order as f64, |z| z.re), part(order as f64, |z| z.im));
                    assert!((got - want).abs() < 1e-9 * want.abs(), "{z:?} {order} {got:?} {want:?}");
                }
            }
        }
    }

    #[test]
    fn elementary_functions_are_each_others_inverse() {
        for (re, im) in [(0.3, 0.4), (-2.0, 1e-3), (-2.0, -1e-3), (1e-12, 3.0), (5.0, 0.0), (-1.0, 0.0)] {
            let z = Complex::new(re, im);
            let root = z.sqrt();
            assert!(root.re >= 0.0 && (root * root - z).abs() < 1e-14 * z.abs(), "{z:?}");
            assert!((z.ln().exp() - z).abs() < 1e-14 * z.abs());
            assert!((z / z - Complex::ONE).abs() < 1e-15);
            for small in [1.0, 0.09 / z.abs(), 1e-9] {
                let x = z.scale(small);
                let plain = Complex::ONE - (-x).exp();
                assert!((x.one_minus_decay() - plain).abs() < 4e-16 * (1.0 + plain.abs()), "{x:?}");
            }
        }
    }
}
