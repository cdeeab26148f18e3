//! The texels at run time: light arrives in them, samples are chosen, receivers sum R_d over these.

use std::sync::{Arc, OnceLock};

use glam::DVec3;
use rayon::prelude::*;
use translux_format::texture_space::{self as stored, Numbers};
use translux_format::{Budget, FormatError, atlas};

use super::descent::{Descent, Kernels};
#[cfg(feature = "gpu")]
use super::gpu::TextureSpaceOnDevice;
use super::hybrid::{Division, LightView};
use super::light::LitMap;
use super::map::{Order, TexelMap};
use super::samples::{self, Sample};
use super::settings::{Sampling, TextureSpace};
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
#[cfg(feature = "gpu")]
use crate::evaluate::DeviceEvaluator;
#[cfg(feature = "gpu")]
use crate::evaluate::device::Device;
use crate::evaluate::exitance::{Exitance, MeshPoint};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, SourceFields};
use crate::forms::baked_in::Truth;
use crate::geometry::atlas::Atlas;
use crate::geometry::bvh::Bvh;
use crate::light::{Light, LightKind, refuse_fields};
use crate::math::simd::InstructionSet;
use crate::math::statistics::{VertexError, vertex_error};
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::kernel::{Block, PointSource};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{Group, Receivers};

/// Names in ledgers.
const TEXTURE: &str = "texture";
const SAMPLES: &str = "samples";

/// Receivers that share a descent; those of shared samples only share a centre of their coordinates.
const OF_DESCENT: usize = 16;
const OF_SHARED: usize = 256;

/// Spacing of receivers, over the length on which R_d changes, beyond which each descends alone.
const ALONE: f64 = 0.5;

/// Vertices that errors are measured on; where there are not many more, all are.
const MEASURED: usize = 768;

/// Samples of the exact sums at most.
const MOST_SAMPLES: u32 = 1 << 15;

/// Samples that stand for all texels where errors are measured.
const RESOLVED: usize = 1 << 14;

/// Choice of the samples under some lights and media.
pub(super) enum Chosen {
    /// Those of each part, shared by its receivers.
    Shared(Vec<Vec<Sample>>),
    /// The limit of each group's descent.
    Limit(f64),
    /// Shared samples of the global part, and the images of the local part.
    Hybrid(Vec<Vec<Sample>>, Vec<LightView>),
}

/// Evaluator of texels, with the lights in force.
pub(super) struct TextureSpaceEvaluator {
    pub(super) form: TextureSpace,
    pub(super) scene: Scene,
    bvh: OnceLock<Bvh>,
    pub(super) map: TexelMap,
    pub(super) receivers: Receivers,
    areas: Vec<f64>,
    pub(super) numbers: Numbers,
    pub(super) profile: Option<LoadedProfile>,
    kernels: Kernels,
    /// The division of R_d and the kernels of its global part, where the method is the hybrid one.
    division: Option<(Division, Kernels)>,
    lights: Vec<Light>,
    pub(super) lit: Option<LitMap>,
    pub(super) chosen: Option<Chosen>,
    truth: Truth,
}

pub(super) fn open(form: &TextureSpace, asset: &Arc<Asset>) -> Result<Box<dyn Evaluator>> {
    let input = |e: FormatError| Error::input(e.to_string());
    let missing = || Error::input("an asset without its atlas (sections atl.rec and tex.rec); bake it again");
    let triangles = &asset.scene.mesh.triangles;
    let atlas = atlas::Atlas::from_sections(&asset.sections, triangles, Budget::default()).map_err(input)?;
    let atlas = Atlas::from_codes(&atlas.ok_or_else(missing)?.corners);
    let numbers = stored::from_sections(&asset.sections).map_err(input)?.ok_or_else(missing)?;
    Ok(Box::new(TextureSpaceEvaluator::new(form, &asset.scene, atlas, numbers)?))
}

impl TextureSpaceEvaluator {
    pub(super) fn new(form: &TextureSpace, scene: &Scene, atlas: Atlas, numbers: Numbers) -> Result<Self> {
        let map = TexelMap::new(scene, atlas, numbers.resolution, order(&form.sampling))?;
        let receivers = receivers(form, scene);
        let areas = receivers.areas_mm2(&scene.mesh);
        let mut made = Self {
            form: *form,
            scene: scene.clone(),
            bvh: OnceLock::new(),
            map,
            receivers,
            areas,
            truth: Truth::new(numbers.truth_samples.min(MOST_SAMPLES) as usize),
            numbers,
            profile: None,
            kernels: Kernels::new(Vec::new()),
            division: None,
            lights: Vec::new(),
            lit: None,
            chosen: None,
        };
        made.take_media(scene.media.clone())?;
        Ok(made)
    }

    /// Kernels of some media under the profile in force.
    fn take_media(&mut self, media: Vec<Medium>) -> Result<()> {
        let diagonal_mm = self.scene.mesh.diagonal_mm();
        let kernels = match &self.profile {
            None => MediumKernel::of_media(&media),
            Some(profile) => {
                let of = |medium| MediumKernel::with_profile(medium, profile, diagonal_mm);
                media.iter().map(of).collect::<Result<_>>()?
            }
        };
        if let Sampling::Hybrid(local) = &self.form.sampling {
            let (division, global) = Division::new(local, &kernels, diagonal_mm);
            self.division = Some((division, Kernels::new(global)));
        }
        self.kernels = Kernels::new(kernels);
        let eta = |m: &Medium| m.properties.eta_inside_over_outside;
        if media.iter().zip(&self.scene.media).any(|(a, b)| eta(a) != eta(b)) {
            self.lit = None;
        }
        self.chosen = None;
        self.scene.media = media;
        Ok(())
    }

    fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    fn illuminate(&self, lights: &[Light], progress: &dyn Progress) -> Result<LitMap> {
        LitMap::new(&self.map, (&self.scene, self.bvh()), lights, self.form.rays, progress)
    }

    pub(super) fn descent<'a>(&'a self, lit: &'a LitMap, near: NearField) -> Descent<'a> {
        Descent { scene: &self.scene, map: &self.map, lit, kernels: &self.kernels, near }
    }

    /// Irradiance of the patches under the lights in force, RGB.
    #[cfg(feature = "gpu")]
    pub(super) fn irradiance(&self) -> Vec<DVec3> {
        self.lit.as_ref().map_or(Vec::new(), |lit| lit.irradiance.iter().map(|e| lit.unit * *e).collect())
    }

    /// Chooses the samples.
    fn choose(&self, lights: &[Light], lit: &LitMap) -> Result<Chosen> {
        let count = self.numbers.count as usize;
        let parts = 0..self.map.roots.len();
        let drawn = || parts.clone().map(|part| samples::drawn(&self.map, lit, part, count)).collect();
        Ok(match &self.form.sampling {
            Sampling::Shared => Chosen::Shared(drawn()),
            Sampling::Clusters => {
                Chosen::Shared(parts.map(|part| samples::clusters(&self.map, lit, part, count)).collect())
            }
            Sampling::Product => Chosen::Limit(self.descent(lit, self.form.near).limit(&self.receivers, count)),
            Sampling::Hybrid(local) => {
                let view = |light: &Light| LightView::new((&self.scene, self.bvh()), light, local);
                Chosen::Hybrid(drawn(), lights.iter().map(view).collect::<Result<_>>()?)
            }
        })
    }

    /// Radiosity of some receivers from the chosen samples, RGB.
    fn sums(&self, chosen: &Chosen, lit: &LitMap, receivers: &Receivers) -> Vec<DVec3> {
        match chosen {
            Chosen::Limit(limit) => self.descent(lit, self.form.near).radiosity(receivers, *limit),
            Chosen::Shared(samples) => self.shared(&self.kernels, (samples, lit.unit), receivers),
            Chosen::Hybrid(samples, views) => {
                let Some((division, global)) = &self.division else { return vec![DVec3::ZERO; receivers.len()] };
                let mut all = self.shared(global, (samples, lit.unit), receivers);
                views.iter().for_each(|view| view.add(&self.scene, division, receivers, &mut all));
                all
            }
        }
    }

    /// Sums over the samples of each part.
    fn shared(&self, kernels: &Kernels, (samples, unit): (&[Vec<Sample>], f64), receivers: &Receivers) -> Vec<DVec3> {
        let level = InstructionSet::detect();
        let of_group = |(block, points): &mut (Block, Vec<PointSource>), group: &Group| {
            let centre = receivers.sphere(*group).centre_mm;
            block.reset(centre, receivers.of(*group));
            let of_part = samples.get(group.part as usize);
            if let (Some(kernel), Some(samples)) = (kernels.of_part(&self.scene, group.part), of_part) {
                points.clear();
                points.extend(samples.iter().map(|s| PointSource::new(s.at_mm, s.flux, centre)));
                kernel.add_points(level, block, points);
            }
            (0..group.run.range().len()).map(|i| unit * block.sum(i)).collect::<Vec<DVec3>>()
        };
        let of_groups: Vec<_> = receivers.groups.par_iter().map_init(Default::default, of_group).collect();
        of_groups.into_iter().flatten().collect()
    }

    /// Lights the texels and chooses the samples, where that is missing.
    pub(super) fn prepare(&mut self, progress: &dyn Progress) -> Result<()> {
        let lit = match self.lit.take() {
            Some(lit) => lit,
            None => {
                self.chosen = None;
                self.illuminate(&self.lights, progress)?
            }
        };
        if self.chosen.is_none() {
            self.chosen = Some(self.choose(&self.lights, &lit)?);
        }
        self.lit = Some(lit);
        Ok(())
    }

    /// Radiosity of some receivers from as many samples as tell every texel that matters, RGB.
    fn resolved(&self, lit: &LitMap, receivers: &Receivers) -> Vec<DVec3> {
        let descent = self.descent(lit, self.form.near);
        descent.radiosity(receivers, descent.limit(&self.receivers, RESOLVED.max(4 * self.numbers.count as usize)))
    }

    /// Receivers that descend one by one, each a group.
    fn are_alone(&self) -> bool {
        self.receivers.groups.len() == self.receivers.len()
    }

    /// Receivers that errors are measured on, with the areas around them.
    fn measured(&self, phase: usize) -> (Receivers, Vec<f64>) {
        if self.receivers.len() <= 2 * MEASURED {
            return (self.receivers.clone(), self.areas.clone());
        }
        let descends_in_groups = self.form.sampling == Sampling::Product && !self.are_alone();
        let (subset, indices) = if descends_in_groups {
            // Whole groups: smaller ones would fare better.
            let step = self.receivers.groups.len().div_ceil(MEASURED / OF_DESCENT).max(1);
            let groups = self.receivers.groups.iter().skip(phase * step / 2).step_by(step);
            let indices: Vec<u32> = groups.flat_map(|group| group.run.first..group.run.end).collect();
            (self.receivers.only(&indices, OF_DESCENT), indices)
        } else {
            self.receivers.subset(MEASURED, phase)
        };
        (subset, indices.iter().map(|i| self.areas[*i as usize]).collect())
    }

    /// Chooses the least number of samples, doubled from `least` to `most`, whose error is as asked under each
    /// of some lights, at vertices that no reported error looks at.
    pub(super) fn choose_count(&mut self, lights: &[Light], asked: f64, (least, most): (u32, u32)) -> Result<()> {
        let (receivers, areas) = self.measured(0);
        self.numbers.count = least;
        for light in lights {
            let light = std::slice::from_ref(light);
            let lit = self.illuminate(light, &Silent)?;
            let all = self.resolved(&lit, &receivers);
            loop {
                let found = self.sums(&self.choose(light, &lit)?, &lit, &receivers);
                if self.numbers.count >= most || vertex_error(&found, &all, &areas).or_none().rms <= asked {
                    break;
                }
                self.numbers.count = (2 * self.numbers.count).min(most);
            }
        }
        Ok(())
    }

    /// The errors of texels against exact sums and of samples against all texels, under the worst of some sets of lights.
    pub(super) fn errors(&mut self, sets: &[Vec<Light>], note: &str) -> Result<Ledger> {
        let (receivers, areas) = self.measured(1);
        let mut worst = [VertexError::default(); 2];
        for lights in sets {
            let lit = self.illuminate(lights, &Silent)?;
            let found = self.sums(&self.choose(lights, &lit)?, &lit, &receivers);
            let all = self.resolved(&lit, &receivers);
            let truth = self.truth.lit(&self.scene, lights, &Silent)?;
            if let Some(profile) = &self.profile {
                truth.set_profile(profile.clone())?;
            }
            let expected = truth.radiosity_at(&receivers, &Silent)?;
            let of = |values: &[DVec3], truth: &[DVec3]| vertex_error(values, truth, &areas).or_none();
            worst = [worst[0].max(of(&all, &expected)), worst[1].max(of(&found, &all))];
        }
        let (texels, side) = (self.map.texels, self.map.resolution);
        let mut ledger = Ledger::default();
        let texture = format!("{texels} texels of {side} x {side}, against exact sums over samples, {note}");
        ledger.add(TEXTURE, worst[0], texture);
        ledger.add(SAMPLES, worst[1], format!("{} samples, against all texels, {note}", self.numbers.count));
        Ok(ledger)
    }
}

/// Exitance that is summed at each point.
struct AtPoints<'a> {
    evaluator: &'a TextureSpaceEvaluator,
    chosen: &'a Chosen,
    lit: &'a LitMap,
}

impl Exitance for AtPoints<'_> {
    fn at_vertices(&self) -> Option<&[DVec3]> {
        None
    }

    fn at(&self, point: &MeshPoint) -> DVec3 {
        self.at_each(std::slice::from_ref(point), &Silent).first().copied().unwrap_or_default()
    }

    fn at_each(&self, points: &[MeshPoint], progress: &dyn Progress) -> Vec<DVec3> {
        let parts = &self.evaluator.scene.parts;
        let place = |point: &MeshPoint| {
            let part = *parts.triangle_part.get(point.triangle as usize)?;
            parts.parts.get(part as usize)?.transfers().then_some((part, point.at_mm))
        };
        let capacity = if self.evaluator.are_alone() { 1 } else { OF_DESCENT };
        let receivers = Receivers::at(&points.iter().map(place).collect::<Vec<_>>(), capacity);
        progress.start("transfer", receivers.len() as u64);
        let values = self.evaluator.sums(self.chosen, self.lit, &receivers);
        progress.finish();
        receivers.expand(&values)
    }
}

impl Evaluator for TextureSpaceEvaluator {
    fn capabilities(&self) -> Capabilities {
        Capabilities { material: MaterialEdit::Any, profile: ProfileEdit::OnCpu, source_fields: SourceFields::None }
    }

    fn cost(&self) -> Cost {
        let flux = self.lit.as_ref().map_or(0, LitMap::bytes);
        Cost {
            samples: self.numbers.count as usize,
            receivers: self.receivers.len(),
            resident_bytes: self.map.bytes() + flux + size_of_val(self.receivers.positions.as_slice()),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        Self::bvh(self)
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        refuse_fields(&lights)?;
        let kinds = kinds(&self.form.sampling);
        if let Some(light) = lights.iter().find(|light| !kinds.contains(&light.kind())) {
            let kind = light.kind().name();
            return Err(Error::unsupported(format!(
                "sampling=hybrid sees directional and point lights, no {kind}; --set sampling=product takes all"
            )));
        }
        let lit = self.illuminate(&lights, progress)?;
        // Images that cannot be made are refused here.
        let hybrid = matches!(self.form.sampling, Sampling::Hybrid(_));
        self.chosen = if hybrid { Some(self.choose(&lights, &lit)?) } else { None };
        (self.lit, self.lights) = (Some(lit), lights);
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        if media.len() != self.scene.media.len() {
            let (given, there) = (media.len(), self.scene.media.len());
            return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
        }
        self.take_media(media)?;
        self.truth = Truth::new(self.numbers.truth_samples.min(MOST_SAMPLES) as usize);
        Ok(())
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        let before = self.profile.replace(profile);
        let taken = self.take_media(self.scene.media.clone());
        if taken.is_err() {
            self.profile = before;
        }
        taken
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.prepare(progress)?;
        let (Some(chosen), Some(lit)) = (&self.chosen, &self.lit) else { return Ok(Vec::new()) };
        progress.start("transfer", self.receivers.len() as u64);
        let values = self.sums(chosen, lit, &self.receivers);
        progress.finish();
        Ok(self.receivers.expand(&values))
    }

    fn prepare_points(&mut self, progress: &dyn Progress) -> Result<()> {
        self.prepare(progress)
    }

    fn exitance_at_points(&self) -> Option<Box<dyn Exitance + '_>> {
        let (chosen, lit) = (self.chosen.as_ref()?, self.lit.as_ref()?);
        Some(Box::new(AtPoints { evaluator: self, chosen, lit }))
    }

    fn measured_error(&mut self, unseen: &[Light], _: &dyn Progress) -> Result<Ledger> {
        let together = [self.lights.clone()];
        let kinds = kinds(&self.form.sampling);
        let each = unseen.iter().filter(|light| kinds.contains(&light.kind())).map(|light| vec![light.clone()]);
        let sets: Vec<Vec<Light>> = together.into_iter().chain(each).collect();
        self.errors(&sets, "the worst of these lights and of probe lights")
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.prepare(progress)?;
        let Some(lit) = &self.lit else { return Ok(Vec::new()) };
        Ok(self.receivers.expand(&self.descent(lit, NearField::REFERENCE).radiosity(&self.receivers, 0.0)))
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(TextureSpaceOnDevice::new(*self, device)?))
    }
}

/// Receivers in groups. Those of a descent are alone where they are farther from each other than R_d reaches without change: together
/// they would look at most of the surface.
fn receivers(form: &TextureSpace, scene: &Scene) -> Receivers {
    let grouped = |capacity| Receivers::new(&scene.mesh, &scene.parts, capacity);
    if form.sampling != Sampling::Product {
        return grouped(OF_SHARED);
    }
    let all = grouped(OF_DESCENT);
    let area: f64 = scene.parts.parts.iter().filter(|p| p.transfers()).map(|p| p.area_mm2).sum();
    let spacing_mm = (area / all.len().max(1) as f64).sqrt();
    let smooth_mm = Kernels::new(MediumKernel::of_media(&scene.media)).smooth_mm();
    if spacing_mm > ALONE * smooth_mm { grouped(1) } else { all }
}

/// The hierarchy that a choice of samples descends.
pub(super) fn order(sampling: &Sampling) -> Order {
    match sampling {
        Sampling::Shared | Sampling::Hybrid(_) => Order::Texture,
        Sampling::Clusters | Sampling::Product => Order::Space,
    }
}

/// Kinds of light that a choice of samples takes.
pub(super) fn kinds(sampling: &Sampling) -> &'static [LightKind] {
    match sampling {
        Sampling::Hybrid(_) => &[LightKind::Directional, LightKind::Point],
        _ => &LightKind::ALL,
    }
}
