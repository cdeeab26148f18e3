//! A light as weights over the entries of a quantised light set.

use glam::DVec3;

use super::distances::QuantisedLights;
use super::interpolation::Interpolator;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::light::cone::Lit;
use crate::light::cube_light::sums_of_texels;
use crate::light::environment::{EnvironmentMap, Rotation};
use crate::math::cube_map::{FACES, direction as texel_direction, solid_angles_sr};
use crate::math::quadrature::gauss_legendre_cached;

/// Texels along an edge of the cube map that distant light is gathered in: 1.4 degrees.
const GATHER_SIDE: usize = 64;

/// Quadrature points along an edge of an area light, at least and at most.
const AREA_POINTS: (usize, usize) = (2, 16);

/// Why a spot light is refused.
const PARTIAL_CONE: &str = "the cone lights a part of the body alone, and stored transport knows lights that shine on all of it: widen the \
     cone (angle=, blend=) until it holds the body, or bake with a method that gathers (--method editable or two_pass, or --for-lights \
     spot)";

/// RGB weights over the entries of `lights` (see [`QuantisedLights::entry`]) that stand for `light`: radiosity, irradiance and
/// everything else that is linear in the light is the weighted sum over the entries, up to the interpolation.
///
/// - Directional: irradiance times the interpolator's weights on the parallel entries.
/// - Constant and environment: every piece of the sphere as parallel light, all of its energy. Light is gathered in texels of
///   1.4 degrees, each in the direction of its centre of energy, so that a sun keeps its place. Sums over the parallel entries are
///   the integral of the radiance.
/// - Point: the weights of its direction from the scene's centre times those of its distance, times intensity / distance^2. A
///   far point is parallel light.
/// - Spot: a point light where its cone lights all of the scene's bounding ball in full, nothing where it lights none of it.
/// - Area: Gauss-Legendre points over the rectangle, as many as its size over its distance asks for, each a point light of
///   the intensity radiance dA cos(a), where a is the angle between the emitter's normal and the scene's centre. The
///   approximation: all of the scene sees the emission that the centre sees. A part of the scene that is off the centre by an angle b,
///   seen from the emitter, would see cos(a + b) / cos(a) = cos(b) - tan(a) sin(b) of that: about 2 % less at most for an
///   emitter that faces the centre from 5 radii, more the nearer it is and the more it looks past the scene; where scattering is
///   local, [`Emission::ratio`] mends that. Parts of the emitter that face away from the centre are dark.
///
/// # Errors
/// An interpolator of another set (exit 3); a point light, or a part of an area light, nearer than the nearest shell, a spot light
/// that lights a part of the scene (exit 5);
/// a light so bright that sums overflow (exit 4).
pub fn light_vector(lights: &QuantisedLights, interpolator: &Interpolator, light: &Light) -> Result<Vec<DVec3>> {
    if interpolator.set() != &lights.directions {
        return Err(Error::input("the interpolator was made for another set of directions than that of the lights"));
    }
    let mut vector: Vec<DVec3> = pieces(lights, light)?.iter().flat_map(|shell| interpolator.sum(shell)).collect();
    vector.resize(lights.count(), DVec3::ZERO);
    if vector.iter().all(|weight| weight.is_finite()) {
        Ok(vector)
    } else {
        Err(Error::runtime("the light is too bright for double precision; make it weaker"))
    }
}

/// A light as parallel light and point lights on the shells, as [`light_vector`] makes it: for each shell pairs of direction (of any
/// length, from the scene's centre) and irradiance at the centre. Shells beyond the last one in use are left out.
///
/// # Errors
/// A point light, or a part of an area light, nearer than the nearest shell; a spot light that lights a part of the scene alone
/// (exit 5).
pub fn pieces(lights: &QuantisedLights, light: &Light) -> Result<Vec<Vec<(DVec3, DVec3)>>> {
    Ok(match light {
        Light::Directional { .. } | Light::Constant { .. } | Light::Environment { .. } => vec![distant(light)?],
        Light::Point { at_mm, intensity } => points(lights, &[(*at_mm, *intensity)])?,
        Light::Spot { at_mm, cone, intensity } => {
            let (centre_mm, radius_mm) = (lights.shells.centre_mm(), lights.shells.radius_mm());
            match cone.falloff(*at_mm).lights_ball(*at_mm, centre_mm, radius_mm) {
                Lit::Fully => points(lights, &[(*at_mm, *intensity)])?,
                Lit::Not => Vec::new(),
                Lit::InPart => return Err(Error::unsupported(PARTIAL_CONE)),
            }
        }
        Light::Area { .. } => points(lights, &emitters(light, lights.shells.centre_mm()))
            .map_err(|error| error.at("a part of an area light"))?,
    })
}

/// A light that is far away as parallel light: pairs of direction (of any length) and irradiance, with all of its energy, a texel
/// of 1.4 degrees each.
///
/// # Errors
/// A light at a distance (exit 5).
pub fn distant(light: &Light) -> Result<Vec<(DVec3, DVec3)>> {
    match light {
        Light::Directional { from, irradiance } => Ok(vec![(*from, *irradiance)]),
        Light::Constant { radiance } => Ok(everywhere(*radiance)),
        Light::Environment { map, rotate_degrees, scale } => {
            Ok(gather(map, Rotation::from_degrees(*rotate_degrees), *scale))
        }
        Light::Point { .. } | Light::Spot { .. } | Light::Area { .. } => Err(Error::unsupported(
            "point, spot and area lights are not far away: environments, constant and directional lights are",
        )),
    }
}

/// Pieces on the shells (see [`pieces`]) of points, pairs of position in mm and intensity.
fn points(lights: &QuantisedLights, points: &[(DVec3, DVec3)]) -> Result<Vec<Vec<(DVec3, DVec3)>>> {
    let shells = lights.shells.inverse().len();
    let mut by_shell = vec![Vec::with_capacity(points.len()); shells];
    for (at_mm, intensity) in points {
        let from_centre = *at_mm - lights.shells.centre_mm();
        let distance_mm = from_centre.length();
        let weights = lights.shells.weights(distance_mm)?;
        // Two divisions: the square of a distance that is still finite may not be.
        let irradiance = *intensity / distance_mm / distance_mm;
        for (out, weight) in by_shell.iter_mut().zip(weights) {
            if weight != 0.0 {
                out.push((from_centre, weight * irradiance));
            }
        }
    }
    Ok(by_shell)
}

/// A rectangle as points that emit, cosine-weighted, to mend the approximation that all of the scene sees the emission
/// that its centre sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Emission {
    normal: DVec3,
    /// Position in mm, area in mm^2, cosine towards the centre of the scene, positive.
    points: Vec<(DVec3, f64, f64)>,
}

impl Emission {
    /// The points of an area light; none for other lights.
    pub fn new(light: &Light, centre_mm: DVec3) -> Option<Self> {
        let Light::Area { at_mm, normal, u, size_mm, .. } = light else { return None };
        let v = normal.cross(*u);
        let distance_mm = at_mm.distance(centre_mm);
        let [across, along] = size_mm.map(|size| {
            let wanted = (12.0 * size / distance_mm).ceil();
            gauss_legendre_cached((wanted as usize).saturating_add(1).clamp(AREA_POINTS.0, AREA_POINTS.1))
        });
        let mut points = Vec::with_capacity(across.len() * along.len());
        for s in across {
            for t in along {
                let point = *at_mm + 0.5 * (s.position * size_mm[0] * *u + t.position * size_mm[1] * v);
                let area_mm2 = 0.25 * s.weight * t.weight * size_mm[0] * size_mm[1];
                let cosine = (centre_mm - point).try_normalize().map_or(0.0, |to_centre| normal.dot(to_centre));
                if cosine > 0.0 {
                    points.push((point, area_mm2, cosine));
                }
            }
        }
        Some(Self { normal: *normal, points })
    }

    /// Irradiance at a place (mm) from the rectangle, over that with each point's cosine as towards the centre.
    pub fn ratio(&self, at_mm: DVec3) -> f64 {
        let (mut seen, mut assumed) = (0.0, 0.0);
        for (point, area_mm2, cosine) in &self.points {
            let to = at_mm - *point;
            let squared = to.length_squared();
            if squared > 0.0 {
                seen += area_mm2 / squared * (self.normal.dot(to) / squared.sqrt()).max(0.0);
                assumed += area_mm2 / squared * cosine;
            }
        }
        let ratio = seen / assumed;
        if ratio.is_finite() { ratio } else { 0.0 }
    }
}

/// A rectangle as point lights, as the centre of the scene sees them: position in mm and intensity.
fn emitters(light: &Light, centre_mm: DVec3) -> Vec<(DVec3, DVec3)> {
    let (Light::Area { radiance, .. }, Some(emission)) = (light, Emission::new(light, centre_mm)) else {
        return Vec::new();
    };
    let intensity = |(point, area_mm2, cosine): &(DVec3, f64, f64)| (*point, *radiance * (area_mm2 * cosine));
    emission.points.iter().map(intensity).collect()
}

/// Constant radiance from all directions, as irradiance from the centres of texels.
fn everywhere(radiance: DVec3) -> Vec<(DVec3, DVec3)> {
    let side = GATHER_SIDE;
    let angles = solid_angles_sr(side);
    (0..FACES * side * side)
        .map(|i| {
            let direction = texel_direction(side, i / (side * side), i % side, i / side % side);
            (direction, radiance * angles[i % (side * side)])
        })
        .collect()
}

/// The light of a map as irradiance from a direction for every texel that is lit.
fn gather(map: &EnvironmentMap, rotation: Rotation, scale: DVec3) -> Vec<(DVec3, DVec3)> {
    // Energy of a texel, and the sum of its directions weighted by the sum of the channels.
    let add = |[energy, centre]: &mut [DVec3; 2], piece: DVec3, direction: DVec3| {
        *energy += piece;
        *centre += piece.element_sum() * direction;
    };
    let join = |total: &mut [DVec3; 2], texel: [DVec3; 2]| total.iter_mut().zip(texel).for_each(|(sum, t)| *sum += t);
    // Pixels wider than half a texel are cut.
    let mut total = sums_of_texels((map, rotation), (GATHER_SIDE, 2), add, join);
    total.retain(|[energy, _]| *energy != DVec3::ZERO);
    total.iter().map(|[energy, centre]| (*centre, *energy * scale)).collect()
}
