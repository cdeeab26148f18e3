//! A medium by its look: a colour and a length in place of coefficients.

use glam::DVec3;

use super::inversion::{Inversion, RADII_MM, Radius, Reflector, Target, invert};
use super::material::{DEFAULT_ETA, OpticalProperties, Overrides};
use crate::error::{Error, Result};
use crate::math::srgb::linear_from_hex;

/// What is asked of a medium's look; what is missing is that of the material that it starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// The colour under constant light, linear sRGB in [0, 1] (see [`Target::colour`]).
    pub colour: Option<DVec3>,
    /// The length of each channel, mm.
    pub radius_mm: Option<DVec3>,
    /// Meaning of the length; the mean free path where none is given.
    pub radius: Option<Radius>,
}

/// A look, and the medium that has it or comes nearest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The whole of what was asked for.
    pub target: Target,
    /// The medium, and its colour.
    pub inversion: Inversion,
}

impl Look {
    /// Returns whether nothing is asked for.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The medium of this look by `reflector`. A `base` gives the colour, the length, g and eta that are not asked for; of
    /// the overrides g and eta count.
    ///
    /// # Errors
    /// Invalid input for coefficients beside a look, a colour without a length and the other way round where there is no
    /// base, a meaning without a length and without a colour, a base without the length that is to be kept, and values out of range;
    /// otherwise as [`invert`].
    pub fn found(
        &self,
        base: Option<&OpticalProperties>,
        overrides: &Overrides,
        reflector: &Reflector,
    ) -> Result<Found> {
        let Overrides { sigma_s_reduced_per_mm, sigma_s_per_mm, sigma_a_per_mm, g, eta_inside_over_outside } =
            *overrides;
        if sigma_s_reduced_per_mm.or(sigma_s_per_mm).or(sigma_a_per_mm).is_some() {
            return Err(Error::input(
                "both a look (colour, radius) and coefficients (sigma_s, sigma_a) are given; give one of them",
            ));
        }
        if self.colour.or(self.radius_mm).is_none() {
            return Err(Error::input("the convention of a radius is given, but neither a radius nor a colour"));
        }
        let radius = self.radius.unwrap_or_default();
        let own = base.map(|base| reflector.colour(base)).transpose()?;
        let colour = self.colour.or(own).ok_or_else(|| {
            Error::input("a radius without a colour: say which (--color, color), or start from a material")
        })?;
        if !(colour.min_element() >= 0.0 && colour.max_element() <= 1.0) {
            return Err(Error::input(format!("the colour is {colour}; channels must be between 0 and 1")));
        }
        let radius_mm = match (self.radius_mm, base.zip(own)) {
            (Some(radius_mm), _) => radius_mm,
            (None, Some((base, own))) => kept(radius, base, own)?,
            (None, None) => {
                return Err(Error::input(
                    "a colour without a radius: say how far light goes inside (--radius-mm, radius_mm), or start from a material",
                ));
            }
        };
        let target = Target {
            colour,
            radius,
            radius_mm,
            g: g.or(base.map(|b| b.g)).unwrap_or(0.0),
            eta_inside_over_outside: eta_inside_over_outside
                .or(base.map(|b| b.eta_inside_over_outside))
                .unwrap_or(DEFAULT_ETA),
        };
        Ok(Found { target, inversion: invert(reflector, &target)? })
    }
}

/// The length of a base, which another colour keeps.
fn kept(radius: Radius, base: &OpticalProperties, own: DVec3) -> Result<DVec3> {
    let length = match radius {
        Radius::DiffusionLength => base.diffusion_length_mm(),
        _ => base.mean_free_path_mm(),
    };
    if length.max_element() > *RADII_MM.end() {
        let name = radius.name();
        return Err(Error::input(format!(
            "the material has no {name} that another colour could keep; say how long it is"
        )));
    }
    Ok(radius.of_medium_mm(base, own))
}

/// A colour as it is typed: `#e8c4b0` (sRGB, decoded to linear light), or linear sRGB as a number or three.
///
/// # Errors
/// What is wrong with it, in words.
pub fn parse_colour(text: &str) -> std::result::Result<DVec3, String> {
    let text = text.trim();
    if let Some(colour) = linear_from_hex(text) {
        return Ok(colour);
    }
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let colour = match numbers.as_deref() {
        Some([v]) => DVec3::splat(*v),
        Some([r, g, b]) => DVec3::new(*r, *g, *b),
        _ => return Err(format!("`{text}` is no colour; type '#e8c4b0' (sRGB), or linear R,G,B between 0 and 1")),
    };
    // Written so that NaN fails as well.
    if colour.min_element() >= 0.0 && colour.max_element() <= 1.0 && colour.is_finite() {
        return Ok(colour);
    }
    Err(format!("`{text}`: linear channels are between 0 and 1; codes are written '#e8c4b0'"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::medium::material::preset;

    fn marble() -> OpticalProperties {
        preset("marble").unwrap().properties()
    }

    #[test]
    fn colours_are_codes_or_linear_light() {
        let code = parse_colour("#e8c4b0").unwrap();
        assert!((code.x - 0.806_952).abs() < 1e-6);
        assert_eq!(parse_colour(" 0.5 ").unwrap(), DVec3::splat(0.5));
        assert_eq!(parse_colour("1, 0.5,0").unwrap(), DVec3::new(1.0, 0.5, 0.0));
        for bad in ["", "rose", "232,196,176", "0.1,0.2", "-0.1", "nan", "0,nan,0", "#e8c4b", "1,2"] {
            assert!(parse_colour(bad).unwrap_err().contains("#e8c4b0"), "{bad}");
        }
    }

    #[test]
    fn a_base_gives_what_is_not_asked_for() {
        let (base, dipole) = (marble(), Reflector::default());
        let rose = parse_colour("#c08080").unwrap();
        let found = |look: Look, overrides: Overrides| look.found(Some(&base), &overrides, &dipole).unwrap();
        // Another colour keeps the length, another length the colour, in every convention.
        for radius in Radius::ALL {
            let look = Look { colour: Some(rose), radius: Some(radius), ..Look::default() };
            let Found { target, inversion } = found(look, Overrides::default());
            assert!(inversion.is_reached() && target.eta_inside_over_outside == 1.5, "{radius:?}");
            let there = radius.of_medium_mm(&inversion.properties, rose) / target.radius_mm - 1.0;
            assert!(there.abs().max_element() < 1e-9, "{radius:?} {there}");
            let look = Look { radius_mm: Some(DVec3::new(2.0, 1.0, 0.5)), radius: Some(radius), ..Look::default() };
            let Found { inversion, .. } = found(look, Overrides::default());
            assert!((inversion.achieved - dipole.colour(&base).unwrap()).abs().max_element() < 1e-6, "{radius:?}");
        }
        // Another index as well.
        let look = Look { colour: Some(rose), ..Look::default() };
        let of_eta =
            found(look, Overrides { eta_inside_over_outside: Some(1.2), g: Some(0.5), ..Overrides::default() });
        assert_eq!((of_eta.target.g, of_eta.target.eta_inside_over_outside), (0.5, 1.2));
        assert!(of_eta.inversion.is_reached());
    }

    #[test]
    fn what_is_missing_or_too_much_is_told() {
        let (colour, radius_mm) = (Some(DVec3::splat(0.5)), Some(DVec3::ONE));
        let (none, nothing) = (Look::default(), Overrides::default());
        let spectralon = preset("spectralon").unwrap().properties();
        let diffusion = Some(Radius::DiffusionLength);
        let coefficients = Overrides { sigma_a_per_mm: radius_mm, ..nothing };
        for (look, base, overrides, fragment) in [
            (Look { colour, ..none }, None, nothing, "a colour without a radius"),
            (Look { radius_mm, ..none }, None, nothing, "a radius without a colour"),
            (Look { radius: diffusion, ..none }, None, nothing, "neither a radius nor a colour"),
            (Look { colour, radius_mm, ..none }, None, coefficients, "give one of them"),
            (Look { colour, radius: diffusion, ..none }, Some(&spectralon), nothing, "has no diffusion length"),
            (Look { colour: Some(DVec3::splat(1.1)), radius_mm, ..none }, None, nothing, "between 0 and 1"),
            (Look { colour, radius_mm: Some(DVec3::ZERO), ..none }, None, nothing, "red channel is 0 mm"),
            (Look { colour, radius_mm, ..none }, None, Overrides { g: Some(1.0), ..nothing }, "g is 1"),
        ] {
            let error = look.found(base, &overrides, &Reflector::default()).unwrap_err();
            assert!(error.message().contains(fragment), "{fragment}: {error}");
        }
    }
}
