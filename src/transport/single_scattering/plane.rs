//! Single scattering of a half space and a slab in closed form (Hanrahan and Krueger 1993), to test the rest against.

use std::f64::consts::{FRAC_1_PI, TAU};

use super::interface::{Form, Refraction};
use crate::math::quadrature::integrate;
use crate::medium::fresnel::transmittance;

/// One channel of a medium behind a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneMedium {
    /// Scattering, 1/mm.
    pub sigma_s_per_mm: f64,
    /// Extinction, 1/mm.
    pub sigma_t_per_mm: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
    /// Depth below which there is nothing and no light comes from; infinite for a half space.
    pub thickness_mm: f64,
}

impl PlaneMedium {
    /// `Int_0^dm sigma_s exp(-s sigma_t) exp(-s_i' sigma_t) ds` along a path whose cosine inside is `cos_path`, for
    /// light at `cos_light` inside: the share of entering light that is scattered once into the path and reaches its
    /// end, without p.
    pub fn attenuated(&self, cos_path: f64, cos_light: f64) -> f64 {
        if !(self.sigma_t_per_mm > 0.0 && cos_path > 0.0 && cos_light > 0.0) {
            return 0.0;
        }
        let rate = self.sigma_t_per_mm * (1.0 + cos_path / cos_light);
        let length = self.thickness_mm / cos_path;
        self.sigma_s_per_mm / rate * -(-rate * length).exp_m1()
    }

    /// Radiance towards an eye at `cos_eye` for radiance 1 over one steradian at `cos_light`, both outside, and a phase
    /// function that has the value `phase_per_sr` between them inside.
    pub fn radiance(&self, form: Form, cos_eye: f64, cos_light: f64, phase_per_sr: f64) -> f64 {
        let eta = self.eta_inside_over_outside;
        let (Some(eye), Some(light)) = (Refraction::new(form, eta, cos_eye), Refraction::new(form, eta, cos_light))
        else {
            return 0.0;
        };
        transmittance(eta, cos_eye) * light.gain * phase_per_sr * self.attenuated(eye.cos_inside, light.cos_inside)
    }

    /// Radiosity over irradiance outside under constant light, isotropic phase function.
    pub fn albedo(&self, form: Form) -> f64 {
        let critical = {
            let eta = self.eta_inside_over_outside;
            ((1.0 - eta) * (1.0 + eta)).max(0.0).sqrt()
        };
        let inner = |cos_eye: f64| {
            let of = |cos_light: f64| TAU * self.radiance(form, cos_eye, cos_light, 0.25 * FRAC_1_PI);
            integrate(of, critical, 1.0, 1e-9)
        };
        // Irradiance of radiance 1 is pi.
        FRAC_1_PI * integrate(|mu| TAU * mu * inner(mu), critical, 1.0, 1e-8)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::math::quadrature::{gauss_legendre, integrate_with};

    fn half_space(eta: f64) -> PlaneMedium {
        let [sigma_s_per_mm, sigma_t_per_mm] = [1.7; 2];
        PlaneMedium { sigma_s_per_mm, sigma_t_per_mm, eta_inside_over_outside: eta, thickness_mm: f64::INFINITY }
    }

    #[test]
    fn albedos_of_the_half_space_are_the_known_ones() {
        for (eta, physical, printed) in [(1.3, 0.078, 0.190), (1.5, 0.052, 0.178)] {
            let found = [Form::Physical, Form::Printed].map(|form| half_space(eta).albedo(form));
            println!("eta {eta}: {found:.5?}");
            assert!((found[0] - physical).abs() < 6e-4 && (found[1] - printed).abs() < 6e-4, "{eta} {found:?}");
        }
        // Matched indices: Int Int mu mu' / (mu + mu') over the unit square.
        let closed = 2.0 / 3.0 * (1.0 - std::f64::consts::LN_2);
        assert!((half_space(1.0).albedo(Form::Physical) - closed).abs() < 1e-6);
    }

    #[test]
    fn the_physical_form_is_reciprocal_and_the_printed_one_is_not() {
        for eta in [0.7, 1.3, 1.5] {
            let medium = half_space(eta);
            let mut worst = [0.0f64; 2];
            for i in 1..20 {
                for j in 1..20 {
                    let (a, b) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                    for (form, worst) in [Form::Physical, Form::Printed].into_iter().zip(&mut worst) {
                        // The BRDF is the radiance over the cosine of the light.
                        let there = medium.radiance(form, a, b, 0.08) / b;
                        let back = medium.radiance(form, b, a, 0.08) / a;
                        if there.max(back) > 0.0 {
                            *worst = worst.max((there - back).abs() / there.max(back));
                        }
                    }
                }
            }
            assert!(worst[0] < 1e-12 && worst[1] > 0.1, "{eta} {worst:?}");
        }
    }

    /// Albedo of first order with a phase function of the cosine, sigma_a = 0.
    fn albedo_of(eta: f64, phase: impl Fn(f64) -> f64) -> f64 {
        let rule = gauss_legendre(48);
        let medium = half_space(eta);
        let inner = |eye: f64| {
            integrate_with(&rule, 0.0, 1.0, |light| {
                let inside = |mu: f64| Refraction::new(Form::Physical, eta, mu).map_or(0.0, |e| e.cos_inside);
                let (a, b) = (inside(eye), inside(light));
                let sines = ((1.0 - a * a) * (1.0 - b * b)).max(0.0).sqrt();
                let mean = integrate_with(&rule, 0.0, PI, |azimuth| phase(-a * b - sines * azimuth.cos())) / PI;
                TAU * medium.radiance(Form::Physical, eye, light, mean)
            })
        };
        2.0 * integrate_with(&rule, 0.0, 1.0, |mu| mu * inner(mu))
    }

    #[test]
    fn the_first_order_falls_as_scattering_goes_forward() {
        use crate::medium::phase::HenyeyGreenstein;
        let exact = |g: f64| albedo_of(1.3, |c| HenyeyGreenstein::new(g).density(c));
        assert!((exact(0.0) - half_space(1.3).albedo(Form::Physical)).abs() < 1e-5);
        for (g, first) in [(0.7, 0.01077), (0.9, 0.00291)] {
            assert!((exact(g) - first).abs() < 5e-5, "{g}");
        }
    }

    #[test]
    fn nothing_comes_from_nothing() {
        for medium in [
            PlaneMedium { sigma_s_per_mm: 0.0, sigma_t_per_mm: 0.0, ..half_space(1.3) },
            PlaneMedium { thickness_mm: 0.0, ..half_space(1.3) },
        ] {
            assert_eq!(medium.albedo(Form::Physical), 0.0);
        }
    }
}
