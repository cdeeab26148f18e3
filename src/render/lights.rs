//! Lights as surfaces in pictures see them, places relative to the mesh's origin.

use glam::{DVec3, Vec3};

use crate::geometry::bvh::{Bvh, Ray, offset_origin};
use crate::light::Light;
use crate::light::cone::ConeFalloff;

/// A directional, a point or a spot light.
pub(super) enum Sharp {
    Direction { from: DVec3, irradiance: DVec3 },
    Place { at: DVec3, intensity: DVec3, falloff: ConeFalloff },
}

impl Sharp {
    /// The light for a mesh with this origin; none for those that come from many directions.
    pub(super) fn new(light: &Light, origin_mm: DVec3) -> Option<Self> {
        if let Light::Directional { from, irradiance } = light {
            return Some(Self::Direction { from: *from, irradiance: *irradiance });
        }
        let (at_mm, intensity, falloff) = light.from_place()?;
        Some(Self::Place { at: at_mm - origin_mm, intensity, falloff })
    }

    /// Unit direction towards it from a point, its distance, and its irradiance on a surface there that faces it.
    ///
    /// A light in the surface itself has no direction: the distance is 0 and the others may be anything.
    #[inline]
    pub(super) fn seen_from(&self, point: DVec3) -> (DVec3, f64, DVec3) {
        match self {
            Self::Direction { from, irradiance } => (*from, f64::INFINITY, *irradiance),
            Self::Place { at, intensity, falloff } => {
                let offset = *at - point;
                let distance = offset.length();
                let to_light = offset / distance;
                (to_light, distance, *intensity * (falloff.at(to_light) / (distance * distance)))
            }
        }
    }
}

/// A rectangle that emits to one side.
pub(super) struct Rectangle {
    pub(super) corner: DVec3,
    pub(super) normal: DVec3,
    pub(super) edges: [DVec3; 2],
    pub(super) lengths: [f64; 2],
    pub(super) radiance: DVec3,
}

impl Rectangle {
    /// An area light for a mesh with this origin; none for other kinds.
    pub(super) fn new(light: &Light, origin_mm: DVec3) -> Option<Self> {
        let Light::Area { at_mm, normal, u, size_mm, radiance, .. } = light else { return None };
        let edges = [*u, normal.cross(*u)];
        let corner = *at_mm - origin_mm - 0.5 * (edges[0] * size_mm[0] + edges[1] * size_mm[1]);
        Some(Self { corner, normal: *normal, edges, lengths: *size_mm, radiance: *radiance })
    }

    /// Distance at which a ray meets the side that emits, mm, if it does.
    pub(super) fn distance_mm(&self, from: DVec3, direction: DVec3) -> Option<f64> {
        let towards = direction.dot(self.normal);
        let distance = (self.corner - from).dot(self.normal) / towards;
        let at = from + direction * distance - self.corner;
        let is_on = (0..2).all(|k| (0.0..=self.lengths[k]).contains(&at.dot(self.edges[k])));
        (towards < 0.0 && distance > 0.0 && is_on).then_some(distance)
    }
}

/// Where shadow rays of a point start, and the triangle that it is on.
pub(super) struct Start {
    origin: Vec3,
    triangle: u32,
}

impl Start {
    /// A point on the side of a geometric unit normal.
    pub(super) fn new(point: DVec3, geometric: DVec3, triangle: u32) -> Self {
        Self { origin: offset_origin(point.as_vec3(), geometric.as_vec3()), triangle }
    }
}

/// Shadow rays to be traced, and what each adds if it is not occluded.
#[derive(Default)]
pub(super) struct ShadowRays {
    rays: Vec<Ray>,
    skip: Vec<u32>,
    /// Index of the point, and its gain.
    gains: Vec<(u32, DVec3)>,
    occluded: Vec<bool>,
}

impl ShadowRays {
    /// Adds a ray, unless it gains nothing; true if it did.
    pub(super) fn push(
        &mut self,
        index: usize,
        Start { origin, triangle }: Start,
        (to_light, distance): (DVec3, f64),
        gain: DVec3,
    ) -> bool {
        if gain == DVec3::ZERO || !gain.is_finite() {
            return false;
        }
        self.rays.push(Ray { t_max: distance as f32, ..Ray::new(origin, to_light.as_vec3()) });
        self.skip.push(triangle);
        self.gains.push((index as u32, gain));
        true
    }

    /// Traces the rays; `add` takes the gains of those that meet nothing.
    pub(super) fn resolve(&mut self, bvh: &Bvh, mut add: impl FnMut(usize, DVec3)) {
        self.occluded.clear();
        self.occluded.resize(self.rays.len(), false);
        bvh.occluded_many(&self.rays, &self.skip, &mut self.occluded);
        for (&(index, gain), &occluded) in self.gains.iter().zip(&self.occluded) {
            if !occluded {
                add(index as usize, gain);
            }
        }
        self.rays.clear();
        self.skip.clear();
        self.gains.clear();
    }
}
