//! The evaluator of methods that store surface samples and no transport: light reaches the samples by ray casting and
//! is gathered at the receivers, over all pairs or through the tree. Everything about lights and media may change.

mod errors;
mod nets;

use std::sync::Arc;

use glam::DVec3;

use self::nets::Nets;
#[cfg(feature = "gpu")]
use super::device::{Device, DeviceEvaluator, nets::NetsOnDevice, sampled::SampledOnDevice};
use super::environment::{StoredRows, by_rays, error_of_rows};
use super::inter_reflection::{Outside, Returned, Transfer};
use super::sampling_error::{Sampled, receiver_areas};
use super::single_scattering::{LitScene, TowardsEye, Traced};
use super::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, SingleScattering};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::Patch;
use crate::light::Light;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;
use crate::transport::gather::{Criterion, Gather, Lit, MediumKernel, NearField, Scheme};
use crate::transport::interreflection::InterReflection;
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::multilevel::{Quality, SurfaceNets, SurfaceTables};
use crate::transport::receivers::Receivers;
use crate::transport::scene::{self, Medium, Scene, Surface};
use crate::transport::tree::SampleTree;

/// How samples turn into radiosity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Rays.
    pub sampling: LightSampling,
    /// Near field.
    pub near: NearField,
    /// Far field.
    pub far: Far,
    /// Receivers that share a traversal.
    pub group: usize,
    /// Radiosity of the vertices by multilevel summation; through the far field above otherwise.
    pub nets: Option<Quality>,
}

/// The far field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Far {
    /// Every sample with every receiver.
    AllPairs,
    /// Through the tree, with an asked error relative to all pairs.
    Hierarchical {
        /// Asked relative error of the hierarchy alone.
        error: f64,
        /// Which clusters may stand for their samples.
        bound: Bound,
    },
}

/// The criterion that the asked error tunes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// Solid angle of the cluster.
    SolidAngle,
    /// Bound on the kernel's error.
    Kernel,
}

impl Bound {
    fn criterion(self, limit: f64) -> Criterion {
        match self {
            Self::SolidAngle => Criterion::SolidAngle(limit),
            Self::Kernel => Criterion::KernelBound(limit),
        }
    }

    /// Where tuning starts: loose enough that a larger limit would not pay, by the measured error of each criterion.
    fn first_limit(self, error: f64) -> f64 {
        match self {
            Self::SolidAngle => (8.0 * error).clamp(1e-4, 1.0),
            Self::Kernel => 0.02 * error,
        }
    }
}

/// What there is before there are lights.
static NO_PIECES: Pieces = Pieces::NONE;

/// Samples, lights and media, with what follows from them.
pub struct SampledEvaluator {
    asset: Arc<Asset>,
    scene: Scene,
    plan: Plan,
    bvh: Bvh,
    patches: Vec<Patch>,
    tree: SampleTree,
    receivers: Receivers,
    areas: Vec<f64>,
    lights: Vec<Light>,
    irradiance: Option<(Vec<DVec3>, Pieces)>,
    limit: Option<f64>,
    single: Option<Traced>,
    outside: Option<Outside>,
    /// Of the indices of refraction in force.
    matrix: Option<InterReflection>,
    /// Of the lights and media in force.
    returned: Option<Returned>,
    /// In place of the dipole, with its kernels for the media in force.
    profile: Option<(LoadedProfile, Vec<MediumKernel>)>,
    nets: Option<Nets>,
    /// Irradiance under light from far away, in place of rays.
    rows: Option<StoredRows>,
}

impl SampledEvaluator {
    /// Builds the tree and the occluders of an asset.
    pub fn new(asset: Arc<Asset>, plan: Plan) -> Self {
        let scene = asset.scene.clone();
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || scene::patches(&scene, &asset.samples));
        let tree = SampleTree::new(&asset.samples, &patches);
        let receivers = Receivers::new(&scene.mesh, &scene.parts, plan.group);
        let areas = receiver_areas(&scene, &receivers);
        Self {
            asset,
            scene,
            plan,
            bvh,
            patches,
            tree,
            receivers,
            areas,
            lights: Vec::new(),
            irradiance: None,
            limit: None,
            single: None,
            outside: None,
            matrix: None,
            returned: None,
            profile: None,
            nets: plan.nets.map(Nets::new),
            rows: None,
        }
    }

    /// The same with stored rows for light from far away.
    #[must_use]
    pub fn with_rows(self, rows: Option<StoredRows>) -> Self {
        Self { rows, ..self }
    }

    /// The same with single scattering by rays.
    #[must_use]
    pub fn with_single_scattering(self, single: Option<Traced>) -> Self {
        Self { single, ..self }
    }

    /// The same with light that comes back from outside the medium.
    #[must_use]
    pub fn with_inter_reflection(self, outside: Option<Outside>) -> Self {
        Self { outside, ..self }
    }

    /// For the media and profiles in force.
    fn gather<'a>(&'a self, surface: &'a Surface<'a>, near: NearField) -> Gather<'a> {
        match &self.profile {
            Some((_, kernels)) => Gather::with_kernels(surface, &self.tree, kernels.clone(), near),
            None => Gather::new(surface, &self.tree, &self.scene.media, near),
        }
    }

    /// Kernels of some media with a profile.
    fn kernels(&self, profile: &LoadedProfile, media: &[Medium]) -> Result<Vec<MediumKernel>> {
        let reach = self.scene.mesh.diagonal_mm();
        media.iter().map(|medium| MediumKernel::with_profile(medium, profile, reach)).collect()
    }

    fn lit_scene(&self) -> LitScene<'_> {
        LitScene { scene: &self.scene, bvh: &self.bvh, lights: &self.lights }
    }

    /// The samples and what is known of them.
    pub fn surface(&self) -> Surface<'_> {
        Surface { scene: &self.scene, bvh: &self.bvh, samples: &self.asset.samples, patches: &self.patches }
    }

    /// Irradiance of every sample under the lights in force, RGB, with what comes back from outside where that is asked for.
    ///
    /// # Errors
    /// As [`Illumination::new`].
    pub fn irradiance(&mut self, progress: &dyn Progress) -> Result<&[DVec3]> {
        self.light_up(progress)?;
        if let (Some(outside), None) = (self.outside, &self.returned) {
            let scheme = self.tuned_scheme();
            self.returned = Some(self.return_light(outside, self.plan.near, scheme, progress));
        }
        Ok(self.lit().0)
    }

    /// Irradiance of the lights alone.
    fn light_up(&mut self, progress: &dyn Progress) -> Result<()> {
        if self.irradiance.is_none() {
            self.irradiance = Some(self.illuminate(&self.lights, progress)?);
        }
        Ok(())
    }

    /// Follows the light outside; there must have been [`Self::light_up`].
    fn return_light(&mut self, outside: Outside, near: NearField, scheme: Scheme, progress: &dyn Progress) -> Returned {
        let matrix = match self.matrix.take() {
            Some(matrix) => matrix,
            None => outside.matrix(&self.surface(), &self.receivers, progress),
        };
        let surface = self.surface();
        let gather = self.gather(&surface, near);
        let transfer = Transfer { gather: &gather, receivers: &self.receivers, scheme };
        let returned = outside.returned(&matrix, transfer, self.direct(), progress);
        self.matrix = Some(matrix);
        returned
    }

    /// Where radiosity is gathered.
    pub fn receivers(&self) -> &Receivers {
        &self.receivers
    }

    /// How near samples are integrated.
    pub fn near(&self) -> NearField {
        self.plan.near
    }

    /// How light reaches the samples.
    pub fn sampling(&self) -> LightSampling {
        self.plan.sampling
    }

    /// How samples are summed under the light and the media in force, after tuning where that is needed. There must have
    /// been [`Self::irradiance`]; what tunes is the light before any of it came back.
    pub fn tuned_scheme(&mut self) -> Scheme {
        if let (Far::Hierarchical { error, bound }, None) = (self.plan.far, self.limit) {
            self.tune(error, bound);
        }
        self.scheme()
    }

    /// Calls `work` with a gather for the media in force and the light on the samples.
    pub fn with_gather<T>(&self, work: impl FnOnce(&Gather, &Lit) -> T) -> T {
        let surface = self.surface();
        let gather = self.gather(&surface, self.plan.near);
        let (irradiance, pieces) = self.lit();
        work(&gather, &gather.light_with_pieces(irradiance, pieces))
    }

    /// Irradiance of the samples, with what came back from outside, and of the pieces of those that are not lit evenly; empty
    /// before there are lights.
    pub fn lit(&self) -> (&[DVec3], &Pieces) {
        let (direct, pieces) = self.direct();
        (self.returned.as_ref().map_or(direct, |returned| &returned.irradiance), pieces)
    }

    /// The same of the lights alone.
    fn direct(&self) -> (&[DVec3], &Pieces) {
        self.irradiance.as_ref().map_or((&[], &NO_PIECES), |(irradiance, pieces)| (irradiance, pieces))
    }

    /// Through the stored rows where there are any for a light, else by rays.
    fn illuminate(&self, lights: &[Light], progress: &dyn Progress) -> Result<(Vec<DVec3>, Pieces)> {
        let asset = (&self.scene, &self.asset.samples);
        StoredRows::illuminate(self.rows.as_ref(), asset, lights, progress, |lights| self.by_rays(lights, progress))
    }

    fn is_stored(&self, light: &Light) -> bool {
        self.rows.as_ref().is_some_and(|rows| rows.have(light, &self.scene.media))
    }

    fn by_rays(&self, lights: &[Light], progress: &dyn Progress) -> Result<(Vec<DVec3>, Pieces)> {
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        Ok(Illumination::new(&self.surface(), lights, &etas, self.plan.sampling)?.all_with_pieces(progress))
    }

    /// Makes what [`Self::nets`] gives, where radiosity is summed over nets.
    pub fn prepare_nets(&mut self, progress: &dyn Progress) {
        let Some(mut nets) = self.nets.take() else { return };
        if !nets.is_prepared() {
            let kernels = match &self.profile {
                Some((_, kernels)) => kernels.clone(),
                None => self.scene.media.iter().map(MediumKernel::new).collect(),
            };
            nets.prepare(&self.surface(), &self.receivers, &kernels, progress);
        }
        self.nets = Some(nets);
    }

    /// Nets, and tables of the media and profiles in force: there must have been [`Self::prepare_nets`].
    pub fn nets(&self) -> Option<(&SurfaceNets, &SurfaceTables)> {
        self.nets.as_ref()?.prepared()
    }

    fn scheme(&self) -> Scheme {
        match (self.plan.far, self.limit) {
            (Far::Hierarchical { bound, .. }, Some(limit)) => {
                Scheme::Hierarchical { criterion: bound.criterion(limit) }
            }
            _ => Scheme::AllPairs,
        }
    }
}

impl Evaluator for SampledEvaluator {
    fn capabilities(&self) -> Capabilities {
        let profile = if self.nets.is_some() { ProfileEdit::Any } else { ProfileEdit::OnCpu };
        let source_fields = StoredRows::source_fields(self.rows.as_ref(), &self.scene.media);
        Capabilities { material: MaterialEdit::Any, profile, source_fields }
    }

    fn cost(&self) -> Cost {
        Cost {
            samples: self.asset.samples.len(),
            receivers: self.receivers.len(),
            resident_bytes: self.tree.bytes()
                + size_of_val(self.patches.as_slice())
                + size_of_val(self.asset.samples.facets.as_slice())
                + size_of_val(self.asset.samples.patch_offsets.as_slice())
                + self.matrix.as_ref().map_or(0, InterReflection::bytes)
                + self.nets.as_ref().map_or(0, Nets::bytes)
                + self.rows.as_ref().map_or(0, StoredRows::bytes),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.lights = lights;
        (self.irradiance, self.returned, self.limit) = (None, None, None);
        self.light_up(progress)
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        if media.len() != self.scene.media.len() {
            let (given, there) = (media.len(), self.scene.media.len());
            return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
        }
        let eta = |m: &Medium| m.properties.eta_inside_over_outside;
        if media.iter().zip(&self.scene.media).any(|(a, b)| eta(a) != eta(b)) {
            (self.irradiance, self.matrix) = (None, None);
        }
        // Names may change without work.
        if media.iter().zip(&self.scene.media).any(|(a, b)| a.properties != b.properties) {
            if let Some((profile, _)) = &self.profile {
                let kernels = self.kernels(profile, &media)?;
                self.profile = Some((profile.clone(), kernels));
            }
            self.nets.iter_mut().for_each(Nets::forget_media);
        }
        (self.returned, self.limit) = (None, None);
        self.scene.media = media;
        Ok(())
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        let kernels = self.kernels(&profile, &self.scene.media)?;
        self.profile = Some((profile, kernels));
        (self.returned, self.limit) = (None, None);
        self.nets.iter_mut().for_each(Nets::forget_media);
        Ok(())
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.irradiance(progress)?;
        self.prepare_nets(progress);
        let values = match self.nets() {
            Some((nets, tables)) => nets.radiosity(&self.surface(), tables, self.lit(), self.receivers.len()),
            None => {
                let scheme = self.tuned_scheme();
                self.with_gather(|gather, lit| gather.radiosity(&self.receivers, lit, scheme, progress))
            }
        };
        Ok(self.receivers.expand(&values))
    }

    fn radiosity_at(&mut self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.irradiance(progress)?;
        let scheme = self.tuned_scheme();
        Ok(self.with_gather(|gather, lit| gather.radiosity(receivers, lit, scheme, progress)))
    }

    fn single_scattering_is(&self) -> SingleScattering {
        self.single.map_or(SingleScattering::None, |single| single.is(&self.scene))
    }

    fn single_scattering(&mut self, progress: &dyn Progress) -> Result<Option<Vec<DVec3>>> {
        self.single.map_or(Ok(None), |single| single.per_vertex(self.lit_scene(), progress))
    }

    fn towards_eye(&self) -> Result<Option<Box<dyn TowardsEye + '_>>> {
        self.single.map(|single| single.towards_eye(self.lit_scene())).transpose()
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        self.irradiance(progress)?;
        let mut ledger = Ledger::default();
        // Sampling is that of rays; what rows lose against them has an entry of its own.
        let lights = by_rays(&self.lights);
        let rays = match self.lights.iter().any(|light| self.is_stored(light)) {
            true => Some(self.by_rays(&lights, progress)?),
            false => None,
        };
        let direct = rays.as_ref().map_or(self.direct(), |(irradiance, pieces)| (irradiance, pieces));
        let sampled = Sampled {
            surface: self.surface(),
            media: &self.scene.media,
            kernels: self.profile.as_ref().map(|(_, kernels)| kernels.as_slice()),
            lights: &lights,
            irradiance: direct,
            sampling: self.plan.sampling,
            near: self.plan.near,
            receivers: &self.receivers,
            areas: &self.areas,
        };
        sampled.enter(&mut ledger, progress)?;
        if let Some((rays, _)) = &rays {
            let error = error_of_rows(&sampled, (self.direct().0, rays));
            ledger.add(
                "environment",
                error,
                "stored rows (cube map, truncation, quantiser; fields of area lights) against rays",
            );
        }
        let gain = self.enter_inter_reflection(&mut ledger);
        if let Some(single) = self.single {
            single.enter_noise(self.lit_scene(), &mut ledger)?;
        }
        self.prepare_nets(progress);
        let Some((stage, mut error)) = self.transfer_error(self.lit()) else { return Ok(ledger) };
        for light in unseen {
            let (irradiance, pieces) = self.illuminate(std::slice::from_ref(light), progress)?;
            error = self.transfer_error((&irradiance, &pieces)).map_or(error, |(_, other)| error.max(other));
        }
        let note = "against all pairs, on vertices that no tuning saw, the worst of these and of probe lights";
        ledger.add(stage, error.scaled(gain), note);
        Ok(ledger)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.light_up(progress)?;
        let near = NearField::REFERENCE;
        let returned = self.outside.map(|outside| self.return_light(outside, near, Scheme::AllPairs, progress));
        let surface = self.surface();
        let gather = self.gather(&surface, near);
        let (direct, pieces) = self.direct();
        let irradiance = returned.as_ref().map_or(direct, |returned| &returned.irradiance);
        let lit = gather.light_with_pieces(irradiance, pieces);
        Ok(self.receivers.expand(&gather.radiosity(&self.receivers, &lit, Scheme::AllPairs, progress)))
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        if self.nets.is_some() {
            return Ok(Box::new(NetsOnDevice::new(*self, device)?));
        }
        if self.profile.is_some() {
            return Err(Error::unsupported(
                "the shaders that sum all pairs and trees know the dipole alone; use --device cpu with --profile",
            ));
        }
        Ok(Box::new(SampledOnDevice::new(*self, device)?))
    }
}
