//! The colour spaces of FLIP: linear RGB (Rec. 709), the linearised L*a*b* that the eye's filters work in (YCxCz), and
//! L*a*b* with Hunt's effect.

use glam::{DMat3, DVec3};

/// Linear Rec. 709 to CIE XYZ; the digits are those that FLIP's authors publish, so that figures agree.
const XYZ_FROM_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(10_135_552.0 / 24_577_794.0, 2_613_072.0 / 12_288_897.0, 1_425_312.0 / 73_733_382.0),
    DVec3::new(8_788_810.0 / 24_577_794.0, 8_788_810.0 / 12_288_897.0, 8_788_810.0 / 73_733_382.0),
    DVec3::new(4_435_075.0 / 24_577_794.0, 887_015.0 / 12_288_897.0, 70_074_185.0 / 73_733_382.0),
);

/// Rec. 709 luminance, from which the exposures are computed.
const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

/// Coefficients of the tone curve `(n2 x^2 + n1 x) / (d2 x^2 + d1 x + d0)`: a fit of ACES (Narkowicz 2015) without its
/// pre-exposure, that is at 0.6 x.
const CURVE: ToneCurve = ToneCurve { n2: 0.36 * 2.51, n1: 0.6 * 0.03, d2: 0.36 * 2.43, d1: 0.6 * 0.59, d0: 0.14 };

struct ToneCurve {
    n2: f64,
    n1: f64,
    d2: f64,
    d1: f64,
    d0: f64,
}

/// Luminance of linear RGB.
pub(super) fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(LUMINANCE)
}

/// The tone curve, clamped to [0, 1].
pub(super) fn tone_mapped(linear: DVec3) -> DVec3 {
    let numerator = linear * (linear * CURVE.n2 + CURVE.n1);
    let denominator = linear * (linear * CURVE.d2 + CURVE.d1) + CURVE.d0;
    (numerator / denominator).clamp(DVec3::ZERO, DVec3::ONE)
}

/// The input that the tone curve takes to `level` in (0, 1).
pub(super) fn tone_curve_inverse(level: f64) -> f64 {
    let a = CURVE.n2 - level * CURVE.d2;
    let b = CURVE.n1 - level * CURVE.d1;
    let c = -level * CURVE.d0;
    (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a)
}

/// The matrices of one comparison, in units of white (every channel of white is 1).
#[derive(Clone, Copy)]
pub(super) struct Colours {
    white_from_rgb: DMat3,
    rgb_from_white: DMat3,
    /// The colour difference that counts as the largest of the gamut: Hunt-adjusted green to blue, compressed.
    pub(super) largest_distance: f64,
}

impl Colours {
    pub(super) fn new() -> Self {
        let white = XYZ_FROM_RGB * DVec3::ONE;
        let white_from_rgb = DMat3::from_diagonal(white.recip()) * XYZ_FROM_RGB;
        let mut colours = Self { white_from_rgb, rgb_from_white: white_from_rgb.inverse(), largest_distance: 1.0 };
        colours.largest_distance = compressed_distance(colours.hunt_lab(DVec3::Y), colours.hunt_lab(DVec3::Z));
        colours
    }

    /// YCxCz of linear RGB.
    pub(super) fn opponent(&self, rgb: DVec3) -> DVec3 {
        let v = self.white_from_rgb * rgb;
        DVec3::new(116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z))
    }

    /// Linear RGB of YCxCz, clamped to the gamut.
    pub(super) fn rgb(&self, opponent: DVec3) -> DVec3 {
        let y = (opponent.x + 16.0) / 116.0;
        let v = DVec3::new(y + opponent.y / 500.0, y, y - opponent.z / 200.0);
        (self.rgb_from_white * v).clamp(DVec3::ZERO, DVec3::ONE)
    }

    /// L*a*b* of linear RGB, its chroma scaled by L* / 100 (Hunt's effect: brighter colours look more colourful).
    pub(super) fn hunt_lab(&self, rgb: DVec3) -> DVec3 {
        let v = self.white_from_rgb * rgb;
        let [x, y, z] = [v.x, v.y, v.z].map(lab_response);
        let lightness = 116.0 * y - 16.0;
        DVec3::new(lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z))
    }

    /// The colour difference of two pixels of Hunt-adjusted L*a*b*, in [0, 1] (FLIP 2020, section 4.1.3): the lower
    /// `COMMON_SHARE` of the distances takes the lower `COMMON_RANGE` of the range.
    pub(super) fn difference(&self, a: DVec3, b: DVec3) -> f64 {
        const COMMON_SHARE: f64 = 0.4;
        const COMMON_RANGE: f64 = 0.95;
        let distance = compressed_distance(a, b);
        let knee = COMMON_SHARE * self.largest_distance;
        if distance < knee {
            distance * COMMON_RANGE / knee
        } else {
            (COMMON_RANGE + (distance - knee) / (self.largest_distance - knee) * (1.0 - COMMON_RANGE)).min(1.0)
        }
    }
}

/// The response of one cone channel in L*a*b* (CIE 15).
fn lab_response(v: f64) -> f64 {
    const DELTA: f64 = 6.0 / 29.0;
    if v > DELTA * DELTA * DELTA { v.cbrt() } else { v / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
}

/// The HyAB distance (Abasi et al. 2020) to the power 0.7, which keeps large differences comparable.
fn compressed_distance(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    (d.x.abs() + d.y.hypot(d.z)).powf(0.7)
}
