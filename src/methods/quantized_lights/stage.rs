//! Geometry that a bake works with, and radiosity of the set's lights at chosen vertices.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::lights::SIDE;
use crate::error::Result;
use crate::evaluate::sampling_error::receiver_areas;
use crate::geometry::bvh::Bvh;
use crate::geometry::cluster;
use crate::geometry::samples::{Patch, Samples};
use crate::geometry::scattered::OrientedPoint;
use crate::light::Light;
use crate::light::quantised::directions::DirectionSet;
use crate::math::cube_map::texel_of;
use crate::medium::fresnel;
use crate::progress::{Progress, Silent};
use crate::transport::gather::Gather;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::receivers::Receivers;
use crate::transport::scene::{self, Scene, Surface};
use crate::transport::tree::SampleTree;
use crate::transport::visibility::{self, Observer, Occluders, Resolution, visit};

/// Receivers that share a traversal of the tree.
pub(super) const GROUP: usize = 16;

/// Rays of the lights near the scene; scattering and the number of samples smooth what one ray each decides.
const SAMPLING: LightSampling = LightSampling { points_per_patch: 1, ..LightSampling::FAST };

/// Samples that look around together.
const GROUP_OF_OBSERVERS: usize = 2 * visibility::GROUP;

/// Lights that share their clusters.
const NEIGHBOURS: usize = 32;

/// The vertices as points of the surface.
pub(super) fn oriented(scene: &Scene, receivers: &Receivers) -> Vec<OrientedPoint> {
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
pub(super) fn parts(receivers: &Receivers) -> Vec<Range<usize>> {
    let run = |groups: &[crate::transport::receivers::Group]| {
        let end = groups.last().map_or(0, |g| g.run.end as usize);
        groups.first().map_or(0, |g| g.run.first as usize)..end
    };
    receivers.groups.chunk_by(|a, b| a.part == b.part).map(run).collect()
}

/// What every stage reads.
pub(super) struct Stage<'a> {
    pub(super) scene: &'a Scene,
    pub(super) bvh: Bvh,
    pub(super) samples: Samples,
    pub(super) patches: Vec<Patch>,
    pub(super) tree: SampleTree,
    pub(super) receivers: Receivers,
    pub(super) areas: Vec<f64>,
    pub(super) points: Vec<OrientedPoint>,
    pub(super) sampling: LightSampling,
}

/// Which directions each sample sees: one bit each, `[sample][word]`.
pub(super) struct Seen {
    words: usize,
    bits: Vec<u64>,
}

impl Seen {
    /// Of directions that are centres of texels of a cube map.
    pub(super) fn new(stage: &Stage, set: &DirectionSet, progress: &dyn Progress) -> Self {
        let (words, samples) = (set.count().div_ceil(64), stage.samples.len());
        let place = |d: &DVec3| {
            let texel = texel_of(SIDE, *d);
            (texel / (SIDE * SIDE), texel % SIDE, texel / SIDE % SIDE)
        };
        let places: Vec<(usize, usize, usize)> = set.directions().iter().map(place).collect();
        let occluders = Occluders::new(&stage.scene.mesh);
        let mut bits = vec![0u64; samples * words];
        progress.start("visibility", samples as u64);
        bits.par_chunks_mut(GROUP_OF_OBSERVERS * words.max(1)).enumerate().for_each(|(chunk, bits)| {
            let first = chunk * GROUP_OF_OBSERVERS;
            let range = first..(first + GROUP_OF_OBSERVERS).min(samples);
            let observers: Vec<Observer> =
                range.clone().map(|i| Observer::of(&stage.scene.mesh, stage.samples.patch(i))).collect();
            visit(&occluders, &stage.bvh, &observers, Resolution::Sub64, |i, visible| {
                for (light, &(face, x, y)) in places.iter().enumerate() {
                    let seen = visible.bit(&visible.seen, face, x, y);
                    bits[i * words + light / 64] |= u64::from(seen) << (light % 64);
                }
            });
            progress.advance(range.len() as u64);
        });
        progress.finish();
        Self { words, bits }
    }
}

impl<'a> Stage<'a> {
    pub(super) fn new(scene: &'a Scene, count: usize) -> Self {
        let samples = Samples::new(&scene.mesh, &scene.parts, count);
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || scene::patches(scene, &samples));
        let tree = SampleTree::new(&samples, &patches);
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let areas = receiver_areas(scene, &receivers);
        let points = oriented(scene, &receivers);
        Self { scene, bvh, samples, patches, tree, receivers, areas, points, sampling: SAMPLING }
    }

    pub(super) fn surface(&self) -> Surface<'_> {
        Surface { scene: self.scene, bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Irradiance of every sample under each light, RGB lights as their first channel.
    pub(super) fn irradiance(&self, lights: &[Light]) -> Result<IrradianceRows> {
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

    /// The same of parallel lights of irradiance 1 by their indices in a set, from what is known of visibility.
    pub(super) fn parallel(&self, seen: &Seen, set: &DirectionSet, lights: &[u32]) -> IrradianceRows {
        let count = lights.len();
        let mut values = vec![0.0f32; self.samples.len() * count];
        let directions: Vec<DVec3> = lights.iter().map(|&l| set.directions()[l as usize]).collect();
        let eta_of_part = |part: usize| {
            let medium = self.scene.parts.parts[part].medium.and_then(|m| self.scene.media.get(m as usize));
            medium.map_or(1.0, |m| m.properties.eta_inside_over_outside)
        };
        values.par_chunks_mut(count.max(1)).enumerate().for_each(|(sample, row)| {
            let part = self.samples.part_offsets.partition_point(|&p| p as usize <= sample).saturating_sub(1);
            let eta = eta_of_part(part);
            let observer = Observer::of(&self.scene.mesh, self.samples.patch(sample));
            let bits = &seen.bits[sample * seen.words..(sample + 1) * seen.words];
            for ((value, &light), direction) in row.iter_mut().zip(lights).zip(&directions) {
                if bits[light as usize / 64] >> (light % 64) & 1 == 1 {
                    let cosine = observer.normal.dot(*direction).max(0.0);
                    *value = (fresnel::transmittance(eta, cosine) * cosine) as f32;
                }
            }
        });
        IrradianceRows { lights: count, values }
    }

    /// Calls `work` with the transfer, which keeps an error under some lights.
    pub(super) fn with_transfer<T>(
        &self,
        near: crate::transport::gather::NearField,
        work: impl FnOnce(ManyLights) -> Result<T>,
    ) -> Result<T> {
        let surface = self.surface();
        let gather = Gather::new(&surface, &self.tree, &self.scene.media, near);
        work(ManyLights::new(&gather, &self.tree, &self.receivers, &self.areas))
    }
}

/// The lights of a set in runs of neighbours: indices of entries.
pub(super) fn neighbours(set: &DirectionSet, shells: usize) -> Vec<Vec<u32>> {
    let count = set.count();
    let mut order: Vec<u32> = (0..count as u32).collect();
    let runs = cluster::groups(&mut order, set.directions(), NEIGHBOURS);
    let of_shell = |shell: usize| {
        let entry = move |i: &u32| shell as u32 * count as u32 + i;
        runs.iter().map(|run| order[run.range()].iter().map(entry).collect()).collect::<Vec<Vec<u32>>>()
    };
    (0..shells).flat_map(of_shell).collect()
}

/// Radiosity at receivers under lights of a set: `[receiver][channel][light]`.
pub(super) fn radiosity_of_set(
    stage: &Stage,
    transfer: &ManyLights,
    lights: &crate::light::quantised::distances::QuantisedLights,
    receivers: usize,
    progress: &dyn Progress,
) -> Result<Vec<f32>> {
    let (count, parallel) = (lights.count(), lights.directions.count());
    let mut values = vec![0.0f32; receivers * 3 * count];
    let seen = Seen::new(stage, &lights.directions, progress);
    progress.start("lights", count as u64);
    for run in neighbours(&lights.directions, lights.shells.inverse().len()) {
        let irradiance = if run.iter().all(|&i| (i as usize) < parallel) {
            stage.parallel(&seen, &lights.directions, &run)
        } else {
            let entries: Vec<Light> = run.iter().filter_map(|&i| lights.entry(i as usize)).collect();
            stage.irradiance(&entries)?
        };
        let rows = transfer.radiosity(&irradiance, &Silent);
        for (out, row) in values.chunks_exact_mut(count).zip(rows.values.chunks_exact(run.len().max(1))) {
            run.iter().zip(row).for_each(|(&light, value)| out[light as usize] = *value);
        }
        progress.advance(run.len() as u64);
    }
    progress.finish();
    Ok(values)
}
