//! Light in the texels: irradiance of each patch by rays, its flux summed up the mip-map.

use glam::DVec3;
use rayon::prelude::*;

use super::map::{Node, Patch, TexelMap};
use crate::error::Result;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::irradiance::{Illumination, LightSampling, SurfacePoint};
use crate::transport::sample_light::SampleLight;
use crate::transport::surface::Surface;

/// Light that arrives in a texel or in a node of the hierarchy.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flux {
    /// Flux behind the surface, RGB, mm^2 times the unit of irradiance.
    pub(super) rgb: DVec3,
    /// Mean place, weighted by the sum of the channels, mm.
    pub(super) at_mm: DVec3,
    /// Sum of the channels times the squared distance from there, mm^4.
    pub(super) moment: f64,
}

impl Flux {
    /// Light of an irradiance on a patch.
    fn of_patch(patch: &Patch, irradiance: DVec3) -> Self {
        let rgb = patch.area_mm2 * irradiance;
        Self { rgb, at_mm: patch.centre_mm, moment: rgb.element_sum() * patch.spread_mm2 }
    }

    /// Sum of the channels, by which samples are drawn.
    pub(super) fn weight(&self) -> f64 {
        self.rgb.element_sum()
    }

    /// The sum of several, by the theorem of parallel axes.
    fn sum(of: impl Iterator<Item = Self> + Clone) -> Self {
        let rgb: DVec3 = of.clone().map(|f| f.rgb).sum();
        let weight = rgb.element_sum();
        if weight <= 0.0 {
            return Self::default();
        }
        let at_mm = of.clone().map(|f| f.weight() * f.at_mm).sum::<DVec3>() / weight;
        let moment = of.map(|f| f.moment + f.weight() * f.at_mm.distance_squared(at_mm)).sum();
        Self { rgb, at_mm, moment }
    }
}

/// The map under some lights.
pub(super) struct LitMap {
    /// Irradiance of each patch over the unit, RGB.
    pub(super) irradiance: Vec<DVec3>,
    /// Flux of each node, over the unit.
    pub(super) nodes: Vec<Flux>,
    /// A power of two near the brightest irradiance: what is over it is in the range of single precision.
    pub(super) unit: f64,
}

impl LitMap {
    /// Lights the patches from their centroids.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn new(
        map: &TexelMap,
        (scene, bvh): (&Scene, &Bvh),
        lights: &[Light],
        rays: LightSampling,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let part_offsets = vec![0; scene.parts.parts.len() + 1];
        let samples = Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets };
        let surface = Surface { domain: scene.domain(), bvh, samples: &samples, patches: &[] };
        let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let points: Vec<(SurfacePoint, u32)> = map
            .patches
            .par_iter()
            .map(|patch| {
                let part = scene.parts.triangle_part.get(patch.triangle as usize);
                let medium = part.and_then(|p| scene.parts.parts.get(*p as usize)).and_then(|p| p.medium);
                (
                    SurfacePoint { at: patch.centre_mm, normal: patch.normal, triangle: patch.triangle },
                    medium.unwrap_or(u32::MAX),
                )
            })
            .collect();
        let mut irradiance = Illumination::new(&surface, lights, &etas, rays)?.at_points(&points, progress);
        let unit = SampleLight::even(&irradiance).unit();
        irradiance.par_iter_mut().for_each(|e| *e /= unit);
        Ok(Self { nodes: nodes(map, &irradiance), irradiance, unit })
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.irradiance.as_slice()) + size_of_val(self.nodes.as_slice())
    }

    /// Flux of a part.
    pub(super) fn of_part(&self, map: &TexelMap, part: usize) -> Flux {
        let root = map.roots.get(part).copied().flatten();
        root.map_or(Flux::default(), |root| self.nodes[root as usize])
    }
}

/// Flux of every node, children first.
fn nodes(map: &TexelMap, irradiance: &[DVec3]) -> Vec<Flux> {
    let patch = |p: u32| Flux::of_patch(&map.patches[p as usize], irradiance[p as usize]);
    let mut nodes: Vec<Flux> = Vec::with_capacity(map.nodes.len());
    for Node { children, is_texel, .. } in &map.nodes {
        let sum = match is_texel {
            true => Flux::sum(children.clone().map(patch)),
            false => Flux::sum(children.clone().map(|child| nodes[child as usize])),
        };
        nodes.push(sum);
    }
    nodes
}
