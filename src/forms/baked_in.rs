//! Evaluators whose material is baked in: lights become factors of the stored transport; media stay fixed; errors are
//! measured against samples lit by rays.

use std::sync::{Arc, OnceLock};

use glam::DVec3;
use translux_format::RawSection;

use super::gathered::{Bound, Far, GatheredEvaluator, Gathering};
use super::sampled_scene::GROUP;
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::inter_reflection::Outside;
use crate::evaluate::single_scattering::{LitScene, TowardsEye, Traced};
use crate::evaluate::stages::worst_and_unseen;
use crate::evaluate::{Capabilities, Cost, Evaluator, SingleScattering};
#[cfg(feature = "gpu")]
use crate::evaluate::{DeviceEvaluator, device::Device};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::math::statistics::vertex_error;
use crate::medium::material::Medium;
use crate::medium::profile::Orders;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::irradiance::LightSampling;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;

/// Error of the hierarchy that the transport is measured against.
const TRUTH_ERROR: f64 = 0.001;

/// Samples lit by rays and summed through the hierarchy.
pub fn truth(scene: &Scene, samples: usize) -> GatheredEvaluator {
    GatheredEvaluator::new(sampled(scene, samples, Vec::new()), gathering(samples))
}

/// An asset of samples and sections.
fn sampled(scene: &Scene, samples: usize, sections: Vec<RawSection>) -> Arc<Asset> {
    Arc::new(Asset::of_scene(scene.clone(), Samples::new(&scene.mesh, &scene.parts, samples), sections))
}

/// Rays towards an environment of all samples together, and of one at least.
const SOFT_RAYS: usize = 1 << 24;
const LEAST_DIRECTIONS: u32 = 32;

fn gathering(samples: usize) -> Gathering {
    let fast = LightSampling::FAST;
    Gathering {
        sampling: fast.with_directions_of_all(SOFT_RAYS, samples, LEAST_DIRECTIONS..=fast.directions),
        near: NearField::FAST,
        far: Far::Hierarchical { error: TRUTH_ERROR, bound: Bound::SolidAngle },
        group: GROUP,
        nets: None,
    }
}

/// Reference for an evaluator's radiosity: [`truth`], made when it is first asked for.
pub struct Truth {
    samples: usize,
    outside: Option<Outside>,
    /// Sections of a calibration, where its kernels are not the dipole's.
    calibration: Vec<RawSection>,
    /// Orders of scattering of dipoles.
    orders: Orders,
    made: Option<Box<GatheredEvaluator>>,
}

impl Truth {
    /// A reference of `samples` samples.
    pub fn new(samples: usize) -> Self {
        Self { samples, outside: None, calibration: Vec::new(), orders: Orders::FromOne, made: None }
    }

    /// The reference under some lights.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub fn lit(&mut self, scene: &Scene, lights: &[Light], progress: &dyn Progress) -> Result<&mut GatheredEvaluator> {
        if self.made.is_none() {
            let asset = sampled(scene, self.samples, self.calibration.clone());
            let evaluator =
                GatheredEvaluator::new(asset, gathering(self.samples)).with_model()?.of_orders(self.orders)?;
            self.made = Some(Box::new(evaluator.with_inter_reflection(self.outside)));
        }
        let Some(made) = &mut self.made else { return Err(Error::runtime("a reference that was just made is gone")) };
        made.set_lights(lights.to_vec(), progress)?;
        Ok(made)
    }

    /// The reference's own error, and a stage with the error of `values`: the worst of the lights in force, all
    /// together, and of `unseen`, each alone.
    ///
    /// # Errors
    /// Errors of `values`; lights that cannot be served.
    pub fn measured(
        &mut self,
        scene: &Scene,
        (lights, unseen): (&[Light], &[Light]),
        mut values: impl FnMut(&[Light]) -> Result<Vec<DVec3>>,
        (stage, note): (&str, &str),
        progress: &dyn Progress,
    ) -> Result<Ledger> {
        let areas = scene.vertex_areas_mm2();
        let error = worst_and_unseen(unseen, |light| {
            let lights = light.map_or(lights, std::slice::from_ref);
            let expected = self.lit(scene, lights, progress)?.radiosity(progress)?;
            Ok(vertex_error(&values(lights)?, &expected, &areas).or_none())
        })?;
        let mut ledger = self.lit(scene, lights, progress)?.measured_error(&[], progress)?;
        ledger.add(stage, error, note);
        Ok(ledger)
    }
}

/// Editability of the mean cosine of the phase function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeanCosine {
    /// It is baked in, or nothing depends on it.
    Stays,
    /// It is read at run time.
    Free,
}

/// Replaces the media: names may change, properties may not, the mean cosine apart where it is free.
///
/// # Errors
/// Command line: another number of media; unsupported: other properties.
pub fn replace_media(scene: &mut Scene, media: Vec<Medium>, g: MeanCosine) -> Result<()> {
    if media.len() != scene.media.len() {
        let (given, there) = (media.len(), scene.media.len());
        return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
    }
    let differs = |(a, b): (&Medium, &Medium)| {
        let mut own = a.properties;
        if g == MeanCosine::Free {
            own.g = b.properties.g;
        }
        own != b.properties
    };
    if media.iter().zip(&scene.media).any(differs) {
        return Err(Error::unsupported(
            "the material is baked into this asset; bake it again, or with --method editable",
        ));
    }
    scene.media = media;
    Ok(())
}

/// Stored transport of an asset, as it is evaluated.
pub trait Stored: Send + Sync {
    /// Lights, converted to the factor of the stored transport.
    type Light: Send + Sync;

    /// Converts several lights together to the factor of the stored transport.
    ///
    /// # Errors
    ///
    /// Lights of a kind that the asset does not hold, or whose files cannot be used.
    fn light(&self, lights: &[Light]) -> Result<Self::Light>;

    /// Radiosity of every source vertex, RGB, none negative.
    fn radiosity(&mut self, light: &Self::Light, receivers: &Receivers) -> Vec<DVec3>;

    /// Name of the stage of [`Evaluator::measured_error`] with the error of these values.
    fn stage(&self) -> &'static str;

    /// Bytes in memory.
    fn bytes(&self) -> usize;

    /// The evaluator on a device.
    ///
    /// # Errors
    ///
    /// `Unsupported` where there are no shaders for it, and what the device itself reports.
    #[cfg(feature = "gpu")]
    fn on_device(_: BakedIn<Self>, _: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>>
    where
        Self: Sized,
    {
        Err(Error::unsupported(
            "what this asset stores is evaluated on the CPU only: --device cpu, or bake it with the defaults of its method",
        ))
    }
}

/// Single scattering of an asset.
pub(crate) enum Single {
    /// Nothing.
    None,
    /// Part of the radiosity, isotropic; these rays give the same.
    Folded(Traced),
    /// Apart from the radiosity.
    Beside(Box<dyn StoredSingle>),
}

/// Single scattering, inter-reflection and model of an asset.
pub(crate) struct Beside {
    pub(crate) single: Single,
    /// Inter-reflection, part of the radiosity.
    pub(crate) outside: Option<Outside>,
    /// Sections of the calibration of the kernels that the transport is of.
    pub(crate) calibration: Vec<RawSection>,
}

impl Single {
    fn beside(&self) -> Option<&dyn StoredSingle> {
        match self {
            Self::Beside(single) => Some(single.as_ref()),
            Self::None | Self::Folded(_) => None,
        }
    }
}

/// Single scattering, stored in an asset or by rays at run time.
pub(crate) trait StoredSingle: Send + Sync {
    /// Answer of [`Evaluator::single_scattering_is`].
    fn is(&self, scene: &Scene) -> SingleScattering;

    /// Result of [`Evaluator::single_scattering`].
    fn per_vertex(&self, lit: LitScene, receivers: &Receivers) -> Result<Option<Vec<DVec3>>>;

    /// Result of [`Evaluator::towards_eye`].
    fn towards_eye<'a>(
        &'a self,
        lit: LitScene<'a>,
        receivers: &'a Receivers,
    ) -> Result<Option<Box<dyn TowardsEye + 'a>>>;

    /// `Free` if the mean cosine of media is read at run time.
    fn mean_cosine(&self) -> MeanCosine;

    /// Enters its error against rays into a ledger.
    fn enter_error(&self, lit: LitScene, receivers: &Receivers, ledger: &mut Ledger) -> Result<()>;

    /// Bytes in memory.
    fn bytes(&self) -> usize;
}

/// Evaluator of stored transport under the lights in force.
pub struct BakedIn<S: Stored> {
    scene: Scene,
    bvh: OnceLock<Bvh>,
    pub(crate) receivers: Receivers,
    pub(crate) stored: S,
    lights: Vec<Light>,
    /// The lights in force.
    pub(crate) light: S::Light,
    /// Reference for the measured error.
    truth: Truth,
    single: Single,
}

impl<S: Stored + 'static> BakedIn<S> {
    /// An evaluator of `stored` at these receivers, without lights.
    ///
    /// # Errors
    /// Errors of [`Stored::light`] without lights.
    pub fn boxed(scene: Scene, receivers: Receivers, samples: usize, stored: S) -> Result<Box<dyn Evaluator>> {
        Self::with(
            scene,
            receivers,
            samples,
            stored,
            Beside { single: Single::None, outside: None, calibration: Vec::new() },
        )
    }

    /// The same with single scattering and inter-reflection.
    pub(crate) fn with(
        scene: Scene,
        receivers: Receivers,
        samples: usize,
        stored: S,
        Beside { single, outside, calibration }: Beside,
    ) -> Result<Box<dyn Evaluator>> {
        let (lights, bvh, light) = (Vec::new(), OnceLock::new(), stored.light(&[])?);
        let orders = Orders::beside_first(!matches!(single, Single::None));
        Ok(Box::new(Self {
            scene,
            bvh,
            receivers,
            stored,
            lights,
            light,
            truth: Truth { outside, calibration, orders, ..Truth::new(samples) },
            single,
        }))
    }
}

impl<S: Stored> BakedIn<S> {
    fn lit_scene(&self) -> LitScene<'_> {
        let bvh = self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh));
        LitScene { scene: &self.scene, bvh, lights: &self.lights }
    }
}

impl<S: Stored + 'static> Evaluator for BakedIn<S> {
    fn capabilities(&self) -> Capabilities {
        Capabilities::NONE
    }

    fn cost(&self) -> Cost {
        Cost {
            samples: self.truth.samples,
            receivers: self.receivers.len(),
            resident_bytes: self.stored.bytes()
                + self.single.beside().map_or(0, |single| single.bytes())
                + size_of_val(self.receivers.of_vertex.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    fn set_lights(&mut self, lights: Vec<Light>, _: &dyn Progress) -> Result<()> {
        // On a thread of the pool: of the sums inside, which take microseconds, none waits for another thread to wake.
        self.light = rayon::scope(|_| self.stored.light(&lights))?;
        self.lights = lights;
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        let g = self.single.beside().map_or(MeanCosine::Stays, |single| single.mean_cosine());
        replace_media(&mut self.scene, media, g)
    }

    fn radiosity(&mut self, _: &dyn Progress) -> Result<Vec<DVec3>> {
        let Self { stored, light, receivers, .. } = self;
        Ok(rayon::scope(|_| stored.radiosity(light, receivers)))
    }

    fn single_scattering(&mut self, _: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        let Some(single) = self.single.beside() else { return Ok(None) };
        single.per_vertex(self.lit_scene(), &self.receivers)
    }

    fn single_scattering_is(&self) -> SingleScattering {
        match &self.single {
            Single::None => SingleScattering::None,
            Single::Folded(_) => SingleScattering::Included,
            Single::Beside(single) => single.is(&self.scene),
        }
    }

    fn towards_eye(&self) -> Result<Option<Box<dyn TowardsEye + '_>>> {
        let Some(single) = self.single.beside() else { return Ok(None) };
        single.towards_eye(self.lit_scene(), &self.receivers)
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        let folded = match &self.single {
            Single::Folded(traced) => Some(*traced),
            Single::None | Single::Beside(_) => None,
        };
        let bvh = self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh));
        let Self { scene, receivers, stored, lights, truth, .. } = self;
        let stage = stored.stage();
        // Of the unseen ones those that are served.
        let served = |light: &&Light| match stored.light(std::slice::from_ref(*light)) {
            Ok(_) => true,
            Err(error) => error.code() != ExitCode::Unsupported,
        };
        let unseen: Vec<Light> = unseen.iter().filter(served).cloned().collect();
        let values = |lights: &[Light]| {
            let light = stored.light(lights)?;
            let mut values = stored.radiosity(&light, receivers);
            if let Some(traced) = folded {
                // What the truth has apart.
                let rays = traced.per_vertex(LitScene { scene, bvh, lights }, &Silent)?.unwrap_or_default();
                values.iter_mut().zip(rays).for_each(|(value, single)| *value -= single);
            }
            Ok(values)
        };
        let note = "against its samples lit by rays, the worst of these lights and of probe lights";
        let mut ledger = truth.measured(scene, (lights, &unseen), values, (stage, note), progress)?;
        if let Some(single) = self.single.beside() {
            single.enter_error(self.lit_scene(), &self.receivers, &mut ledger)?;
        }
        Ok(ledger)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let mut values = self.truth.lit(&self.scene, &self.lights, progress)?.all_pairs(progress)?;
        if let Single::Folded(traced) = self.single {
            // What the truth has apart.
            let rays = traced.per_vertex(self.lit_scene(), progress)?.unwrap_or_default();
            values.iter_mut().zip(rays).for_each(|(value, single)| *value += single);
        }
        Ok(values)
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        S::on_device(*self, device)
    }
}
