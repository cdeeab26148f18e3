//! The texels at run time: light arrives in them, samples are chosen, receivers sum R_d over these.

use std::sync::OnceLock;

use glam::DVec3;
use translux_format::texture_space::Numbers;

use super::carried::Carried;
use super::descent::Descent;
use super::falloff::Kernels;
use super::hybrid::Division;
use super::kept::{Kept, Shone};
use super::light::LitMap;
use super::map::{Order, TexelMap};
use super::samples::{self, Sample};
use super::settings::{Far, Local, Sampling, TextureSpace};
use super::view::LightView;
use crate::error::{Error, Result};
use crate::forms::baked_in::Truth;
use crate::geometry::atlas::Atlas;
use crate::geometry::bvh::Bvh;
use crate::light::{Light, refuse_fields};
use crate::math::simd::InstructionSet;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::parallel::*;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::irradiance::LightSampling;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::kernel::{Block, PointSource};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{Group, Receivers};

/// Receivers that share a descent; those of shared samples only share a centre of their coordinates. 64 take a sixth less time than 16 for as many
/// sources, at a fifth less error (bunny_closed in marble) to a third more (santa in skin1, both 30 mm, 400 sources); 128 are no faster, and with 256
/// few sources are not enough for what is near.
const OF_DESCENT: usize = 64;
const OF_SHARED: usize = 256;

/// Receivers that share a descent where there are fewer samples than the others have in a group: those of one would see little but the light among them.
const OF_SHORT_DESCENT: usize = 16;

/// Spacing of receivers, over the length on which R_d changes, beyond which each descends alone.
const ALONE: f64 = 0.5;

/// Samples of the exact sums at most.
const MOST_SAMPLES: u32 = 1 << 18;

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
    pub(super) areas: Vec<f64>,
    pub(super) numbers: Numbers,
    pub(super) profile: Option<LoadedProfile>,
    kernels: Kernels,
    /// The division of R_d and the kernels of its global part, where the method is the hybrid one.
    division: Option<(Division, Kernels)>,
    pub(super) lights: Vec<Light>,
    pub(super) lit: Option<LitMap>,
    pub(super) chosen: Option<Chosen>,
    /// What lights that move leave: shadows, and draws.
    pub(super) kept: Kept,
    carried: Option<Carried>,
    /// The light in the texels is that of lights before, the samples are those of the lights in force.
    is_behind: bool,
    pub(super) truth: Truth,
}

impl TextureSpaceEvaluator {
    pub(super) fn new(form: &TextureSpace, scene: &Scene, atlas: Atlas, numbers: Numbers) -> Result<Self> {
        let map = TexelMap::new(scene, atlas, numbers.resolution, order(&form.sampling))?;
        let receivers = receivers(form, scene, numbers.count);
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
            carried: None,
            is_behind: false,
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
        self.catch_up();
        (self.chosen, self.carried) = (None, None);
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

    /// Rays by which each patch sees the lights.
    pub(super) fn rays(&self) -> LightSampling {
        self.form.rays(self.map.points.len())
    }

    /// What lights shine on.
    fn shone(&self) -> Shone<'_> {
        Shone { map: &self.map, scene: &self.scene, bvh: self.bvh(), sampling: self.rays() }
    }

    pub(super) fn illuminate(&self, lights: &[Light], progress: &dyn Progress) -> Result<LitMap> {
        Ok(LitMap::new(&self.map, self.shone().irradiance(lights, progress)?))
    }

    /// Forgets what lights before left.
    pub(super) fn forget(&mut self) {
        self.kept.clear();
        self.carried = None;
        self.catch_up();
    }

    /// Light in the texels that is behind the lights in force has to be made anew.
    pub(super) fn catch_up(&mut self) {
        if std::mem::take(&mut self.is_behind) {
            (self.lit, self.chosen) = (None, None);
        }
    }

    /// Samples whose draws are kept, under lights that have moved; false where they have to be drawn anew.
    fn carry(&mut self, lights: &[Light]) -> Result<bool> {
        let (Some(mut carried), Some(lit)) = (self.carried.take(), &self.lit) else { return Ok(false) };
        let Some(samples) = carried.under(self.shone(), lights, lit.unit)? else { return Ok(false) };
        (self.carried, self.chosen, self.is_behind) = (Some(carried), Some(Chosen::Shared(samples)), true);
        Ok(true)
    }

    /// Takes lights that have moved, and keeps what was seen of those before; draws and the limit of descents as well, where they still hold.
    pub(super) fn move_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        if self.carry(&lights)? {
            self.lights = lights;
            return Ok(());
        }
        let mut kept = std::mem::take(&mut self.kept);
        let irradiance = kept.irradiance(self.shone(), &lights, progress);
        self.kept = kept;
        let lit = LitMap::new(&self.map, irradiance?);
        let guess = match self.chosen {
            Some(Chosen::Limit(limit)) => Some(limit * self.lit.as_ref().map_or(1.0, |before| before.unit / lit.unit)),
            _ => None,
        };
        if self.form.sampling == Sampling::Shared {
            let (carried, samples) = Carried::new(&self.map, &lit.nodes, self.numbers.count as usize);
            (self.carried, self.chosen) = (Some(carried), Some(Chosen::Shared(samples)));
        } else {
            self.chosen = Some(self.choose_near(&lights, &lit, guess)?);
        }
        (self.lit, self.lights, self.is_behind) = (Some(lit), lights, false);
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
}

/// Receivers that share a descent to some number of samples in the mean.
pub(super) fn of_descent(count: u32) -> usize {
    if (count as usize) < OF_DESCENT { OF_SHORT_DESCENT } else { OF_DESCENT }
}

/// Receivers in groups. Those of a descent are alone where they are farther from each other than R_d reaches without change: together
/// they would look at most of the surface.
fn receivers(form: &TextureSpace, scene: &Scene, count: u32) -> Receivers {
    let grouped = |capacity| Receivers::new(&scene.mesh, &scene.parts, capacity);
    if form.sampling != Sampling::Product {
        return grouped(OF_SHARED);
    }
    let all = grouped(of_descent(count));
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
