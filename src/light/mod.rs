//! Light sources: constant, directional, point, area and environment, and the text form that the command line takes.

pub mod environment;
pub mod parse;

use glam::DVec3;

use environment::EnvironmentMap;
use std::sync::Arc;

/// A light source. Colours are linear sRGB; positions world mm; directions point towards the light.
#[derive(Clone, Debug)]
pub enum Light {
    /// The same radiance from every direction.
    Constant {
        /// W/(m^2 sr) in arbitrary but common units, RGB.
        radiance: DVec3,
    },
    /// Parallel light.
    Directional {
        /// Unit vector from the surface towards the light.
        from: DVec3,
        /// Irradiance on a surface that faces the light, RGB.
        irradiance: DVec3,
    },
    /// A point: E = intensity / d^2, d in mm.
    Point {
        /// World position in mm.
        at_mm: DVec3,
        /// Intensity in irradiance times mm^2, RGB.
        intensity: DVec3,
    },
    /// A one-sided rectangle.
    Area {
        /// World position of its centre in mm.
        at_mm: DVec3,
        /// Unit normal of the emitting side.
        normal: DVec3,
        /// Unit vector along the first edge, perpendicular to `normal`.
        u: DVec3,
        /// Lengths of the first and the second edge in mm.
        size_mm: [f64; 2],
        /// Radiance of the emitting side, RGB.
        radiance: DVec3,
    },
    /// A distant environment.
    Environment {
        /// The picture.
        map: Arc<EnvironmentMap>,
        /// Counter-clockwise turn about +Y seen from above, in degrees.
        rotate_degrees: f64,
        /// Factor on the picture's radiance, RGB.
        scale: DVec3,
    },
}
