//! The sums of [`GatheredEvaluator`] in compute shaders. Light reaches the samples on the CPU.

use std::sync::Arc;

use glam::DVec3;

use super::hierarchy_gpu::HierarchyOnDevice;
use super::lit_samples::GatheredEvaluator;
use super::model::Model;
use super::nets_gpu::NetsOnDevice;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::surface::{Geometry, SurfaceBuffers};
use crate::evaluate::forward::{forward_scene, forward_to_processor};
use crate::evaluate::{DeviceEvaluator, Evaluator, Held, Refined};
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::{Progress, Silent};
use crate::transport::kernel::EdgePrecision;
use crate::transport::near_field::Corners;
use crate::transport::surface::Surface;

/// A [`GatheredEvaluator`] whose radiosity a device gathers: over nets, or through the hierarchy where there are none or where
/// these do not resolve the kernels in force.
pub(super) struct GatheredOnDevice {
    cpu: GatheredEvaluator,
    device: Arc<Device>,
    buffers: SurfaceBuffers,
    nets: Option<NetsOnDevice>,
    hierarchy: Option<HierarchyOnDevice>,
    has_kernels: bool,
    is_current: bool,
}

impl GatheredOnDevice {
    /// Uploads samples and receivers, and what is known of the kernels.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5).
    pub(super) fn new(cpu: GatheredEvaluator, device: &Arc<Device>) -> Result<Self> {
        let Surface { domain, samples, patches, .. } = cpu.surface();
        let geometry = Geometry {
            facet_offsets: &samples.patch_offsets,
            patches,
            corners: &Corners::new(domain.mesh, samples, patches),
            receivers: &cpu.receivers,
            near: cpu.gathering.near,
            rules: EdgePrecision::Reference.rules(),
            terms: 0,
        };
        let buffers = SurfaceBuffers::new(device, &geometry)?;
        let device = Arc::clone(device);
        let mut result =
            Self { cpu, device, buffers, nets: None, hierarchy: None, has_kernels: false, is_current: false };
        // A calibration that is still to be made needs light first.
        if result.cpu.model.as_ref().is_none_or(|model| Model::in_force(model).is_some()) {
            result.set_kernels()?;
        }
        Ok(result)
    }

    /// Brings the kernels in force to the device.
    fn set_kernels(&mut self) -> Result<()> {
        let Self { cpu, device, buffers, nets, hierarchy, .. } = self;
        cpu.prepare_nets(None, &Silent);
        if cpu.nets().is_some() {
            match nets {
                Some(nets) => nets.set_tables(cpu, device, buffers)?,
                None => *nets = Some(NetsOnDevice::new(cpu, device, buffers)?),
            }
        } else {
            let kernels = cpu.kernels_in_force();
            match hierarchy {
                Some(there) if there.takes(&kernels.0) => there.set_kernels(cpu, device, buffers, &kernels)?,
                _ => *hierarchy = Some(HierarchyOnDevice::new(cpu, device, buffers, &kernels)?),
            }
        }
        buffers.orient(&cpu.receivers)?;
        device.check()?;
        self.has_kernels = true;
        Ok(())
    }

    fn other_kernels(&mut self) {
        (self.has_kernels, self.is_current) = (false, false);
    }
}

impl DeviceEvaluator for GatheredOnDevice {
    fn update(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.is_current {
            return Ok(());
        }
        self.cpu.irradiance(progress)?;
        if !self.has_kernels {
            self.set_kernels()?;
        }
        let Self { cpu, device, buffers, nets, hierarchy, .. } = self;
        buffers.set_light(&cpu.sample_light(cpu.lit()))?;
        match (nets, hierarchy) {
            (Some(nets), _) if cpu.nets().is_some() => nets.run(cpu, device, buffers)?,
            (_, Some(hierarchy)) => hierarchy.run(cpu, device, buffers)?,
            _ => return Err(Error::runtime("no kernels on the device")),
        }
        self.is_current = true;
        Ok(())
    }

    fn held(&self) -> Held<'_> {
        self.buffers.held(&self.cpu.receivers)
    }
}

impl Evaluator for GatheredOnDevice {
    forward_scene!(cpu);
    forward_to_processor!(cpu);

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.is_current = false;
        self.cpu.set_lights(lights, progress)
    }

    fn remember_lights(&mut self, count: usize) {
        self.cpu.remember_lights(count);
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        self.cpu.set_media(media)?;
        self.other_kernels();
        Ok(())
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        self.cpu.set_profile(profile)?;
        self.other_kernels();
        Ok(())
    }

    fn answer_at_once(&mut self) {
        self.cpu.answer_at_once();
    }

    fn refine(&mut self) -> Result<Refined> {
        let refined = self.cpu.refine()?;
        if refined == Refined::Changed {
            self.other_kernels();
        }
        Ok(refined)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.read_back(progress)
    }
}
