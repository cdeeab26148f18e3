//! `editable` in compute shaders: rays reach the samples on the CPU; stored rows, far field, near field and materials
//! run on the device.

use std::sync::Arc;

use glam::DVec3;

use super::evaluate::FactoredEvaluator;
use super::far_field_gpu::FarOnDevice;
use crate::compress::ledger::Ledger;
use crate::error::Result;
use crate::evaluate::device::jobs::Effort;
use crate::evaluate::device::near_field::NearOnDevice;
use crate::evaluate::device::surface::{Geometry, SurfaceBuffers};
use crate::evaluate::device::tree::TreeOnDevice;
use crate::evaluate::device::{Device, read_radiosity};
use crate::evaluate::{Capabilities, Cost, DeviceEvaluator, Evaluator};
use crate::forms::environment_rows::gpu::RowsOnDevice;
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::light::cube_light::CubeLight;
use crate::medium::material::Medium;
use crate::progress::Progress;
use crate::scene::Scene;
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
    lights: Vec<Light>,
    stale: Stale,
}

impl FactoredOnDevice {
    pub(super) fn new(cpu: FactoredEvaluator, device: &Arc<Device>) -> Result<Self> {
        let geometry = Geometry {
            samples: &cpu.samples,
            patches: &cpu.patches,
            corners: &cpu.corners,
            receivers: &cpu.receivers,
            near: cpu.form.near,
            precision: EdgePrecision::Near,
            terms: cpu.far.terms,
        };
        let buffers = SurfaceBuffers::new(device, &geometry)?;
        let rows = cpu.rows.as_ref().map(|rows| RowsOnDevice::new(&buffers, rows, &cpu.samples)).transpose()?;
        let tree = TreeOnDevice::new(&buffers, &cpu.samples, &cpu.patches)?;
        let far = FarOnDevice::new(device, (&cpu.far, &cpu.points.fills, cpu.points.weights.as_ref()), &tree)?;
        let pieces = cpu.form.sampling.pieces_of_uneven() as usize;
        let effort = Effort::new(&cpu.surface(), cpu.form.near, EdgePrecision::Near, pieces);
        let parts = &cpu.scene.parts.parts;
        let media = (cpu.scene.media.len(), |part: u32| parts[part as usize].medium);
        let near = NearOnDevice::new(&buffers, &cpu.receivers, (&cpu.around, &effort), media, far.values())?;
        let lights = cpu.lights.clone();
        let device = Arc::clone(device);
        let mut evaluator = Self { cpu, device, buffers, rows, tree, far, near, lights, stale: Stale::Light };
        evaluator.upload_media()?;
        Ok(evaluator)
    }

    /// Lights the samples and sums the far field, where that is not done.
    fn light(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.stale != Stale::Light {
            return Ok(());
        }
        let cpu = &self.cpu;
        let (near, stored): (Vec<Light>, Vec<Light>) = self.lights.iter().cloned().partition(|l| !cpu.is_stored(l));
        let (fields, stored): (Vec<Light>, Vec<Light>) = stored.into_iter().partition(Light::has_field);
        let (mut irradiance, pieces) = match near.as_slice() {
            [] => (vec![DVec3::ZERO; cpu.samples.len()], Pieces::default()),
            near => cpu.sampled(near, progress)?,
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
    fn device(&self) -> &Arc<Device> {
        &self.device
    }

    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        self.light(progress)?;
        if self.stale != Stale::Nothing {
            self.near.run(&self.buffers);
        }
        self.stale = Stale::Nothing;
        self.device.check()
    }

    fn radiosity_buffer(&self) -> &wgpu::Buffer {
        self.buffers.radiosity()
    }

    fn scale(&self) -> f64 {
        self.buffers.scale()
    }

    fn receiver_of_vertex(&self) -> &[u32] {
        &self.cpu.receivers.of_vertex
    }

    fn transport(&self) -> String {
        self.device.describe()
    }
}

impl Evaluator for FactoredOnDevice {
    fn capabilities(&self) -> Capabilities {
        self.cpu.capabilities()
    }

    fn cost(&self) -> Cost {
        self.cpu.cost()
    }

    fn scene(&self) -> &Scene {
        self.cpu.scene()
    }

    fn bvh(&self) -> &Bvh {
        self.cpu.bvh()
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.lights = lights;
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
        read_radiosity(self, progress)
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        self.cpu.set_lights(self.lights.clone(), progress)?;
        self.cpu.measured_error(unseen, progress)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.cpu.set_lights(self.lights.clone(), progress)?;
        self.cpu.all_pairs(progress)
    }
}
