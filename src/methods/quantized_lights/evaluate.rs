//! How `quantized_lights` evaluates: lights become weights over the set, these a vector over the columns; radiosity at a
//! reference point is a dot product with it, and at a vertex a weighted sum over reference points.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

#[cfg(feature = "gpu")]
use super::gpu::QuantisedOnDevice;
use super::lights::{LightSet, scheme};
use super::sections::{Columns, Transport, read};
use super::stage::GROUP;
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
#[cfg(feature = "gpu")]
use crate::evaluate::device::{Device, DeviceEvaluator};
use crate::evaluate::sampled::{Bound, Far, Plan, SampledEvaluator};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::Progress;
use crate::transport::gather::NearField;
use crate::transport::irradiance::LightSampling;
use crate::transport::receivers::Receivers;
use crate::transport::scene::{Medium, Scene};

/// Error of the hierarchy that the transport is measured against.
const TRUTH_ERROR: f64 = 0.001;

/// The transport of an asset, lit.
pub(super) struct QuantisedEvaluator {
    scene: Scene,
    samples: usize,
    bvh: OnceLock<Bvh>,
    receivers: Receivers,
    set: LightSet,
    transport: Transport,
    lights: Vec<Light>,
    columns: Columns,
    /// Radiosity of the reference points and of the receivers, kept for their memory.
    references: Vec<[f32; 4]>,
    gathered: Vec<[f32; 4]>,
    /// Samples and rays, for who asks what the transport is worth.
    truth: Option<Box<SampledEvaluator>>,
}

pub(super) fn open(asset: Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let file = read(&asset.sections)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let set =
        LightSet::new(&scene, file.directions as usize, file.shells.clone(), scheme(&asset.provenance.settings)?)?;
    let transport = Transport::new(&file, &scene, &receivers, &set)?;
    let columns = transport.columns(&set, &[])?;
    let samples = file.samples as usize;
    Ok(Box::new(QuantisedEvaluator {
        scene,
        samples,
        bvh: OnceLock::new(),
        receivers,
        set,
        transport,
        lights: Vec::new(),
        columns,
        references: Vec::new(),
        gathered: Vec::new(),
        truth: None,
    }))
}

impl QuantisedEvaluator {
    /// Radiosity of the vertices.
    fn gathered(&mut self, columns: &Columns) -> Vec<DVec3> {
        self.transport.products(columns, &mut self.references);
        self.transport.weights.apply(&self.references, &mut self.gathered);
        self.receivers.expand_rgb(&self.gathered, columns.scale)
    }

    /// The samples with rays and the hierarchy; made when it is first asked for.
    fn truth(&mut self, lights: &[Light], progress: &dyn Progress) -> Result<&mut SampledEvaluator> {
        if self.truth.is_none() {
            let scene = self.scene.clone();
            let samples = Samples::new(&scene.mesh, &scene.parts, self.samples);
            let asset = Asset {
                scene,
                samples,
                provenance: Default::default(),
                ledger: Ledger::default(),
                sections: Vec::new(),
            };
            let plan = Plan {
                sampling: LightSampling::FAST,
                near: NearField::FAST,
                far: Far::Hierarchical { error: TRUTH_ERROR, bound: Bound::SolidAngle },
                group: GROUP,
            };
            self.truth = Some(Box::new(SampledEvaluator::new(Arc::new(asset), plan)));
        }
        let truth = self.truth.as_mut().ok_or_else(|| Error::runtime("no samples"))?;
        truth.set_lights(lights.to_vec(), progress)?;
        Ok(truth)
    }

    /// The error against the gather of the samples.
    fn error(&mut self, lights: &[Light], progress: &dyn Progress) -> Result<VertexError> {
        let columns = self.transport.columns(&self.set, lights)?;
        let values = self.gathered(&columns);
        let expected = self.truth(lights, progress)?.radiosity(progress)?;
        Ok(vertex_error(&values, &expected, &self.scene.vertex_areas_mm2()))
    }
}

/// What a device takes from here.
#[cfg(feature = "gpu")]
impl QuantisedEvaluator {
    pub(super) fn transport(&self) -> &Transport {
        &self.transport
    }

    pub(super) fn receivers(&self) -> &Receivers {
        &self.receivers
    }

    /// The lights in force.
    pub(super) fn columns(&self) -> &Columns {
        &self.columns
    }
}

impl Evaluator for QuantisedEvaluator {
    fn capabilities(&self) -> Capabilities {
        Capabilities { material: MaterialEdit::None }
    }

    fn cost(&self) -> Cost {
        Cost {
            samples: self.samples,
            receivers: self.receivers.len(),
            resident_bytes: self.transport.bytes() + size_of_val(self.receivers.of_vertex.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    fn set_lights(&mut self, lights: Vec<Light>, _: &dyn Progress) -> Result<()> {
        self.columns = self.transport.columns(&self.set, &lights)?;
        self.lights = lights;
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        if media.len() != self.scene.media.len() {
            let (given, there) = (media.len(), self.scene.media.len());
            return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
        }
        if media.iter().zip(&self.scene.media).any(|(a, b)| a.properties != b.properties) {
            return Err(Error::unsupported(
                "the material is baked into this asset of `quantized_lights`; bake it again, or with --method editable",
            ));
        }
        self.scene.media = media;
        Ok(())
    }

    fn radiosity(&mut self, _: &dyn Progress) -> Result<Vec<DVec3>> {
        let columns = std::mem::take(&mut self.columns);
        let values = self.gathered(&columns);
        self.columns = columns;
        Ok(values)
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        let lights = self.lights.clone();
        let mut error = VertexError::default();
        for light in unseen {
            error = error.max(self.error(std::slice::from_ref(light), progress)?);
        }
        error = error.max(self.error(&lights, progress)?);
        let mut ledger = self.truth(&lights, progress)?.measured_error(&[], progress)?;
        let note = "the quantised set against its samples lit by rays, the worst of these lights and of probe lights";
        ledger.add("quantised lights", error, note);
        Ok(ledger)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let lights = self.lights.clone();
        self.truth(&lights, progress)?.all_pairs(progress)
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(QuantisedOnDevice::new(*self, device)?))
    }
}
