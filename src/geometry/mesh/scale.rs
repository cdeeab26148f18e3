//! Conversion of the units of a source to millimetres.

use glam::DVec3;

use super::Mesh;
use crate::error::{Error, Result};
use crate::geometry::source::SourceModel;

/// Smallest bounding-box diagonal in mm; below it, areas of single triangles leave single precision.
pub(super) const MIN_DIAGONAL_MM: f64 = 1e-6;

/// Largest bounding-box diagonal in mm; above it, squared distances come near the end of single precision.
pub(super) const MAX_DIAGONAL_MM: f64 = 1e9;

/// The axis of the source that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum UpAxis {
    /// +Y is up.
    #[default]
    Y,
    /// +Z is up.
    Z,
}

/// Size of a model, as a user states it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Length of one source unit in mm.
    MillimetresPerUnit(f64),
    /// Diagonal of the bounding box in mm.
    DiagonalMm(f64),
    /// Extent of the bounding box along the up axis in mm.
    HeightMm(f64, UpAxis),
}

/// Placement of a model in the world: a scale about its own origin, nothing else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Length of one source unit in mm.
    pub mm_per_unit: f64,
}

/// The scale of a model: that of the user, else that of the file format.
///
/// The bounding box is that of the vertices that triangles use.
///
/// # Errors
/// Command line: a size that is not positive and finite, or no size for a format without units (the message guesses
/// and says what to type). Invalid input: no triangles, non-finite vertices, extents that overflow or that are zero
/// where a size needs them.
pub fn resolve_scale(source: &SourceModel, scale: Option<Scale>) -> Result<Placement> {
    let (min, max) = used_bounds(source)?;
    let extents = max - min;
    let mm_per_unit = match scale {
        Some(Scale::MillimetresPerUnit(mm)) => positive(mm, "the length of a unit")?,
        Some(Scale::DiagonalMm(mm)) => {
            positive(mm, "--size-mm")? / positive_extent(diagonal(extents), "the bounding-box diagonal")?
        }
        Some(Scale::HeightMm(mm, up)) => {
            let (extent, axis) = match up {
                UpAxis::Y => (extents.y, "the extent along y"),
                UpAxis::Z => (extents.z, "the extent along z"),
            };
            positive(mm, "--height-mm")? / positive_extent(extent, axis)?
        }
        None => match source.metres_per_unit {
            Some(metres) => 1000.0 * positive(metres, "the unit of the file")?,
            None => return Err(Error::command_line(guess(extents))),
        },
    };
    if !(mm_per_unit.is_finite() && mm_per_unit > 0.0) {
        return Err(Error::input(format!(
            "the model's extents ({}) and the asked size leave no usable scale: give another --unit or --size-mm",
            describe(extents)
        )));
    }
    Ok(Placement { mm_per_unit })
}

/// Diagonal of the bounding box of the vertices that triangles use, in source units.
///
/// # Errors
/// Invalid input: as [`resolve_scale`].
pub fn diagonal_in_units(source: &SourceModel) -> Result<f64> {
    used_bounds(source).map(|(min, max)| diagonal(max - min))
}

impl Mesh {
    /// Scales the mesh about the world's origin so that its diagonal is `diagonal_mm`; returns the factor. A mesh whose
    /// diagonal is already within a relative 1e-6 of it stays as it is.
    ///
    /// # Errors
    /// Command line: a size that is not positive and finite, or outside the range of a mesh's; a mesh of no extent.
    pub fn resize(&mut self, diagonal_mm: f64) -> Result<f64> {
        let size = positive(diagonal_mm, "--size-mm")?;
        if !(MIN_DIAGONAL_MM..=MAX_DIAGONAL_MM).contains(&size) {
            return Err(Error::command_line(format!(
                "--size-mm {size}: {MIN_DIAGONAL_MM:.0e} to {MAX_DIAGONAL_MM:.0e} mm are possible"
            )));
        }
        let factor = size / positive_extent(self.diagonal_mm(), "the bounding-box diagonal")?;
        if (factor - 1.0).abs() < SAME_SIZE {
            return Ok(1.0);
        }
        self.origin_mm *= factor;
        self.local_mm.iter_mut().for_each(|p| *p = (p.as_dvec3() * factor).as_vec3());
        Ok(factor)
    }
}

/// Sizes nearer to each other than this are the same: the diagonal comes from rounded vertices.
const SAME_SIZE: f64 = 1e-6;

/// Bounding box of the vertices that triangles use, in source units.
///
/// # Errors
/// Invalid input: no triangles, an index out of range, a non-finite vertex, extents beyond double precision.
pub(super) fn used_bounds(source: &SourceModel) -> Result<(DVec3, DVec3)> {
    if source.triangles.is_empty() {
        return Err(Error::input("the model has no triangles"));
    }
    let mut min = DVec3::INFINITY;
    let mut max = DVec3::NEG_INFINITY;
    for (t, triangle) in source.triangles.iter().enumerate() {
        for &v in triangle {
            let Some(&p) = source.positions.get(v as usize) else {
                return Err(Error::input(format!(
                    "triangle {t} uses vertex {v}, and the model has {} vertices",
                    source.positions.len()
                )));
            };
            if !p.is_finite() {
                return Err(Error::input(format!("triangle {t} uses vertex {v}, whose position ({p}) is not finite")));
            }
            min = min.min(p);
            max = max.max(p);
        }
    }
    if !diagonal(max - min).is_finite() {
        return Err(Error::input(format!("the model's extents overflow: from ({min}) to ({max})")));
    }
    Ok((min, max))
}

/// Length of a vector whose squares may overflow.
fn diagonal(extents: DVec3) -> f64 {
    let largest = extents.max_element();
    if largest > 0.0 && largest.is_finite() { largest * (extents / largest).length() } else { largest }
}

fn positive(value: f64, what: &str) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Error::command_line(format!("{what} is {value}; it must be a positive number")))
    }
}

fn positive_extent(value: f64, what: &str) -> Result<f64> {
    if value > 0.0 {
        Ok(value)
    } else {
        Err(Error::input(format!("{what} of the model is zero, so it cannot be scaled by it: give --unit mm|cm|m")))
    }
}

fn describe(extents: DVec3) -> String {
    format!("{} x {} x {} units", short(extents.x), short(extents.y), short(extents.z))
}

/// Four significant digits, in scientific notation where that is shorter.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value) {
        let digits = if value >= 1000.0 {
            0
        } else if value >= 10.0 {
            1
        } else {
            4
        };
        format!("{value:.digits$}")
    } else {
        format!("{value:.3e}")
    }
}

fn guess(extents: DVec3) -> String {
    let longest = extents.max_element();
    let (guess, flag) = if (0.02..0.6).contains(&longest) {
        (format!("they look like metres ({:.0} mm long), or like a model without a unit", longest * 1000.0), "--unit m")
    } else if (0.6..3.0).contains(&longest) {
        ("they look normalised to about 1, so the file holds no size".to_string(), "--size-mm 50")
    } else if (3.0..30.0).contains(&longest) {
        (format!("they look like centimetres ({longest:.1} cm long), or like a model without a unit"), "--unit cm")
    } else if (30.0..3000.0).contains(&longest) {
        (format!("they look like millimetres ({longest:.0} mm long)"), "--unit mm")
    } else {
        ("they fit no usual unit".to_string(), "--size-mm 50")
    };
    format!(
        "this file format states no unit. The model's extents are {}: {guess}. Light in a translucent object depends \
         on its size, so say it: --unit mm|cm|m for the unit of the coordinates, --size-mm D for the bounding-box \
         diagonal or --height-mm H for the height; here perhaps {flag}",
        describe(extents)
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::error::ExitCode;

    fn box_of(extents: DVec3) -> SourceModel {
        let corners = vec![DVec3::ZERO, DVec3::new(extents.x, extents.y, 0.0), extents, DVec3::NAN];
        SourceModel::new(corners, vec![[0, 1, 2]])
    }

    #[test]
    fn sizes_scale_the_box_of_the_used_vertices() {
        let model = box_of(DVec3::new(3.0, 4.0, 12.0));
        let scale = |s| resolve_scale(&model, Some(s)).unwrap().mm_per_unit;
        assert_eq!(scale(Scale::DiagonalMm(26.0)), 2.0);
        assert_eq!(scale(Scale::HeightMm(8.0, UpAxis::Y)), 2.0);
        assert_eq!(scale(Scale::HeightMm(6.0, UpAxis::Z)), 0.5);
        assert_eq!(scale(Scale::MillimetresPerUnit(10.0)), 10.0);
        let metres = SourceModel { metres_per_unit: Some(1.0), ..model };
        assert_eq!(resolve_scale(&metres, None).unwrap().mm_per_unit, 1000.0);
    }

    #[test]
    fn a_model_without_a_unit_is_an_error_that_says_what_to_type() {
        for (longest, flag) in
            [(0.15, "--unit m"), (1.0, "--size-mm"), (11.0, "--unit cm"), (340.0, "--unit mm"), (1e7, "--size-mm")]
        {
            let error = resolve_scale(&box_of(DVec3::splat(longest)), None).unwrap_err();
            assert_eq!(error.code(), ExitCode::CommandLine);
            let end = error.message().split("here perhaps").last().unwrap().trim().to_string();
            assert!(end.starts_with(flag), "{longest}: {error}");
            assert!(error.message().contains("--height-mm"));
        }
    }

    #[test]
    fn impossible_sizes_are_errors() {
        let model = box_of(DVec3::new(1.0, 0.0, 1.0));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = resolve_scale(&model, Some(Scale::DiagonalMm(bad))).unwrap_err();
            assert_eq!(error.code(), ExitCode::CommandLine);
        }
        let flat = resolve_scale(&model, Some(Scale::HeightMm(5.0, UpAxis::Y))).unwrap_err();
        assert_eq!(flat.code(), ExitCode::InvalidInput);
        let empty = resolve_scale(&SourceModel::default(), Some(Scale::DiagonalMm(1.0))).unwrap_err();
        assert_eq!(empty.code(), ExitCode::InvalidInput);
        let mut overflow = box_of(DVec3::splat(f64::MAX));
        overflow.positions[0] = DVec3::splat(-f64::MAX);
        assert_eq!(resolve_scale(&overflow, Some(Scale::DiagonalMm(1.0))).unwrap_err().code(), ExitCode::InvalidInput);
        let float_range = resolve_scale(&box_of(DVec3::splat(6.8e38)), Some(Scale::DiagonalMm(30.0))).unwrap();
        assert!(float_range.mm_per_unit > 0.0);
    }
}
