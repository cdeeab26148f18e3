//! The sums of [`GatheredEvaluator`] in compute shaders. Light reaches the samples, and the hierarchy is tuned and walked,
//! on the CPU; every pair is summed on the device.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::lit_samples::GatheredEvaluator;
use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::{CLUSTER, Effort, Entries, Shard, shards};
use crate::evaluate::device::surface::{
    Geometry, READ, SurfaceBuffers, bind, bind_group_layout, dispatch, pipeline, shader,
};
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::evaluate::{DeviceEvaluator, Evaluator, Held};
use crate::light::Light;
use crate::medium::material::Medium;
use crate::progress::Progress;
use crate::transport::gather::{Scheme, Source};
use crate::transport::kernel::EdgePrecision;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_field::Corners;
use crate::transport::sample_light::SampleLight;
use crate::transport::surface::Surface;

/// The shader that sums samples and clusters of lists.
pub const GATHER_SHADER: &str = include_str!("gather.wgsl");

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuCluster {
    centre: [f32; 4],
    flux: [f32; 4],
}

/// Uploads the samples and the receivers.
pub(super) fn buffers(cpu: &GatheredEvaluator, device: &Arc<Device>) -> Result<SurfaceBuffers> {
    let Surface { domain, samples, patches, .. } = cpu.surface();
    let geometry = Geometry {
        facet_offsets: &samples.patch_offsets,
        patches,
        corners: &Corners::new(domain.mesh, samples, patches),
        receivers: &cpu.receivers,
        near: cpu.gathering.near,
        precision: EdgePrecision::Reference,
        terms: 0,
    };
    SurfaceBuffers::new(device, &geometry)
}

/// A [`GatheredEvaluator`] whose radiosity a device gathers.
pub(super) struct HierarchyOnDevice {
    cpu: GatheredEvaluator,
    device: Arc<Device>,
    buffers: SurfaceBuffers,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    effort: Effort,
    /// Shards of all pairs, which depend on the samples only.
    all_pairs: Option<Vec<Shard>>,
    is_current: bool,
}

impl HierarchyOnDevice {
    /// Uploads the samples.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5).
    pub(super) fn new(cpu: GatheredEvaluator, device: &Arc<Device>) -> Result<Self> {
        let surface = cpu.surface();
        let pieces = cpu.gathering.sampling.pieces_of_uneven() as usize;
        let effort = Effort::new(&surface, cpu.gathering.near, EdgePrecision::Reference, pieces);
        let mut buffers = buffers(&cpu, device)?;
        buffers.set_media(&MediumKernel::of_media(surface.domain.media), None)?;
        let layout = bind_group_layout(&device.device, "gather", &[READ; 3]);
        let text = shader(GATHER_SHADER);
        let pipeline = pipeline(&device.device, &text, "gather", [buffers.layout(), &layout]);
        device.check()?;
        let device = Arc::clone(device);
        Ok(Self { cpu, device, buffers, layout, pipeline, effort, all_pairs: None, is_current: false })
    }

    /// Sources of every group of receivers, and the clusters of the light.
    fn interactions(&self, scheme: Scheme) -> Result<(Vec<Shard>, Vec<GpuCluster>)> {
        self.cpu.with_gather(|gather, lit| {
            let entry = |source: &Source| match source {
                Source::Cluster(index) => index | CLUSTER,
                Source::Patch(index) => *index,
            };
            let sources = gather.sources(&self.cpu.receivers, lit, scheme);
            let lists = sources.iter().map(|list| Entries::List(list.iter().map(entry).collect())).collect();
            let packed = |v: DVec3| v.as_vec3().extend(0.0).to_array();
            let cluster = |(centre, flux)| GpuCluster { centre: packed(centre), flux: packed(flux) };
            Ok((self.shards(lists)?, gather.clusters(lit).map(cluster).collect()))
        })
    }

    fn shards(&self, entries: Vec<Entries>) -> Result<Vec<Shard>> {
        let parts = &self.cpu.scene().parts.parts;
        let medium = |part: u32| parts[part as usize].medium;
        shards(&self.device, &self.cpu.receivers, medium, &entries, &self.effort)
    }

    fn run(&self, shards: &[Shard], clusters: &[GpuCluster]) -> Result<()> {
        let clusters = self.device.storage("clusters", clusters)?;
        let of_shard = |Shard { jobs, list, count }: &Shard| {
            (bind(&self.device.device, &self.layout, [jobs, list, &clusters]), *count)
        };
        let shards: Vec<_> = shards.iter().map(of_shard).collect();
        dispatch(&self.device, &self.pipeline, self.buffers.bind_group(), &shards);
        self.device.check()
    }
}

impl DeviceEvaluator for HierarchyOnDevice {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.is_current {
            return Ok(());
        }
        self.cpu.irradiance(progress)?;
        let (irradiance, pieces) = self.cpu.lit();
        self.buffers.set_light(&SampleLight::new(irradiance, pieces))?;
        match self.cpu.tuned_scheme() {
            Scheme::AllPairs => {
                let shards = match self.all_pairs.take() {
                    Some(shards) => shards,
                    None => {
                        let samples = self.cpu.surface().samples;
                        let range =
                            |part: u32| samples.part_offsets[part as usize]..samples.part_offsets[part as usize + 1];
                        let groups = &self.cpu.receivers.groups;
                        self.shards(groups.iter().map(|g| Entries::Samples(range(g.part))).collect())?
                    }
                };
                self.run(&shards, &[])?;
                self.all_pairs = Some(shards);
            }
            scheme @ Scheme::Hierarchical { .. } => {
                let (shards, clusters) = self.interactions(scheme)?;
                self.run(&shards, &clusters)?;
            }
        }
        self.is_current = true;
        Ok(())
    }

    fn held(&self) -> Held<'_> {
        self.buffers.held(&self.cpu.receivers)
    }
}

impl Evaluator for HierarchyOnDevice {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.is_current = false;
        self.cpu.set_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.cpu.set_media(media)?;
        self.is_current = false;
        self.buffers.set_media(&MediumKernel::of_media(&self.cpu.scene().media), None)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}
