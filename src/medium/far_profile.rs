//! The smooth far part of R_d, which a basis has to represent when the surroundings of a receiver are integrated with
//! the profile itself.
//!
//! With `s = r^2` the far part is `f = R_d` from the split radius rho on, and inside it the Taylor polynomial of R_d in
//! s of degree 2 around `s = rho^2`, so that f is even in r and twice continuously differentiable.
//!
//! `exp(-x) / d` with `x = sigma d`, `d^2 = s + z^2` is completely monotone in s: its derivatives alternate in sign,
//! and so do those of R_d, which is a positive sum of `-2 d/ds` of it. Towards smaller s every term of the Taylor
//! series, the remainder included, is therefore positive: `0 < f <= R_d` and f decreases with r, for every dipole and
//! every rho. The near part R_d - f is never negative, and f never returns more than the profile does.

use std::f64::consts::{PI, TAU};

use super::dipole::{Dipole, Pole, decay};
use super::softened::Softened;

/// Split radii beyond this (mm) count as this: the seventh power of the distance stays a finite number.
const LARGEST_SPLIT_MM: f64 = 1e30;

/// Squared distances beyond this (mm^2) count as this; nothing is left of any profile there.
const LARGEST_SQUARE_MM2: f64 = 1e120;

/// The far part of the profile of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FarProfile {
    poles: [Pole; 2],
    split_mm: f64,
    softened: Softened,
}

impl FarProfile {
    /// Splits the profile at `split_mm`, rho. A radius that is not positive leaves the whole profile to the far part.
    pub fn new(dipole: &Dipole, split_mm: f64) -> Self {
        let split_mm = if split_mm > 0.0 { split_mm.min(LARGEST_SPLIT_MM) } else { 0.0 };
        Self { poles: dipole.poles(), split_mm, softened: Softened::new(dipole, split_mm) }
    }

    /// The radius rho in mm inside which the profile is replaced by its continuation.
    pub fn split_mm(&self) -> f64 {
        self.split_mm
    }

    /// c of the continuation `c[0] + c[1] u + c[2] u^2`, `u = r^2 - rho^2` in mm^2; 1/mm^2, 1/mm^4, 1/mm^6.
    pub fn polynomial(&self) -> [f64; 3] {
        self.softened.polynomial()
    }

    /// f at distance `r_mm`, in 1/mm^2.
    pub fn reflectance(&self, r_mm: f64) -> f64 {
        self.reflectance_at_square(r_mm * r_mm)
    }

    /// f at the squared distance `r2_mm2`, in 1/mm^2.
    pub fn reflectance_at_square(&self, r2_mm2: f64) -> f64 {
        self.softened.inside(r2_mm2).unwrap_or_else(|| {
            // f64::min turns NaN into the bound.
            let s = r2_mm2.min(LARGEST_SQUARE_MM2);
            self.poles[0].reflectance_at_square(s) + self.poles[1].reflectance_at_square(s)
        })
    }

    /// `Int 2 pi r f dr` over the plane: the far part's share of the total diffuse reflectance.
    pub fn total(&self) -> f64 {
        let rho2 = self.split_mm * self.split_mm;
        let [value, first, second] = self.polynomial();
        let inside = PI * rho2 * (value - rho2 * (first / 2.0 - rho2 * (second / 3.0)));
        inside + self.beyond(rho2)
    }

    /// `Int 2 pi r f dr` over `[0, reach_mm]`; a reach inside the split radius counts as the split radius.
    pub fn total_within(&self, reach_mm: f64) -> f64 {
        let reach_mm = if reach_mm > self.split_mm { reach_mm.min(LARGEST_SPLIT_MM) } else { self.split_mm };
        (self.total() - self.beyond(reach_mm * reach_mm)).max(0.0)
    }

    /// `Int 2 pi r R_d dr` from a squared radius on.
    fn beyond(&self, square_mm2: f64) -> f64 {
        let of_pole = |pole: &Pole| {
            let d = (square_mm2 + pole.z_mm * pole.z_mm).sqrt();
            TAU * pole.weight * decay(pole.sigma_per_mm * d) / d
        };
        of_pole(&self.poles[0]) + of_pole(&self.poles[1])
    }

    /// `Int 2 pi r R_d dr` over the plane: the total diffuse reflectance of the whole profile.
    pub fn profile_total(&self) -> f64 {
        let half = |pole: &Pole| TAU * pole.weight / pole.z_mm * decay(pole.sigma_per_mm * pole.z_mm);
        half(&self.poles[0]) + half(&self.poles[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::quadrature::integrate;
    use crate::medium::fresnel::{BoundaryFit, boundary_a};
    use crate::medium::material::preset_dipoles;
    use crate::medium::profile::Profile;

    const SPLITS_MM: [f64; 6] = [0.01, 0.1, 0.5, 2.0, 30.0, 1000.0];

    /// Presets, no scattering, no absorption, and both ends of the scale.
    fn dipoles() -> Vec<Dipole> {
        let mut all: Vec<Dipole> = preset_dipoles().collect();
        let a = boundary_a(1.3, BoundaryFit::Published);
        let extremes =
            [(0.0, 1.0), (0.0, 0.0), (1e6, 0.0), (1e6, 1e6), (1e-6, 0.0), (1e-9, 1e-9), (1e-6, 1e6), (1e300, 1e300)];
        all.extend(extremes.map(|(scattering, absorption)| Dipole::new(scattering, absorption, a)));
        all
    }

    #[test]
    fn the_far_part_is_the_profile_outside_and_twice_differentiable_at_the_split() {
        let mut compared = 0;
        for dipole in dipoles() {
            for split in SPLITS_MM {
                let far = FarProfile::new(&dipole, split);
                for factor in [1.0, 1.01, 2.0, 50.0] {
                    let r = factor * split;
                    let exact = dipole.reflectance(r);
                    assert!((far.reflectance(r) - exact).abs() <= 1e-11 * exact + 1e-300, "{dipole:?} {split} {r}");
                }
                // The remainder is of the order u^3: halving u divides the distance from the profile by 8.
                let s = split * split;
                let scale = far.poles.map(|pole| {
                    let d2 = s + pole.z_mm * pole.z_mm;
                    d2 / (1.0 + pole.sigma_per_mm * d2.sqrt())
                });
                let u = 0.02 * scale[0].min(scale[1]).min(s);
                let away = |u: f64| dipole.reflectance((s - u).sqrt()) - far.reflectance((s - u).sqrt());
                let value = far.polynomial()[0];
                assert!(away(u).abs() <= 1e-4 * value, "{dipole:?} {split}");
                if value > 1e-200 && u > 0.01 * scale[0] {
                    assert!((away(0.5 * u) / away(u) - 0.125).abs() < 0.02, "{dipole:?} {split}");
                    compared += 1;
                }
            }
        }
        assert!(compared > 60, "{compared}");
    }

    #[test]
    fn the_far_part_is_positive_decreasing_and_below_the_profile() {
        for dipole in dipoles() {
            for split in SPLITS_MM {
                let far = FarProfile::new(&dipole, split);
                let mut previous = f64::INFINITY;
                for i in 0..=300 {
                    let r = split * f64::from(i) / 100.0;
                    let (value, whole) = (far.reflectance(r), dipole.reflectance(r));
                    assert!(value >= 0.0 && value <= previous * (1.0 + 1e-14), "{dipole:?} {split} {r}");
                    assert!(value <= whole * (1.0 + 1e-11) + 1e-300, "{dipole:?} {split} {r} {value:e} {whole:e}");
                    previous = value;
                }
            }
        }
    }

    #[test]
    fn totals_are_the_integrals() {
        for dipole in dipoles() {
            for split in SPLITS_MM {
                let far = FarProfile::new(&dipole, split);
                let whole = dipole.total();
                assert!((far.profile_total() - whole).abs() <= 1e-13 * whole, "{dipole:?}");
                assert!(far.total() >= 0.0 && far.total() <= whole * (1.0 + 1e-12), "{dipole:?} {split}");
                let inside = integrate(|r| TAU * r * far.reflectance(r), 0.0, split, 1e-12 * whole);
                let sum = inside + TAU * dipole.tail(split);
                assert!((far.total() - sum).abs() <= 1e-10 * whole, "{dipole:?} {split} {} {sum}", far.total());
                assert!((far.total_within(split) - inside).abs() <= 1e-10 * whole, "{dipole:?} {split}");
                let ring = integrate(|r| TAU * r * far.reflectance(r), split, 3.0 * split, 1e-12 * whole);
                assert!((far.total_within(3.0 * split) - inside - ring).abs() <= 1e-10 * whole, "{dipole:?} {split}");
                assert!(far.total_within(f64::NAN) <= far.total() && far.total_within(f64::INFINITY) <= far.total());
            }
        }
    }

    #[test]
    fn any_radius_gives_a_finite_number() {
        for dipole in dipoles() {
            for split in [f64::NAN, -1.0, 0.0, f64::MIN_POSITIVE, 1e-20, 1e20, f64::MAX, f64::INFINITY] {
                let far = FarProfile::new(&dipole, split);
                assert!(far.polynomial().iter().all(|c| c.is_finite()), "{dipole:?} {split}");
                assert!(far.total().is_finite() && far.profile_total().is_finite());
                for r in [0.0, 1e-300, 1.0, 1e30, f64::MAX, f64::INFINITY, f64::NAN] {
                    let value = far.reflectance(r);
                    assert!(value.is_finite() && value >= 0.0, "{dipole:?} {split} {r} {value}");
                }
            }
        }
    }
}
