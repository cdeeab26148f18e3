//! The set of lights and how others are made of it.

use std::collections::BTreeMap;

use glam::DVec3;

use super::encoding::{Choices, Integral};
use super::{BLEND, INTERPOLATION, LIGHTS, NEAREST, SHELLS, SPACING};
use crate::compress::prediction::Net;
use crate::error::{Error, Result};
use crate::geometry::scattered::OrientedPoint;
use crate::light::quantised::directions::DirectionSet;
use crate::light::quantised::distances::{Blend, DistanceSet, QuantisedLights};
use crate::light::quantised::interpolation::{Interpolator, Scheme};
use crate::light::quantised::vector::{light_vector, pieces};
use crate::light::{Light, LightKind, refuse_fields};
use crate::math::cube_map::{direction, texel_of};
use crate::math::sphere::unit;
use crate::methods::settings::number;
use crate::transport::receivers::Sphere;
use crate::transport::scene::Scene;

/// Shells of point lights unless they are asked for.
const DEFAULT_SHELLS: usize = 3;

/// What the keys say.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    /// Directions; as many as the error asks for.
    pub(super) directions: Option<usize>,
    pub(super) scheme: Scheme,
    pub(super) blend: Blend,
    /// Shells beside infinity.
    pub(super) shells: usize,
    /// Bounding radius over the distance of the nearest shell.
    pub(super) nearest: f64,
    /// Between reference points, mm.
    pub(super) spacing_mm: Option<f64>,
    /// What is stored.
    pub(super) choices: Choices,
}

impl Plan {
    pub(super) fn new(
        values: &BTreeMap<String, String>,
        kinds: &std::collections::BTreeSet<LightKind>,
    ) -> Result<Self> {
        let is_auto = |key: &str| values.get(key).is_none_or(|text| text == "auto");
        let near = kinds.contains(&LightKind::Point) || kinds.contains(&LightKind::Area);
        let shells = match is_auto(SHELLS.name) {
            true => DEFAULT_SHELLS * usize::from(near),
            false => number(values, &SHELLS, 0..=16)?,
        };
        let directions = match is_auto(LIGHTS.name) {
            true => None,
            false => Some(number(values, &LIGHTS, 16..=2048)?),
        };
        let spacing_mm = match is_auto(SPACING.name) {
            true => None,
            false => Some(number(values, &SPACING, 1e-6..=1e6)?),
        };
        let (scheme, blend) = (scheme(values)?, blend(values)?);
        let choices = Choices::new(values)?;
        if choices.integral == Integral::Vector && shells > 0 {
            return Err(Error::command_line(
                "--set integral=vector: vectors are for parallel light alone; add --set shells=0 (or --for-lights without point and \
                 area)",
            ));
        }
        if let (Some(order), Some(count)) = (choices.order, directions)
            && order * order > count
        {
            return Err(Error::command_line(format!(
                "--set order={order}: {} harmonics need as many directions at least; --set lights={count} gives fewer",
                order * order
            )));
        }
        let nearest = 1.0 / number(values, &NEAREST, 1.05..=100.0)?;
        Ok(Self { directions, scheme, blend, shells, nearest, spacing_mm, choices })
    }
}

/// The interpolation that was asked for.
pub(super) fn scheme(values: &BTreeMap<String, String>) -> Result<Scheme> {
    let text = values.get(INTERPOLATION.name).map_or(INTERPOLATION.default, String::as_str);
    Scheme::ALL.into_iter().find(|s| s.name() == text).ok_or_else(|| {
        let names: Vec<&str> = Scheme::ALL.iter().map(|s| s.name()).collect();
        Error::command_line(format!("--set interpolation={text}: it is one of {}", names.join(", ")))
    })
}

/// What was asked for between distances.
pub(super) fn blend(values: &BTreeMap<String, String>) -> Result<Blend> {
    match values.get(BLEND.name).map_or(BLEND.default, String::as_str) {
        "polynomial" => Ok(Blend::Polynomial),
        "linear" => Ok(Blend::Linear),
        other => Err(Error::command_line(format!("--set blend={other}: it is polynomial or linear"))),
    }
}

/// A set with its interpolation.
pub(super) struct LightSet {
    pub(super) lights: QuantisedLights,
    pub(super) interpolator: Interpolator,
}

impl LightSet {
    /// Shells around the scene; `inverse` are its radius over their distances, from 0.
    pub(super) fn new(
        scene: &Scene,
        directions: usize,
        inverse: Vec<f64>,
        (scheme, blend): (Scheme, Blend),
    ) -> Result<Self> {
        let (centre_mm, radius_mm) = sphere(scene);
        let directions = DirectionSet::new(lattice(directions)?)?;
        let shells = match inverse.len() {
            0 | 1 => DistanceSet::parallel(centre_mm, radius_mm)?,
            _ => DistanceSet::new(centre_mm, radius_mm, inverse, blend)?,
        };
        let interpolator = Interpolator::new(&directions, scheme)?;
        Ok(Self { lights: QuantisedLights { directions, shells }, interpolator })
    }

    /// The same with as many shells as were planned.
    pub(super) fn planned(scene: &Scene, directions: usize, plan: &Plan) -> Result<Self> {
        let (centre_mm, radius_mm) = sphere(scene);
        let inverse = match plan.shells {
            0 => vec![0.0],
            count => DistanceSet::spread(centre_mm, radius_mm, count + 1, plan.nearest, plan.blend)?.inverse().to_vec(),
        };
        Self::new(scene, directions, inverse, (plan.scheme, plan.blend))
    }

    /// Weights of the lights of the set, RGB, for several lights together.
    pub(super) fn vector(&self, lights: &[Light]) -> Result<Vec<DVec3>> {
        let mut sum = vec![DVec3::ZERO; self.lights.count()];
        for light in lights {
            self.check(light)?;
            let vector = light_vector(&self.lights, &self.interpolator, light)?;
            sum.iter_mut().zip(vector).for_each(|(sum, value)| *sum += value);
        }
        Ok(sum)
    }

    /// The same before it is interpolated: for each shell, sums of the functions that the interpolator's weights are linear in.
    pub(super) fn function_sums(&self, lights: &[Light]) -> Result<Vec<[Vec<f64>; 3]>> {
        Ok(self.pieces(lights)?.iter().map(|shell| self.interpolator.function_sums(shell)).collect())
    }

    /// Several lights as parallel light and point lights on the shells: pairs of unit direction and irradiance, by shell.
    pub(super) fn pieces(&self, lights: &[Light]) -> Result<Vec<Vec<(DVec3, DVec3)>>> {
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
            (Light::Point { .. } | Light::Area { .. }, 1) => Err(Error::unsupported(
                "this asset has parallel light only: bake it --for-lights point (or area) for others",
            )),
            _ => Ok(()),
        }
    }
}

/// Side of the faces of the cube map that visibility is decided on.
pub(super) const SIDE: usize = 64;

/// The net over the directions of a set.
pub(super) fn light_net(set: &DirectionSet, spacing: f64) -> Net {
    let point = |d: &DVec3| OrientedPoint { at_mm: *d, normal: DVec3::ZERO };
    let points: Vec<OrientedPoint> = set.directions().iter().map(point).collect();
    Net::new(&points, std::slice::from_ref(&(0..points.len())), spacing)
}

/// Spacing at which every direction of a set is in its net.
pub(super) fn light_spacing(set: &DirectionSet) -> f64 {
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

/// Around the surfaces that light enters, not what only casts shadows.
fn sphere(scene: &Scene) -> (DVec3, f64) {
    let transfers = |part: u32| scene.parts.parts.get(part as usize).is_some_and(|p| p.transfers());
    let mesh = &scene.mesh;
    let triangles = mesh.triangles.iter().zip(&scene.parts.triangle_part).filter(|(_, part)| transfers(**part));
    let points: Vec<DVec3> =
        triangles.flat_map(|(t, _)| t.map(|v| mesh.local_mm[v as usize].as_dvec3() + mesh.origin_mm)).collect();
    let sphere = Sphere::around(&points);
    (sphere.centre_mm, sphere.radius_mm.max(f64::MIN_POSITIVE))
}
