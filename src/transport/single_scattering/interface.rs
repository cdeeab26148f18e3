//! Light that enters through a flat piece of surface.

use glam::DVec3;

use crate::medium::fresnel::{refracted_cosine, transmittance};

/// Form of the integrand, equation (4) of Wang, Tran and Luebke 2005.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Form {
    /// The integrand with the change of solid angle and of radiance at the surface, `|w_i.n_i| / (eta^2 |w_i'.n_i|)`:
    /// reciprocal, and no energy is gained.
    #[default]
    Physical,
    /// The integrand as printed, without it, for the paper's figures: 2.4 times as bright at eta = 1.3, 3.4 at 1.5.
    Printed,
}

/// Largest length of a refracted path over that of the straight one (reached for eta < 1, near the critical angle).
const MOST_STRETCH: f64 = 1e9;

/// Refraction of light that enters from one direction: its gain, its path and its cosine inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refraction {
    /// Gain `F_t(eta, w_i)`, times the refraction factor in the physical form.
    pub gain: f64,
    /// Length of the refracted path over that of the straight one, equation (5): `cos / cos'`.
    pub stretch: f64,
    /// Cosine inside.
    pub cos_inside: f64,
}

impl Refraction {
    /// Refraction at a cosine outside; none where no light enters (from behind, under total reflection).
    ///
    /// The physical gain is written without the division by `cos'`, so that it stays finite at the critical angle of eta < 1.
    #[inline]
    pub fn new(form: Form, eta_inside_over_outside: f64, cos_outside: f64) -> Option<Self> {
        let eta = eta_inside_over_outside;
        let cos_inside = refracted_cosine(eta, cos_outside)?;
        let cosine = cos_outside.min(1.0);
        if eta == 1.0 {
            return Some(Self { gain: 1.0, stretch: 1.0, cos_inside });
        }
        let gain = match form {
            Form::Printed => transmittance(eta, cosine),
            Form::Physical => {
                let (perpendicular, parallel) = (cosine + eta * cos_inside, eta * cosine + cos_inside);
                let reciprocals = (perpendicular * perpendicular).recip() + (parallel * parallel).recip();
                2.0 * cosine * cosine / eta * reciprocals
            }
        };
        if !gain.is_finite() {
            return None;
        }
        Some(Self { gain, stretch: (cosine / cos_inside).min(MOST_STRETCH), cos_inside })
    }
}

/// The direction inside, outward, of a ray from or to the unit vector `outside` with the outward unit normal; none where
/// nothing passes.
#[inline]
pub fn refracted(eta_inside_over_outside: f64, outside: DVec3, normal: DVec3) -> Option<DVec3> {
    let cosine = outside.dot(normal);
    let cos_inside = refracted_cosine(eta_inside_over_outside, cosine)?;
    Some(inside_direction(eta_inside_over_outside, outside, normal, cosine, cos_inside))
}

/// The refracted direction, by the cosines outside and inside.
#[inline]
pub(super) fn inside_direction(eta: f64, outside: DVec3, normal: DVec3, cosine: f64, cos_inside: f64) -> DVec3 {
    (outside / eta + normal * (cos_inside - cosine / eta)).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ETAS: [f64; 8] = [0.4, 0.7, 0.999, 1.0, 1.0 + 1e-9, 1.3, 1.5, 3.0];

    #[test]
    fn the_physical_gain_is_transmittance_times_the_refraction_factor() {
        for eta in ETAS {
            for i in 1..=100 {
                let cosine = f64::from(i) / 100.0;
                let Some(refraction) = Refraction::new(Form::Physical, eta, cosine) else {
                    assert!(eta < 1.0 && Refraction::new(Form::Printed, eta, cosine).is_none());
                    continue;
                };
                let expected = transmittance(eta, cosine) * cosine / (eta * eta * refraction.cos_inside);
                assert!((refraction.gain / expected - 1.0).abs() < 1e-9, "{eta} {cosine}");
                assert!((refraction.stretch * refraction.cos_inside / cosine - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn every_cosine_gives_finite_numbers() {
        for eta in ETAS {
            for cosine in [f64::NAN, -1.0, 0.0, 1e-300, 1e-12, 0.5, 1.0, 2.0, f64::INFINITY] {
                for form in [Form::Physical, Form::Printed] {
                    if let Some(e) = Refraction::new(form, eta, cosine) {
                        assert!(e.gain.is_finite() && e.gain >= 0.0 && e.stretch.is_finite(), "{eta} {cosine} {e:?}");
                    }
                }
            }
            // The critical angle itself.
            let critical = ((1.0 - eta) * (1.0 + eta)).max(0.0).sqrt();
            for cosine in [critical, critical.next_up(), critical.next_down(), critical + 1e-15] {
                if let Some(e) = Refraction::new(Form::Physical, eta, cosine) {
                    assert!(e.gain.is_finite() && e.stretch.is_finite());
                }
            }
        }
    }

    #[test]
    fn refraction_is_snells_law() {
        let normal = DVec3::new(0.2, 0.9, -0.3).normalize();
        for eta in ETAS {
            for i in 0..50 {
                let angle = f64::from(i) * 0.07 - 1.7;
                let outside = (normal * angle.cos() + normal.any_orthonormal_vector() * angle.sin()).normalize();
                let Some(inside) = refracted(eta, outside, normal) else { continue };
                assert!((inside.length() - 1.0).abs() < 1e-12);
                let (sin_in, sin_out) = (inside.cross(normal).length(), outside.cross(normal).length());
                assert!((sin_out - eta * sin_in).abs() < 1e-9 && inside.dot(outside) > 0.0, "{eta} {angle}");
            }
        }
    }
}
