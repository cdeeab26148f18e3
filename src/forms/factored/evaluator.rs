//! `FactoredEvaluator` as an [`Evaluator`].

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::DVec3;

use super::evaluate::FactoredEvaluator;
#[cfg(feature = "gpu")]
use super::gpu::FactoredOnDevice;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::sampling_error::Sampled;
use crate::evaluate::stages::worst_and_unseen;
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit};
#[cfg(feature = "gpu")]
use crate::evaluate::{DeviceEvaluator, device::Device};
use crate::forms::environment_rows::{StoredRows, by_rays, sampled};
use crate::geometry::bvh::Bvh;
use crate::light::Light;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::Medium;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::near_rings::{NearRings, RingMoments};
use crate::transport::near_rule::NearField;
use crate::transport::tree::SampleTree;

/// A material whose error by the basis alone is above this (T1, any light) is refused.
const MOST_BASIS_ERROR: f64 = 0.1;

impl Evaluator for FactoredEvaluator {
    fn capabilities(&self) -> Capabilities {
        let source_fields = StoredRows::source_fields(self.rows.as_ref(), &self.scene.media);
        Capabilities { material: MaterialEdit::Any, profile: ProfileEdit::None, source_fields }
    }

    fn cost(&self) -> Cost {
        let far = &self.far;
        Cost {
            samples: self.samples.len(),
            receivers: self.receivers.len(),
            resident_bytes: self.around.bytes()
                + self.points.bytes()
                + self.corners.bytes()
                + size_of_val(self.patches.as_slice())
                + size_of_val(self.samples.facets.as_slice())
                + size_of_val(self.samples.patch_offsets.as_slice())
                + size_of_val(far.narrow.as_slice())
                + size_of_val(far.wide.as_slice())
                + size_of_val(far.wide_masks.as_slice())
                + size_of_val(far.nodes.as_slice())
                + size_of_val(far.masks.as_slice())
                + size_of_val(far.row_sums.as_slice())
                + self.order.bytes()
                + self.rows.as_ref().map_or(0, StoredRows::bytes)
                + self.rings.as_ref().map_or(0, NearRings::bytes)
                + self
                    .lit
                    .as_ref()
                    .map_or(0, |lit| lit.far.bytes() + lit.moments.as_ref().map_or(0, RingMoments::bytes)),
        }
    }

    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    fn set_lights(&mut self, lights: Vec<Light>, progress: &dyn Progress) -> Result<()> {
        self.lit = None;
        self.lights = lights;
        self.lit = Some(self.light(&self.lights, progress)?);
        Ok(())
    }

    fn set_media(&mut self, media: Vec<Medium>) -> Result<()> {
        if media.len() != self.scene.media.len() {
            let (given, there) = (media.len(), self.scene.media.len());
            return Err(Error::command_line(format!("{given} materials for the {there} media of the asset")));
        }
        let mut coefficients = Vec::with_capacity(media.len());
        for medium in &media {
            let projections = medium.properties.dipoles(BoundaryFit::Published).map(|d| self.basis.project(&d));
            let error = projections.iter().map(|p| p.error).fold(0.0, f64::max);
            if error > MOST_BASIS_ERROR {
                return Err(Error::unsupported(format!(
                    "`{}` is outside the range of this asset's basis: its radiosity could be off by {:.0} %; bake with more \
                     --set terms, or with --method two_pass",
                    medium.name,
                    100.0 * error
                )));
            }
            coefficients.push(projections.map(|p| p.coefficients));
        }
        let eta = |m: &Medium| m.properties.eta_inside_over_outside;
        if media.iter().zip(&self.scene.media).any(|(a, b)| eta(a) != eta(b)) {
            self.lit = None;
        }
        self.coefficients = coefficients;
        self.kernels = MediumKernel::of_media(&media);
        self.scene.media = media;
        self.prepare_ring_coefficients();
        Ok(())
    }

    fn prepare_for_edits(&mut self, progress: &dyn Progress) {
        if self.rings.is_some() {
            return;
        }
        let (geometry, rule) = ((&self.around, &self.corners), (self.form.near, self.basis.split_mm()));
        self.rings = Some(NearRings::new(&self.surface(), geometry, &self.receivers, rule, progress));
        self.prepare_ring_coefficients();
        if let Some(mut lit) = self.lit.take() {
            self.gather_rings(&mut lit);
            self.lit = Some(lit);
        }
    }

    fn radiosity(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let lit = self.take_lit(progress)?;
        let values = self.combine(&lit, progress);
        self.lit = Some(lit);
        Ok(self.receivers.expand(&values))
    }

    fn measured_error(&mut self, unseen: &[Light], progress: &dyn Progress) -> Result<Ledger> {
        let lit = self.light(&self.lights, progress)?;
        let mut ledger = Ledger::default();
        // Sampling is that of rays; what rows lose against them has an entry of its own.
        let lights = by_rays(&self.lights);
        let rays = match self.lights.iter().any(|l| self.is_stored(l)) {
            true => Some(sampled(&self.surface(), &lights, self.form.sampling, progress)?),
            false => None,
        };
        let with_rays = Sampled {
            surface: self.surface(),
            kernels: None,
            calibrated: None,
            lights: &lights,
            irradiance: rays.as_ref().map_or((&lit.irradiance, &lit.pieces), |(e, pieces)| (e, pieces)),
            stored: rays.as_ref().map(|_| lit.irradiance.as_slice()),
            sampling: self.form.sampling,
            near: self.form.near,
            receivers: &self.receivers,
            areas: &self.areas,
        };
        with_rays.enter(&mut ledger, progress)?;
        let error = worst_and_unseen(unseen, |light| match light {
            None => Ok(self.transport_error(&lit)),
            Some(light) => Ok(self.transport_error(&self.light(std::slice::from_ref(light), progress)?)),
        })?;
        let note = "hierarchy, basis, truncation and quantiser against all pairs, on vertices that no choice saw, the worst \
                    of these and of probe lights";
        ledger.add("transport", error, note);
        self.lit = Some(lit);
        Ok(ledger)
    }

    fn all_pairs(&mut self, progress: &dyn Progress) -> Result<Vec<DVec3>> {
        let lit = self.take_lit(progress)?;
        let (surface, tree) = (self.surface(), SampleTree::default());
        let gather = Gather::with_kernels(&surface, &tree, self.kernels.clone(), NearField::REFERENCE);
        let light = gather.light_with_pieces(&lit.irradiance, &lit.pieces);
        let values = gather.radiosity(&self.receivers, &light, Scheme::AllPairs, progress);
        let radiosity = self.receivers.expand(&values);
        self.lit = Some(lit);
        Ok(radiosity)
    }

    #[cfg(feature = "gpu")]
    fn on_device(self: Box<Self>, device: &Arc<Device>) -> Result<Box<dyn DeviceEvaluator>> {
        Ok(Box::new(FactoredOnDevice::new(*self, device)?))
    }
}
