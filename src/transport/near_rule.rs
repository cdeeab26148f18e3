//! The near-field rule: the distances below which a piece of the surface is no point, and the points that stand for it
//! where it is less near.
//!
//! A radial kernel that is smooth inside a depth s changes at a distance r over a length of `sqrt(r^2 + s^2)`. A piece
//! of the surface is near where that is below some multiple of its radius. The number of radii follows from the asked
//! error: a [`NearField`] or a [`NearRule`].

use glam::DVec3;

use crate::error::{Error, Result};
use crate::geometry::samples::{self, Patch};

/// Squared distance (mm^2) below which a kernel that is smooth inside a depth (mm) changes over less than `length_mm`; may be negative.
#[inline(always)]
pub fn near_square(length_mm: f64, smooth_mm: f64) -> f64 {
    length_mm * length_mm - smooth_mm * smooth_mm
}

/// Three points of a triangle between its centroid and its corners: share of the way to the corner, weight of each.
pub type CornerPoints = (f32, f32);

/// Three points, which integrate polynomials of degree 2.
pub const THREE_POINTS: CornerPoints = (0.5, 1.0 / 3.0);

/// Six points, which integrate polynomials of degree 4 (Dunavant 1985).
pub const SIX_POINTS: [CornerPoints; 2] = [
    (1.5 * 0.108_103_018_168_070 - 0.5, 0.223_381_589_678_011),
    (1.5 * 0.816_847_572_980_459 - 0.5, 0.109_951_743_655_322),
];

/// Three points are enough for a facet from this many times farther on than six are: nothing is lost at 2, and much at 1.
pub const THREE_BEYOND: f32 = 2.0;

/// Distance over radius from which on a piece of a sample that a shadow boundary crosses is a point.
pub const PIECE_IS_POINT: f32 = 3.0;

/// A triangle whose area is less than this share of its longest edge's square is cut across that edge: quarters keep its
/// shape, and side by side they would be twice as many with every cut.
pub const SLIVER: f32 = 0.15;

/// Splits of a facet at most.
pub const MOST_SPLITS: u32 = 16;

/// The [`THREE_POINTS`] of a triangle and the area of each.
pub fn three_points(corners: [DVec3; 3]) -> ([DVec3; 3], f64) {
    let centre = corners.iter().sum::<DVec3>() / 3.0;
    (corners.map(|corner| 0.5 * (centre + corner)), samples::area(corners) / 3.0)
}

/// Distances, in units of a patch's radius, below which the patch counts as near.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NearField {
    /// Closed form below this distance over radius.
    pub exact_below: f64,
    /// Three points on each facet below this distance over radius, the centroid beyond.
    pub three_points_below: f64,
}

impl NearField {
    /// Radius of a group of receivers, mm, above which its receivers would share more of what is near than each has alone.
    pub fn narrow_mm(&self, patches: &[Patch]) -> f64 {
        let sum: f64 = patches.iter().map(|patch| patch.radius_mm).sum();
        self.exact_below * sum / patches.len().max(1) as f64
    }

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let Self { exact_below, three_points_below } = *self;
        if !(exact_below >= 0.0 && three_points_below >= exact_below && three_points_below <= 1e3) {
            return Err(Error::input(format!("a near field of {exact_below} and {three_points_below} radii")));
        }
        Ok(())
    }

    /// Errors of 1e-5 of the total reflectance, worst receiver of a plane: for the truth.
    pub const REFERENCE: Self = Self { exact_below: 6.0, three_points_below: 24.0 };
    /// Errors of 8e-4 of the total reflectance (worst receiver of a plane) at 0.3 mean free paths between samples, less
    /// elsewhere: 3e-4 at 0.1, 4e-4 at 1, 2e-4 at 3.
    pub const FAST: Self = Self { exact_below: 3.0, three_points_below: 6.0 };

    /// The rule for an asked error of the whole result: [`Self::FAST`] at 0.5 %. The error of a rule falls with the
    /// square of distance over size.
    pub fn for_error(relative_rms: f64) -> Self {
        let reach = (0.005 / relative_rms).sqrt();
        let Self { exact_below, three_points_below } = Self::FAST;
        Self {
            exact_below: (exact_below * reach).clamp(1.5, Self::REFERENCE.exact_below),
            three_points_below: (three_points_below * reach).clamp(3.0, Self::REFERENCE.three_points_below),
        }
    }
}

/// Distances over the radius of a sample below which it is more than a disc.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NearRule {
    /// Points of its facets are summed below this.
    pub facets_below: f64,
    /// Pieces of a sample that is not lit evenly are summed below this.
    pub pieces_below: f64,
}
