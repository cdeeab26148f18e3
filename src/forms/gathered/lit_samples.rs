//! The evaluator of methods that store surface samples and no transport: light reaches the samples by ray casting and
//! is gathered at the receivers, over all pairs or through the tree. Everything about lights and media may change.

use std::sync::Arc;

use glam::DVec3;

use super::model::Model;
use super::settings::{Far, Gathering};
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::inter_reflection::{Outside, Returned, Transfer};
use crate::evaluate::single_scattering::{LitScene, Traced};
use crate::forms::environment_rows::StoredRows;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch};
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profile::Orders;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::calibration::{Calibrated, CalibratedSamples};
use crate::transport::gather::{Gather, Lit, Scheme};
use crate::transport::interreflection::InterReflection;
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::{KernelsOfParts, MediumKernel};
use crate::transport::multilevel::{Quality, SurfaceNets, SurfaceTables};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::Receivers;
use crate::transport::sample_light::SampleLight;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Spacing of receivers over the distance up to which patches are integrated exactly, beyond which a group of 16 integrates more than they
/// do one by one.
const FAR_APART: f64 = 4.0 / 3.0;

/// No pieces, in force before there are lights.
static NO_PIECES: Pieces = Pieces::NONE;

/// Irradiance of the samples under some lights, and of the pieces of those that are lit unevenly.
pub(super) struct Unmoved {
    of: Vec<Light>,
    irradiance: (Vec<DVec3>, Pieces),
}

/// Samples, lights and media, with the state that depends on them.
pub struct GatheredEvaluator {
    pub(super) asset: Arc<Asset>,
    pub(super) scene: Scene,
    pub(super) gathering: Gathering,
    pub(super) bvh: Bvh,
    pub(super) patches: Vec<Patch>,
    pub(super) tree: SampleTree,
    pub(super) receivers: Receivers,
    pub(super) areas: Vec<f64>,
    pub(super) lights: Vec<Light>,
    pub(super) irradiance: Option<(Vec<DVec3>, Pieces)>,
    /// What the lights that were set last send before calibrated kernels move it: the same in all media of the same indices of refraction, so
    /// that edits cast no rays towards skies again.
    pub(super) unmoved: Vec<Unmoved>,
    /// The number of lights of which that is kept.
    pub(super) remembered_lights: usize,
    /// Limit of the criterion of the hierarchy, tuned at the receivers.
    pub(super) limit: Option<f64>,
    /// The same for points anywhere.
    pub(super) limit_at_points: Option<f64>,
    pub(super) single: Option<Traced>,
    pub(super) outside: Option<Outside>,
    /// Inter-reflection for the indices of refraction in force.
    pub(super) matrix: Option<InterReflection>,
    /// Light returned for the lights and media in force.
    pub(super) returned: Option<Returned>,
    /// Profile in place of the dipole, with its kernels for the media in force.
    pub(super) profile: Option<(LoadedProfile, Vec<MediumKernel>)>,
    /// Calibrated kernels in place of the dipole's.
    pub(super) model: Option<Model>,
    /// Media that are not calibrated yet have their dipoles until [`Evaluator::refine`] brings more.
    pub(super) at_once: bool,
    pub(super) nets: Option<Nets>,
    /// Stored irradiance rows for light from far away, in place of rays.
    pub(super) rows: Option<StoredRows>,
}

impl GatheredEvaluator {
    /// Builds the tree and the occluders of an asset.
    pub fn new(asset: Arc<Asset>, gathering: Gathering) -> Self {
        let scene = asset.scene.clone();
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || samples::patches(&scene.mesh, &asset.samples));
        let tree = SampleTree::new(&asset.samples, &patches);
        let receivers = receivers(&scene, &patches, gathering);
        let areas = receivers.areas_mm2(&scene.mesh);
        Self {
            asset,
            scene,
            gathering,
            bvh,
            patches,
            tree,
            receivers,
            areas,
            lights: Vec::new(),
            irradiance: None,
            unmoved: Vec::new(),
            remembered_lights: 1,
            limit: None,
            limit_at_points: None,
            single: None,
            outside: None,
            matrix: None,
            returned: None,
            profile: None,
            model: None,
            at_once: false,
            nets: gathering.nets.map(Nets::new),
            rows: None,
        }
    }

    /// The same with inter-reflection outside the medium.
    #[must_use]
    pub fn with_inter_reflection(self, outside: Option<Outside>) -> Self {
        Self { outside, ..self }
    }

    /// The same with the calibrated kernels of its asset, if that has any.
    ///
    /// # Errors
    /// Sections that cannot be read or do not fit.
    pub(crate) fn with_model(mut self) -> Result<Self> {
        self.model = Model::of(&self.asset, &self.surface())?;
        self.factor_receivers();
        Ok(self)
    }

    /// The same with single scattering beside radiosity, which holds the later orders then.
    ///
    /// # Errors
    /// As [`LoadedProfile::channels`].
    pub(crate) fn with_single(self, single: Option<Traced>) -> Result<Self> {
        let orders = Orders::beside_first(single.is_some());
        Ok(Self { single, ..self.of_orders(orders)? })
    }

    /// The same with the orders of its dipoles; calibrated kernels have their own.
    ///
    /// # Errors
    /// As [`LoadedProfile::channels`].
    pub(crate) fn of_orders(mut self, orders: Orders) -> Result<Self> {
        if orders == Orders::FromTwo && self.model.is_none() {
            let profile = LoadedProfile::dipole(orders);
            let kernels = self.kernels(&profile, &self.scene.media)?;
            self.profile = Some((profile, kernels));
        }
        Ok(self)
    }

    /// The same before there are lights.
    fn unlit(mut self) -> Self {
        self.forget_limits();
        Self { lights: Vec::new(), irradiance: None, unmoved: Vec::new(), returned: None, ..self }
    }

    /// The same of another asset of the same scene and samples, before there are lights.
    pub(super) fn of_asset(self, asset: Arc<Asset>) -> Self {
        Self { asset, ..self.unlit() }
    }

    /// Sums of another kind over the same samples with the same kernels, before there are lights.
    #[must_use]
    pub(crate) fn with_gathering(self, gathering: Gathering) -> Self {
        let receivers = receivers(&self.scene, &self.patches, gathering);
        let areas = receivers.areas_mm2(&self.scene.mesh);
        let mut result = Self { gathering, receivers, areas, nets: gathering.nets.map(Nets::new), ..self.unlit() };
        result.factor_receivers();
        result
    }

    /// Takes nets of its quality that have been made for its samples and receivers.
    pub(super) fn take_nets(&mut self, made: SurfaceNets) {
        if let Some(nets) = &mut self.nets {
            nets.nets = Some(made);
        }
    }

    /// The calibrated kernels in force, if there are any.
    pub(super) fn calibrated(&self) -> Option<&Calibrated> {
        self.model.as_ref()?.in_force().map(|in_force| in_force.calibrated.as_ref())
    }

    /// Gives the receivers the factors of the calibrated kernels in force, none where there are none.
    pub(super) fn factor_receivers(&mut self) {
        let receivers = std::mem::take(&mut self.receivers);
        self.receivers = match self.calibrated() {
            Some(calibrated) => calibrated.at_vertices(receivers),
            None => Receivers { factors: Vec::new(), ..receivers },
        };
    }

    /// Drops what rests on the kernels that were in force: light enters as far from where it meets the surface as they say.
    pub(super) fn other_model(&mut self) {
        (self.irradiance, self.returned) = (None, None);
        self.forget_limits();
        self.nets.iter_mut().for_each(Nets::forget_media);
        self.factor_receivers();
    }

    /// A gather for the media and profiles in force.
    pub(super) fn gather<'a>(&'a self, surface: &Surface<'a>, near: NearField) -> Gather<'a> {
        match (&self.profile, self.model.as_ref().and_then(Model::in_force)) {
            (Some((_, kernels)), _) => Gather::with_kernels(surface, &self.tree, kernels.clone(), near),
            (None, Some(CalibratedSamples { calibrated, factors, .. })) => {
                Gather::calibrated(surface, &self.tree, (&calibrated.kernels, factors), near)
            }
            (None, None) => Gather::new(surface, &self.tree, &self.scene.media, near),
        }
    }

    /// Kernels of some media with a profile.
    pub(super) fn kernels(&self, profile: &LoadedProfile, media: &[Medium]) -> Result<Vec<MediumKernel>> {
        let reach = self.scene.mesh.diagonal_mm();
        media.iter().map(|medium| MediumKernel::with_profile(medium, profile, reach)).collect()
    }

    /// Kernels in force, and which of them each part has.
    pub(super) fn kernels_in_force(&self) -> KernelsOfParts {
        let of_part = || self.scene.parts.parts.iter().map(|part| part.medium).collect();
        match (&self.profile, self.calibrated()) {
            (Some((_, kernels)), _) => (kernels.clone(), of_part()),
            (None, Some(calibrated)) => calibrated.kernels.clone(),
            (None, None) => (MediumKernel::of_media(&self.scene.media), of_part()),
        }
    }

    pub(super) fn lit_scene(&self) -> LitScene<'_> {
        LitScene { scene: &self.scene, bvh: &self.bvh, lights: &self.lights }
    }

    /// The samples on the surface of the scene.
    pub fn surface(&self) -> Surface<'_> {
        Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.asset.samples, patches: &self.patches }
    }

    /// Irradiance of every sample under the lights in force, RGB, with inter-reflection where that is asked for.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub fn irradiance(&mut self, progress: &dyn Progress) -> Result<&[DVec3]> {
        self.light_up(progress)?;
        if let (Some(outside), None) = (self.outside, &self.returned) {
            let scheme = self.tuned_scheme();
            self.returned = Some(self.return_light(outside, self.gathering.near, scheme, progress));
        }
        Ok(self.lit().0)
    }

    /// Computes the irradiance of the lights alone, where that is missing, and calibrated kernels likewise.
    pub(super) fn light_up(&mut self, progress: &dyn Progress) -> Result<()> {
        if let Some(mut model) = self.model.take_if(|_| !self.at_once) {
            let made = model.prepare(&self.surface(), progress);
            self.model = Some(model);
            if made? {
                self.factor_receivers();
            }
        }
        if self.irradiance.is_none() {
            let mut unmoved = std::mem::take(&mut self.unmoved);
            self.irradiance = Some(self.illuminate_beside(&self.lights, &mut unmoved, progress)?);
            self.unmoved = unmoved;
        }
        Ok(())
    }

    /// Follows the light outside; there must have been [`Self::light_up`].
    pub(super) fn return_light(
        &mut self,
        outside: Outside,
        near: NearField,
        scheme: Scheme,
        progress: &dyn Progress,
    ) -> Returned {
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

    /// Summation scheme under the light and the media in force, after tuning where that is needed, on the light before
    /// inter-reflection. [`Self::irradiance`] must have been called.
    pub fn tuned_scheme(&mut self) -> Scheme {
        if let (Far::Hierarchical { error, bound }, None) = (self.gathering.far, self.limit) {
            self.tune(error, bound);
        }
        self.scheme()
    }

    /// Radiosity of any receivers of the scene's parts under the light and the media in force, RGB, in their order.
    ///
    /// # Errors
    /// Failures of the work.
    pub fn radiosity_at(&mut self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.irradiance(progress)?;
        let scheme = self.tuned_scheme();
        let alone = self.receivers.groups.len() == self.receivers.len();
        let split = alone.then(|| receivers.only(&(0..receivers.len() as u32).collect::<Vec<_>>(), 1));
        let receivers = split.as_ref().unwrap_or(receivers);
        Ok(self.with_gather(|gather, lit| gather.radiosity(receivers, lit, scheme, progress)))
    }

    /// Calls `work` with a gather for the media in force and the light on the samples.
    pub fn with_gather<T>(&self, work: impl FnOnce(&Gather, &Lit) -> T) -> T {
        let surface = self.surface();
        let gather = self.gather(&surface, self.gathering.near);
        let (irradiance, pieces) = self.lit();
        work(&gather, &gather.light_with_pieces(irradiance, pieces))
    }

    /// Light on the samples as sums over nets take it, with the factors of calibrated kernels.
    pub(super) fn sample_light<'a>(&'a self, (irradiance, pieces): (&'a [DVec3], &'a Pieces)) -> SampleLight<'a> {
        let factors = self.model.as_ref().and_then(Model::in_force).map_or(&[][..], |m| m.factors.as_slice());
        SampleLight::new(irradiance, pieces).with_factors(factors)
    }

    /// Irradiance of the samples, inter-reflection included, and of the pieces of those that are not lit evenly; empty
    /// before there are lights.
    pub fn lit(&self) -> (&[DVec3], &Pieces) {
        let (direct, pieces) = self.direct();
        (self.returned.as_ref().map_or(direct, |returned| &returned.irradiance), pieces)
    }

    /// The same of the lights alone.
    pub(super) fn direct(&self) -> (&[DVec3], &Pieces) {
        self.irradiance.as_ref().map_or((&[], &NO_PIECES), |(irradiance, pieces)| (irradiance, pieces))
    }

    /// Irradiance through the stored rows where they hold a light, else by rays.
    pub(super) fn illuminate(&self, lights: &[Light], progress: &dyn Progress) -> Result<(Vec<DVec3>, Pieces)> {
        self.illuminate_beside(lights, &mut Vec::new(), progress)
    }

    /// [`Self::illuminate`], for which what does not depend on the media is taken from there, or put there.
    fn illuminate_beside(
        &self,
        lights: &[Light],
        unmoved: &mut Vec<Unmoved>,
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        let (surface, sampling) = (self.surface(), self.gathering.sampling);
        let of_rows =
            |lights: &[Light]| StoredRows::illuminate(self.rows.as_ref(), &surface, (lights, sampling), progress);
        let mut known_or_new = |lights: &[Light]| {
            if let Some(known) = unmoved.iter().find(|known| known.of == lights) {
                return Ok(known.irradiance.clone());
            }
            let irradiance = of_rows(lights)?;
            unmoved.drain(..(unmoved.len() + 1).saturating_sub(self.remembered_lights));
            unmoved.push(Unmoved { of: lights.to_vec(), irradiance: irradiance.clone() });
            Ok(irradiance)
        };
        let Some(in_force) = self.model.as_ref().and_then(Model::in_force) else {
            // Where nothing moves, what is in force outlives edits anyway.
            return if self.remembered_lights > 1 { known_or_new(lights) } else { of_rows(lights) };
        };
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        in_force.entry.entered(&surface, lights, (&etas, sampling), known_or_new, progress)
    }

    pub(super) fn is_stored(&self, light: &Light) -> bool {
        self.rows.as_ref().is_some_and(|rows| rows.have(light, &self.scene.media))
    }

    /// Makes the nets and tables of [`Self::nets`], where radiosity is summed over nets: for some of the receivers, or for all.
    pub fn prepare_nets(&mut self, asked: Option<&[u32]>, progress: &dyn Progress) {
        let Some(mut nets) = self.nets.take() else { return };
        nets.prepare(&self.surface(), (&self.receivers, asked), || self.kernels_in_force(), progress);
        self.nets = Some(nets);
    }

    /// Nets, and tables of the media and profiles in force: there must have been [`Self::prepare_nets`]. None where they do not resolve
    /// calibrated kernels, which the hierarchy sums then.
    pub fn nets(&self) -> Option<(&SurfaceNets, &SurfaceTables)> {
        self.nets.as_ref()?.prepared()
    }

    pub(super) fn scheme(&self) -> Scheme {
        self.scheme_of(self.limit)
    }

    /// Forgets what was tuned, since light or media change.
    pub(super) fn forget_limits(&mut self) {
        (self.limit, self.limit_at_points) = (None, None);
    }

    pub(super) fn scheme_of(&self, limit: Option<f64>) -> Scheme {
        match (self.gathering.far, limit) {
            (Far::Hierarchical { bound, .. }, Some(limit)) => {
                Scheme::Hierarchical { criterion: bound.criterion(limit) }
            }
            _ => Scheme::AllPairs,
        }
    }
}

/// Receivers in groups, which share what is near to any of them: alone where they are so far apart that together they would
/// share most of the surface.
fn receivers(scene: &Scene, patches: &[Patch], gathering: Gathering) -> Receivers {
    let all = Receivers::new(&scene.mesh, &scene.parts, gathering.group);
    let area: f64 = patches.iter().map(|patch| patch.area_mm2).sum();
    let radius = patches.iter().map(|patch| patch.radius_mm).sum::<f64>() / patches.len().max(1) as f64;
    let spacing = (area / all.len().max(1) as f64).sqrt();
    if gathering.nets.is_none() && spacing > FAR_APART * gathering.near.exact_below * radius {
        return Receivers::new(&scene.mesh, &scene.parts, 1);
    }
    all
}

/// What multilevel summation needs, made when it is first needed: nets once for the samples, tables for each set of media.
pub(super) struct Nets {
    quality: Quality,
    nets: Option<SurfaceNets>,
    /// Tables of the media and profiles in force.
    tables: Option<SurfaceTables>,
}

impl Nets {
    fn new(quality: Quality) -> Self {
        Self { quality, nets: None, tables: None }
    }

    /// Drops the tables, since other media or profiles are in force.
    pub(super) fn forget_media(&mut self) {
        self.tables = None;
    }

    /// Makes what is missing.
    fn prepare(
        &mut self,
        surface: &Surface,
        (receivers, asked): (&Receivers, Option<&[u32]>),
        kernels: impl FnOnce() -> KernelsOfParts,
        progress: &dyn Progress,
    ) {
        let quality = self.quality;
        let nets = self.nets.get_or_insert_with(|| {
            progress.start("nets", 0);
            let nets = SurfaceNets::at_some(surface, receivers, quality, asked);
            progress.finish();
            nets
        });
        nets.ask(surface, receivers, asked);
        if self.tables.is_none() {
            let (kernels, of_part) = kernels();
            if nets.resolve((&kernels, &of_part)) {
                self.tables = Some(nets.tables(surface, receivers, (&kernels, &of_part)));
            }
        }
    }

    /// Nets and tables, present after [`Self::prepare`] where nets resolve the kernels.
    fn prepared(&self) -> Option<(&SurfaceNets, &SurfaceTables)> {
        self.nets.as_ref().zip(self.tables.as_ref())
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        self.nets.as_ref().map_or(0, SurfaceNets::bytes)
    }
}
