//! The settings of environment rows.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::transport::irradiance_rows::RowSettings;
use crate::transport::visibility::Resolution;

/// Functions of the angle that hold F_t over the allowed refractive indices: 0.4 % of irradiance at most between 1.2
/// and 1.6.
pub(super) const TERMS: usize = 2;

/// Bytes of a sample's row for each coefficient, with a copy while it is written. Blocks keep a fifth of the coefficients or less where
/// samples see much the same, but no surface has to be like that.
const BYTES_PER_COEFFICIENT: u64 = 10;

/// Directional resolution of the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EnvironmentRows {
    /// Texels along an edge of the cube map, 32 or 64.
    pub side: u32,
    /// Rows have the squared error of so many Haar coefficients for each sample, 8 to 1024.
    pub coefficients: u32,
}

impl EnvironmentRows {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        if !matches!(self.side, 32 | 64) || !(8..=1024).contains(&self.coefficients) {
            let Self { side, coefficients } = self;
            return Err(Error::input(format!("rows of {coefficients} coefficients on a cube map of {side} texels")));
        }
        Ok(())
    }

    /// Bytes that rows of so many samples take while they are made.
    pub fn memory(&self, samples: usize) -> u64 {
        samples as u64 * u64::from(self.coefficients) * BYTES_PER_COEFFICIENT
    }

    /// Error that rows are expected to add under environments, from bakes of bunny_3k in skin1.
    pub const EXPECTED_RMS: f64 = 0.003;

    /// Bytes that rows of so many samples are expected to take in a file: neighbours share more where there are more of them.
    pub fn expected_bytes(&self, samples: usize) -> f64 {
        let n = samples as f64;
        20.0 * n * (131_072.0 / n.max(1.0)).powf(0.53) * f64::from(self.coefficients) / 128.0
    }

    /// Settings of the stage that makes rows, with a number of coefficients for each sample.
    pub(super) fn of_rows(&self, coefficients: usize) -> RowSettings {
        let resolution = if self.side == 32 { Resolution::Sub64 } else { Resolution::Sub128 };
        RowSettings { resolution, terms: TERMS, coefficients }
    }
}
