//! The texels at run time: light arrives in them, samples are chosen, receivers sum R_d over these.

use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;
use translux_format::texture_space::Numbers;

use super::descent::Descent;
use super::falloff::Kernels;
use super::hybrid::Division;
use super::kept::{Kept, Shone};
use super::light::LitMap;
use super::map::{Order, TexelMap};
use super::samples::{self, Sample};
use super::settings::{Far, Local, Sampling, TextureSpace};
use super::view::LightView;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::forms::baked_in::Truth;
use crate::geometry::atlas::Atlas;
use crate::geometry::bvh::Bvh;
use crate::light::{Light, refuse_fields};
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
pub(super) const OF_DESCENT: usize = 16;
const OF_SHARED: usize = 256;

/// Spacing of receivers, over the length on which R_d changes, beyond which each descends alone.
const ALONE: f64 = 0.5;

/// Vertices that errors are measured on; where there are not many more, all are.
const MEASURED: usize = 768;

/// Samples of the exact sums at most.
const MOST_SAMPLES: u32 = 1 << 15;

/// What twice the samples leave of the error at most, where they are worth it.
const WORTH_MORE: f64 = 0.9;

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
    pub(super) lights: Vec<Light>,
    pub(super) lit: Option<LitMap>,
    pub(super) chosen: Option<Chosen>,
    /// What lights that move leave.
    pub(super) kept: Kept,
    pub(super) truth: Truth,
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
            kernels: Kernels::new(Vec::new(), 1.0),
            division: None,
            lights: Vec::new(),
            lit: None,
            chosen: None,
            kept: Kept::default(),
        };
        made.take_media(scene.media.clone())?;
        Ok(made)
    }

    /// Exact sums for the media in force, made when they are asked for.
    pub(super) fn new_truth(&self) -> Truth {
        Truth::new(self.numbers.truth_samples.min(MOST_SAMPLES) as usize)
    }

    /// Kernels of some media under the profile in force.
    pub(super) fn take_media(&mut self, media: Vec<Medium>) -> Result<()> {
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
            self.division = Some((division, Kernels::new(global, diagonal_mm)));
        }
        self.kernels = Kernels::new(kernels, diagonal_mm);
        let eta = |m: &Medium| m.properties.eta_inside_over_outside;
        if media.iter().zip(&self.scene.media).any(|(a, b)| eta(a) != eta(b)) {
            self.lit = None;
        }
        self.chosen = None;
        self.scene.media = media;
        Ok(())
    }

    pub(super) fn bvh(&self) -> &Bvh {
        self.bvh.get_or_init(|| Bvh::new(&self.scene.mesh))
    }

    /// Refuses lights that the samples cannot see.
    ///
    /// # Errors
    /// Unsupported: source radiance fields; with the hybrid method other lights than directional and point ones.
    pub(super) fn check_lights(&self, lights: &[Light]) -> Result<()> {
        refuse_fields(lights)?;
        let kinds = self.form.sampling.kinds();
        match lights.iter().find(|light| !kinds.contains(&light.kind())) {
            None => Ok(()),
            Some(light) => Err(Error::unsupported(format!(
                "sampling=hybrid sees directional and point lights, no {}; --set sampling=product takes all",
                light.kind().name()
            ))),
        }
    }

    /// Replaces the lights, without any work yet.
    #[cfg(feature = "gpu")]
    pub(super) fn take_lights(&mut self, lights: Vec<Light>) {
        (self.lights, self.lit, self.chosen) = (lights, None, None);
    }

    /// What lights shine on.
    fn shone(&self) -> Shone<'_> {
        Shone { map: &self.map, scene: &self.scene, bvh: self.bvh(), sampling: self.form.rays }
    }

    pub(super) fn illuminate(&self, lights: &[Light], progress: &dyn Progress) -> Result<LitMap> {
        Ok(LitMap::new(&self.map, self.shone().irradiance(lights, progress)?))
    }

    /// Takes lights that have moved, and keeps what was seen of those before; the limit of descents as well, where it still holds.
    pub(super) fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        let mut kept = std::mem::take(&mut self.kept);
        let irradiance = kept.irradiance(self.shone(), &lights, progress);
        self.kept = kept;
        let lit = LitMap::new(&self.map, irradiance?);
        let guess = match self.chosen {
            Some(Chosen::Limit(limit)) => Some(limit * self.lit.as_ref().map_or(1.0, |before| before.unit / lit.unit)),
            _ => None,
        };
        self.chosen = Some(self.choose_near(&lights, &lit, guess)?);
        (self.lit, self.lights) = (Some(lit), lights);
        Ok(())
    }

    pub(super) fn descent<'a>(&'a self, lit: &'a LitMap, near: NearField) -> Descent<'a> {
        Descent { scene: &self.scene, map: &self.map, lit, kernels: &self.kernels, near }
    }

    /// Kernels of the media in force.
    #[cfg(feature = "gpu")]
    pub(super) fn kernels(&self) -> &Kernels {
        &self.kernels
    }

    /// The division of R_d in force and the kernels of its global part; none unless the method is the hybrid one.
    #[cfg(feature = "gpu")]
    pub(super) fn division(&self) -> Option<&(Division, Kernels)> {
        self.division.as_ref()
    }

    /// Chooses the samples.
    pub(super) fn choose(&self, lights: &[Light], lit: &LitMap) -> Result<Chosen> {
        self.choose_near(lights, lit, None)
    }

    /// Chooses the samples; a limit of descents may be guessed.
    fn choose_near(&self, lights: &[Light], lit: &LitMap, guess: Option<f64>) -> Result<Chosen> {
        let count = self.numbers.count as usize;
        let parts = 0..self.map.roots.len();
        let drawn = || parts.clone().map(|part| samples::drawn(&self.map, &lit.nodes, part, count)).collect();
        let clusters = || parts.clone().map(|part| samples::clusters(&self.map, &lit.nodes, part, count)).collect();
        Ok(match &self.form.sampling {
            Sampling::Shared => Chosen::Shared(drawn()),
            Sampling::Clusters => Chosen::Shared(clusters()),
            Sampling::Product => Chosen::Limit(self.descent(lit, self.form.near).limit(&self.receivers, count, guess)),
            Sampling::Hybrid(local) => {
                let view = |light: &Light| LightView::new((&self.scene, self.bvh()), light, local);
                let far = match local.far {
                    Far::Drawn => drawn(),
                    Far::Clusters => clusters(),
                };
                Chosen::Hybrid(far, lights.iter().map(view).collect::<Result<_>>()?)
            }
        })
    }

    /// Radiosity of some receivers from the chosen samples, RGB.
    pub(super) fn sums(&self, chosen: &Chosen, lit: &LitMap, receivers: &Receivers) -> Vec<DVec3> {
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
        descent
            .radiosity(receivers, descent.limit(&self.receivers, RESOLVED.max(4 * self.numbers.count as usize), None))
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
    /// of some lights, at vertices that no reported error looks at. The hybrid method's is no more than lowers the error: its near part has
    /// samples of its own.
    pub(super) fn choose_count(&mut self, lights: &[Light], asked: f64, (least, most): (u32, u32)) -> Result<()> {
        let (receivers, areas) = self.measured(0);
        self.numbers.count = least;
        let near_samples = matches!(self.form.sampling, Sampling::Hybrid(_));
        for light in lights {
            let light = std::slice::from_ref(light);
            let lit = self.illuminate(light, &Silent)?;
            let all = self.resolved(&lit, &receivers);
            let mut before: Option<(u32, f64)> = None;
            loop {
                let found = self.sums(&self.choose(light, &lit)?, &lit, &receivers);
                let rms = vertex_error(&found, &all, &areas).or_none().rms;
                match before {
                    Some((count, error)) if near_samples && rms > WORTH_MORE * error => {
                        self.numbers.count = count;
                        break;
                    }
                    _ if self.numbers.count >= most || rms <= asked => break,
                    _ => before = Some((self.numbers.count, rms)),
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
    let smooth_mm = Kernels::new(MediumKernel::of_media(&scene.media), scene.mesh.diagonal_mm()).smooth_mm();
    if spacing_mm > ALONE * smooth_mm { grouped(1) } else { all }
}

/// The hierarchy that a choice of samples descends.
pub(super) fn order(sampling: &Sampling) -> Order {
    match sampling {
        Sampling::Shared | Sampling::Hybrid(Local { far: Far::Drawn, .. }) => Order::Texture,
        Sampling::Clusters | Sampling::Product | Sampling::Hybrid(Local { far: Far::Clusters, .. }) => Order::Space,
    }
}
