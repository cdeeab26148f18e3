//! Light in the texels: irradiance of each patch, its flux summed up the mip-map.

use glam::DVec3;

use super::map::{Node, Patch, TexelMap};
use crate::parallel::*;
use crate::transport::sample_light::SampleLight;

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
    pub(super) fn of_patch(patch: &Patch, irradiance: DVec3) -> Self {
        let rgb = patch.area_mm2 * irradiance;
        Self { rgb, at_mm: patch.centre_mm, moment: rgb.element_sum() * patch.spread_mm2 }
    }

    /// Sum of the channels, by which samples are drawn.
    pub(super) fn weight(&self) -> f64 {
        self.rgb.element_sum()
    }

    /// The sum of several, by the theorem of parallel axes.
    pub(super) fn sum(of: impl Iterator<Item = Self> + Clone) -> Self {
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

/// A node as walks of the hierarchy see it.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Walked {
    /// Mean place of its light relative to the mesh's origin, mm.
    pub(super) at_mm: [f32; 3],
    /// Sum of the channels times the squared distance from there, mm^4, over the unit.
    pub(super) moment: f32,
    /// Flux, RGB, mm^2, over the unit.
    pub(super) rgb: [f32; 3],
    /// Sum of the channels.
    pub(super) weight: f32,
    /// The node after all that is below.
    pub(super) next: u32,
    /// Patches of a texel.
    pub(super) patches: [u32; 2],
    /// Number of patches below that are lit; shaders alone count them.
    pub(super) lit: u32,
}

impl Walked {
    /// A node and its light.
    pub(super) fn new(node: &Node, flux: &Flux) -> Self {
        Self {
            at_mm: flux.at_mm.as_vec3().to_array(),
            moment: flux.moment as f32,
            rgb: flux.rgb.as_vec3().to_array(),
            weight: flux.weight() as f32,
            next: node.next,
            patches: [node.patches.start, node.patches.end],
            lit: 0,
        }
    }
}

/// A patch as walks of the hierarchy see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct LitPatch {
    /// Centroid relative to the mesh's origin, mm.
    pub(super) at_mm: [f32; 3],
    /// Distance of the farthest corner from there, mm.
    pub(super) radius_mm: f32,
    /// Flux, RGB, mm^2, over the unit.
    pub(super) flux: [f32; 3],
}

/// Nodes of one task.
const TASK: usize = 1 << 12;

/// The map under some lights.
pub(super) struct LitMap {
    /// Irradiance of each patch over the unit, RGB.
    pub(super) irradiance: Vec<DVec3>,
    /// Flux of each node, over the unit.
    pub(super) nodes: Vec<Flux>,
    /// The same for walks.
    pub(super) walked: Vec<Walked>,
    pub(super) patches: Vec<LitPatch>,
    /// A power of two near the brightest irradiance: what is over it is in the range of single precision.
    pub(super) unit: f64,
}

impl LitMap {
    /// The map under an irradiance of each patch.
    pub(super) fn new(map: &TexelMap, mut irradiance: Vec<DVec3>) -> Self {
        let unit = SampleLight::even(&irradiance).unit();
        irradiance.par_iter_mut().for_each(|e| *e /= unit);
        let nodes = nodes(map, &irradiance);
        let walked = map.nodes.par_iter().zip(&nodes).with_min_len(TASK).map(|(n, f)| Walked::new(n, f)).collect();
        let patch = |(patch, e): (&Patch, &DVec3)| LitPatch {
            at_mm: patch.centre_mm.as_vec3().to_array(),
            radius_mm: patch.radius_mm as f32,
            flux: (patch.area_mm2 * *e).as_vec3().to_array(),
        };
        let patches = map.patches.par_iter().zip(&irradiance).with_min_len(TASK).map(patch).collect();
        Self { nodes, walked, patches, irradiance, unit }
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.irradiance.as_slice())
            + size_of_val(self.nodes.as_slice())
            + size_of_val(self.walked.as_slice())
            + size_of_val(self.patches.as_slice())
    }

    /// Flux of a part.
    pub(super) fn of_part(&self, map: &TexelMap, part: usize) -> Flux {
        let root = map.roots.get(part).copied().flatten();
        root.map_or(Flux::default(), |root| self.nodes[root as usize])
    }
}

/// Flux of every node, from the lowest ones up.
pub(super) fn nodes(map: &TexelMap, irradiance: &[DVec3]) -> Vec<Flux> {
    let patch = |p: u32| Flux::of_patch(&map.patches[p as usize], irradiance[p as usize]);
    let of_texel = |node: &Node| Flux::sum(node.patches.clone().map(patch));
    let mut nodes: Vec<Flux> = map.nodes.par_iter().with_min_len(TASK).map(of_texel).collect();
    for (index, node) in map.nodes.iter().enumerate().rev() {
        if !node.is_texel() {
            nodes[index] = Flux::sum(map.children(index as u32).map(|child| nodes[child as usize]));
        }
    }
    nodes
}
