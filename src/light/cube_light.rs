//! Light from far away as a cube map: the mean radiance of every texel, as Haar coefficients that rows multiply.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::Light;
use super::environment::{EnvironmentMap, Rotation};
use crate::error::{Error, Result};
use crate::math::cube_map::{FACES, solid_angles_sr, texel_of};
use crate::math::haar::Haar;
use crate::parallel::*;

/// Pieces of a pixel are at most this fraction of a texel wide.
const PIECES_PER_TEXEL: usize = 16;

/// Rows of a map that are summed together, so that sums do not depend on the number of threads.
const BANDS: usize = 16;

/// Haar transform of light and transport over a cube map; their dot product is the same in both variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Transform {
    /// Orthonormal on the sphere: both times the square root of the texels' solid angles, which weight the transform.
    SolidAngle,
    /// Orthonormal on the texels (Ng et al. 2003; Wang, Tran & Luebke 2005): the transport times the solid angles, the light as
    /// it is.
    Texels,
}

impl Transform {
    fn haar(self, side: usize) -> Result<(Haar, Vec<f64>)> {
        let fits = side.is_power_of_two() && side <= MOST_SIDE;
        let angles = if fits { solid_angles_sr(side) } else { Vec::new() };
        let weights = match self {
            Self::SolidAngle => angles.clone(),
            Self::Texels => vec![1.0; angles.len()],
        };
        let haar = Haar::new(side, &weights).ok_or_else(|| {
            Error::unsupported(format!("cube maps have 1, 2, 4, ... {MOST_SIDE} texels along an edge, not {side}"))
        })?;
        Ok((haar, angles))
    }

    /// The transform of a face's picture of transport (means over texels), and the factor on each texel before it.
    ///
    /// # Errors
    /// Another side than a power of two (exit 5).
    pub fn of_transport(self, side: usize) -> Result<(Haar, Vec<f32>)> {
        let (haar, angles) = self.haar(side)?;
        let factor = |angle: f64| if self == Self::SolidAngle { angle.sqrt() } else { angle };
        Ok((haar, angles.into_iter().map(|angle| factor(angle) as f32).collect()))
    }

    /// The transform of a face's picture of radiance, and the factor on each texel before it.
    fn of_light(self, side: usize) -> Result<(Haar, Vec<f64>)> {
        let (haar, angles) = self.haar(side)?;
        let factor = |angle: f64| if self == Self::SolidAngle { angle.sqrt() } else { 1.0 };
        Ok((haar, angles.into_iter().map(factor).collect()))
    }
}

/// Texels along an edge at most.
const MOST_SIDE: usize = 256;

/// Mean radiance of the texels of a cube map.
#[derive(Clone, Debug, PartialEq)]
pub struct CubeLight {
    side: usize,
    /// Mean radiance, RGB, texel by texel.
    radiance: Vec<DVec3>,
    /// Haar coefficients of radiance in the transform asked for, over `scale`; the fourth number is 0.
    coefficients: Vec<[f32; 4]>,
    scale: f64,
}

impl CubeLight {
    /// The cube map of a constant, directional or environment light in [`Transform::SolidAngle`].
    ///
    /// Every pixel's energy is conserved: it is cut in pieces, and each piece goes to one texel.
    ///
    /// # Errors
    /// A point or area light, or another side (exit 5).
    pub fn new(light: &Light, side: usize) -> Result<Self> {
        Self::transformed(light, side, Transform::SolidAngle)
    }

    /// The cube map in a given transform; parallel light fills its texel evenly.
    ///
    /// # Errors
    /// A light at a distance, or another side (exit 5).
    pub fn transformed(light: &Light, side: usize, transform: Transform) -> Result<Self> {
        let (haar, factors) = transform.of_light(side)?;
        let angles = solid_angles_sr(side);
        let radiance = match light {
            Light::Constant { radiance } => vec![*radiance; FACES * side * side],
            Light::Environment { map, rotate_degrees, scale } => {
                let turned = (map.as_ref(), Rotation::from_degrees(*rotate_degrees));
                let add = |sum: &mut DVec3, energy| *sum += energy;
                let mut sums = sums_of_texels(turned, (side, PIECES_PER_TEXEL), |sum, energy, _| add(sum, energy), add);
                sums.iter_mut().zip(angles.iter().cycle()).for_each(|(sum, angle)| *sum *= *scale / *angle);
                sums
            }
            Light::Directional { from, irradiance } => {
                let texel = texel_of(side, *from);
                let mut radiance = vec![DVec3::ZERO; FACES * side * side];
                radiance[texel] = *irradiance / angles[texel % (side * side)];
                radiance
            }
            _ => return Err(Error::unsupported("point and area lights are not far away and no cube maps")),
        };
        let scale = radiance.iter().map(|r| r.max_element()).fold(0.0, f64::max);
        let mut coefficients = vec![[0.0; 4]; FACES * side * side];
        let (mut face, mut scratch) = (vec![0.0f32; side * side], vec![0.0f32; side * side]);
        for (texels, out) in radiance.chunks_exact(side * side).zip(coefficients.chunks_exact_mut(side * side)) {
            for channel in (0..3).filter(|_| scale > 0.0) {
                for ((value, texel), factor) in face.iter_mut().zip(texels).zip(&factors) {
                    *value = (texel[channel] / scale * factor) as f32;
                }
                haar.forward(&mut face, &mut scratch);
                out.iter_mut().zip(&face).for_each(|(out, value)| out[channel] = *value);
            }
        }
        Ok(Self { side, radiance, coefficients, scale })
    }

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Mean radiance of every texel, RGB, in the order of [`crate::math::cube_map`].
    pub fn radiance(&self) -> &[DVec3] {
        &self.radiance
    }

    /// Haar coefficients of every face (see [`Haar`]) of radiance, in the transform asked for, over [`CubeLight::scale`]: R, G, B,
    /// 0.
    pub fn coefficients(&self) -> &[[f32; 4]] {
        &self.coefficients
    }

    /// Largest radiance of a texel.
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

/// Sums of the light of a map over the texels of a cube map. Pixels are cut into pieces that are a fraction of a texel wide,
/// `pieces` of them to one; `add` takes the energy of each and its direction, `join` adds up the sums of several rows.
pub(super) fn sums_of_texels<T: Copy + Default + Send>(
    (map, rotation): (&EnvironmentMap, Rotation),
    (side, pieces): (usize, usize),
    add: impl Fn(&mut T, DVec3, DVec3) + Sync,
    join: impl Fn(&mut T, T),
) -> Vec<T> {
    let (width, height) = (map.width(), map.height());
    let (across, down) = ((4 * side * pieces).div_ceil(width), (2 * side * pieces).div_ceil(height));
    let columns = columns(width * across, rotation);
    let band = |index: usize| {
        let mut sums = vec![T::default(); FACES * side * side];
        for row in index * height / BANDS..(index + 1) * height / BANDS {
            for piece in 0..down {
                let step = PI / (height * down) as f64;
                let (sin, cos) = (((row * down + piece) as f64 + 0.5) * step).sin_cos();
                let angle = TAU / (width * across) as f64 * 2.0 * sin * (0.5 * step).sin();
                for (x, pieces) in columns.chunks_exact(across).enumerate() {
                    let energy = map.pixel(x, row) * angle;
                    for &(dx, dz) in pieces.iter().filter(|_| energy != DVec3::ZERO) {
                        let direction = DVec3::new(sin * dx, cos, sin * dz);
                        add(&mut sums[texel_of(side, direction)], energy, direction);
                    }
                }
            }
        }
        sums
    };
    let bands: Vec<Vec<T>> = (0..BANDS).into_par_iter().map(band).collect();
    let mut total = vec![T::default(); FACES * side * side];
    for sums in bands {
        total.iter_mut().zip(sums).for_each(|(total, sum)| join(total, sum));
    }
    total
}

/// `x` and `z` of the turned horizontal directions of `count` columns around an environment map.
fn columns(count: usize, rotation: Rotation) -> Vec<(f64, f64)> {
    let column = |i: usize| {
        let longitude = TAU * (0.5 - (i as f64 + 0.5) / count as f64);
        let turned = rotation.to_world(DVec3::new(longitude.sin(), 0.0, longitude.cos()));
        (turned.x, turned.z)
    };
    (0..count).map(column).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::light::sky::sky;
    use crate::math::cube_map::direction;

    fn energy(light: &CubeLight) -> DVec3 {
        light.radiance.iter().zip(solid_angles_sr(light.side).iter().cycle()).map(|(r, a)| *r * *a).sum()
    }

    #[test]
    fn energy_is_conserved() {
        let one = EnvironmentMap::new(1, 1, vec![[1.0, 2.0, 3.0]]).unwrap();
        let mut spot = vec![[0.0; 3]; 64 * 32];
        spot[9 * 64 + 41] = [9e5, 8e5, 7e5];
        for map in [sky(), one, EnvironmentMap::new(64, 32, spot).unwrap()] {
            let expected = map.energy() * DVec3::new(2.0, 1.0, 0.5);
            let light = Light::environment(Arc::new(map), 33.0, DVec3::new(2.0, 1.0, 0.5)).unwrap();
            let found = energy(&CubeLight::new(&light, 32).unwrap());
            assert!(((found - expected) / expected).abs().max_element() < 1e-12, "{found} {expected}");
        }
    }

    #[test]
    fn texels_have_the_radiance_of_the_map() {
        let map = Arc::new(sky());
        for degrees in [0.0, 90.0, 211.0] {
            let light = Light::environment(map.clone(), degrees, DVec3::ONE).unwrap();
            let cube = CubeLight::new(&light, 32).unwrap();
            let rotation = Rotation::from_degrees(degrees);
            let (mut error, mut total) = (0.0, 0.0);
            for (i, radiance) in cube.radiance().iter().enumerate() {
                let exact = map.radiance_bilinear(rotation.to_map(direction(32, i / 1024, i % 32, i / 32 % 32)));
                // Away from the sun the sky is smooth.
                if exact.max_element() < 5.0 && radiance.max_element() < 5.0 {
                    error += (*radiance - exact).length();
                    total += exact.length();
                }
            }
            assert!(error < 0.06 * total, "{degrees}: {}", error / total);
        }
    }

    #[test]
    fn constant_light_has_six_coefficients_and_others_are_refused() {
        let cube = CubeLight::new(&Light::constant(DVec3::new(3.0, 1.0, 0.0)).unwrap(), 32).unwrap();
        let lit = cube.coefficients().iter().enumerate().filter(|(_, c)| c[0].abs() > 1e-6);
        assert_eq!(lit.map(|(i, _)| i).collect::<Vec<_>>(), [0, 1024, 2048, 3072, 4096, 5120]);
        assert_eq!(cube.scale(), 3.0);
        let dark = CubeLight::new(&Light::constant(DVec3::ZERO).unwrap(), 4).unwrap();
        assert!(dark.coefficients().iter().flatten().all(|c| *c == 0.0));
        let sun = CubeLight::new(&Light::directional(DVec3::Y, DVec3::ONE).unwrap(), 32).unwrap();
        assert!((energy(&sun) - DVec3::ONE).length() < 1e-12);
        let lamp = Light::point(DVec3::Y, DVec3::ONE).unwrap();
        assert_eq!(CubeLight::new(&lamp, 32).map(|_| ()).unwrap_err().code(), crate::error::ExitCode::Unsupported);
        for side in [0, 3, 512, usize::MAX] {
            assert!(CubeLight::new(&Light::constant(DVec3::ONE).unwrap(), side).is_err());
        }
    }
}
