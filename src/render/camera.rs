//! A pinhole camera in world millimetres: eye rays, projection of points, framing of a mesh.

use glam::{DVec2, DVec3};

use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;

/// Default vertical field of view, in degrees: objects look as from arm's length.
pub const DEFAULT_FOV_DEGREES: f64 = 28.0;
/// Narrowest vertical field of view, in degrees: below it, pixels fall under the precision of ray directions.
pub const MIN_FOV_DEGREES: f64 = 0.01;
/// Widest vertical field of view, in degrees: a plane picture has no room for more.
pub const MAX_FOV_DEGREES: f64 = 179.0;
/// Elevation of the default camera above the horizon, in degrees.
const DEFAULT_ELEVATION_DEGREES: f64 = 12.0;
/// Share of the half width or half height that the object fills under the default camera.
const FILL: f64 = 0.93;
/// Largest accepted coordinate: larger ones are mistakes, and their squares would lose digits.
const MAX_COORDINATE_MM: f64 = 1e12;
/// Sine of the angle between view direction and `up` below which no horizontal is left.
const PARALLEL_SINE: f64 = 1e-6;

/// Size of a picture in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Resolution {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Longest side of a picture, in pixels.
pub const MAX_SIDE: usize = 1 << 16;

impl Resolution {
    /// A picture of this size.
    ///
    /// # Errors
    /// A side of 0 or above [`MAX_SIDE`] (exit 1).
    pub fn new(width: usize, height: usize) -> Result<Self> {
        if width == 0 || height == 0 || width.max(height) > MAX_SIDE {
            return Err(Error::command_line(format!(
                "resolution {width}x{height}: both sides must be from 1 to {MAX_SIDE} pixels; type for example 1024x768"
            )));
        }
        Ok(Self { width, height })
    }

    /// Width over height.
    pub fn aspect(self) -> f64 {
        self.width as f64 / self.height as f64
    }

    /// Number of pixels.
    pub fn pixels(self) -> usize {
        self.width * self.height
    }
}

/// A pinhole camera. Its pixels are square; `fov_degrees` spans the height of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    at_mm: DVec3,
    look_mm: DVec3,
    up: DVec3,
    fov_degrees: f64,
    /// Unit vectors of the picture: to the right, up, and into the scene.
    right: DVec3,
    upward: DVec3,
    forward: DVec3,
    /// Tangent of half the vertical field of view.
    half_height: f64,
}

/// Image of a point in a camera's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Column and row in pixels from the upper left corner of the picture; pixel (0, 0) spans [0, 1) in both.
    pub pixel: DVec2,
    /// Distance along the viewing axis in mm.
    pub depth_mm: f64,
}

impl Camera {
    /// A camera at `at_mm` that looks at `look_mm`, with `up` upwards in the picture (any length, need not be
    /// perpendicular), `fov_degrees` high.
    ///
    /// # Errors
    /// Values that are not finite or beyond 1e12 mm, `at` and `look` in one place, `up` along the view, a field of view
    /// outside [`MIN_FOV_DEGREES`] to [`MAX_FOV_DEGREES`] (exit 1).
    pub fn new(at_mm: DVec3, look_mm: DVec3, up: DVec3, fov_degrees: f64) -> Result<Self> {
        let wrong = |what: String| Err(Error::command_line(what));
        let at_mm = checked_vector("at", at_mm)?;
        let look_mm = checked_vector("look", look_mm)?;
        let up = checked_vector("up", up)?;
        let fov_degrees = checked_fov(fov_degrees)?;
        let Some(forward) = unit(look_mm - at_mm) else {
            return wrong(format!("at and look are both {}; move one of them", xyz(at_mm)));
        };
        let Some(up_unit) = unit(up) else {
            return wrong("up=0,0,0 has no direction; type for example up=0,1,0".to_owned());
        };
        let across = forward.cross(up_unit);
        if across.length() < PARALLEL_SINE {
            let [up, at, look, example] = [up, at_mm, look_mm, upward_of(forward)].map(xyz);
            return wrong(format!(
                "up={up} is parallel to the view from at={at} to look={look}; give the direction that is up in the picture, for \
                 example up={example}"
            ));
        }
        let right = across.normalize();
        let upward = right.cross(forward).normalize();
        let half_height = (0.5 * fov_degrees).to_radians().tan();
        Ok(Self { at_mm, look_mm, up, fov_degrees, right, upward, forward, half_height })
    }

    /// The default camera: the whole mesh from the front (+Z), slightly above.
    ///
    /// # Errors
    /// As [`Camera::new`], for a mesh beyond 1e12 mm.
    pub fn framing(mesh: &Mesh, resolution: Resolution) -> Result<Self> {
        let front = View::Front.direction();
        Self::framing_from(mesh, resolution, front, centre_mm(mesh), default_up(-front), DEFAULT_FOV_DEGREES)
    }

    /// The camera on the ray from `look_mm` towards `direction`, as near as possible with the whole mesh in view.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn framing_from(
        mesh: &Mesh,
        resolution: Resolution,
        direction: DVec3,
        look_mm: DVec3,
        up: DVec3,
        fov_degrees: f64,
    ) -> Result<Self> {
        let frame = Self::new(look_mm + direction, look_mm, up, fov_degrees)?;
        let limit = DVec2::new(resolution.aspect(), 1.0) * frame.half_height * FILL;
        let (mut distance, mut nearest) = (0.0f64, 0.0f64);
        for &v in mesh.triangles.iter().flatten() {
            let p = mesh.position_mm(v) - look_mm;
            let beside = DVec2::new(p.dot(frame.right), p.dot(frame.upward)).abs() / limit;
            distance = distance.max(beside.max_element() - p.dot(frame.forward));
            // In front of the eye, even where a wide view would let it come as near as it likes.
            nearest = nearest.max(-p.dot(frame.forward));
        }
        let diagonal = mesh.diagonal_mm();
        let distance = distance.max(nearest + 1e-2 * diagonal).max(1e-6);
        Self::new(rounded(look_mm + direction * distance, diagonal), look_mm, up, fov_degrees)
    }

    /// Position of the eye in mm.
    pub fn at_mm(&self) -> DVec3 {
        self.at_mm
    }

    /// The point in the middle of the picture, in mm.
    pub fn look_mm(&self) -> DVec3 {
        self.look_mm
    }

    /// The direction that is up in the picture, as it was given.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Unit vector of the viewing axis.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// Vertical field of view in degrees.
    pub fn fov_degrees(&self) -> f64 {
        self.fov_degrees
    }

    /// Unit direction from the eye through a place in the picture: `pixel` as in [`Projection`].
    #[inline]
    pub fn direction(&self, pixel: DVec2, resolution: Resolution) -> DVec3 {
        let half = 0.5 * resolution.height as f64;
        let x = (pixel.x - 0.5 * resolution.width as f64) / half;
        let y = (half - pixel.y) / half;
        (self.forward + (self.right * x + self.upward * y) * self.half_height).normalize()
    }

    /// Image of a point; none for points that are not in front of the eye.
    pub fn project(&self, point_mm: DVec3, resolution: Resolution) -> Option<Projection> {
        let p = point_mm - self.at_mm;
        let depth_mm = p.dot(self.forward);
        if depth_mm <= 0.0 {
            return None;
        }
        let half = 0.5 * resolution.height as f64;
        let scale = half / (depth_mm * self.half_height);
        let pixel =
            DVec2::new(0.5 * resolution.width as f64 + p.dot(self.right) * scale, half - p.dot(self.upward) * scale);
        pixel.is_finite().then_some(Projection { pixel, depth_mm })
    }
}

/// The canonical text form, which [`CameraSpec`](super::camera_text::CameraSpec) reads back bit for bit.
impl std::fmt::Display for Camera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (at, look, up) = (xyz(self.at_mm), xyz(self.look_mm), xyz(self.up));
        write!(f, "at={at}:look={look}:up={up}:fov={}", self.fov_degrees)
    }
}

/// Checks that a vector is finite and within [`MAX_COORDINATE_MM`].
pub(super) fn checked_vector(key: &str, v: DVec3) -> Result<DVec3> {
    // Written so that NaN fails as well.
    if v.is_finite() && v.abs().max_element() <= MAX_COORDINATE_MM {
        // Adding zero turns -0 into 0, which prints as people expect.
        return Ok(v + 0.0);
    }
    Err(Error::command_line(format!("{key}={} must hold finite numbers up to 1e12", xyz(v))))
}

/// Checks that a plane picture can have the field of view.
pub(super) fn checked_fov(degrees: f64) -> Result<f64> {
    if (MIN_FOV_DEGREES..=MAX_FOV_DEGREES).contains(&degrees) {
        return Ok(degrees);
    }
    Err(Error::command_line(format!(
        "fov={degrees} must be a vertical angle from {MIN_FOV_DEGREES} to {MAX_FOV_DEGREES} degrees"
    )))
}

/// A side of the object, which cameras see the whole of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// From the front (+Z), slightly above.
    #[default]
    Front,
    /// Between the front and the side (+X), slightly above.
    ThreeQuarter,
    /// From behind (-Z), slightly above.
    Back,
    /// Straight down.
    Top,
}

impl View {
    /// Direction from the object to the eye.
    pub fn direction(self) -> DVec3 {
        let (sin, cos) = DEFAULT_ELEVATION_DEGREES.to_radians().sin_cos();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        match self {
            Self::Front => DVec3::new(0.0, sin, cos),
            Self::ThreeQuarter => DVec3::new(half * cos, sin, half * cos),
            Self::Back => DVec3::new(0.0, sin, -cos),
            Self::Top => DVec3::Y,
        }
    }
}

/// Default for `up`: +Y, and for a vertical view the direction that a person sees who tilts the head from the front
/// (+Z).
pub(super) fn default_up(forward: DVec3) -> DVec3 {
    if forward.cross(DVec3::Y).length() < 1e-3 * forward.length() { upward_of(forward) } else { DVec3::Y }
}

/// An axis that points up in a picture along `forward`.
fn upward_of(forward: DVec3) -> DVec3 {
    let d = forward.abs();
    if d.y >= d.x.max(d.z) { DVec3::new(0.0, 0.0, forward.y.signum()) } else { DVec3::Y }
}

/// Centre of the bounding box of the triangles in mm, rounded to a few digits.
pub(super) fn centre_mm(mesh: &Mesh) -> DVec3 {
    let [min, max] = mesh.bounds_local_mm();
    rounded(mesh.origin_mm + 0.5 * (min + max), mesh.diagonal_mm())
}

/// The vector rounded to about 1e-4 of `scale`, so that a chosen camera reads well and can be typed again.
fn rounded(v: DVec3, scale: f64) -> DVec3 {
    let digits = 4.0 - scale.log10().floor();
    if !(-12.0..=18.0).contains(&digits) {
        return v;
    }
    // A power of ten is exact up to 22, so dividing by it gives the decimal nearest to the value.
    let factor = 10f64.powi(digits.abs() as i32);
    let round = |c: f64| {
        let short = if digits >= 0.0 { (c * factor).round() / factor } else { (c / factor).round() * factor };
        if short.is_finite() { short + 0.0 } else { c }
    };
    v.map(round)
}

fn unit(v: DVec3) -> Option<DVec3> {
    let largest = v.abs().max_element();
    (largest > 0.0 && largest.is_finite()).then(|| (v / largest).normalize())
}

/// Three numbers as they are typed.
pub(crate) fn xyz(v: DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}
