//! The set of lights and the interpolation of other lights from it.

use glam::DVec3;

use super::settings::LightSetSettings;
use crate::compress::prediction::Net;
use crate::error::{Error, Result};
use crate::geometry::scattered::OrientedPoint;
use crate::light::quantised::directions::DirectionSet;
use crate::light::quantised::distances::{Blend, DistanceSet, QuantisedLights};
use crate::light::quantised::interpolation::{Interpolator, Scheme};
use crate::light::quantised::vector::{light_vector, pieces};
use crate::light::{Light, refuse_fields};
use crate::math::cube_map::{direction, texel_of};
use crate::math::sphere::unit;
use crate::scene::Scene;
use crate::transport::receivers::Sphere;

/// A set with its interpolation.
pub struct LightSet {
    /// The lights: directions on shells.
    pub lights: QuantisedLights,
    /// Interpolation between the directions.
    pub interpolator: Interpolator,
}

impl LightSet {
    /// Shells around the scene; `inverse` are its radius over their distances, from 0.
    ///
    /// # Errors
    /// Numbers out of range.
    pub fn new(scene: &Scene, directions: usize, inverse: Vec<f64>, (scheme, blend): (Scheme, Blend)) -> Result<Self> {
        let (centre_mm, radius_mm) = sphere(scene);
        let directions = DirectionSet::new(lattice(directions)?)?;
        let shells = match inverse.len() {
            0 | 1 => DistanceSet::new(centre_mm, radius_mm, vec![0.0], Blend::Linear)?,
            _ => DistanceSet::new(centre_mm, radius_mm, inverse, blend)?,
        };
        let interpolator = Interpolator::new(&directions, scheme)?;
        Ok(Self { lights: QuantisedLights { directions, shells }, interpolator })
    }

    /// The same with the shells of the settings.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn planned(scene: &Scene, directions: usize, settings: &LightSetSettings) -> Result<Self> {
        let (centre_mm, radius_mm) = sphere(scene);
        let inverse = match settings.shells {
            0 => vec![0.0],
            count => DistanceSet::spread(centre_mm, radius_mm, count + 1, settings.nearest, settings.blend)?
                .inverse()
                .to_vec(),
        };
        Self::new(scene, directions, inverse, (settings.scheme, settings.blend))
    }

    /// Weights of the lights of the set, RGB, for several lights together.
    ///
    /// # Errors
    /// Unsupported: lights near the scene where the set has none, source fields.
    pub fn vector(&self, lights: &[Light]) -> Result<Vec<DVec3>> {
        let mut sum = vec![DVec3::ZERO; self.lights.count()];
        for light in lights {
            self.check(light)?;
            let vector = light_vector(&self.lights, &self.interpolator, light)?;
            sum.iter_mut().zip(vector).for_each(|(sum, value)| *sum += value);
        }
        Ok(sum)
    }

    /// The same before interpolation: for each shell, sums of the functions behind the interpolator's weights.
    pub(crate) fn function_sums(&self, lights: &[Light]) -> Result<Vec<[Vec<f64>; 3]>> {
        Ok(self.pieces(lights)?.iter().map(|shell| self.interpolator.function_sums(shell)).collect())
    }

    /// Several lights as parallel light and point lights on the shells: pairs of unit direction and irradiance, by shell.
    ///
    /// # Errors
    /// As [`Self::vector`]; lights too bright for double precision.
    pub fn pieces(&self, lights: &[Light]) -> Result<Vec<Vec<(DVec3, DVec3)>>> {
        let mut all = vec![Vec::new(); self.lights.shells.inverse().len()];
        for light in lights {
            self.check(light)?;
            let own = pieces(&self.lights, light)?;
            all.iter_mut().zip(own).for_each(|(all, own)| {
                all.extend(own.into_iter().map(|(direction, irradiance)| (unit(direction), irradiance)));
            });
        }
        match all.iter().flatten().all(|(_, irradiance)| irradiance.is_finite()) {
            true => Ok(all),
            false => Err(Error::runtime("the light is too bright for double precision; make it weaker")),
        }
    }

    fn check(&self, light: &Light) -> Result<()> {
        refuse_fields(std::slice::from_ref(light))?;
        match (light, self.lights.shells.inverse().len()) {
            (Light::Point { .. } | Light::Spot { .. } | Light::Area { .. }, 1) => Err(Error::unsupported(
                "this asset has parallel light only: bake it --for-lights point (or area) for others",
            )),
            _ => Ok(()),
        }
    }
}

/// Parallel light from so many directions all around.
///
/// # Errors
/// A number of directions out of range.
pub(crate) fn parallel(scene: &Scene, count: usize) -> Result<QuantisedLights> {
    let (centre_mm, radius_mm) = sphere(scene);
    let shells = DistanceSet::new(centre_mm, radius_mm, vec![0.0], Blend::Linear)?;
    Ok(QuantisedLights { directions: DirectionSet::new(lattice(count)?)?, shells })
}

/// Texels along an edge of the cube map that visibility is decided on.
pub(crate) const SIDE: usize = 64;

/// The net over the directions of a set.
pub(crate) fn light_net(set: &DirectionSet, spacing: f64) -> Net {
    let point = |d: &DVec3| OrientedPoint { at_mm: *d, normal: DVec3::ZERO };
    let points: Vec<OrientedPoint> = set.directions().iter().map(point).collect();
    Net::new(&points, std::slice::from_ref(&(0..points.len())), spacing)
}

/// Spacing at which every direction of a set is in its net.
pub(crate) fn light_spacing(set: &DirectionSet) -> f64 {
    let nearest = |d: &DVec3| set.nearest(*d, 2).get(1).map_or(1.0, |n| 2.0 * (0.5 * n.angle).sin());
    0.5 * set.directions().iter().map(nearest).fold(f64::MAX, f64::min)
}

/// The spherical Fibonacci lattice, each direction moved to the centre of its texel of a cube map (0.7 degrees at most),
/// where visibility of all directions is decided at once.
fn lattice(count: usize) -> Result<Vec<DVec3>> {
    let set = DirectionSet::fibonacci(count)?;
    let centre = |d: &DVec3| {
        let texel = texel_of(SIDE, *d);
        let (face, rest) = (texel / (SIDE * SIDE), texel % (SIDE * SIDE));
        direction(SIDE, face, rest % SIDE, rest / SIDE)
    };
    Ok(set.directions().iter().map(centre).collect())
}

/// Centre and radius, mm, of a sphere around the surfaces that light enters, without those that only cast shadows.
fn sphere(scene: &Scene) -> (DVec3, f64) {
    let transfers = |part: u32| scene.parts.parts.get(part as usize).is_some_and(|p| p.transfers());
    let mesh = &scene.mesh;
    let triangles = mesh.triangles.iter().zip(&scene.parts.triangle_part).filter(|(_, part)| transfers(**part));
    let points: Vec<DVec3> =
        triangles.flat_map(|(t, _)| t.map(|v| mesh.local_mm[v as usize].as_dvec3() + mesh.origin_mm)).collect();
    let sphere = Sphere::around(&points);
    (sphere.centre_mm, sphere.radius_mm.max(f64::MIN_POSITIVE))
}
