//! [`TextureSpaceEvaluator`] on a device: light falls on the texels, the mip-map sums it up, samples are drawn from it and receivers sum R_d over them in
//! shaders.

mod descent;
mod hybrid;
mod light;
mod samples;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use glam::DVec3;

use self::descent::DescentOnDevice;
use self::hybrid::HybridOnDevice;
use self::light::LightOnDevice;
use self::samples::SamplesOnDevice;
use super::settings::{Far, Local, Sampling};
use super::state::TextureSpaceEvaluator;
use super::view::Frame;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::{CLUSTER, Effort, Entries, Shard, shards};
use crate::evaluate::device::rays::RaysOnDevice;
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

/// Integrals over patches nearby, as on the processor.
const PRECISION: EdgePrecision = EdgePrecision::Reference;

/// A [`TextureSpaceEvaluator`] that a device computes.
pub(super) struct TextureSpaceOnDevice {
    cpu: TextureSpaceEvaluator,
    device: Arc<Device>,
    light: LightOnDevice,
    sums: Sums,
    /// The unit of the irradiance in the texels, where that is of the lights and media in force.
    lit: Option<f64>,
    /// The lights are those before, moved.
    have_moved: bool,
    /// The limit of descents over the unit, where it may be that of lights that have moved.
    limit: Option<f64>,
    is_current: bool,
}

/// How receivers sum.
enum Sums {
    Shared(Shared),
    Product(SurfaceBuffers, DescentOnDevice),
    Hybrid(HybridOnDevice, Local, SamplesOnDevice, f64),
}

/// Sums over shared samples.
struct Shared {
    buffers: SurfaceBuffers,
    samples: SamplesOnDevice,
    is_drawn: bool,
    pipeline: wgpu::ComputePipeline,
    shards: Vec<(wgpu::BindGroup, u32)>,
}

impl TextureSpaceOnDevice {
    /// Uploads the texels, the triangles and the receivers.
    ///
    /// # Errors
    /// Unsupported: another profile than the dipole, an adapter with too few or too small bindings.
    pub(super) fn new(cpu: TextureSpaceEvaluator, device: &Arc<Device>) -> Result<Self> {
        if cpu.profile.is_some() {
            return Err(Error::unsupported(
                "the shaders of texture_space know the dipole alone; use --device cpu with --profile",
            ));
        }
        let rays = RaysOnDevice::new(device, cpu.bvh())?;
        let count = cpu.numbers.count as usize;
        let samples = |light: &LightOnDevice| SamplesOnDevice::new(device, &cpu.map, count, light.nodes());
        let (light, sums) = match cpu.form.sampling {
            Sampling::Hybrid(local) => {
                let irradiance = device.zeros("irradiance", 16 * cpu.map.patches.len() as u64)?;
                let light = LightOnDevice::new(&cpu, device, rays, irradiance)?;
                let samples = samples(&light)?;
                let of_part = |part: usize| samples.of_part(part);
                let hybrid = HybridOnDevice::new(&cpu, &local, (device, light.rays()), of_part)?;
                (light, Sums::Hybrid(hybrid, local, samples, 1.0))
            }
            Sampling::Product => {
                let buffers = buffers(&cpu, device, true)?;
                let light = LightOnDevice::new(&cpu, device, rays, buffers.irradiance().clone())?;
                let descent = DescentOnDevice::new(&cpu, &buffers, PRECISION)?;
                (light, Sums::Product(buffers, descent))
            }
            Sampling::Shared | Sampling::Clusters => {
                let buffers = buffers(&cpu, device, false)?;
                let light = LightOnDevice::new(&cpu, device, rays, buffers.irradiance().clone())?;
                let samples = samples(&light)?;
                let shared = Shared::new(&cpu, device, buffers, samples)?;
                (light, Sums::Shared(shared))
            }
        };
        device.check()?;
        Ok(Self {
            cpu,
            device: Arc::clone(device),
            light,
            sums,
            lit: None,
            have_moved: false,
            limit: None,
            is_current: false,
        })
    }
}

impl TextureSpaceOnDevice {
    fn take_lights(&mut self, lights: Vec<Light>, have_moved: bool) -> Result<()> {
        self.cpu.check_lights(&lights)?;
        if let Sampling::Hybrid(local) = &self.cpu.form.sampling {
            // Views that cannot be had are refused here.
            lights.iter().try_for_each(|light| Frame::new(&self.cpu.scene, light, local).map(|_| ()))?;
        }
        (self.lit, self.have_moved, self.is_current) = (None, have_moved, false);
        self.cpu.take_lights(lights);
        Ok(())
    }
}

/// Buffers of the receivers, the media and, where receivers see them on their own, the patches.
fn buffers(cpu: &TextureSpaceEvaluator, device: &Arc<Device>, with_corners: bool) -> Result<SurfaceBuffers> {
    // Patches are flat and lit evenly: they are points or exact.
    let exact_below = cpu.form.near.exact_below;
    let near = NearField { exact_below, three_points_below: exact_below };
    let (mut patches, mut facet_offsets, mut corners) = (Vec::new(), vec![0], Vec::new());
    for patch in &cpu.map.patches {
        if with_corners {
            let relative = |c: DVec3| (c - patch.centre_mm).as_vec3().to_array();
            corners.extend(cpu.map.outline(&cpu.scene, patch).triangles().map(|t| t.map(relative)));
        }
        facet_offsets.push(corners.len() as u32);
        let (centre_mm, area_mm2, radius_mm) = (patch.centre_mm, patch.area_mm2, patch.radius_mm);
        patches.push(Patch { centre_mm, area_mm2, radius_mm, ..Patch::default() });
    }
    let geometry = Geometry {
        facet_offsets: &facet_offsets,
        patches: &patches,
        corners: &Corners::from_values(corners),
        receivers: &cpu.receivers,
        near,
        rules: PRECISION.rules(),
        terms: 0,
    };
    let mut buffers = SurfaceBuffers::new(device, &geometry)?;
    buffers.set_media(&MediumKernel::of_media(&cpu.scene.media), None)?;
    Ok(buffers)
}

impl Shared {
    fn new(
        cpu: &TextureSpaceEvaluator,
        device: &Arc<Device>,
        buffers: SurfaceBuffers,
        samples: SamplesOnDevice,
    ) -> Result<Self> {
        let layout = bind_group_layout(&device.device, "gather", &[READ; 3]);
        let pipeline = pipeline(&device.device, &shader(GATHER_SHADER), "gather", [buffers.layout(), &layout]);
        let entries = |part: u32| {
            let of_part = samples.of_part(part as usize);
            Entries::List(of_part.map(|index| index | CLUSTER).collect())
        };
        let lists: Vec<Entries> = cpu.receivers.groups.iter().map(|group| entries(group.part)).collect();
        let parts = &cpu.scene.parts.parts;
        let medium = |part: u32| parts.get(part as usize)?.medium;
        let effort = Effort::with_turns(&[], [0.0; 2], |_| [1; 2]);
        let of_shard = |Shard { jobs, list, count }: &Shard| {
            (bind(&device.device, &layout, [jobs, list, samples.buffer()]), *count)
        };
        let shards = shards(device, &cpu.receivers, medium, &lists, &effort)?;
        let shards = shards.iter().map(of_shard).collect();
        Ok(Self { buffers, samples, is_drawn: cpu.form.sampling == Sampling::Shared, pipeline, shards })
    }

    fn run(&self, device: &Device) {
        dispatch(device, &self.pipeline, self.buffers.bind_group(), &self.shards);
    }
}

/// Enqueues the choice of samples.
fn choose(samples: &SamplesOnDevice, is_drawn: bool, cpu: &TextureSpaceEvaluator, nodes: &wgpu::Buffer) -> Result<()> {
    if is_drawn {
        samples.draw();
        return Ok(());
    }
    samples.cluster(&cpu.map, nodes)
}

impl DeviceEvaluator for TextureSpaceOnDevice {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.is_current {
            return Ok(());
        }
        let Self { cpu, light, sums, .. } = self;
        let unit = match self.lit {
            Some(unit) => unit,
            None => {
                progress.start("irradiance", 0);
                let unit = light.run(&cpu.lights, cpu, self.have_moved)?;
                self.lit = Some(unit);
                progress.finish();
                unit
            }
        };
        match sums {
            Sums::Shared(shared) => {
                shared.buffers.set_unit(unit);
                choose(&shared.samples, shared.is_drawn, cpu, light.nodes())?;
                shared.run(&self.device);
            }
            Sums::Product(buffers, descent) => {
                buffers.set_unit(unit);
                let guess = self.limit.filter(|_| self.have_moved).map(|limit| limit / unit);
                let limit = descent.limit(cpu, buffers, (light.nodes(), guess))?;
                self.limit = Some(limit * unit);
                descent.run(buffers, light.nodes(), limit)?;
            }
            Sums::Hybrid(hybrid, local, samples, scale) => {
                *scale = unit;
                choose(samples, local.far == Far::Drawn, cpu, light.nodes())?;
                hybrid.run((cpu, &cpu.lights), (light.rays(), samples.buffer(), unit))?;
            }
        }
        self.device.check()?;
        self.is_current = true;
        Ok(())
    }

    fn held(&self) -> Held<'_> {
        match &self.sums {
            Sums::Shared(Shared { buffers, .. }) | Sums::Product(buffers, _) => buffers.held(&self.cpu.receivers),
            Sums::Hybrid(hybrid, _, _, unit) => hybrid.held(&self.cpu, *unit),
        }
    }
}

impl Evaluator for TextureSpaceOnDevice {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, _: &dyn Progress) -> Result<()> {
        self.take_lights(lights, false)
    }

    fn move_lights(&mut self, lights: Vec<Light>, _: &dyn Progress) -> Result<()> {
        self.take_lights(lights, true)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        let eta = |m: &Medium| m.properties.eta_inside_over_outside;
        let enters_otherwise = media.iter().zip(&self.cpu.scene.media).any(|(a, b)| eta(a) != eta(b));
        self.cpu.set_media(media)?;
        self.is_current = false;
        if enters_otherwise {
            self.lit = None;
            self.light.set_media(&self.cpu.scene.media)?;
        }
        let kernels = || MediumKernel::of_media(&self.cpu.scene.media);
        match &mut self.sums {
            Sums::Shared(shared) => shared.buffers.set_media(&kernels(), None),
            Sums::Product(buffers, descent) => {
                buffers.set_media(&kernels(), None)?;
                descent.set_media(&self.cpu)
            }
            Sums::Hybrid(hybrid, ..) => hybrid.set_media(&self.cpu),
        }
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}
