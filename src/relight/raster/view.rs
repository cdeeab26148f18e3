//! The view of a frame: camera, exposure and the quantity that is shown; and its form for the shaders.

use glam::{DVec2, DVec3, Mat4, Vec4};

use super::environment::level_of;
use crate::render::background::Background;
use crate::render::camera::{Camera, Resolution};
use crate::render::frame::Specular;
use crate::render::specular::Roughness;

/// Distance of the near plane, as a share of the object's diagonal.
const NEAREST: f64 = 1e-4;

/// Colours of the error view from none to the end of its scale, as they are shown (sRGB).
pub const ERROR_COLOURS: [[f32; 3]; 6] = [
    [0.05, 0.05, 0.25],
    [0.15, 0.30, 0.70],
    [0.10, 0.62, 0.62],
    [0.55, 0.78, 0.25],
    [0.98, 0.75, 0.15],
    [0.85, 0.15, 0.10],
];

/// The quantity that is shown of the object; shaders know it by its number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Look {
    /// The radiance towards the eye.
    #[default]
    Picture,
    /// Radiosity, shown as a white diffuse surface of this brightness.
    Radiosity,
    /// The error of the transport in false colours.
    Error,
}

/// The view of a frame, everything beside the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Size of the picture.
    pub resolution: Resolution,
    /// Factor on radiance.
    pub exposure: f64,
    /// Specular reflection.
    pub specular: Specular,
    /// The quantity that is shown.
    pub look: Look,
    /// The background beside the object.
    pub background: Background,
    /// Whether the texture multiplies the scattered light, where there is one.
    pub textured: bool,
    /// Whether the triangles' edges are drawn over the picture.
    pub wires: bool,
    /// The error that gets the last colour; none while it is unknown.
    pub worst_error: Option<f64>,
}

impl View {
    /// A view with the default settings.
    pub fn new(camera: Camera, resolution: Resolution, exposure: f64) -> Self {
        Self {
            camera,
            resolution,
            exposure,
            specular: Specular::default(),
            look: Look::default(),
            background: Background::default(),
            textured: true,
            wires: false,
            worst_error: None,
        }
    }
}

/// An environment's rotation and factor.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct EnvironmentUniform {
    pub(super) turn: [f32; 4],
    pub(super) scale: [f32; 4],
}

/// Number of environments that are reflected and visible, the first ones.
pub(super) const ENVIRONMENTS: usize = 4;

/// `View` as declared in the shaders.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct ViewUniform {
    clip_from_local: [[f32; 4]; 4],
    eye: [f32; 3],
    exposure: f32,
    right: [f32; 3],
    alpha: f32,
    upward: [f32; 3],
    level: f32,
    forward: [f32; 3],
    mode: u32,
    pub(super) constant: [f32; 3],
    pub(super) light_count: u32,
    pub(super) backdrop: [f32; 3],
    pub(super) environment_count: u32,
    diffuse: f32,
    specular: f32,
    encode: u32,
    backdrop_alpha: f32,
    error_scale: f32,
    error_known: u32,
    textured: u32,
    exponent: f32,
    colours: [[f32; 4]; 6],
    pub(super) environments: [EnvironmentUniform; ENVIRONMENTS],
}

impl ViewUniform {
    /// The uniform of a view; `origin_mm` is the mesh's origin, `bounds_mm` its bounding box in local coordinates.
    pub(super) fn new(view: &View, srgb: bool, origin_mm: DVec3, bounds_mm: [DVec3; 2]) -> Self {
        let Resolution { width, height } = view.resolution;
        let camera = &view.camera;
        let (size, forward) = (DVec2::new(width as f64, height as f64), camera.forward());
        // Offset in the plane at distance 1 in front of the eye.
        let offset = |pixel: DVec2| {
            let direction = camera.direction(pixel, view.resolution);
            direction / direction.dot(forward) - forward
        };
        let right = offset(DVec2::new(size.x, 0.5 * size.y));
        let upward = offset(DVec2::new(0.5 * size.x, 0.0));
        let eye = camera.at_mm() - origin_mm;
        let [min, max] = bounds_mm;
        let (centre, radius) = (0.5 * (min + max), 0.5 * (max - min).length());
        let near = ((eye - centre).length() - 1.01 * radius).max(2.0 * NEAREST * radius).max(1e-9);
        let rows = [right / right.length_squared(), upward / upward.length_squared(), forward];
        let translated = |row: DVec3| row.extend(-row.dot(eye)).as_vec4();
        // Reversed: the near plane is 1 and infinity 0, where floats are densest.
        let rows =
            [translated(rows[0]), translated(rows[1]), Vec4::new(0.0, 0.0, 0.0, near as f32), translated(rows[2])];
        let colour = |c: [f32; 3]| [c[0], c[1], c[2], 1.0];
        Self {
            clip_from_local: Mat4::from_cols_array_2d(&rows.map(|r| r.to_array())).transpose().to_cols_array_2d(),
            eye: eye.as_vec3().to_array(),
            exposure: finite(view.exposure),
            right: right.as_vec3().to_array(),
            alpha: view.specular.roughness().map_or(1.0, Roughness::alpha) as f32,
            upward: upward.as_vec3().to_array(),
            level: level_of(view.specular) as f32,
            forward: forward.as_vec3().to_array(),
            mode: view.look as u32,
            diffuse: 1.0,
            specular: if view.specular == Specular::Off { 0.0 } else { 1.0 },
            encode: u32::from(srgb),
            backdrop_alpha: match view.background {
                Background::Environment => 2.0,
                Background::None => 0.0,
                Background::Colour(_) => 1.0,
            },
            error_scale: view.worst_error.map_or(0.0, |e| finite(1.0 / e.max(1e-12))),
            error_known: u32::from(view.worst_error.is_some()),
            textured: u32::from(view.textured),
            exponent: match view.specular {
                Specular::BlinnPhong(exponent) => exponent.value() as f32,
                Specular::Off | Specular::Rough(_) => 0.0,
            },
            colours: ERROR_COLOURS.map(colour),
            ..Self::default()
        }
    }
}

/// The nearest finite number of 32 bits.
pub(super) fn finite(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

/// A colour in single precision, cut to finite values.
pub(super) fn finite3(value: DVec3) -> [f32; 3] {
    value.to_array().map(finite)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn points_land_where_the_camera_shows_them() {
        let resolution = Resolution::new(640, 480).unwrap();
        let origin = DVec3::new(5.0, -3.0, 100.0);
        let camera = Camera::new(origin + DVec3::new(4.0, 8.0, 75.0), origin, DVec3::Y, 28.0).unwrap();
        let view = View::new(camera, resolution, 1.0);
        let bounds = [DVec3::splat(-10.0), DVec3::splat(10.0)];
        let uniform = ViewUniform::new(&view, false, origin, bounds);
        let matrix = Mat4::from_cols_array_2d(&uniform.clip_from_local);
        let mut depths = Vec::new();
        for local in [DVec3::ZERO, DVec3::splat(9.0), DVec3::new(-7.0, 3.0, 5.0)] {
            let clip = matrix * local.extend(1.0).as_vec4();
            let expected = camera.project(origin + local, resolution).unwrap();
            let x = 0.5 * (1.0 + f64::from(clip.x / clip.w)) * 640.0;
            let y = 0.5 * (1.0 - f64::from(clip.y / clip.w)) * 480.0;
            assert!((DVec2::new(x, y) - expected.pixel).length() < 1e-3, "{x} {y} {expected:?}");
            assert!(clip.z > 0.0 && clip.z < clip.w);
            depths.push((expected.depth_mm, clip.z / clip.w));
        }
        depths.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert!(depths.is_sorted_by(|a, b| a.1 > b.1), "{depths:?}");
    }
}
