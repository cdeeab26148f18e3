//! Evaluation of `editable`: shadow rays at the samples (or stored rows for an environment), the stored far field once
//! for every basis function, and the near field from the geometry. A change of material repeats the combination only.

use glam::DVec3;
use translux_format::far_field::{FarField, Shape};
use translux_format::profile_basis as file;

use super::far_sums::{ByFunction, FarSums};
use super::points::FarPoints;
use super::settings::Factored;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::form::read_error;
use crate::evaluate::stages::probe_points;
use crate::forms::environment_rows::StoredRows;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::light::Light;
use crate::math::simd::InstructionSet;
use crate::math::statistics::VertexError;
use crate::medium::profile_basis::ProfileBasis;
use crate::parallel::*;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::close_pairs::ClosePairs;
use crate::transport::far_field::LANES;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::light_range::LightRange;
use crate::transport::near_field::{Corners, Near, around};
use crate::transport::near_rings::{NearRings, RingCoefficients, RingMoments};
use crate::transport::near_rule::NearField;
use crate::transport::receivers::{Group, Receivers};
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers that are combined as one task.
const RUN: usize = 1024;

/// One coefficient for each channel and basis function.
type Coefficients = [Vec<f64>; 3];

pub(super) struct FactoredEvaluator {
    // Not the asset: its sections would be in memory twice.
    pub(super) samples: Samples,
    pub(super) scene: Scene,
    pub(super) form: Factored,
    pub(super) bvh: Bvh,
    pub(super) patches: Vec<Patch>,
    pub(super) around: ClosePairs,
    pub(super) corners: Corners,
    pub(super) receivers: Receivers,
    /// Points of the far field.
    pub(super) points: FarPoints,
    pub(super) areas: Vec<f64>,
    pub(super) basis: ProfileBasis,
    pub(super) far: FarField,
    pub(super) order: ByFunction,
    pub(super) rows: Option<StoredRows>,
    /// Kernel of each medium, and its coefficients.
    pub(super) kernels: Vec<MediumKernel>,
    pub(super) coefficients: Vec<Coefficients>,
    /// Rings in place of the near field, where many edits are expected, and their coefficients for each medium.
    pub(super) rings: Option<NearRings>,
    pub(super) ring_coefficients: Vec<RingCoefficients>,
    pub(super) lights: Vec<Light>,
    pub(super) lit: Option<Lit>,
}

/// State that depends on the lights.
pub(super) struct Lit {
    pub(super) irradiance: Vec<DVec3>,
    pub(super) pieces: Pieces,
    range: LightRange,
    pub(super) far: FarSums,
    pub(super) moments: Option<RingMoments>,
}

pub(super) fn open(form: Factored, asset: &Asset) -> Result<Box<dyn Evaluator>> {
    let scene = asset.scene.clone();
    let stored = || rayon::join(|| read(asset), || StoredRows::of(asset));
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

/// The basis and the far field of an asset.
fn read(asset: &Asset) -> Result<(ProfileBasis, FarField)> {
    let missing = |what: &str| Error::input(format!("an asset of `editable` without its {what}; bake it again"));
    let basis = file::ProfileBasis::from_sections(&asset.sections)
        .map_err(read_error)?
        .ok_or_else(|| missing("basis (sections bas.*)"))?;
    let shape = Shape { vertices: asset.scene.mesh.local_mm.len(), part_offsets: &asset.samples.part_offsets };
    let far = FarField::from_sections(&asset.sections, &shape)
        .map_err(read_error)?
        .ok_or_else(|| missing("far field (sections far.*)"))?;
    let file::ProfileBasis { split_mm, nodes_mm, weights_mm4, functions, totals } = basis;
    let basis = ProfileBasis::from_parts(split_mm, nodes_mm, weights_mm4, functions, totals)?;
    if basis.terms() != far.terms {
        let (a, b) = (basis.terms(), far.terms);
        return Err(Error::input(format!("the basis has {a} functions and the far field {b}; bake the asset again")));
    }
    Ok((basis, far))
}

impl FactoredEvaluator {
    pub(super) fn surface(&self) -> Surface<'_> {
        Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Irradiance of every sample: through the stored rows where they hold a light, else by rays.
    fn irradiance(&self, lights: &[Light], progress: &dyn Progress) -> Result<(Vec<DVec3>, Pieces)> {
        StoredRows::illuminate(self.rows.as_ref(), &self.surface(), (lights, self.form.sampling), progress)
    }

    /// True if a light goes through the stored rows.
    pub(super) fn is_stored(&self, light: &Light) -> bool {
        self.rows.as_ref().is_some_and(|rows| rows.have(light, &self.scene.media))
    }

    pub(super) fn light(&self, lights: &[Light], progress: &dyn Progress) -> Result<Lit> {
        let (irradiance, pieces) = self.irradiance(lights, progress)?;
        progress.start("far field", self.far.groups.len() as u64);
        let range = LightRange::new(&irradiance, pieces.deviations());
        let details = LightDetails::of_range(&self.samples, &self.patches, &irradiance, range);
        let far = FarSums::new(InstructionSet::detect(), (&self.far, &self.order, &self.points.fills), &details);
        let mut lit = Lit { irradiance, pieces, range, far, moments: None };
        self.gather_rings(&mut lit);
        progress.finish();
        Ok(lit)
    }

    /// What depends on the lights in force.
    pub(super) fn take_lit(&mut self, progress: &dyn Progress) -> Result<Lit> {
        self.lit.take().map_or_else(|| self.light(&self.lights, progress), Ok)
    }

    /// Gathers light on the rings, where there are any.
    pub(super) fn gather_rings(&self, lit: &mut Lit) {
        let light = (lit.irradiance.as_slice(), &lit.pieces);
        let gather =
            |rings: &NearRings| rings.moments(&self.surface(), &self.around, &self.receivers, light, lit.range);
        lit.moments = self.rings.as_ref().map(gather);
    }

    pub(super) fn prepare_ring_coefficients(&mut self) {
        let of_rings = |rings: &NearRings| self.kernels.iter().map(|kernel| rings.coefficients(kernel)).collect();
        self.ring_coefficients = self.rings.as_ref().map_or_else(Vec::new, of_rings);
    }

    pub(super) fn combine(&self, lit: &Lit, progress: &dyn Progress) -> Vec<DVec3> {
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
    pub(super) fn transport_error(&self, lit: &Lit) -> VertexError {
        let (subset, points) = probe_points(&self.receivers, &self.areas);
        let (surface, tree) = (self.surface(), SampleTree::default());
        let gather = Gather::with_kernels(&surface, &tree, self.kernels.clone(), NearField::REFERENCE);
        let light = gather.light_with_pieces(&lit.irradiance, &lit.pieces);
        let truth = gather.radiosity(&subset, &light, Scheme::AllPairs, &Silent);
        points.error(&points.of(&self.combine(lit, &Silent)), &truth)
    }
}
