//! Settings of transport of light from far away, whatever its basis.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::evaluate::inter_reflection::Outside;
use crate::forms::density::Density;
use crate::forms::projected::references::Spacing;
use crate::light::LightKind;
use crate::light::cube_light::Transform;
use crate::math::cube_map::FACES;
use crate::transport::single_scattering::{Crossings, Form};
use crate::transport::visibility::Resolution;

/// Order of the harmonics at most.
pub const MOST_ORDER: usize = 32;

/// Kinds of light that come from far away.
pub const KINDS: &[LightKind] = &[LightKind::Constant, LightKind::Directional, LightKind::Environment];

/// The basis of the light that transport is expressed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Basis {
    /// Sparse rows of Haar coefficients.
    Haar,
    /// Spherical harmonics, coded together.
    Harmonics,
}

/// Rule that chooses the coefficients of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Choice {
    /// The largest coefficients of each vertex.
    Magnitude,
    /// The largest products of coefficient and expected light, for each vertex.
    Light,
    /// Coefficients that are worth their bytes, at one threshold for all vertices.
    Rate,
}

/// Treatment of single scattering.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Single {
    /// It is left out.
    Off,
    /// Isotropic, with reduced coefficients: a value for each vertex.
    Isotropic,
    /// The same, added to the radiosity.
    Folded,
    /// By the phase function of each medium, as a sum of terms.
    Phase(Terms),
}

/// Terms of a phase function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Terms {
    /// As many as the media need.
    Auto,
    /// A fixed number.
    Stored(usize),
    /// None: rays at run time.
    Rays,
}

/// The integrand of single scattering, equation (4) of Wang, Tran and Luebke 2005.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Integrand {
    /// With the refraction factor, or as printed.
    pub form: Form,
    /// Treatment of light whose straight path crosses further surfaces.
    pub crossings: Crossings,
}

/// Samples, resolutions and single scattering of transport over directions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distant {
    /// Number of samples of a bake.
    pub density: Density,
    /// Texels along an edge of the cube map that irradiance is sampled on, 32 or 64.
    pub side: u32,
    /// Measure on which the Haar functions are orthonormal.
    pub transform: Transform,
    /// Rule that chooses the coefficients of a Haar row.
    pub choice: Choice,
    /// Number of coefficients of a Haar row.
    pub row: usize,
    /// Order of the harmonics, or as the error asks.
    pub order: Option<usize>,
    /// Distance between reference points of harmonics.
    pub spacing: Spacing,
    /// Single scattering.
    pub single: Single,
    /// Basis of single scattering.
    pub single_basis: Basis,
    /// Integrand of single scattering.
    pub integrand: Integrand,
    /// Inter-reflection, if any.
    pub outside: Option<Outside>,
}

impl Distant {
    /// Sub-texels of the cube map.
    pub fn resolution(&self) -> Resolution {
        if self.side == 32 { Resolution::Sub64 } else { Resolution::Sub128 }
    }

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        self.density.validate()?;
        self.spacing.validate()?;
        self.outside.iter().try_for_each(Outside::validate)?;
        let most = FACES * (self.side as usize).pow(2);
        let terms = match self.single {
            Single::Phase(Terms::Stored(terms)) => terms,
            _ => 1,
        };
        let fits = matches!(self.side, 32 | 64)
            && (FACES..=most).contains(&self.row)
            && self.order.is_none_or(|order| (1..=MOST_ORDER).contains(&order))
            && matches!(terms, 1 | 4 | 9 | 16);
        if fits { Ok(()) } else { Err(Error::input(format!("settings of distant light out of range: {self:?}"))) }
    }
}
