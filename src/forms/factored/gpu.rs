//! `editable` in compute shaders: rays reach the samples on the CPU; stored rows, far field, near field and materials
//! run on the device.

use std::sync::Arc;

use glam::DVec3;

use super::evaluate::FactoredEvaluator;
use super::far_field_gpu::FarOnDevice;
use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::Effort;
use crate::evaluate::device::near_field::NearOnDevice;
use crate::evaluate::device::surface::{Geometry, SurfaceBuffers};
use crate::evaluate::device::tree::TreeOnDevice;
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::evaluate::{DeviceEvaluator, Evaluator, Held};
use crate::forms::environment_rows::gpu::RowsOnDevice;
use crate::forms::environment_rows::sampled;
use crate::light::Light;
use crate::light::cube_light::CubeLight;
use crate::light::suns::apart;
use crate::medium::material::Medium;
use crate::progress::Progress;
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::EdgePrecision;
use crate::transport::sample_light::SampleLight;

/// Work to do before the radiosity is that of the lights and media in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stale {
    Nothing,
    Media,
    Light,
}

pub(super) struct FactoredOnDevice {
    cpu: FactoredEvaluator,
    device: Arc<Device>,
    buffers: SurfaceBuffers,
    rows: Option<RowsOnDevice>,
    tree: TreeOnDevice,
    far: FarOnDevice,
    near: NearOnDevice,
    stale: Stale,
}

impl FactoredOnDevice {
    pub(super) fn new(cpu: FactoredEvaluator, device: &Arc<Device>) -> Result<Self> {
        let geometry = Geometry {
            facet_offsets: &cpu.samples.patch_offsets,
            patches: &cpu.patches,
            corners: &cpu.corners,
            receivers: &cpu.receivers,
            near: cpu.form.near,
            rules: EdgePrecision::Near.rules(),
            terms: cpu.far.terms,
        };
        let buffers = SurfaceBuffers::new(device, &geometry)?;
        let rows = cpu.rows.as_ref().map(|rows| RowsOnDevice::new(&buffers, rows, &cpu.samples)).transpose()?;
        let tree = TreeOnDevice::new(&buffers, &cpu.samples, &cpu.patches)?;
        let far = FarOnDevice::new(device, (&cpu.far, &cpu.points.fills, cpu.points.weights.as_ref()), &tree)?;
        let pieces = cpu.form.sampling.pieces_of_uneven() as usize;
        let effort = Effort::new(&cpu.surface(), cpu.form.near, EdgePrecision::Near.rules(), pieces);
        let parts = &cpu.scene.parts.parts;
        let media = (cpu.scene.media.len(), |part: u32| parts[part as usize].medium);
        let near = NearOnDevice::new(&buffers, &cpu.receivers, (&cpu.around, &effort), media, far.values())?;
        let device = Arc::clone(device);
        let mut evaluator = Self { cpu, device, buffers, rows, tree, far, near, stale: Stale::Light };
        evaluator.upload_media()?;
        Ok(evaluator)
    }

    /// Lights the samples and sums the far field, where that is not done.
    fn light(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.stale != Stale::Light {
            return Ok(());
        }
        let cpu = &self.cpu;
        let lights = apart(&cpu.lights, |_| true);
        let (near, stored): (Vec<Light>, Vec<Light>) = lights.into_iter().partition(|l| !cpu.is_stored(l));
        let (fields, stored): (Vec<Light>, Vec<Light>) = stored.into_iter().partition(Light::has_field);
        let (mut irradiance, pieces) = match near.as_slice() {
            [] => (vec![DVec3::ZERO; cpu.samples.len()], Pieces::default()),
            near => sampled(&cpu.surface(), near, cpu.form.sampling, progress)?,
        };
        // Products with the maps of a field are sums of the processor.
        if let Some(rows) = &cpu.rows {
            rows.add(&fields, cpu.scene.domain(), &cpu.samples, &mut irradiance)?;
        }
        let maps: Vec<CubeLight> = match &self.rows {
            Some(rows) => stored.iter().map(|l| CubeLight::new(l, rows.side())).collect::<Result<_>>()?,
            None => Vec::new(),
        };
        let brightest = irradiance.iter().map(|e| e.max_element()).chain(maps.iter().map(CubeLight::scale));
        let light = SampleLight::with_brightest(&irradiance, &pieces, brightest.fold(0.0, f64::max));
        self.buffers.set_light(&light)?;
        if let (Some(rows), Some(stored), false) = (&self.rows, &cpu.rows, maps.is_empty()) {
            let entrance = stored.entrance_of_parts(&cpu.scene.parts, &cpu.scene.media)?;
            maps.iter().try_for_each(|map| rows.add(map, &entrance, light.unit()))?;
        }
        self.tree.run();
        self.far.run();
        self.stale = Stale::Media;
        self.device.check()
    }

    fn upload_media(&mut self) -> Result<()> {
        self.near.set_media(&self.cpu.coefficients);
        self.buffers.set_media(&self.cpu.kernels, Some(self.cpu.basis.split_mm()))
    }
}

impl DeviceEvaluator for FactoredOnDevice {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        self.light(progress)?;
        if self.stale != Stale::Nothing {
            self.near.run(&self.buffers);
        }
        self.stale = Stale::Nothing;
        self.device.check()
    }

    fn held(&self) -> Held<'_> {
        self.buffers.held(&self.cpu.receivers)
    }
}

impl Evaluator for FactoredOnDevice {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        // Lit anew by the processor only where it is asked for an error.
        (self.cpu.lights, self.cpu.lit) = (lights, None);
        self.stale = Stale::Light;
        self.light(progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        let eta = |m: &Medium| m.properties.eta_inside_over_outside;
        let etas: Vec<f64> = self.cpu.scene.media.iter().map(eta).collect();
        self.cpu.set_media(media)?;
        let same_light = self.cpu.scene.media.iter().map(eta).eq(etas);
        self.stale = if same_light && self.stale != Stale::Light { Stale::Media } else { Stale::Light };
        self.upload_media()
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}
