//! How `quantized_lights` evaluates: lights become weights over what is stored, and radiosity is linear in these. Components:
//! weights over the set become a vector over the columns, radiosity at a reference point is a dot product with it, and at a vertex
//! a weighted sum over reference points.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::lights::{LightSet, scheme};
use super::sections::{Transport, interpolate, read};
use super::stage::GROUP;
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
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

/// An error, or none where the truth is black and the values are not: nothing can be relative to that.
pub(super) fn relative(error: VertexError) -> VertexError {
    if error.rms.is_finite() { error } else { VertexError::default() }
}

/// What an asset stores, as it is evaluated.
pub(super) trait Stored: Send {
    /// A light, made ready.
    type Light: Send;

    /// Several lights together.
    fn light(&self, set: &LightSet, lights: &[Light]) -> Result<Self::Light>;

    /// Radiosity of every receiver, RGB, none negative.
    fn radiosity(&self, light: &Self::Light) -> Vec<DVec3>;

    /// Bytes in memory.
    fn bytes(&self) -> usize;
}

/// The transport of an asset, lit.
pub(super) struct QuantisedEvaluator<S: Stored> {
    scene: Scene,
    samples: usize,
    bvh: OnceLock<Bvh>,
    receivers: Receivers,
    set: LightSet,
    stored: S,
    lights: Vec<Light>,
    light: S::Light,
    /// Samples and rays, for who asks what the transport is worth.
    truth: Option<Box<SampledEvaluator>>,
}

/// An asset of components.
pub(super) fn open(asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let file = read(&asset.sections)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let set =
        LightSet::new(&scene, file.directions as usize, file.shells.clone(), scheme(&asset.provenance.settings)?)?;
    let transport = Transport::new(&file, &scene, &receivers, &set)?;
    let components = Components { transport, receivers: receivers.len() };
    QuantisedEvaluator::boxed(scene, receivers, set, file.samples as usize, components)
}

/// Components at reference points.
struct Components {
    transport: Transport,
    receivers: usize,
}

impl Stored for Components {
    /// Per channel, column after column.
    type Light = [Vec<f32>; 3];

    fn light(&self, set: &LightSet, lights: &[Light]) -> Result<Self::Light> {
        Ok(self.transport.columns_of(&set.vector(lights)?))
    }

    fn radiosity(&self, columns: &Self::Light) -> Vec<DVec3> {
        interpolate(&self.transport.weights, &self.transport.products(columns), self.receivers)
    }

    fn bytes(&self) -> usize {
        self.transport.bytes()
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
        Ok(Box::new(Self { scene, samples, bvh, receivers, set, stored, lights, light, truth: None }))
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
        let values = self.receivers.expand(&self.stored.radiosity(&self.stored.light(&self.set, lights)?));
        let expected = self.truth(lights, progress)?.radiosity(progress)?;
        Ok(relative(vertex_error(&values, &expected, &self.scene.vertex_areas_mm2())))
    }
}

impl<S: Stored + 'static> Evaluator for QuantisedEvaluator<S> {
    fn capabilities(&self) -> Capabilities {
        Capabilities { material: MaterialEdit::None }
    }

    fn cost(&self) -> Cost {
        Cost {
            samples: self.samples,
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
        Ok(self.receivers.expand(&self.stored.radiosity(&self.light)))
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
}
