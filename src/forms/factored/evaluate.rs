//! How `editable` evaluates: shadow rays at the samples (or stored rows for an environment), the stored far field once for
//! every basis function, and the near field from the geometry. A change of material combines anew.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::FarField;

use super::far_sums::{ByFunction, FarSums};
#[cfg(feature = "gpu")]
use super::gpu::FactoredOnDevice;
use super::points::FarPoints;
use super::sections;
use super::settings::Factored;
use crate::asset::Asset;
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::sampling_error::Sampled;
use crate::evaluate::stages::{probe_points, worst_and_unseen};
use crate::evaluate::{Capabilities, Cost, Evaluator, MaterialEdit, ProfileEdit};
#[cfg(feature = "gpu")]
use crate::evaluate::{DeviceEvaluator, device::Device};
use crate::forms::environment_rows::{StoredRows, by_rays};
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::light::Light;
use crate::math::simd::Level;
use crate::math::statistics::VertexError;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::Medium;
use crate::medium::profile_basis::ProfileBasis;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::close_pairs::ClosePairs;
use crate::transport::far_field::LANES;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, Pieces};
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::light_range::LightRange;
use crate::transport::near_field::{Corners, Near, around};
use crate::transport::near_rings::{NearRings, RingCoefficients, RingMoments};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{Group, Receivers};
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// A material whose error by the basis alone is above this (T1, any light) is refused.
const MOST_BASIS_ERROR: f64 = 0.1;

/// Receivers that are combined as one task.
const RUN: usize = 1024;

/// One coefficient for each channel and basis function.
type Coefficients = [Vec<f64>; 3];

pub(super) struct FactoredEvaluator {
    // Not the asset: its sections would be in memory twice.
    pub(super) samples: Samples,
    pub(super) scene: Scene,
    pub(super) form: Factored,
    bvh: Bvh,
    pub(super) patches: Vec<Patch>,
    pub(super) around: ClosePairs,
    pub(super) corners: Corners,
    pub(super) receivers: Receivers,
    /// Of the far field.
    pub(super) points: FarPoints,
    areas: Vec<f64>,
    pub(super) basis: ProfileBasis,
    pub(super) far: FarField,
    order: ByFunction,
    pub(super) rows: Option<StoredRows>,
    /// Of each medium, and its coefficients.
    pub(super) kernels: Vec<MediumKernel>,
    pub(super) coefficients: Vec<Coefficients>,
    /// In place of the near field itself, where many edits are expected, and their coefficients for each medium.
    rings: Option<NearRings>,
    ring_coefficients: Vec<RingCoefficients>,
    pub(super) lights: Vec<Light>,
    lit: Option<Lit>,
}

/// What follows from the lights.
struct Lit {
    irradiance: Vec<DVec3>,
    pieces: Pieces,
    range: LightRange,
    far: FarSums,
    moments: Option<RingMoments>,
}

pub(super) fn open(form: Factored, asset: &Asset) -> Result<Box<dyn Evaluator>> {
    let scene = asset.scene.clone();
    let stored = || rayon::join(|| sections::read(asset), || StoredRows::of(asset));
    let geometry = || {
        let bvh = Bvh::new(&scene.mesh);
        let patches = samples::patches(&scene.mesh, &asset.samples);
        let corners = Corners::new(&scene.mesh, &asset.samples, &patches);
        (bvh, patches, corners)
    };
    let ((far, rows), (bvh, patches, corners)) = rayon::join(stored, geometry);
    let ((basis, far), rows) = (far?, rows?);
    let receivers = Receivers::new(&scene.mesh, &scene.parts, LANES);
    let points = FarPoints::of(&far, &receivers)?;
    let around = {
        let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &asset.samples, patches: &patches };
        around(&surface, &receivers, form.near, basis.split_mm())
    };
    let areas = receivers.areas_mm2(&scene.mesh);
    let media = scene.media.clone();
    let mut evaluator = FactoredEvaluator {
        samples: asset.samples.clone(),
        scene,
        form,
        bvh,
        patches,
        around,
        corners,
        receivers,
        points,
        areas,
        basis,
        order: ByFunction::new(&far),
        far,
        rows,
        kernels: Vec::new(),
        coefficients: Vec::new(),
        rings: None,
        ring_coefficients: Vec::new(),
        lights: Vec::new(),
        lit: None,
    };
    evaluator.set_media(media)?;
    Ok(Box::new(evaluator))
}

impl FactoredEvaluator {
    pub(super) fn surface(&self) -> Surface<'_> {
        Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Through the stored rows where there are any for a light, else by rays.
    fn irradiance(&self, lights: &[Light], progress: &dyn Progress) -> Result<(Vec<DVec3>, Pieces)> {
        let asset = (&self.scene, &self.samples);
        StoredRows::illuminate(self.rows.as_ref(), asset, lights, progress, |lights| self.sampled(lights, progress))
    }

    /// Whether a light goes through the stored rows.
    pub(super) fn is_stored(&self, light: &Light) -> bool {
        self.rows.as_ref().is_some_and(|rows| rows.have(light, &self.scene.media))
    }

    pub(super) fn sampled(&self, lights: &[Light], progress: &dyn Progress) -> Result<(Vec<DVec3>, Pieces)> {
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        Ok(Illumination::new(&self.surface(), lights, &etas, self.form.sampling)?.all_with_pieces(progress))
    }

    fn light(&self, lights: &[Light], progress: &dyn Progress) -> Result<Lit> {
        let (irradiance, pieces) = self.irradiance(lights, progress)?;
        progress.start("far field", self.far.groups.len() as u64);
        let range = LightRange::new(&irradiance, pieces.deviations());
        let details = LightDetails::of_range(&self.samples, &self.patches, &irradiance, range);
        let far = FarSums::new(Level::detect(), (&self.far, &self.order, &self.points.fills), &details);
        let mut lit = Lit { irradiance, pieces, range, far, moments: None };
        self.gather_rings(&mut lit);
        progress.finish();
        Ok(lit)
    }

    /// Gathers light on the rings, where there are any.
    fn gather_rings(&self, lit: &mut Lit) {
        let light = (lit.irradiance.as_slice(), &lit.pieces);
        let gather =
            |rings: &NearRings| rings.moments(&self.surface(), &self.around, &self.receivers, light, lit.range);
        lit.moments = self.rings.as_ref().map(gather);
    }

    fn prepare_ring_coefficients(&mut self) {
        let of_rings = |rings: &NearRings| self.kernels.iter().map(|kernel| rings.coefficients(kernel)).collect();
        self.ring_coefficients = self.rings.as_ref().map_or_else(Vec::new, of_rings);
    }

    fn combine(&self, lit: &Lit, progress: &dyn Progress) -> Vec<DVec3> {
        progress.start("materials", 0);
        let points = &self.points.receivers;
        let mut values = vec![DVec3::ZERO; points.len()];
        // Points of one medium lie together, because those of one part do.
        let mut rest = values.as_mut_slice();
        let mut jobs = Vec::new();
        for group in points.groups.chunk_by(|a, b| a.part == b.part) {
            let first = group[0].run.first as usize;
            let end = group[group.len() - 1].run.end as usize;
            let (mine, others) = rest.split_at_mut(end - first);
            rest = others;
            let Some(medium) = self.scene.parts.parts[group[0].part as usize].medium else { continue };
            let run = mine.chunks_mut(RUN).enumerate();
            jobs.extend(run.map(|(i, out)| (first + i * RUN, &self.coefficients[medium as usize], out)));
        }
        jobs.into_par_iter().for_each(|(first, coefficients, out)| lit.far.combine(first, coefficients, out));
        let mut values = self.points.expand(values);
        progress.finish();
        match (&self.rings, &lit.moments) {
            (Some(rings), Some(moments)) => {
                let of_group = |group: &Group| {
                    let medium = self.scene.parts.parts[group.part as usize].medium?;
                    self.ring_coefficients.get(medium as usize)
                };
                rings.add(moments, &self.receivers, of_group, &mut values);
            }
            _ => self.near().add(&self.receivers, (&lit.irradiance, &lit.pieces), &mut values, progress),
        }
        values
    }

    /// The near field of the media in force.
    pub(super) fn near(&self) -> Near<'_> {
        let geometry = (&self.around, &self.corners);
        Near::new(self.surface(), geometry, &self.kernels, self.form.near, self.basis.split_mm())
    }

    /// Error of everything but the sampling, against all pairs of the same samples.
    fn transport_error(&self, lit: &Lit) -> VertexError {
        let (subset, points) = probe_points(&self.receivers, &self.areas);
        let (surface, tree) = (self.surface(), SampleTree::default());
        let gather = Gather::with_kernels(&surface, &tree, self.kernels.clone(), NearField::REFERENCE);
        let light = gather.light_with_pieces(&lit.irradiance, &lit.pieces);
        let truth = gather.radiosity(&subset, &light, Scheme::AllPairs, &Silent);
        points.error(&points.of(&self.combine(lit, &Silent)), &truth)
    }
}

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
        let lit = match self.lit.take() {
            Some(lit) => lit,
            None => self.light(&self.lights, progress)?,
        };
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
            true => Some(self.sampled(&lights, progress)?),
            false => None,
        };
        let sampled = Sampled {
            surface: self.surface(),
            media: &self.scene.media,
            kernels: None,
            lights: &lights,
            irradiance: rays.as_ref().map_or((&lit.irradiance, &lit.pieces), |(e, pieces)| (e, pieces)),
            stored: rays.as_ref().map(|_| lit.irradiance.as_slice()),
            sampling: self.form.sampling,
            near: self.form.near,
            receivers: &self.receivers,
            areas: &self.areas,
        };
        sampled.enter(&mut ledger, progress)?;
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
        let lit = match self.lit.take() {
            Some(lit) => lit,
            None => self.light(&self.lights, progress)?,
        };
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
