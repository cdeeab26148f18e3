//! Settings of single scattering vectors.

use super::super::interface::Form;
use super::super::interior::{Coefficients, Crossings};
use crate::error::{Error, Result};
use crate::medium::phase::LightTerms;

/// Sharing of rays among the texels and depths of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sharing {
    /// Rays are not shared: the paper's deterministic samples, each with a ray through every one of 2 x 2 sub-texels.
    None {
        /// Distances along the normal.
        depths: u32,
    },
    /// Rays at the corners of cells that are cut where the corners disagree (see the module).
    Adaptive {
        /// Gauss points along the normal, for each group of channels of similar extinction.
        depths: usize,
        /// Cells whose corners differ by more than this share of the largest contribution are cut.
        tolerance: f64,
    },
}

impl Sharing {
    /// The paper's 16 deterministic samples, whose rays are not shared.
    pub const PAPER: Self = Self::None { depths: 16 };
    /// Six Gauss points and a tolerance of 0.3: the module has the figures.
    pub const DEFAULT: Self = Self::Adaptive { depths: 6, tolerance: 0.3 };
}

/// The integrand of the vectors and its sampling.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorSettings {
    /// Texels along an edge of a face: 8, 16, 32, 64 or 128.
    pub side: usize,
    /// The integrand.
    pub form: Form,
    /// Treatment of surfaces between the point where light enters and the light.
    pub crossings: Crossings,
    /// Coefficients of the medium: reduced ones for an isotropic phase function.
    pub coefficients: Coefficients,
    /// Light side of the phase function.
    pub phase: LightTerms,
    /// Sharing of rays.
    pub sharing: Sharing,
}

impl VectorSettings {
    /// Faces of 32 texels, isotropic.
    pub const DEFAULT: Self = Self {
        side: 32,
        form: Form::Physical,
        crossings: Crossings::Occluded,
        coefficients: Coefficients::Reduced,
        phase: LightTerms::Isotropic,
        sharing: Sharing::DEFAULT,
    };

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Another side than 8 to 128, no sample along the normal, a tolerance that is not positive (exit 3).
    pub(super) fn validate(&self) -> Result<()> {
        let side = self.side;
        if !side.is_power_of_two() || !(8..=128).contains(&side) {
            return Err(Error::input(format!("cube map faces of {side} texels: 8, 16, 32, 64 and 128 are possible")));
        }
        let sensible = match self.sharing {
            Sharing::None { depths } => depths > 0,
            Sharing::Adaptive { depths, tolerance } => depths > 0 && tolerance > 0.0,
        };
        if !sensible {
            return Err(Error::input(
                "single scattering vectors need at least one sample along the normal and a positive tolerance",
            ));
        }
        Ok(())
    }
}
