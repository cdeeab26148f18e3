//! The inside of a material as a model's file describes it, with lengths in the unit of the file: it becomes a medium
//! once the size of the model is known.

use glam::DVec3;

use super::fresnel::diffuse_transmittance;
use super::inversion::{RADII_MM, Radius, Reflector};
use super::look::Look;
use super::material::{Material, OpticalProperties, Overrides};
use super::material_file::Chosen;
use crate::error::Result;

/// What is left of light at least over an attenuation distance: a colour of 0 there has no finite coefficient.
pub const LEAST_TRANSMITTANCE: f64 = 1e-3;

/// Largest albedo of a medium of which the albedo and the diffusion length are given: one that absorbs nothing has no
/// such length.
pub const LARGEST_ALBEDO: f64 = 0.99;

/// What a file says of a material's inside.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Inside {
    /// Nothing: light is reflected at the surface.
    #[default]
    Surface,
    /// Light goes through and is not scattered, as in glass.
    Clear,
    /// Light goes in and is scattered, and how far it goes is not said.
    WithoutLength {
        /// The extension that says so.
        source: &'static str,
        /// Colour of what comes back, linear sRGB.
        colour: DVec3,
    },
    /// A medium.
    Volume(Volume),
    /// Something impossible; what is wrong, in words.
    Invalid(String),
}

/// A homogeneous medium; channels are linear sRGB.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// The extension that says that it scatters.
    pub source: &'static str,
    /// Attenuation coefficient of each channel, in 1 / unit of the file.
    pub attenuation_per_unit: DVec3,
    /// What is known of its scattering.
    pub scattering: Scattering,
    /// Mean cosine of the phase function.
    pub g: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
    /// What the file says otherwise than the medium has it, one line each.
    pub warnings: Vec<String>,
}

/// What a file says of the scattering of a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scattering {
    /// The attenuation is the extinction, and a share of it scatters.
    Albedo {
        /// Multi-scatter albedo, as written.
        multiple: DVec3,
        /// Single-scattering albedo sigma_s / sigma_t.
        single: DVec3,
    },
    /// The albedo that is seen of it under constant light, highlight and boundary left out; the attenuation is that of light
    /// which is scattered all the way, sigma_tr.
    Colour(DVec3),
}

/// sigma_t of what is left of light, each channel, after a distance: `-ln(colour) / distance`, with colours of at least
/// [`LEAST_TRANSMITTANCE`]. An infinite distance gives 0.
pub fn attenuation(colour: DVec3, distance: f64) -> DVec3 {
    // Not -ln, which is -0 for a colour of 1.
    colour.max(DVec3::splat(LEAST_TRANSMITTANCE)).map(|c| c.recip().ln()) / distance
}

/// Single-scattering albedo of a multi-scatter albedo (Kulla and Conty 2017): `(1 - s^2) / (1 - g s^2)`,
/// `s = 4.09712 + 4.20863 c - sqrt(9.59217 + 41.6808 c + 17.7126 c^2)`. A `g` of 0 gives the form without anisotropy.
pub fn single_scattering_albedo(multiple: f64, g: f64) -> f64 {
    let s = 4.09712 + 4.20863 * multiple - (9.59217 + 41.6808 * multiple + 17.7126 * multiple * multiple).sqrt();
    // The fit leaves [0, 1] by 1e-5 at its ends.
    ((1.0 - s * s) / (1.0 - g * s * s)).clamp(0.0, 1.0)
}

impl Volume {
    /// The medium where a unit of the file is this long; colours are inverted through `reflector`.
    ///
    /// # Errors
    /// Coefficients out of range; otherwise those of [`Look::found`].
    pub fn chosen(&self, name: &str, mm_per_unit: f64, reflector: &Reflector) -> Result<Chosen> {
        let Self { g, eta_inside_over_outside, .. } = *self;
        let name = name.to_owned();
        match self.scattering {
            Scattering::Albedo { single, .. } => {
                let sigma_t = self.attenuation_per_unit / mm_per_unit;
                let properties = OpticalProperties {
                    sigma_s_reduced_per_mm: sigma_t * single * (1.0 - g),
                    sigma_a_per_mm: sigma_t * (DVec3::ONE - single),
                    g,
                    eta_inside_over_outside,
                };
                Ok(Material { name, properties: properties.validated()? }.into())
            }
            Scattering::Colour(albedo) => {
                let [shortest, longest] = [RADII_MM.start(), RADII_MM.end()].map(|mm| DVec3::splat(*mm));
                let length = self.attenuation_per_unit.map(|sigma| mm_per_unit / sigma);
                let entering = diffuse_transmittance(eta_inside_over_outside);
                let look = Look {
                    colour: Some(entering * albedo.min(DVec3::splat(LARGEST_ALBEDO))),
                    radius_mm: Some(length.clamp(shortest, longest)),
                    radius: Some(Radius::DiffusionLength),
                };
                let given = Overrides {
                    g: Some(g),
                    eta_inside_over_outside: Some(eta_inside_over_outside),
                    ..Overrides::default()
                };
                let found = look.found(None, &given, reflector)?;
                Ok(Chosen { material: Material { name, properties: found.inversion.properties }, look: Some(found) })
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn volume(scattering: Scattering) -> Volume {
        Volume {
            source: "KHR_materials_volume_scatter",
            attenuation_per_unit: attenuation(DVec3::new(0.5, 0.25, 0.125), 0.01),
            scattering,
            g: 0.5,
            eta_inside_over_outside: 1.4,
            warnings: Vec::new(),
        }
    }

    #[test]
    fn attenuation_is_the_logarithm_over_the_distance() {
        let sigma = attenuation(DVec3::new(1.0, (-2.0f64).exp(), 0.0), 0.5);
        assert!(sigma.x == 0.0 && sigma.x.is_sign_positive());
        assert!((sigma.y - 4.0).abs() < 1e-12 && (sigma.z - 2.0 * 1e3f64.ln()).abs() < 1e-12);
        assert_eq!(attenuation(DVec3::splat(0.5), f64::INFINITY), DVec3::ZERO);
    }

    #[test]
    fn albedos_follow_the_fit_and_keep_the_colour_whatever_g_is() {
        assert!(single_scattering_albedo(0.0, 0.0) < 1e-4 && single_scattering_albedo(1.0, 0.0) > 1.0 - 1e-8);
        // s = 4.09712 + 2.104315 - sqrt(9.59217 + 20.8404 + 4.42815) = 0.297140.
        assert!((single_scattering_albedo(0.5, 0.0) - 0.911_709).abs() < 1e-6);
        let (mut last, g) = (0.0, 0.8);
        for i in 1..=100 {
            let multiple = f64::from(i) / 100.0;
            let single = single_scattering_albedo(multiple, 0.0);
            assert!(single > last, "{multiple}");
            last = single;
            // The reduced albedo alpha (1 - g) / (1 - alpha g) is that of isotropic scattering.
            let of_g = single_scattering_albedo(multiple, g);
            assert!((of_g * (1.0 - g) / (1.0 - of_g * g) - single).abs() < 1e-12, "{multiple}");
        }
        // Light that scatters isotropically in an index-matched half space comes back by about the multi-scatter albedo.
        for multiple in [0.2, 0.5, 0.8] {
            let single = single_scattering_albedo(multiple, 0.0);
            let properties = OpticalProperties {
                sigma_s_reduced_per_mm: DVec3::splat(single),
                sigma_a_per_mm: DVec3::splat(1.0 - single),
                g: 0.0,
                eta_inside_over_outside: 1.0,
            };
            let back = Reflector::Volume.totals(&properties).unwrap();
            assert!((back - multiple).abs().max_element() < 0.03, "{multiple}: {back}");
        }
    }

    #[test]
    fn coefficients_are_those_of_the_file_in_mm() {
        let single = DVec3::new(0.9, 0.5, 0.0);
        let albedo = volume(Scattering::Albedo { multiple: DVec3::ZERO, single });
        for mm_per_unit in [1000.0, 20.0] {
            let chosen = albedo.chosen("wax", mm_per_unit, &Reflector::default()).unwrap();
            let found = chosen.material.properties;
            // ln 2 over 10 mm, twice and thrice that.
            let sigma_t = DVec3::new(1.0, 2.0, 3.0) * 2f64.ln() / (0.01 * mm_per_unit);
            assert!((found.sigma_t_per_mm() - sigma_t).abs().max_element() < 1e-12);
            assert!((found.sigma_s_per_mm() - sigma_t * single).abs().max_element() < 1e-12);
            assert_eq!((chosen.material.name.as_str(), chosen.look), ("wax", None));
            assert_eq!((found.g, found.eta_inside_over_outside), (0.5, 1.4));
        }
        assert!(albedo.chosen("wax", 1e-9, &Reflector::default()).unwrap_err().message().contains("sigma"));
    }

    #[test]
    fn colours_are_seen_and_lengths_are_diffusion_lengths() {
        let colour = DVec3::new(0.3, 0.8, 1.0);
        let chosen = volume(Scattering::Colour(colour)).chosen("cup", 1000.0, &Reflector::default()).unwrap();
        let (found, look) = (chosen.material.properties, chosen.look.unwrap());
        let totals = Reflector::default().totals(&found).unwrap();
        assert!((totals - colour.min(DVec3::splat(LARGEST_ALBEDO))).abs().max_element() < 1e-6, "{totals}");
        let sigma_tr = DVec3::new(1.0, 2.0, 3.0) * 2f64.ln() / 10.0;
        assert!((found.sigma_tr_per_mm() - sigma_tr).abs().max_element() < 1e-9);
        assert!(look.inversion.is_reached() && look.target.radius == Radius::DiffusionLength);
    }
}
