//! Colour spaces of pictures: from any RGB primaries to linear sRGB (Rec. 709).

use glam::{DMat3, DVec2, DVec3};

use crate::error::{Error, Result};

/// CIE xy of the three primaries and of white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chromaticities {
    /// xy of R, G and B.
    pub primaries: [DVec2; 3],
    /// xy of R = G = B.
    pub white: DVec2,
}

impl Chromaticities {
    /// Rec. 709 and sRGB (ITU-R BT.709), the space of every colour of this crate.
    pub const REC_709: Self = Self {
        primaries: [DVec2::new(0.64, 0.33), DVec2::new(0.30, 0.60), DVec2::new(0.15, 0.06)],
        white: DVec2::new(0.3127, 0.3290),
    };

    /// Returns whether both describe the same space, up to the rounding found in files.
    pub fn is_close_to(&self, other: &Self) -> bool {
        let same = |a: DVec2, b: DVec2| (a - b).abs().max_element() < 1e-3;
        self.primaries.iter().zip(&other.primaries).all(|(a, b)| same(*a, *b)) && same(self.white, other.white)
    }

    /// The matrix from this space's RGB to CIE XYZ with Y = 1 for white (SMPTE RP 177).
    fn to_xyz(self) -> Result<DMat3> {
        let xyz = |xy: DVec2| DVec3::new(xy.x / xy.y, 1.0, (1.0 - xy.x - xy.y) / xy.y);
        let [r, g, b] = self.primaries.map(xyz);
        let primaries = DMat3::from_cols(r, g, b);
        let scale = primaries.inverse() * xyz(self.white);
        let matrix = primaries * DMat3::from_diagonal(scale);
        if !matrix.is_finite() || primaries.determinant().abs() < 1e-9 || scale.min_element() <= 0.0 {
            return Err(Error::input("its chromaticities do not span a colour space"));
        }
        Ok(matrix)
    }

    /// The matrix from this space's linear RGB to linear sRGB, white to white (Bradford's adaptation where the whites
    /// differ); the identity for Rec. 709 itself.
    ///
    /// # Errors
    /// Chromaticities that span no colour space (exit 3).
    pub fn to_rec_709(self) -> Result<DMat3> {
        if self.is_close_to(&Self::REC_709) {
            return Ok(DMat3::IDENTITY);
        }
        let source = self.to_xyz()?;
        let target = Self::REC_709.to_xyz()?;
        let cone_from_xyz = DMat3::from_cols(
            DVec3::new(0.8951, -0.7502, 0.0389),
            DVec3::new(0.2664, 1.7135, -0.0685),
            DVec3::new(-0.1614, 0.0367, 1.0296),
        );
        let (from, to) = (cone_from_xyz * (source * DVec3::ONE), cone_from_xyz * (target * DVec3::ONE));
        let adapt = cone_from_xyz.inverse() * DMat3::from_diagonal(to / from) * cone_from_xyz;
        let matrix = target.inverse() * adapt * source;
        if matrix.is_finite() { Ok(matrix) } else { Err(Error::input("its chromaticities have no usable white")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rec_709_luminance_is_the_published_row() {
        let luminance = Chromaticities::REC_709.to_xyz().expect("valid").row(1);
        assert!((luminance - DVec3::new(0.212_639, 0.715_169, 0.072_192)).abs().max_element() < 1e-6, "{luminance}");
        assert_eq!(Chromaticities::REC_709.to_rec_709().expect("valid"), DMat3::IDENTITY);
    }

    #[test]
    fn acescg_gives_the_matrix_known_from_the_literature() {
        let ap1 = Chromaticities {
            primaries: [DVec2::new(0.713, 0.293), DVec2::new(0.165, 0.830), DVec2::new(0.128, 0.044)],
            white: DVec2::new(0.32168, 0.33767),
        };
        let known = DMat3::from_cols(
            DVec3::new(1.70505, -0.13026, -0.02400),
            DVec3::new(-0.62179, 1.14080, -0.12897),
            DVec3::new(-0.08326, -0.01055, 1.15297),
        );
        let matrix = ap1.to_rec_709().expect("valid");
        assert!((matrix - known).abs().to_cols_array().iter().all(|d| *d < 2e-4), "{matrix}");
        assert!((matrix * DVec3::ONE - DVec3::ONE).length() < 1e-12, "white stays white");
    }

    #[test]
    fn impossible_chromaticities_are_refused() {
        let with = |x: f64, y: f64| Chromaticities { white: DVec2::new(x, y), ..Chromaticities::REC_709 };
        for bad in [with(0.3, 0.0), with(f64::NAN, 0.3), with(0.9, 0.05), with(-5.0, 0.3)] {
            assert!(bad.to_rec_709().is_err(), "{bad:?}");
        }
        let zero = Chromaticities { primaries: [DVec2::ZERO; 3], white: DVec2::ZERO };
        assert!(zero.to_rec_709().is_err());
    }
}
