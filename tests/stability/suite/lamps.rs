//! Lights of the suite, placed by the body that they fall on.

use std::f64::consts::TAU;
use std::sync::Arc;

use glam::DVec3;
use translux::error::Result;
use translux::light::environment::EnvironmentMap;
use translux::light::sky::{sky, sky_with_sun};
use translux::light::{Light, LightKind};
use translux::math::cube_map::texel_of;
use translux::math::random::uniform;
use translux::scene::Scene;

/// A light by what is odd about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// Parallel light from an odd direction.
    Sun,
    /// Parallel light along the largest flat area, 3 degrees above it.
    EdgeOn,
    /// Parallel light from behind, and below.
    Behind,
    Below,
    /// A point so many bounding radii from the centre.
    PointAt(f64),
    /// On a vertex, inside the body, a million mm away.
    OnVertex,
    Inside,
    FarPoint,
    /// A cone whose edge crosses the body, and one narrower than a sample.
    SpotAcross,
    NarrowSpot,
    /// A rectangle beside the body.
    Area,
    Constant,
    /// The built-in sky, the same with a low sun of one texel, a lone texel in the dark, a lone one at the horizon.
    Sky,
    SkyWithSun,
    LoneSun,
    LowSun,
    /// Parallel light without any.
    Black,
    /// A light of a kind at random, by a seed.
    Drawn(LightKind, u64),
}

impl Lamp {
    pub fn name(self) -> String {
        match self {
            Self::Sun => "sun".to_owned(),
            Self::EdgeOn => "sun edge-on".to_owned(),
            Self::Behind => "sun behind".to_owned(),
            Self::Below => "sun below".to_owned(),
            Self::PointAt(radii) => format!("point at {radii} radii"),
            Self::OnVertex => "point on the surface".to_owned(),
            Self::Inside => "point inside".to_owned(),
            Self::FarPoint => "point at 1e6 mm".to_owned(),
            Self::SpotAcross => "spot across".to_owned(),
            Self::NarrowSpot => "narrow spot".to_owned(),
            Self::Area => "area".to_owned(),
            Self::Constant => "constant".to_owned(),
            Self::Sky => "sky".to_owned(),
            Self::SkyWithSun => "sky and sun".to_owned(),
            Self::LoneSun => "environment of a lone sun".to_owned(),
            Self::LowSun => "environment of a low sun".to_owned(),
            Self::Black => "black".to_owned(),
            Self::Drawn(kind, seed) => format!("{} {seed}", kind.name()),
        }
    }

    pub fn kind(self) -> LightKind {
        match self {
            Self::Sun | Self::EdgeOn | Self::Behind | Self::Below | Self::Black => LightKind::Directional,
            Self::PointAt(_) | Self::OnVertex | Self::Inside | Self::FarPoint => LightKind::Point,
            Self::SpotAcross | Self::NarrowSpot => LightKind::Spot,
            Self::Area => LightKind::Area,
            Self::Constant => LightKind::Constant,
            Self::Sky | Self::SkyWithSun | Self::LoneSun | Self::LowSun => LightKind::Environment,
            Self::Drawn(kind, _) => kind,
        }
    }

    /// Whether it is an environment with a sun in it.
    pub fn is_sun_of_environment(self) -> bool {
        matches!(self, Self::SkyWithSun | Self::LoneSun | Self::LowSun | Self::Drawn(LightKind::Environment, _))
    }

    /// The light; its irradiance where the body stands is about 1.
    pub fn light(self, scene: &Scene) -> Result<Light> {
        let mesh = &scene.mesh;
        let (centre, radius) = (mesh.origin_mm, 0.5 * mesh.diagonal_mm());
        let sun = |from: DVec3| Light::directional(from.normalize(), DVec3::ONE);
        let point = |from: DVec3, distance: f64| {
            Light::point(centre + from.normalize() * distance, DVec3::splat(distance * distance))
        };
        let odd = DVec3::new(0.43, 0.55, 0.72);
        match self {
            Self::Sun => sun(odd),
            Self::EdgeOn => {
                let flat = flattest(scene);
                sun(flat.any_orthonormal_vector() + 0.05 * flat)
            }
            Self::Behind => sun(DVec3::new(-0.25, 0.2, -0.95)),
            Self::Below => sun(DVec3::new(0.2, -0.95, 0.3)),
            Self::PointAt(radii) => point(odd, radii * radius),
            Self::FarPoint => point(odd, 1e6),
            Self::OnVertex => Light::point(mesh.position_mm(0), DVec3::splat(radius * radius)),
            Self::Inside => {
                let corners = mesh.corners_local_mm(0);
                let depth = 1e-2 * mesh.diagonal_mm();
                let at = corners.iter().sum::<DVec3>() / 3.0 - depth * mesh.normal(0);
                Light::point(centre + at, DVec3::splat(depth * depth))
            }
            Self::SpotAcross => {
                let distance = 2.5 * radius;
                let to = centre + 0.5 * radius * odd.any_orthonormal_vector().normalize();
                Light::spot(centre + distance * odd.normalize(), to, 20.0, 0.15, DVec3::splat(distance * distance))
            }
            Self::NarrowSpot => {
                let distance = 2.5 * radius;
                Light::spot(centre + distance * odd.normalize(), centre, 0.5, 0.0, DVec3::splat(distance * distance))
            }
            Self::Area => {
                let from = odd.normalize();
                let at = centre + 2.0 * radius * from;
                Light::area(at, -from, [0.8 * radius; 2], DVec3::splat(2.0), None)
            }
            Self::Constant => Light::constant(DVec3::splat(0.3)),
            Self::Sky => Light::environment(Arc::new(sky()), 40.0, DVec3::ONE),
            Self::SkyWithSun => Light::environment(Arc::new(sky_with_sun()), 40.0, DVec3::ONE),
            Self::LoneSun => Light::environment(Arc::new(lone(20)?), 75.0, DVec3::ONE),
            Self::LowSun => Light::environment(Arc::new(lone(62)?), 75.0, DVec3::ONE),
            Self::Black => Light::directional(odd.normalize(), DVec3::ZERO),
            Self::Drawn(kind, seed) => at_random(kind, seed, (centre, radius)),
        }
    }
}

/// A light of a kind around a ball: from any direction, 1.05 to 8 radii away where it has a place.
fn at_random(kind: LightKind, seed: u64, (centre, radius): (DVec3, f64)) -> Result<Light> {
    const STAGE: u64 = 93;
    let next = |dimension: u64| uniform(STAGE, seed, dimension);
    let direction = |first: u64| {
        let y = 1.0 - 2.0 * next(first);
        let (sin, cos) = (TAU * next(first + 1)).sin_cos();
        let ring = (1.0 - y * y).max(0.0).sqrt();
        DVec3::new(cos * ring, y, sin * ring)
    };
    let from = direction(0);
    let distance = radius * 1.05 * (8f64 / 1.05).powf(next(2));
    let at = centre + distance * from;
    let colour = DVec3::new(0.5, 0.5, 0.5) + DVec3::new(next(3), next(4), next(5));
    // Aimed at somewhere within the ball.
    let to = centre + 0.5 * radius * direction(6);
    match kind {
        LightKind::Directional => Light::directional(from, colour),
        LightKind::Point => Light::point(at, distance * distance * colour),
        LightKind::Spot => Light::spot(at, to, 10.0 + 50.0 * next(8), next(9), distance * distance * colour),
        LightKind::Area => {
            let sides = [10, 11].map(|dimension| radius * (0.1 + next(dimension)));
            let facing = (to - at).normalize_or(-from);
            Light::area(at, facing, sides, distance * distance / (sides[0] * sides[1]) * colour, None)
        }
        LightKind::Constant => Light::constant(colour),
        LightKind::Environment => {
            let map = match (3.0 * next(8)) as u32 {
                0 => sky(),
                1 => sky_with_sun(),
                _ => lone((5.0 + 115.0 * next(9)) as usize)?,
            };
            Light::environment(Arc::new(map), 360.0 * next(10), colour)
        }
    }
}

/// A map of 256 x 128 that is black but for one texel of a row.
fn lone(row: usize) -> Result<EnvironmentMap> {
    let mut pixels = vec![[0.0; 3]; 256 * 128];
    pixels[row * 256 + 133] = [3e3; 3];
    EnvironmentMap::new(256, 128, pixels)
}

/// Normal of the largest flat area.
fn flattest(scene: &Scene) -> DVec3 {
    const SIDE: usize = 8;
    let mut sums = vec![DVec3::ZERO; 6 * SIDE * SIDE];
    for triangle in 0..scene.mesh.triangles.len() as u32 {
        let cross = scene.mesh.cross_mm2(triangle);
        sums[texel_of(SIDE, cross.normalize_or(DVec3::Y))] += cross;
    }
    let largest = sums.into_iter().max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
    largest.unwrap_or_default().normalize_or(DVec3::Y)
}
