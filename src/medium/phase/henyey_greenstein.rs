//! The phase function of Henyey and Greenstein (1941) and its sampling.

use std::f64::consts::PI;

/// The phase function with mean cosine `g`; `g > 0` is forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HenyeyGreenstein {
    g: f64,
}

impl HenyeyGreenstein {
    /// The function for a mean cosine in (-1, 1); values outside are clamped, NaN counts as 0.
    pub fn new(g: f64) -> Self {
        let limit = 1.0 - 1e-9;
        Self { g: if g.is_nan() { 0.0 } else { g.clamp(-limit, limit) } }
    }

    /// The mean cosine.
    pub fn g(self) -> f64 {
        self.g
    }

    /// Density over solid angle, 1/sr, at the cosine between the directions before and after.
    pub fn density(self, cosine: f64) -> f64 {
        let g = self.g;
        let square = 1.0 + g * g - 2.0 * g * cosine.clamp(-1.0, 1.0);
        (1.0 - g) * (1.0 + g) / (4.0 * PI * square * square.sqrt())
    }

    /// The cosine below which the fraction `xi` of the distribution lies.
    ///
    /// The usual form divides a difference by g; here g is divided out, so that every g is exact, 0 included.
    #[inline(always)]
    pub fn sample_cosine(self, xi: f64) -> f64 {
        let (g, t) = (self.g, 2.0 * xi - 1.0);
        let root = 1.0 + g * t;
        let numerator = t + g * (0.5 * (t * t + 3.0) + g * (t + 0.5 * g * (t * t - 1.0)));
        (numerator / (root * root)).clamp(-1.0, 1.0)
    }
}
