//! The sums of [`TextureSpaceEvaluator`] in a compute shader. Light reaches the texels and samples are chosen on the processor.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::descent::Source;

use super::settings::Sampling;
use super::state::{Chosen, TextureSpaceEvaluator};
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::{CLUSTER, Effort, Entries, Shard, shards};
use crate::evaluate::device::surface::{
    Geometry, READ, SurfaceBuffers, bind, bind_group_layout, dispatch, pipeline, shader,
};
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::evaluate::{DeviceEvaluator, Evaluator, Held};
use crate::forms::gathered::GATHER_SHADER;
use crate::geometry::samples::Patch;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::progress::Progress;
use crate::transport::kernel::EdgePrecision;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_field::Corners;
use crate::transport::near_rule::NearField;
use crate::transport::sample_light::SampleLight;

/// A sample of several receivers.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuCluster {
    centre: [f32; 4],
    flux: [f32; 4],
}

/// A [`TextureSpaceEvaluator`] whose sums a device computes.
pub(super) struct TextureSpaceOnDevice {
    cpu: TextureSpaceEvaluator,
    device: Arc<Device>,
    buffers: SurfaceBuffers,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    effort: Effort,
    is_current: bool,
}

impl TextureSpaceOnDevice {
    /// Uploads the patches of the texels and the receivers.
    ///
    /// # Errors
    /// Unsupported: the hybrid method, another profile than the dipole, an adapter with too few or too small bindings.
    pub(super) fn new(cpu: TextureSpaceEvaluator, device: &Arc<Device>) -> Result<Self> {
        if matches!(cpu.form.sampling, Sampling::Hybrid(_)) || cpu.profile.is_some() {
            return Err(Error::unsupported(
                "the shader that sums samples knows the whole dipole alone; use --device cpu with sampling=hybrid or --profile",
            ));
        }
        // Patches are flat and lit evenly: they are points or exact.
        let exact_below = cpu.form.near.exact_below;
        let near = NearField { exact_below, three_points_below: exact_below };
        let (mut patches, mut facet_offsets, mut corners) = (Vec::new(), vec![0], Vec::new());
        for patch in &cpu.map.patches {
            let relative = |c: DVec3| (c - patch.centre_mm).as_vec3().to_array();
            corners.extend(cpu.map.outline(&cpu.scene, patch).triangles().map(|t| t.map(relative)));
            facet_offsets.push(corners.len() as u32);
            let (centre_mm, area_mm2, radius_mm) = (patch.centre_mm, patch.area_mm2, patch.radius_mm);
            patches.push(Patch { centre_mm, area_mm2, radius_mm, ..Patch::default() });
        }
        let precision = EdgePrecision::Reference;
        let geometry = Geometry {
            facet_offsets: &facet_offsets,
            patches: &patches,
            corners: &Corners::from_values(corners),
            receivers: &cpu.receivers,
            near,
            rules: precision.rules(),
            terms: 0,
        };
        let mut buffers = SurfaceBuffers::new(device, &geometry)?;
        buffers.set_media(&MediumKernel::of_media(&cpu.scene.media), None)?;
        let nodes = precision.rules().iter().map(|(_, nodes)| nodes.len()).max().unwrap_or(0);
        let triangle = 3 * (nodes + 1) + precision.rules().len();
        let effort = Effort::with_turns(&patches, [near.exact_below, near.three_points_below], |index| {
            [(triangle + 1) * (facet_offsets[index + 1] - facet_offsets[index]) as usize; 2]
        });
        let layout = bind_group_layout(&device.device, "gather", &[READ; 3]);
        let pipeline = pipeline(&device.device, &shader(GATHER_SHADER), "gather", [buffers.layout(), &layout]);
        device.check()?;
        let device = Arc::clone(device);
        Ok(Self { cpu, device, buffers, layout, pipeline, effort, is_current: false })
    }

    /// Sources of every group of receivers, and those of them that are points of their own.
    fn sources(&self, light: &SampleLight) -> (Vec<Entries>, Vec<GpuCluster>) {
        let cpu = &self.cpu;
        let packed = |v: DVec3| v.as_vec3().extend(0.0).to_array();
        let (Some(chosen), Some(lit)) = (&cpu.chosen, &cpu.lit) else { return (Vec::new(), Vec::new()) };
        let cluster = |at, flux| GpuCluster { centre: packed(at), flux: packed(light.scaled(lit.unit * flux)) };
        match chosen {
            Chosen::Limit(limit) => {
                let entry = |source: &Source| match source {
                    Source::Node(index) => index | CLUSTER,
                    Source::Patch(index) => *index,
                };
                let sources = cpu.descent(lit, cpu.form.near).sources(&cpu.receivers, *limit);
                let lists = sources.iter().map(|list| Entries::List(list.iter().map(entry).collect())).collect();
                (lists, lit.nodes.iter().map(|flux| cluster(flux.at_mm, flux.rgb)).collect())
            }
            Chosen::Shared(samples) | Chosen::Hybrid(samples, _) => {
                let first = |part: usize| samples[..part].iter().map(Vec::len).sum::<usize>() as u32;
                let of_part = |part: usize| {
                    let first = first(part);
                    let end = first + samples.get(part).map_or(0, Vec::len) as u32;
                    Entries::List((first..end).map(|index| index | CLUSTER).collect())
                };
                let lists = cpu.receivers.groups.iter().map(|group| of_part(group.part as usize)).collect();
                (lists, samples.iter().flatten().map(|s| cluster(s.at_mm, s.flux)).collect())
            }
        }
    }
}

impl DeviceEvaluator for TextureSpaceOnDevice {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.is_current {
            return Ok(());
        }
        self.cpu.prepare(progress)?;
        let irradiance = self.cpu.irradiance();
        let light = SampleLight::even(&irradiance);
        self.buffers.set_light(&light)?;
        let (entries, clusters) = self.sources(&light);
        let parts = &self.cpu.scene.parts.parts;
        let medium = |part: u32| parts.get(part as usize)?.medium;
        let shards = shards(&self.device, &self.cpu.receivers, medium, &entries, &self.effort)?;
        let clusters = self.device.storage("clusters", &clusters)?;
        let of_shard = |Shard { jobs, list, count }: &Shard| {
            (bind(&self.device.device, &self.layout, [jobs, list, &clusters]), *count)
        };
        let shards: Vec<_> = shards.iter().map(of_shard).collect();
        dispatch(&self.device, &self.pipeline, self.buffers.bind_group(), &shards);
        self.device.check()?;
        self.is_current = true;
        Ok(())
    }

    fn held(&self) -> Held<'_> {
        self.buffers.held(&self.cpu.receivers)
    }
}

impl Evaluator for TextureSpaceOnDevice {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.is_current = false;
        self.cpu.set_lights(lights, progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.cpu.set_media(media)?;
        self.is_current = false;
        self.buffers.set_media(&MediumKernel::of_media(&self.cpu.scene.media), None)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}
