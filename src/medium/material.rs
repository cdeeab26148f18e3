//! Optical properties with their units, the measured materials, and the ways to name or write down a material.

use glam::DVec3;
use serde::Serialize;

use super::dipole::Dipole;
use super::fresnel::{BoundaryFit, PUBLISHED_FIT_RANGE, boundary_a};
use super::profile::Profile;
use crate::error::{Error, Result};

/// Accepted refractive indices (inside over outside), the range of the published fits of the boundary.
pub const ETA_RANGE: std::ops::RangeInclusive<f64> = PUBLISHED_FIT_RANGE;

/// Largest accepted coefficient, in 1/mm: a mean free path of a nanometre, far below any wavelength of light.
pub const LARGEST_SIGMA_PER_MM: f64 = 1e6;

/// Refractive index where none is given, that of most measured materials.
pub const DEFAULT_ETA: f64 = 1.3;

/// Optical properties of a homogeneous medium. Channels are linear sRGB; coefficients in 1/mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct OpticalProperties {
    /// Reduced scattering coefficient sigma_s' = sigma_s (1 - g).
    #[cfg_attr(test, schemars(with = "[f64; 3]"))]
    pub sigma_s_reduced_per_mm: DVec3,
    /// Absorption coefficient.
    #[cfg_attr(test, schemars(with = "[f64; 3]"))]
    pub sigma_a_per_mm: DVec3,
    /// Mean cosine of the scattering angle, in (-1, 1); positive is forward.
    pub g: f64,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
}

/// A named medium.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// Name of the material that it came from.
    pub name: String,
    /// Its optical properties.
    pub properties: OpticalProperties,
}

impl OpticalProperties {
    /// The properties if they are physical and within the accepted ranges.
    ///
    /// # Errors
    /// Invalid input when a coefficient is negative, not finite or above [`LARGEST_SIGMA_PER_MM`], when |g| is not
    /// below 1, or when eta is outside [`ETA_RANGE`]. Zero scattering and zero extinction are valid: such a channel
    /// returns nothing.
    pub fn validated(self) -> Result<Self> {
        // First, because a g beyond its range spoils the reduced scattering that was derived with it.
        if self.g.is_nan() || self.g.abs() >= 1.0 {
            return Err(Error::input(format!("g is {}; it must be above -1 and below 1", self.g)));
        }
        let sigmas = [("sigma_s'", self.sigma_s_reduced_per_mm), ("sigma_a", self.sigma_a_per_mm)];
        for (name, sigma) in sigmas {
            for (channel, value) in ["red", "green", "blue"].into_iter().zip(sigma.to_array()) {
                if !(0.0..=LARGEST_SIGMA_PER_MM).contains(&value) {
                    return Err(Error::input(format!(
                        "{name} of the {channel} channel is {value} per mm; it must be between 0 and {LARGEST_SIGMA_PER_MM:e}"
                    )));
                }
            }
        }
        if !ETA_RANGE.contains(&self.eta_inside_over_outside) {
            return Err(Error::input(format!(
                "eta is {}; it is the refractive index inside over outside and must be between {} and {}",
                self.eta_inside_over_outside,
                ETA_RANGE.start(),
                ETA_RANGE.end()
            )));
        }
        Ok(self)
    }

    /// Reduced extinction sigma_t' = sigma_s' + sigma_a in 1/mm.
    pub fn sigma_t_reduced_per_mm(&self) -> DVec3 {
        self.sigma_s_reduced_per_mm + self.sigma_a_per_mm
    }

    /// Unreduced scattering coefficient sigma_s = sigma_s' / (1 - g) in 1/mm.
    pub fn sigma_s_per_mm(&self) -> DVec3 {
        self.sigma_s_reduced_per_mm / (1.0 - self.g)
    }

    /// Unreduced extinction sigma_t = sigma_s + sigma_a in 1/mm.
    pub fn sigma_t_per_mm(&self) -> DVec3 {
        self.sigma_s_per_mm() + self.sigma_a_per_mm
    }

    /// Effective transport coefficient sigma_tr = sqrt(3 sigma_a sigma_t') in 1/mm.
    pub fn sigma_tr_per_mm(&self) -> DVec3 {
        (3.0 * self.sigma_a_per_mm * self.sigma_t_reduced_per_mm()).map(f64::sqrt)
    }

    /// Mean free path 1 / sigma_t' in mm, infinite without extinction.
    pub fn mean_free_path_mm(&self) -> DVec3 {
        self.sigma_t_reduced_per_mm().map(f64::recip)
    }

    /// Diffusion length 1 / sigma_tr in mm, infinite without absorption.
    pub fn diffusion_length_mm(&self) -> DVec3 {
        self.sigma_tr_per_mm().map(f64::recip)
    }

    /// `A = (1 + F_dr) / (1 - F_dr)` of the boundary.
    pub fn boundary_a(&self, fit: BoundaryFit) -> f64 {
        boundary_a(self.eta_inside_over_outside, fit)
    }

    /// The dipole of each channel.
    pub fn dipoles(&self, fit: BoundaryFit) -> [Dipole; 3] {
        let a = self.boundary_a(fit);
        let (s, t) = (self.sigma_s_reduced_per_mm, self.sigma_a_per_mm);
        [(s.x, t.x), (s.y, t.y), (s.z, t.z)].map(|(s, t)| Dipole::new(s, t, a))
    }

    /// Diffuse reflectance of a half space by the dipole, each channel.
    pub fn total_reflectance(&self, fit: BoundaryFit) -> [f64; 3] {
        self.dipoles(fit).map(|dipole| dipole.total())
    }
}

/// A medium with a name for reports.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Material {
    /// Name of the preset, the file, or `custom`.
    pub name: String,
    /// Validated optical properties.
    pub properties: OpticalProperties,
}

/// A material that the program knows by name: sigma_s' and sigma_a in 1/mm, eta.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Reduced scattering coefficient in 1/mm.
    pub sigma_s_reduced_per_mm: [f64; 3],
    /// Absorption coefficient in 1/mm.
    pub sigma_a_per_mm: [f64; 3],
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: f64,
    /// Where the numbers are from.
    pub origin: PresetOrigin,
}

/// Where the numbers of a preset are from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PresetOrigin {
    /// Measured (Jensen et al. 2001).
    Measured {
        /// Diffuse reflectance that was published with the measurement, two digits.
        published_reflectance: [f64; 3],
    },
    /// Chosen by eye, for a colour and mean free paths; no measurement of such a thing.
    ByEye {
        /// The colour under constant light by the dipole, as [`crate::math::srgb::linear_from_hex`] reads it.
        colour: &'static str,
    },
}

impl Preset {
    const fn new(
        name: &'static str,
        scattering: [f64; 3],
        absorption: [f64; 3],
        eta: f64,
        published_reflectance: [f64; 3],
    ) -> Self {
        Self {
            name,
            sigma_s_reduced_per_mm: scattering,
            sigma_a_per_mm: absorption,
            eta_inside_over_outside: eta,
            origin: PresetOrigin::Measured { published_reflectance },
        }
    }

    const fn by_eye(
        name: &'static str,
        scattering: [f64; 3],
        absorption: [f64; 3],
        eta: f64,
        colour: &'static str,
    ) -> Self {
        Self { origin: PresetOrigin::ByEye { colour }, ..Self::new(name, scattering, absorption, eta, [0.0; 3]) }
    }

    /// Optical properties of the preset; the measurement gives sigma_s', so g is 0.
    pub fn properties(&self) -> OpticalProperties {
        OpticalProperties {
            sigma_s_reduced_per_mm: DVec3::from_array(self.sigma_s_reduced_per_mm),
            sigma_a_per_mm: DVec3::from_array(self.sigma_a_per_mm),
            g: 0.0,
            eta_inside_over_outside: self.eta_inside_over_outside,
        }
    }

    /// The material of the same name.
    pub fn material(&self) -> Material {
        Material { name: self.name.to_owned(), properties: self.properties() }
    }
}

/// The measured materials in alphabetical order.
#[rustfmt::skip]
pub const PRESETS: [Preset; 12] = [
    Preset::new("apple", [2.29, 2.39, 1.97], [0.0030, 0.0034, 0.046], 1.3, [0.85, 0.84, 0.53]),
    Preset::new("chicken1", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19], 1.3, [0.31, 0.15, 0.10]),
    Preset::new("chicken2", [0.19, 0.25, 0.32], [0.018, 0.088, 0.20], 1.3, [0.32, 0.16, 0.10]),
    Preset::new("cream", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163], 1.3, [0.98, 0.90, 0.73]),
    Preset::new("ketchup", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45], 1.3, [0.16, 0.01, 0.00]),
    Preset::new("marble", [2.19, 2.62, 3.00], [0.0021, 0.0041, 0.0071], 1.5, [0.83, 0.79, 0.75]),
    Preset::new("potato", [0.68, 0.70, 0.55], [0.0024, 0.0090, 0.12], 1.3, [0.77, 0.62, 0.21]),
    Preset::new("skimmilk", [0.70, 1.22, 1.90], [0.0014, 0.0025, 0.0142], 1.3, [0.81, 0.81, 0.69]),
    Preset::new("skin1", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48], 1.3, [0.44, 0.22, 0.13]),
    Preset::new("skin2", [1.09, 1.59, 1.79], [0.013, 0.070, 0.145], 1.3, [0.63, 0.44, 0.34]),
    Preset::new("spectralon", [11.6, 20.4, 14.9], [0.0, 0.0, 0.0], 1.3, [1.00, 1.00, 1.00]),
    Preset::new("wholemilk", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014], 1.3, [0.91, 0.88, 0.76]),
];

/// Materials that were chosen by eye, in alphabetical order: coefficients of three digits for the colour beside them.
#[rustfmt::skip]
pub const BY_EYE: [Preset; 6] = [
    Preset::by_eye("candle", [0.417, 0.587, 0.968], [6.28e-05, 0.00168, 0.0319], 1.44, "#eed8aa"),
    Preset::by_eye("jade", [1.43, 0.884, 1.12], [0.387, 0.0252, 0.217], 1.61, "#6fa578"),
    Preset::by_eye("leaf", [7.6, 5.64, 4.6], [2.4, 0.612, 9.69], 1.42, "#6d8c35"),
    Preset::by_eye("milk-glass", [2.0, 2.17, 2.38], [0.000288, 0.000174, 0.000261], 1.52, "#eceeed"),
    Preset::by_eye("soap", [1.0, 1.18, 1.53], [6.59e-05, 0.000961, 0.00765], 1.46, "#f0e4cf"),
    Preset::by_eye("wax", [0.667, 0.832, 1.17], [0.000164, 0.00129, 0.00842], 1.44, "#ecdfca"),
];

/// All materials that the program knows by name, the measured ones first.
pub fn presets() -> impl Iterator<Item = &'static Preset> {
    PRESETS.iter().chain(&BY_EYE)
}

/// The dipoles of every channel of the measured materials, with the published boundary.
pub(crate) fn preset_dipoles() -> impl Iterator<Item = Dipole> {
    PRESETS.iter().flat_map(|preset| preset.properties().dipoles(BoundaryFit::Published))
}

/// The preset of that name; letter case does not matter.
pub fn preset(name: &str) -> Option<&'static Preset> {
    presets().find(|preset| preset.name.eq_ignore_ascii_case(name))
}

/// Properties that replace parts of a material, or make one from nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overrides {
    /// Reduced scattering coefficient in 1/mm; excludes `sigma_s_per_mm`.
    pub sigma_s_reduced_per_mm: Option<DVec3>,
    /// Unreduced scattering coefficient in 1/mm, to be reduced with the resulting g.
    pub sigma_s_per_mm: Option<DVec3>,
    /// Absorption coefficient in 1/mm.
    pub sigma_a_per_mm: Option<DVec3>,
    /// Mean cosine; on its own it keeps sigma_s'.
    pub g: Option<f64>,
    /// Refractive index inside over outside.
    pub eta_inside_over_outside: Option<f64>,
}

impl Overrides {
    /// Returns whether nothing is overridden.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// `base` with these overrides; without a base, scattering and absorption must be among them, g defaults to 0 and
    /// eta to [`DEFAULT_ETA`].
    ///
    /// # Errors
    /// Invalid input when both scattering coefficients are given, when one is missing, or when the result is not valid.
    pub fn apply(&self, base: Option<&OpticalProperties>) -> Result<OpticalProperties> {
        let g = self.g.or(base.map(|b| b.g)).unwrap_or(0.0);
        let sigma_s_reduced_per_mm = match (self.sigma_s_reduced_per_mm, self.sigma_s_per_mm) {
            (Some(_), Some(_)) => {
                return Err(Error::input(
                    "both sigma_s' (reduced) and sigma_s (unreduced) are given; give one of them",
                ));
            }
            (Some(reduced), None) => reduced,
            (None, Some(unreduced)) => unreduced * (1.0 - g),
            (None, None) => base.map(|b| b.sigma_s_reduced_per_mm).ok_or_else(|| missing("scattering", "sigma_s"))?,
        };
        let sigma_a_per_mm =
            self.sigma_a_per_mm.or(base.map(|b| b.sigma_a_per_mm)).ok_or_else(|| missing("absorption", "sigma_a"))?;
        let eta_inside_over_outside =
            self.eta_inside_over_outside.or(base.map(|b| b.eta_inside_over_outside)).unwrap_or(DEFAULT_ETA);
        OpticalProperties { sigma_s_reduced_per_mm, sigma_a_per_mm, g, eta_inside_over_outside }.validated()
    }
}

fn missing(what: &str, symbol: &str) -> Error {
    Error::input(format!("the {what} coefficient {symbol} is missing; give it in 1/mm, or start from a preset"))
}

/// Message for a name without a preset: lists the similar names, or all.
pub(super) fn unknown_preset(name: &str) -> String {
    let wanted = name.to_ascii_lowercase();
    let mut near: Vec<(usize, &str)> = presets()
        .map(|preset| (edit_distance(&wanted, preset.name), preset.name))
        .filter(|(distance, known)| {
            *distance <= 2.max(known.len() / 3)
                || (wanted.len() >= 3 && (known.contains(&wanted) || wanted.contains(known)))
        })
        .collect();
    near.sort_unstable();
    let names: Vec<&str> = near.iter().take(3).map(|(_, known)| *known).collect();
    if names.is_empty() {
        let all: Vec<&str> = presets().map(|preset| preset.name).collect();
        format!("no material is called '{name}'; there are {}, or give a path that ends in .toml", all.join(", "))
    } else {
        format!("no material is called '{name}'; did you mean {}?", names.join(" or "))
    }
}

/// Levenshtein distance in characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests;
