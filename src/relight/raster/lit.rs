//! Lights as the shaders read them: lamps for highlights, environments as textures.

use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::environment::{LEVELS, LatLongImage, MAX_BACKDROP_WIDTH, MAX_PACKED, blurred, packed, resized};
use super::memory::{Level, layered};
use super::shadows::SHADOWED;
use super::view::{ENVIRONMENTS, EnvironmentUniform, finite, finite3};
use crate::evaluate::device::Device;
use crate::light::Light;
use crate::light::environment::EnvironmentMap;
use crate::render::highlight::{Highlight, HighlightShape};

/// Number of points along each edge that represent a rectangle.
const POINTS_PER_EDGE: usize = 3;

/// A light that makes highlights.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Lamp {
    to: [f32; 4],
    power: [f32; 4],
    normal: [f32; 4],
    cone: [f32; 4],
}

/// Highlights of the directional, point, spot and area lights.
pub(super) fn lamps(lights: &[Light], origin_mm: DVec3) -> Vec<Lamp> {
    let with = |v: [f32; 3], w: f32| [v[0], v[1], v[2], w];
    let mut slot = 0;
    let mut out = Vec::new();
    for light in lights {
        let shadow = if light.is_sharp() && slot < SHADOWED { slot as f32 } else { -1.0 };
        slot += usize::from(light.is_sharp());
        let mut lamp = |to: DVec3, is_place: f32, power: DVec3, normal: [f32; 4]| {
            out.push(Lamp {
                to: with(finite3(to), is_place),
                power: with(finite3(power), shadow),
                normal,
                cone: [0.0; 4],
            });
        };
        match light {
            Light::Directional { from, irradiance } => lamp(*from, 0.0, *irradiance, [0.0; 4]),
            Light::Area { at_mm, normal, u, size_mm, radiance, .. } => {
                let (first, second) = (*u * size_mm[0], normal.cross(*u) * size_mm[1]);
                let share = size_mm[0] * size_mm[1] / (POINTS_PER_EDGE * POINTS_PER_EDGE) as f64;
                let middle = |i: usize| (i as f64 + 0.5) / POINTS_PER_EDGE as f64 - 0.5;
                for (a, b) in (0..POINTS_PER_EDGE).flat_map(|a| (0..POINTS_PER_EDGE).map(move |b| (a, b))) {
                    let point = *at_mm + first * middle(a) + second * middle(b) - origin_mm;
                    lamp(point, 1.0, *radiance * share, with(finite3(*normal), 1.0));
                }
            }
            Light::Point { .. } | Light::Spot { .. } => {
                let Some((at_mm, intensity, falloff)) = light.from_place() else { continue };
                let [edge, full] = falloff.versines();
                lamp(
                    at_mm - origin_mm,
                    1.0,
                    intensity,
                    with(finite3(falloff.axis), if falloff.is_none() { 0.0 } else { 2.0 }),
                );
                if let Some(lamp) = out.last_mut() {
                    lamp.cone = [edge, full, 0.0, 0.0];
                }
            }
            Light::Constant { .. } | Light::Environment { .. } => {}
        }
    }
    out
}

/// Sum of the constant lights.
pub(super) fn constant(lights: &[Light]) -> DVec3 {
    let radiance = |light: &Light| if let Light::Constant { radiance } = light { *radiance } else { DVec3::ZERO };
    lights.iter().map(radiance).sum()
}

/// The environments among the lights that the shaders handle.
fn environments(lights: &[Light]) -> Vec<(&Arc<EnvironmentMap>, f64, DVec3)> {
    let environment = |light| match light {
        &Light::Environment { ref map, rotate_degrees, scale } => Some((map, rotate_degrees, scale)),
        _ => None,
    };
    lights.iter().filter_map(environment).take(ENVIRONMENTS).collect()
}

/// Textures of the environments, renewed only when the pictures change.
pub(super) struct Environments {
    maps: Vec<Arc<EnvironmentMap>>,
    /// Shape of the highlights that they are blurred for.
    pub(super) shape: HighlightShape,
    /// Factors on the textures' values.
    scales: Vec<f64>,
    pub(super) glossy: wgpu::TextureView,
    pub(super) backdrop: wgpu::TextureView,
}

impl Environments {
    /// The textures of some environments; black ones without any.
    pub(super) fn of(device: &Device, maps: Vec<Arc<EnvironmentMap>>, shape: HighlightShape) -> Self {
        let limit = device.device.limits().max_texture_dimension_2d as usize;
        let widest = maps.iter().map(|m| m.width()).max().unwrap_or(2).next_power_of_two();
        let width = widest.clamp(2, MAX_BACKDROP_WIDTH.min(limit));
        let brightest = |m: &Arc<EnvironmentMap>| {
            let largest = f64::from(m.pixels().iter().flatten().fold(0.0f32, |a, b| a.max(*b)));
            // A sun stays as bright as it is as long as the rest keeps its digits.
            (largest / MAX_PACKED).max(1.0).log2().ceil().exp2()
        };
        let scales: Vec<f64> = maps.iter().map(brightest).collect();
        let black = |width: usize| LatLongImage { width, pixels: vec![DVec3::ZERO; width * (width / 2).max(1)] };
        let mut glossy: Vec<Vec<LatLongImage>> = maps.iter().map(|m| blurred(m, shape)).collect();
        let mut backdrop: Vec<Vec<LatLongImage>> = maps.iter().map(|m| vec![resized(m, width)]).collect();
        if maps.is_empty() {
            glossy.push((0..LEVELS).map(|l| black(64 >> l)).collect());
            backdrop.push(vec![black(width)]);
        }
        let layer_scales = if scales.is_empty() { vec![1.0] } else { scales.clone() };
        let glossy = texture(device, "glossy environment", &glossy, &layer_scales);
        let backdrop = texture(device, "background", &backdrop, &layer_scales);
        Self { maps, shape, scales, glossy, backdrop }
    }

    /// Brings the textures up to date with the lights and with the shape of highlights; returns whether they were replaced.
    pub(super) fn update(&mut self, device: &Device, lights: &[Light], shape: HighlightShape) -> bool {
        let now = environments(lights);
        let same = shape == self.shape
            && now.len() == self.maps.len()
            && now.iter().zip(&self.maps).all(|((a, ..), b)| Arc::ptr_eq(a, b));
        if !same {
            *self = Self::of(device, now.iter().map(|(map, ..)| Arc::clone(map)).collect(), shape);
        }
        !same
    }

    /// Rotations and factors of the environments.
    pub(super) fn uniforms(&self, lights: &[Light]) -> ([EnvironmentUniform; ENVIRONMENTS], u32) {
        let mut out = [EnvironmentUniform::default(); ENVIRONMENTS];
        let now = environments(lights);
        for ((out, (_, degrees, scale)), factor) in out.iter_mut().zip(&now).zip(&self.scales) {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let [r, g, b] = (*scale * *factor).to_array().map(finite);
            *out = EnvironmentUniform { turn: [cos as f32, sin as f32, 0.0, 0.0], scale: [r, g, b, 0.0] };
        }
        (out, now.len().min(self.maps.len()) as u32)
    }
}

/// A texture array of one layer for each environment, with the levels of each.
fn texture(device: &Device, label: &str, layers: &[Vec<LatLongImage>], scales: &[f64]) -> wgpu::TextureView {
    let level = |picture: &LatLongImage, scale: f64| Level {
        width: picture.width,
        height: picture.height(),
        texels: picture.pixels.iter().map(|p| packed(*p / scale).to_ne_bytes()).collect(),
    };
    let of_layer = |(pictures, scale): (&Vec<LatLongImage>, &f64)| pictures.iter().map(|p| level(p, *scale)).collect();
    let layers: Vec<Vec<Level>> = layers.iter().zip(scales).map(of_layer).collect();
    layered(device, label, wgpu::TextureFormat::Rgb9e5Ufloat, &layers)
}

/// Steps of the table of [`albedos`].
pub(super) const ALBEDO_STEPS: usize = 32;

/// Share of uniform light that a boundary reflects, at cosines from 0 to 1.
pub(super) fn albedos(highlight: Option<Highlight>) -> [f32; ALBEDO_STEPS] {
    const SIDE: u32 = 24;
    let Some(highlight) = highlight else { return [0.0; ALBEDO_STEPS] };
    let place = |k: u32| (f64::from(k) + 0.5) / f64::from(SIDE);
    std::array::from_fn(|step| {
        let cos = (step as f64 / (ALBEDO_STEPS - 1) as f64).max(1e-3);
        let eye = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
        let reflected = |i: u32| {
            let facet = DVec2::new(place(i % SIDE), place(i / SIDE));
            highlight.sample(DVec3::Z, eye, facet).map_or(0.0, |reflected| reflected.weight)
        };
        ((0..SIDE * SIDE).map(reflected).sum::<f64>() / f64::from(SIDE * SIDE)) as f32
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::render::blinn_phong::Exponent;
    use crate::render::frame::Specular;
    use crate::render::specular::Roughness;

    fn rough(roughness: f64) -> Specular {
        Specular::Rough(Roughness::new(roughness).unwrap())
    }

    fn power(exponent: f64) -> Specular {
        Specular::BlinnPhong(Exponent::new(exponent).unwrap())
    }

    #[test]
    fn a_smooth_boundary_reflects_what_fresnel_says_and_none_without_a_step() {
        // A power loses what its facets' G = cos_i cos_o takes.
        for (specular, slant) in [(rough(0.0), 0), (power(1e4), 2)] {
            let smooth = albedos(specular.highlight(1.5));
            for (step, value) in smooth.iter().enumerate().skip(2) {
                let cos = step as f64 / (ALBEDO_STEPS - 1) as f64;
                let expected = (1.0 - crate::medium::fresnel::transmittance(1.5, cos)) * cos.powi(slant);
                assert!((f64::from(*value) - expected).abs() < 0.01 * expected + 1e-3, "{cos}: {value} {expected}");
            }
        }
        assert_eq!(albedos(rough(0.5).highlight(1.0)), [0.0; ALBEDO_STEPS]);
        for specular in [rough(0.1), rough(0.3), rough(1.0), power(1.0), power(30.0)] {
            assert!(albedos(specular.highlight(1.3)).iter().all(|a| (0.0..=1.0).contains(a)), "{specular:?}");
        }
    }

    #[test]
    fn lamps_hold_the_power_of_their_light() {
        let area =
            Light::area(DVec3::new(0.0, 40.0, 0.0), DVec3::NEG_Y, [20.0, 10.0], DVec3::splat(5.0), None).unwrap();
        let sun = Light::directional(DVec3::Y, DVec3::ONE).unwrap();
        let found = lamps(&[area, sun.clone(), sun], DVec3::ZERO);
        assert_eq!(found.len(), POINTS_PER_EDGE * POINTS_PER_EDGE + 2);
        let sum: f32 = found.iter().filter(|l| l.normal[3] == 1.0).map(|l| l.power[0]).sum();
        assert!((sum - 1000.0).abs() < 1e-2);
        assert_eq!([found[9].power[3], found[10].power[3]], [0.0, 1.0]);
    }
}
