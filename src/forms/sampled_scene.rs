//! A scene with its samples, as bakes see it whose material is baked in.

use std::ops::Range;

use glam::DVec3;

use crate::error::Result;
use crate::evaluate::sampling_error::receiver_areas;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::geometry::scattered::OrientedPoint;
use crate::light::Light;
use crate::progress::Silent;
use crate::scene::Scene;
use crate::transport::gather::Gather;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers that share a traversal of the tree.
pub(crate) const GROUP: usize = 16;

/// Rays of the lights near the scene; scattering and the number of samples smooth what one ray each decides.
const SAMPLING: LightSampling = LightSampling { points_per_patch: 1, ..LightSampling::FAST };

/// The vertices as points of the surface.
pub(crate) fn oriented(scene: &Scene, receivers: &Receivers) -> Vec<OrientedPoint> {
    let mut normals = vec![DVec3::ZERO; receivers.len()];
    for (index, triangle) in scene.mesh.triangles.iter().enumerate() {
        let cross = scene.mesh.cross_mm2(index as u32);
        for &v in triangle {
            if let Some(normal) = normals.get_mut(receivers.of_vertex[v as usize] as usize) {
                *normal += cross;
            }
        }
    }
    let point = |(at_mm, normal): (&DVec3, &DVec3)| OrientedPoint { at_mm: *at_mm, normal: normal.normalize_or_zero() };
    receivers.positions.iter().zip(&normals).map(point).collect()
}

/// Receivers of each part.
pub(crate) fn parts(receivers: &Receivers) -> Vec<Range<usize>> {
    let run = |groups: &[crate::transport::receivers::Group]| {
        let end = groups.last().map_or(0, |g| g.run.end as usize);
        groups.first().map_or(0, |g| g.run.first as usize)..end
    };
    receivers.groups.chunk_by(|a, b| a.part == b.part).map(run).collect()
}

/// A scene, its samples in a tree, and its receivers.
pub(crate) struct SampledScene<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) bvh: Bvh,
    pub(crate) samples: Samples,
    pub(crate) patches: Vec<Patch>,
    pub(crate) tree: SampleTree,
    pub(crate) receivers: Receivers,
    pub(crate) areas: Vec<f64>,
    pub(crate) points: Vec<OrientedPoint>,
    pub(crate) sampling: LightSampling,
}

impl<'a> SampledScene<'a> {
    pub(crate) fn new(scene: &'a Scene, count: usize) -> Self {
        let samples = Samples::new(&scene.mesh, &scene.parts, count);
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || samples::patches(&scene.mesh, &samples));
        let tree = SampleTree::new(&samples, &patches);
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let areas = receiver_areas(&scene.mesh, &receivers);
        let points = oriented(scene, &receivers);
        Self { scene, bvh, samples, patches, tree, receivers, areas, points, sampling: SAMPLING }
    }

    pub(crate) fn surface(&self) -> Surface<'_> {
        Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Irradiance of every sample under each light, RGB lights as their first channel.
    pub(crate) fn irradiance(&self, lights: &[Light]) -> Result<IrradianceRows> {
        let surface = self.surface();
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let mut values = vec![0.0; self.samples.len() * lights.len()];
        for (column, light) in lights.iter().enumerate() {
            let one = std::slice::from_ref(light);
            let irradiance = Illumination::new(&surface, one, &etas, self.sampling)?.all(&Silent);
            for (row, e) in values.chunks_exact_mut(lights.len()).zip(&irradiance) {
                row[column] = e.x as f32;
            }
        }
        Ok(IrradianceRows { lights: lights.len(), values })
    }

    /// Calls `work` with the transfer, which keeps an error under some lights.
    pub(crate) fn with_transfer<T>(
        &self,
        near: crate::transport::near_rule::NearField,
        work: impl FnOnce(ManyLights) -> Result<T>,
    ) -> Result<T> {
        let surface = self.surface();
        let gather = Gather::new(&surface, &self.tree, &self.scene.media, near);
        work(ManyLights::new(&gather, &self.tree, &self.receivers, &self.areas))
    }
}
