//! The truth that an asset is held against: exact sums of more samples than its own, with the media and the profile in force.

use std::sync::Arc;

use glam::DVec3;

use crate::asset::{Asset, Provenance};
use crate::error::{Error, Result};
use crate::evaluate::exitance::MeshPoint;
use crate::evaluate::inter_reflection::{MOST_TIMES, Outside};
use crate::evaluate::single_scattering::{Scattering, Traced};
use crate::evaluate::{Evaluator, Form, SingleScattering};
use crate::forms::gathered::model::sections_of;
use crate::forms::gathered::{Far, Gathered};
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::measure::exact_sums::{ALL_PAIRS, TRUE_RAYS, is_soft, under_soft_light};
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;

/// Places inside where single scattering of the truth is traced, for each vertex and light, where the radiosity includes it.
const SINGLE_SAMPLES: u32 = 256;

/// Rays of a sample of the truth that look for light from outside the medium, where the asset has such light.
const OUTSIDE_RAYS: u32 = 64;

/// Error that the rays of soft light are made for: maps are looked at place by place.
const SOFT_ERROR: f64 = 0.007;

/// Settings of an asset that say how often light outside the medium is transferred again.
const INTER_REFLECTION: &str = "inter-reflection";

/// An asset and its evaluator, with the media and the profile in force.
pub struct Subject<'a> {
    /// The evaluator.
    pub evaluator: &'a mut dyn Evaluator,
    /// The asset that it was made of.
    pub asset: &'a Asset,
    /// Profile that was put in the dipole's place.
    pub profile: Option<LoadedProfile>,
    /// Refuses work that takes so many bytes more than the process has now.
    pub admit: &'a dyn Fn(u64) -> Result<()>,
}

/// Which samples sums are over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Which {
    /// Those of the asset.
    Own,
    /// As many, fewer of them under soft light, which costs many rays of each.
    Finer(usize),
}

/// Sums over samples that rays light, at any vertex or point; made for the lights that are asked for.
pub(super) struct Exact<'a> {
    asset: &'a Asset,
    media: Vec<Medium>,
    profile: Option<LoadedProfile>,
    admit: &'a dyn Fn(u64) -> Result<()>,
    form: Gathered,
    which: Which,
    /// Whether single scattering is part of the radiosity.
    included: bool,
    /// Under sharp lights and under soft ones.
    sums: [Option<Box<dyn Evaluator>>; 2],
}

impl<'a> Exact<'a> {
    pub(super) fn new(subject: &Subject<'a>, which: Which, far: Far) -> Self {
        let is = subject.evaluator.single_scattering_is();
        let single = (is != SingleScattering::None).then(|| Traced::new(Scattering::Isotropic, SINGLE_SAMPLES));
        let outside = bounces(&subject.asset.provenance).map(|times| Outside { times, rays: OUTSIDE_RAYS });
        Self {
            asset: subject.asset,
            media: subject.evaluator.scene().media.clone(),
            profile: subject.profile.clone(),
            admit: subject.admit,
            form: Gathered { far, single, outside, ..ALL_PAIRS },
            which,
            included: is == SingleScattering::Included,
            sums: [None, None],
        }
    }

    /// The sums under one light.
    pub(super) fn under(&mut self, light: &Light, progress: &dyn Progress) -> Result<Lit<'_>> {
        let soft = is_soft(light);
        let slot = usize::from(soft);
        if self.sums[slot].is_none() {
            self.sums[slot] = Some(self.made(soft)?);
        }
        let missing = || Error::runtime("exact sums that were just made are gone");
        let sums = self.sums[slot].as_mut().ok_or_else(missing)?;
        sums.set_lights(vec![light.clone()], progress)?;
        Ok(Lit { sums: sums.as_mut(), included: self.included })
    }

    fn made(&self, soft: bool) -> Result<Box<dyn Evaluator>> {
        let scene = &self.asset.scene;
        let of_count = |count: usize| Samples::new(&scene.mesh, &scene.parts, count);
        let (samples, sampling) = match self.which {
            Which::Finer(count) if soft => {
                let (count, sampling) = under_soft_light(scene, count, SOFT_ERROR);
                (of_count(count), sampling)
            }
            Which::Finer(count) => (of_count(count), TRUE_RAYS),
            Which::Own if soft => {
                (self.asset.samples.clone(), under_soft_light(scene, self.asset.samples.len(), SOFT_ERROR).1)
            }
            Which::Own => (self.asset.samples.clone(), TRUE_RAYS),
        };
        let asset = Asset::of_scene(scene.clone(), samples, sections_of(self.asset));
        let form = Gathered { sampling, ..self.form };
        (self.admit)(Form::run_memory(&form, &asset))?;
        let mut sums = Form::open(&form, Arc::new(asset))?;
        if let Some(profile) = &self.profile {
            sums.set_profile(profile.clone())?;
        }
        sums.set_media(self.media.clone())?;
        Ok(sums)
    }
}

/// How often light outside the medium is transferred again in an asset; none where it is lost.
pub(in crate::measure) fn bounces(provenance: &Provenance) -> Option<u32> {
    match provenance.settings.get(INTER_REFLECTION).map(String::as_str) {
        Some("once") => Some(1),
        Some(text) => text.parse().ok().filter(|times| (1..=MOST_TIMES).contains(times)),
        None => None,
    }
}

/// Sums under a light.
pub(super) struct Lit<'a> {
    sums: &'a mut dyn Evaluator,
    included: bool,
}

impl Lit<'_> {
    /// Radiosity of every source vertex, RGB.
    pub(super) fn at_vertices(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let mut values = self.sums.radiosity(progress)?;
        let single = self.single(progress)?;
        values.iter_mut().zip(single).for_each(|(value, single)| *value += single);
        Ok(values)
    }

    /// Radiosity of some points, RGB. Single scattering, where it is part of the radiosity, is linear between the vertices.
    pub(super) fn at_points(&mut self, points: &[MeshPoint], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let single = self.single(progress)?;
        self.sums.prepare_points(progress)?;
        let missing = || Error::runtime("exact sums serve no points");
        let mut values = self.sums.exitance_at_points().ok_or_else(missing)?.at_each(points, progress);
        if !single.is_empty() {
            let at = |point: &MeshPoint| -> DVec3 {
                let of = |v: u32| single.get(v as usize).copied().unwrap_or_default();
                point.vertices.iter().zip(point.barycentric).map(|(v, weight)| weight * of(*v)).sum()
            };
            values.iter_mut().zip(points).for_each(|(value, point)| *value += at(point));
        }
        Ok(values)
    }

    /// Single scattering of every source vertex where it is part of the radiosity, otherwise nothing.
    fn single(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let values = if self.included { self.sums.single_scattering(progress)? } else { None };
        Ok(values.unwrap_or_default())
    }

    /// The error of these sums themselves, RMS of the worst channel: what their samples and their hierarchy are off.
    pub(super) fn own_error(&mut self, progress: &dyn Progress) -> Result<f64> {
        Ok(self.sums.measured_error(&[], progress)?.total_rms())
    }
}
