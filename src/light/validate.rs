//! Checks of the numbers of a light; shared by the constructors and the text form.

use std::ops::RangeInclusive;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::math::sphere::unit;

/// Allowed steps along an edge of a source radiance field's square grid on the hemisphere, which has one point more.
pub const POINTS: RangeInclusive<u16> = 4..=64;

/// Squared lengths this close to 1 are left alone, so that normalising twice gives the same bits as once.
const UNIT_TOLERANCE: f64 = 4.0 * f64::EPSILON;

/// Vectors closer to parallel than this have no usable perpendicular part.
const PARALLEL_SINE: f64 = 1e-6;

/// Checks that a radiometric RGB quantity is finite and not negative.
pub(super) fn amount(key: &str, value: DVec3) -> Result<DVec3> {
    let value = position(key, value)?;
    if value.min_element() < 0.0 {
        return Err(Error::input(format!("{key} must not be negative, and it is {}", text(value))));
    }
    // Adding zero turns -0 into 0, which prints as people expect.
    Ok(value + 0.0)
}

/// Checks that a position is finite.
pub(super) fn position(key: &str, value: DVec3) -> Result<DVec3> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Error::input(format!("{key} must be finite, and it is {}", text(value))))
    }
}

/// Checks that an angle in degrees is finite.
pub(super) fn angle(key: &str, degrees: f64) -> Result<f64> {
    if degrees.is_finite() {
        Ok(degrees)
    } else {
        Err(Error::input(format!("{key} must be a finite angle in degrees, and it is {degrees}")))
    }
}

/// A unit vector along `value`; lengths from 1e-300 to 1e300 work.
pub(super) fn direction(key: &str, value: DVec3) -> Result<DVec3> {
    let value = position(key, value)?;
    if value == DVec3::ZERO {
        return Err(Error::input(format!("{key} is the zero vector; give a direction, for example {key}=0,1,0")));
    }
    if (value.length_squared() - 1.0).abs() <= UNIT_TOLERANCE {
        return Ok(value);
    }
    Ok(unit(value))
}

/// Checks that two lengths in mm are positive and finite.
pub(super) fn size(size_mm: [f64; 2]) -> Result<[f64; 2]> {
    if size_mm.iter().all(|s| s.is_finite() && *s > 0.0) {
        Ok(size_mm)
    } else {
        Err(Error::input(format!(
            "size must be two positive lengths in mm, for example size=20,20, and it is {},{}",
            size_mm[0], size_mm[1]
        )))
    }
}

/// Checks the number of points along an edge of a source radiance field.
pub(super) fn field_points(points: u16) -> Result<u16> {
    if POINTS.contains(&points) {
        return Ok(points);
    }
    let (least, most) = (POINTS.start(), POINTS.end());
    Err(Error::input(format!("field must be a whole number of points, {least} to {most}, and it is {points}")))
}

/// The unit first edge of a rectangle with the unit normal `normal`.
pub(super) fn first_edge(normal: DVec3, asked: Option<DVec3>) -> Result<DVec3> {
    let edge = match asked {
        Some(edge) => direction("u", edge)?,
        None if normal.z.abs() > 0.99 => DVec3::X,
        None => DVec3::Z.cross(normal).normalize(),
    };
    if edge.dot(normal).abs() <= UNIT_TOLERANCE {
        return Ok(edge);
    }
    let perpendicular = edge - normal * edge.dot(normal);
    if perpendicular.length() < PARALLEL_SINE {
        return Err(Error::input(format!(
            "u={} is parallel to normal={}; give the direction of an edge of the rectangle",
            text(edge),
            text(normal)
        )));
    }
    // The second pass removes what cancellation left in the first.
    let unit = perpendicular.normalize();
    Ok((unit - normal * unit.dot(normal)).normalize())
}

/// Three numbers separated by commas.
pub(super) fn text(v: DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}
