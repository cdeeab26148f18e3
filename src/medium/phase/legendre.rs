//! Phase functions as Legendre series, whose terms separate exactly into real spherical harmonics.

use std::f64::consts::PI;

use glam::DVec3;

use crate::math::sh::real_sh;

/// Largest number of terms of a separated phase function: 12 bands.
pub const MOST_TERMS: usize = 144;

/// `p(cos) = Sum_l (2 l + 1) chi_l / (4 pi) P_l(cos)` cut after K terms, `cos = -w_i'.w_o'`.
///
/// The addition theorem makes it `Sum_k g_k(w_i') h_k(w_o')` with `g_k = y_k` and `h_k = (-1)^l chi_l y_k` over the
/// first K real harmonics. The light side is the same for every medium, so that g stays free at run time; its energy is
/// exactly that of `chi_0 = 1` for every K, from every direction.
///
/// # Number of terms
///
/// Only whole bands, K = 1, 4, 9, 16, ..., depend on the scattering angle alone. Others are direction dependent: with K
/// = 8 the forward value of Henyey and Greenstein's function varies by 12 % of itself (g 0.25), 21 % (0.4), 34 % (0.7)
/// with direction. Series that are too short go negative; the least value over the peak of the true function, in
/// percent, from the tests:
///
/// | g | K = 1 | 4 | 9 | 16 | 25 |
/// | --- | --- | --- | --- | --- | --- |
/// | 0.25 | 0 | 0 | 0 | 0 | 0 |
/// | 0.4 | 0 | -5.1 | 0 | 0 | 0 |
/// | 0.7 | 0 | -5.8 | -2.8 | -5.6 | -1.7 |
/// | 0.9 | 0 | -0.9 | -0.7 | -1.5 | -1.1 |
///
/// Negative g mirror the positive ones. K = 4 is negative somewhere exactly for |g| > 1/3. From |g| = 0.7 on the series
/// misses most of the peak: evaluate single scattering directly. A delta-M split (Wiscombe 1977) of 1, 2 or 3 bands is no way
/// out: it has 1.03, 1.56 and 1.34 times the albedo of first order of a half space at g = 0.7, and 0.34, 4.02 and 3.12 times that
/// at 0.9, because what is scattered into the peak counts as unscattered.
#[derive(Clone, Debug, PartialEq)]
pub struct LegendrePhase {
    /// `chi_l` of each band, `chi_0 = 1` first.
    moments: Vec<f64>,
    terms: usize,
}

impl LegendrePhase {
    /// Henyey and Greenstein's function, `chi_l = g^l`; g is brought into [-1, 1] (NaN: 0), terms into 1 to
    /// [`MOST_TERMS`].
    pub fn henyey_greenstein(g: f64, terms: usize) -> Self {
        let g = if g.is_nan() { 0.0 } else { g.clamp(-1.0, 1.0) };
        let moments = (0..bands(terms)).map(|l| g.powi(l as i32)).collect();
        Self { moments, terms: terms.clamp(1, MOST_TERMS) }
    }

    /// Number of terms K.
    pub fn terms(&self) -> usize {
        self.terms
    }

    /// `g_k = y_k` of the first `terms` harmonics at a unit vector towards the light.
    pub fn light(terms: usize, towards_light: DVec3, out: &mut [f64]) {
        let count = terms.min(out.len());
        real_sh(bands(terms), towards_light, &mut out[..count]);
    }

    /// `h_k` at a unit vector towards the eye.
    pub fn view(&self, towards_eye: DVec3, out: &mut [f64]) {
        let count = self.terms.min(out.len());
        real_sh(self.moments.len(), towards_eye, &mut out[..count]);
        for (k, h) in out[..count].iter_mut().enumerate() {
            let l = k.isqrt();
            *h *= if l % 2 == 0 { self.moments[l] } else { -self.moments[l] };
        }
    }

    /// `Sum_k g_k(w_i') h_k(w_o')`, 1/sr.
    pub fn product(&self, towards_light: DVec3, towards_eye: DVec3) -> f64 {
        let (mut light, mut view) = ([0.0; MOST_TERMS], [0.0; MOST_TERMS]);
        Self::light(self.terms, towards_light, &mut light);
        self.view(towards_eye, &mut view);
        light.iter().zip(&view).take(self.terms).map(|(g, h)| g * h).sum()
    }

    /// The series of all its bands at a cosine of the scattering angle, 1/sr.
    pub fn density(&self, cosine: f64) -> f64 {
        let x = cosine.clamp(-1.0, 1.0);
        let (mut before, mut legendre, mut sum) = (0.0, 1.0, 0.0);
        for (l, chi) in self.moments.iter().enumerate() {
            let l = l as f64;
            sum += (2.0 * l + 1.0) * chi * legendre;
            let next = ((2.0 * l + 1.0) * x * legendre - l * before) / (l + 1.0);
            (before, legendre) = (legendre, next);
        }
        sum / (4.0 * PI)
    }
}

/// Number of bands that hold this many terms.
fn bands(terms: usize) -> usize {
    let terms = terms.clamp(1, MOST_TERMS);
    (terms - 1).isqrt() + 1
}

#[cfg(test)]
#[path = "legendre_tests.rs"]
mod tests;
