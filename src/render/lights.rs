//! Lights as surfaces in pictures see them, places relative to the mesh's origin.

use glam::DVec3;

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
}
