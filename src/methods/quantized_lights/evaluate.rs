//! How `quantized_lights` evaluates: lights become weights over what is stored, and radiosity is linear in these. Components:
//! weights over the set become a vector over the columns, radiosity at a reference point is a dot product with it, and at a vertex
//! a weighted sum over reference points.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::baked_in::{self, Truth};
#[cfg(feature = "gpu")]
use super::gpu::QuantisedOnDevice;
use super::lights::{LightSet, blend, scheme};
use super::sections::{Lit, Transport, read};
use super::stage::GROUP;
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
#[cfg(feature = "gpu")]
use crate::error::Error;
use crate::error::Result;
#[cfg(feature = "gpu")]
use crate::evaluate::device::{Device, DeviceEvaluator};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::progress::Progress;
use crate::transport::receivers::Receivers;
use crate::transport::scene::{Medium, Scene};

/// What an asset stores, as it is evaluated.
pub(super) trait Stored: Send {
    /// A light, made ready.
    type Light: Send;

    /// Several lights together.
    fn light(&self, set: &LightSet, lights: &[Light]) -> Result<Self::Light>;

    /// Radiosity of every source vertex, RGB, none negative.
    fn radiosity(&mut self, light: &Self::Light, receivers: &Receivers) -> Vec<DVec3>;

    /// Bytes in memory.
    fn bytes(&self) -> usize;

    /// The same on a device.
    #[cfg(feature = "gpu")]
    fn on_device(_: QuantisedEvaluator<Self>, _: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>>
    where
        Self: Sized,
    {
        Err(Error::unsupported(
            "this encoding of `quantized_lights` is evaluated on the CPU only: --device cpu, or bake it with --set encoding=auto",
        ))
    }
}

/// The transport of an asset, lit.
pub(super) struct QuantisedEvaluator<S: Stored> {
    scene: Scene,
    bvh: OnceLock<Bvh>,
    receivers: Receivers,
    set: LightSet,
    stored: S,
    lights: Vec<Light>,
    light: S::Light,
    /// For who asks what the transport is worth.
    truth: Truth,
}

/// An asset of components.
pub(super) fn open(asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let file = read(&asset.sections)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let settings = &asset.provenance.settings;
    let between = (scheme(settings)?, blend(settings)?);
    let mut set = LightSet::new(&scene, file.directions as usize, file.shells.clone(), between)?;
    let transport = Transport::new(&file, &scene, &receivers, &set)?;
    // The basis has taken them in.
    set.interpolator.forget_weights();
    let components = Components { transport, references: Vec::new(), gathered: Vec::new() };
    QuantisedEvaluator::boxed(scene, receivers, set, file.samples as usize, components)
}

/// Components at reference points.
pub(super) struct Components {
    transport: Transport,
    /// Radiosity of the reference points and of the receivers, kept for their memory.
    references: Vec<[f32; 4]>,
    gathered: Vec<[f32; 4]>,
}

impl Stored for Components {
    type Light = Lit;

    fn light(&self, set: &LightSet, lights: &[Light]) -> Result<Self::Light> {
        self.transport.light(set, lights)
    }

    fn radiosity(&mut self, lit: &Self::Light, receivers: &Receivers) -> Vec<DVec3> {
        self.transport.products(lit, &mut self.references);
        self.transport.weights.apply(&self.references, &mut self.gathered);
        receivers.expand_rgb(&self.gathered, lit.scale)
    }

    fn bytes(&self) -> usize {
        self.transport.bytes()
    }

    #[cfg(feature = "gpu")]
    fn on_device(evaluator: QuantisedEvaluator<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(QuantisedOnDevice::new(evaluator, device)?))
    }
}

impl<S: Stored + 'static> QuantisedEvaluator<S> {
    /// What was stored for these receivers, without light.
    pub(super) fn boxed(
        scene: Scene,
        receivers: Receivers,
        set: LightSet,
        samples: usize,
        stored: S,
    ) -> Result<Box<dyn Evaluator>> {
        let (lights, bvh, light) = (Vec::new(), OnceLock::new(), stored.light(&set, &[])?);
        Ok(Box::new(Self { scene, bvh, receivers, set, stored, lights, light, truth: Truth::new(samples) }))
    }
}

/// What a device takes from here.
#[cfg(feature = "gpu")]
impl QuantisedEvaluator<Components> {
    pub(super) fn transport(&self) -> &Transport {
        &self.stored.transport
    }

    pub(super) fn receivers(&self) -> &Receivers {
        &self.receivers
    }

    /// The lights in force.
    pub(super) fn lit(&self) -> &Lit {
        &self.light
    }
}

impl<S: Stored + 'static> Evaluator for QuantisedEvaluator<S> {
    fn capabilities(&self) -> Capabilities {
        Capabilities { material: MaterialEdit::None }
    }

    fn cost(&self) -> Cost {
        Cost {
            samples: self.truth.samples(),
            receivers: self.receivers.len(),
            resident_bytes: self.stored.bytes() + size_of_val(self.receivers.of_vertex.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    fn set_lights(&mut self, lights: Vec<Light>, _: &dyn Progress) -> Result<()> {
        self.light = self.stored.light(&self.set, &lights)?;
        self.lights = lights;
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        baked_in::replace_media(&mut self.scene, media)
    }

    fn radiosity(&mut self, _: &dyn Progress) -> Result<Vec<DVec3>> {
        Ok(self.stored.radiosity(&self.light, &self.receivers))
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        let Self { scene, receivers, set, stored, lights, truth, .. } = self;
        let values = |lights: &[Light]| {
            let light = stored.light(set, lights)?;
            Ok(stored.radiosity(&light, receivers))
        };
        let note = "the quantised set against its samples lit by rays, the worst of these lights and of probe lights";
        truth.measured(scene, (lights, unseen), values, ("quantised lights", note), progress)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.truth.lit(&self.scene, &self.lights, progress)?.all_pairs(progress)
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        S::on_device(*self, device)
    }
}
