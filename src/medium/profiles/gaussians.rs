//! Sums of two-dimensional Gaussians: d'Eon, Luebke and Enderton, "Efficient Rendering of Human Skin" (2007).

use std::path::Path;

use super::csv::{self, Row};
use crate::error::{Error, Result};
use crate::medium::profile::Profile;

use std::f64::consts::TAU;

/// One Gaussian of all channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Variance v of `exp(-r^2 / (2 v)) / (2 pi v)` in mm^2.
    pub variance_mm2: f64,
    /// Reflectance of the Gaussian, linear RGB.
    pub weights: [f64; 3],
}

/// Three-layer skin as published (d'Eon and Luebke, GPU Gems 3, 2007, figure 14-13): each channel's weights sum to 1.
#[rustfmt::skip]
pub const SKIN: [Lobe; 6] = [
    Lobe { variance_mm2: 0.0064, weights: [0.233, 0.455, 0.649] },
    Lobe { variance_mm2: 0.0484, weights: [0.100, 0.336, 0.344] },
    Lobe { variance_mm2: 0.187, weights: [0.118, 0.198, 0.0] },
    Lobe { variance_mm2: 0.567, weights: [0.113, 0.007, 0.007] },
    Lobe { variance_mm2: 1.99, weights: [0.358, 0.004, 0.0] },
    Lobe { variance_mm2: 7.41, weights: [0.078, 0.0, 0.0] },
];

/// Accepted variances (mm^2).
const VARIANCES_MM2: std::ops::RangeInclusive<f64> = 1e-24..=1e24;

/// Largest weight of a channel.
const LARGEST_WEIGHT: f64 = 1.0;

/// A sum of Gaussians of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussians {
    /// Weight and variance (mm^2) of each.
    terms: Vec<(f64, f64)>,
}

impl Gaussians {
    /// The sum of Gaussians with these weights and variances in mm^2.
    ///
    /// # Errors
    /// Invalid input when a weight is negative, when the weights sum to more than 1 by more than 1e-6, or when a
    /// variance is not between 1e-24 and 1e24.
    pub fn new(terms: &[(f64, f64)]) -> Result<Self> {
        for (weight, variance) in terms {
            if !(0.0..=LARGEST_WEIGHT).contains(weight) {
                return Err(Error::input(format!("a weight is {weight}; it must be between 0 and 1")));
            }
            if !VARIANCES_MM2.contains(variance) {
                return Err(Error::input(format!("a variance is {variance} mm^2; it must be between 1e-24 and 1e24")));
            }
        }
        let sum: f64 = terms.iter().map(|term| term.0).sum();
        if sum > 1.0 + 1e-6 {
            return Err(Error::input(format!("the weights sum to {sum}: more light than came in; divide them by it")));
        }
        Ok(Self { terms: terms.iter().copied().filter(|term| term.0 > 0.0).collect() })
    }

    /// The three channels of `lobes`.
    ///
    /// # Errors
    /// Errors of [`Gaussians::new`], with the channel.
    pub fn channels(lobes: &[Lobe]) -> Result<[Self; 3]> {
        let channel = |c: usize| {
            let terms: Vec<(f64, f64)> = lobes.iter().map(|lobe| (lobe.weights[c], lobe.variance_mm2)).collect();
            Self::new(&terms).map_err(|error| error.at(["red", "green", "blue"][c]))
        };
        Ok([channel(0)?, channel(1)?, channel(2)?])
    }
}

/// Reads lobes from CSV with the header `variance_mm2,r,g,b`; blank lines and lines that start with `#` are skipped.
///
/// # Errors
/// I/O when it cannot be read; invalid input, with path and line, for its contents.
pub fn read_lobes(path: &Path) -> Result<Vec<Lobe>> {
    let rows = csv::read(path, "variance_mm2")?;
    if rows.is_empty() {
        return Err(Error::input("there is no Gaussian below the header").in_file(path));
    }
    let lobe = |row: &Row| {
        let lobe = Lobe { variance_mm2: row.key, weights: row.rgb };
        // The row alone first: the sum over rows belongs to no line.
        let place = format!("{}:{}", path.display(), row.line);
        Gaussians::channels(&[lobe]).map(|_| lobe).map_err(|error| error.at(place))
    };
    let lobes = rows.iter().map(lobe).collect::<Result<Vec<Lobe>>>()?;
    Gaussians::channels(&lobes).map_err(|error| error.in_file(path))?;
    Ok(lobes)
}

impl Profile for Gaussians {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.terms.iter().map(|(w, v)| w / (TAU * v) * (-0.5 * r_mm * (r_mm / v)).exp()).sum()
    }

    fn tail(&self, r_mm: f64) -> f64 {
        self.terms.iter().map(|(w, v)| w / TAU * (-0.5 * r_mm * (r_mm / v)).exp()).sum()
    }
}
