//! Samples, lights and media as an [`Evaluator`].

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::DVec3;

use super::lit_samples::{GatheredEvaluator, Nets};
use super::model::Model;
#[cfg(feature = "gpu")]
use super::on_device::GatheredOnDevice;
use super::settings::Far;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
#[cfg(feature = "gpu")]
use crate::evaluate::DeviceEvaluator;
#[cfg(feature = "gpu")]
use crate::evaluate::device::Device;
use crate::evaluate::exitance::{Exitance, MeshPoint};
use crate::evaluate::sampling_error::Sampled;
use crate::evaluate::single_scattering::TowardsEye;
use crate::evaluate::stages::{probe_points, worst_and_unseen};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit, Refined, SingleScattering};
use crate::forms::environment_rows::{StoredRows, by_rays, sampled};
use crate::geometry::bvh::Bvh;
use crate::geometry::part_table::PartTable;
use crate::light::Light;
use crate::medium::material::Medium;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::calibration::Calibrated;
use crate::transport::gather::{Gather, Lit, Scheme};
use crate::transport::interreflection::InterReflection;
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{NONE, Receivers};

/// Receivers that share a traversal of the samples, where points anywhere are receivers.
const GROUP: usize = 16;

/// Exitance that is gathered at each point.
struct AtPoints<'a> {
    gather: Gather<'a>,
    lit: Lit<'a>,
    scheme: Scheme,
    parts: &'a PartTable,
    calibrated: Option<&'a Calibrated>,
}

impl Exitance for AtPoints<'_> {
    fn at_vertices(&self) -> Option<&[DVec3]> {
        None
    }

    fn at(&self, point: &MeshPoint) -> DVec3 {
        self.at_each(std::slice::from_ref(point), &Silent).first().copied().unwrap_or_default()
    }

    fn at_each(&self, points: &[MeshPoint], progress: &dyn Progress) -> Vec<DVec3> {
        let place = |point: &MeshPoint| {
            let part = *self.parts.triangle_part.get(point.triangle as usize)?;
            self.parts.parts.get(part as usize)?.transfers().then_some((part, point.at_mm))
        };
        let places: Vec<_> = points.iter().map(place).collect();
        let receivers = match self.calibrated {
            None => Receivers::at(&places, GROUP),
            Some(calibrated) => {
                let weights = |point: &MeshPoint| [point.barycentric[1], point.barycentric[2]];
                let normals: Vec<DVec3> = points.iter().map(|p| calibrated.normal_at(p.triangle, weights(p))).collect();
                let factors: Vec<DVec3> = points.iter().map(|p| calibrated.at(p.triangle, weights(p))).collect();
                Receivers::oriented(&places, &normals, GROUP).with_factors(&factors)
            }
        };
        receivers.expand(&not_negative(self.gather.radiosity(&receivers, &self.lit, self.scheme, progress)))
    }
}

/// Radiosity without what rounding leaves below zero: closed forms over the edges of near triangles cancel, and where it
/// is dark for many mean free paths around, 1e-8 of the brightest is all that is left of them.
fn not_negative(mut values: Vec<DVec3>) -> Vec<DVec3> {
    values.iter_mut().for_each(|b| *b = b.max(DVec3::ZERO));
    values
}

impl GatheredEvaluator {
    /// What receivers gather over nets, all or those that are asked for, if nets have been made and resolve the kernels.
    fn over_nets(&self, asked: Option<&[u32]>) -> Option<Vec<DVec3>> {
        let (nets, tables) = self.nets()?;
        Some(nets.radiosity(&self.surface(), tables, self.sample_light(self.lit()), (&self.receivers, asked)))
    }

    /// What receivers gather without nets, for the places or vertices that they are made of; there must have been
    /// [`Self::tuned_scheme`].
    fn summed(&self, receivers: &Receivers, progress: &dyn Progress) -> Vec<DVec3> {
        let values = self.with_gather(|gather, lit| gather.radiosity(receivers, lit, self.scheme(), progress));
        receivers.expand(&not_negative(values))
    }

    /// Radiosity of some receivers over all pairs, with the near field of the truth, RGB.
    ///
    /// # Errors
    /// Failures of the work.
    pub fn all_pairs_at(&mut self, receivers: &Receivers, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.light_up(progress)?;
        let near = NearField::REFERENCE;
        let returned = self.outside.map(|outside| self.return_light(outside, near, Scheme::AllPairs, progress));
        let surface = self.surface();
        let gather = self.gather(&surface, near);
        let (direct, pieces) = self.direct();
        let irradiance = returned.as_ref().map_or(direct, |returned| &returned.irradiance);
        let lit = gather.light_with_pieces(irradiance, pieces);
        Ok(not_negative(gather.radiosity(receivers, &lit, Scheme::AllPairs, progress)))
    }
}

impl Evaluator for GatheredEvaluator {
    fn capabilities(&self) -> Capabilities {
        let profile = if self.model.is_some() { ProfileEdit::Calibrated } else { ProfileEdit::Any };
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
                + self.model.as_ref().map_or(0, Model::bytes)
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
        (self.irradiance, self.returned) = (None, None);
        if self.remembered_lights == 1 {
            self.unmoved.clear();
        }
        self.forget_limits();
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
            self.unmoved.clear();
        }
        // Names may change without work.
        if media.iter().zip(&self.scene.media).any(|(a, b)| a.properties != b.properties) {
            if let Some((profile, _)) = &self.profile {
                let kernels = self.kernels(profile, &media)?;
                self.profile = Some((profile.clone(), kernels));
            }
            self.nets.iter_mut().for_each(Nets::forget_media);
            if let Some(model) = &mut self.model {
                model.set_media(&media);
                self.other_model();
            }
        }
        self.returned = None;
        self.forget_limits();
        self.scene.media = media;
        Ok(())
    }

    fn set_profile(&mut self, profile: LoadedProfile) -> Result<()> {
        if self.model.is_some() {
            return Err(Error::unsupported(
                "--profile: the kernels of the asset are calibrated by walks, which have no profile; bake it with --model dipole",
            ));
        }
        let profile = if self.single.is_some() { profile.beside_single_scattering() } else { profile };
        let kernels = self.kernels(&profile, &self.scene.media)?;
        self.profile = Some((profile, kernels));
        self.returned = None;
        self.forget_limits();
        self.nets.iter_mut().for_each(Nets::forget_media);
        Ok(())
    }

    fn remember_lights(&mut self, count: usize) {
        self.remembered_lights = count.max(1);
        self.unmoved.clear();
    }

    fn answer_at_once(&mut self) {
        self.at_once = true;
    }

    fn refine(&mut self) -> Result<Refined> {
        let Some(mut model) = self.model.take() else { return Ok(Refined::Done) };
        let refined = model.refine(&self.scene, &self.surface());
        self.model = Some(model);
        let refined = refined?;
        if refined == Refined::Changed {
            self.other_model();
        }
        Ok(refined)
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.irradiance(progress)?;
        self.prepare_nets(None, progress);
        if let Some(values) = self.over_nets(None) {
            return Ok(self.receivers.expand(&not_negative(values)));
        }
        self.tuned_scheme();
        Ok(self.summed(&self.receivers, progress))
    }

    fn radiosity_of(&mut self, vertices: &[u32], progress: &dyn Progress) -> Result<Vec<DVec3>> {
        self.irradiance(progress)?;
        let receiver = |vertex: &u32| self.receivers.of_vertex.get(*vertex as usize).copied().unwrap_or(NONE);
        let asked: Vec<u32> = vertices.iter().map(receiver).collect();
        self.prepare_nets(Some(&asked), progress);
        if let Some(values) = self.over_nets(Some(&asked)) {
            let values = not_negative(values);
            return Ok(asked.iter().map(|&r| values.get(r as usize).copied().unwrap_or_default()).collect());
        }
        self.tuned_scheme();
        Ok(self.summed(&self.receivers.of_vertices(vertices), progress))
    }

    fn prepare_points(&mut self, progress: &dyn Progress) -> Result<()> {
        self.irradiance(progress)?;
        if let (Far::Hierarchical { error, bound }, None) = (self.gathering.far, self.limit_at_points) {
            self.tune_for_points(error, bound);
        }
        Ok(())
    }

    fn exitance_at_points(&self) -> Option<Box<dyn Exitance + '_>> {
        let lit = self.irradiance.is_some() && (self.outside.is_none() || self.returned.is_some());
        let tuned = matches!(self.gathering.far, Far::AllPairs) || self.limit_at_points.is_some();
        (lit && tuned).then(|| {
            let gather = self.gather(&self.surface(), self.gathering.near);
            let (irradiance, pieces) = self.lit();
            let lit = gather.light_with_pieces(irradiance, pieces);
            let exitance = AtPoints {
                gather,
                lit,
                scheme: self.scheme_of(self.limit_at_points),
                parts: &self.scene.parts,
                calibrated: self.calibrated(),
            };
            Box::new(exitance) as Box<dyn Exitance>
        })
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
            true => Some(sampled(&self.surface(), &lights, self.gathering.sampling, progress)?),
            false => None,
        };
        let direct = rays.as_ref().map_or(self.direct(), |(irradiance, pieces)| (irradiance, pieces));
        let with_rays = Sampled {
            surface: self.surface(),
            kernels: self.profile.as_ref().map(|(_, kernels)| kernels.as_slice()),
            calibrated: self.calibrated(),
            lights: &lights,
            irradiance: direct,
            stored: rays.as_ref().map(|_| self.direct().0),
            sampling: self.gathering.sampling,
            near: self.gathering.near,
            receivers: &self.receivers,
            areas: &self.areas,
        };
        with_rays.enter(&mut ledger, progress)?;
        let gain = self.enter_inter_reflection(&mut ledger);
        if let Some(single) = self.single {
            single.enter_noise(self.lit_scene(), &mut ledger)?;
        }
        let (_, probes) = probe_points(&self.receivers, &self.areas);
        self.prepare_nets(Some(&probes.indices), progress);
        if self.nets().is_none() {
            self.tuned_scheme();
        }
        let Some(stage) = self.transfer() else { return Ok(ledger) };
        let error = worst_and_unseen(unseen, |light| {
            let Some(light) = light else { return Ok(self.transfer_error(self.lit())) };
            let (irradiance, pieces) = self.illuminate(std::slice::from_ref(light), progress)?;
            Ok(self.transfer_error((&irradiance, &pieces)))
        })?;
        let note = "against all pairs, on vertices that no tuning saw, the worst of these and of probe lights";
        ledger.add(stage, error.scaled(gain), note);
        Ok(ledger)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let receivers = self.receivers.clone();
        Ok(receivers.expand(&self.all_pairs_at(&receivers, progress)?))
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(GatheredOnDevice::new(*self, device)?))
    }
}
