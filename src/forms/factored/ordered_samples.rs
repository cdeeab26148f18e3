//! Geometry used by every stage of a bake.

use glam::DVec3;

use super::points::FarPoints;
use super::settings::Factored;
use super::sources::{Merged, Sources};
use crate::error::Result;
use crate::forms::environment_rows::sampled;
use crate::geometry::bvh::Bvh;
use crate::geometry::samples::{self, Patch, Samples};
use crate::light::Light;
use crate::medium::profile_basis::{ProfileBasis, Table};
use crate::progress::Silent;
use crate::scene::Scene;
use crate::transport::balanced_tree::BalancedTree;
use crate::transport::far_field::LANES;
use crate::transport::irradiance::{LightSampling, Pieces};
use crate::transport::near_field::Corners;
use crate::transport::receivers::Receivers;
use crate::transport::surface::Surface;

/// Spacing of the samples, mm: side of a square of their mean area.
pub(super) fn spacing_mm(patches: &[Patch]) -> f64 {
    let area: f64 = patches.iter().map(|p| p.area_mm2).sum();
    (area / patches.len().max(1) as f64).sqrt()
}

/// What a bake chooses by and is measured with.
#[derive(Clone, Copy)]
pub(super) struct Work<'a> {
    pub(super) scene: &'a Scene,
    pub(super) ordered: &'a OrderedSamples,
    pub(super) form: &'a Factored,
    pub(super) basis: &'a ProfileBasis,
    pub(super) table: &'a Table,
}

/// Samples in tree order, and the geometry that follows from them.
pub(super) struct OrderedSamples {
    pub(super) bvh: Bvh,
    pub(super) samples: Samples,
    pub(super) patches: Vec<Patch>,
    pub(super) tree: BalancedTree,
    pub(super) corners: Corners,
    pub(super) receivers: Receivers,
    /// Points of the far field; every receiver until they are chosen.
    pub(super) points: FarPoints,
    pub(super) split_mm: f64,
    pub(super) merged: Merged,
}

impl OrderedSamples {
    pub(super) fn new(scene: &Scene, count: usize, form: &Factored) -> Self {
        let samples = Samples::new(&scene.mesh, &scene.parts, count).in_tree_order(&scene.mesh, &scene.parts);
        let (bvh, patches) = rayon::join(|| Bvh::new(&scene.mesh), || samples::patches(&scene.mesh, &samples));
        let tree = BalancedTree::new(&samples, &patches);
        let corners = Corners::new(&scene.mesh, &samples, &patches);
        let receivers = Receivers::new(&scene.mesh, &scene.parts, LANES);
        let points = FarPoints::choose(&receivers, 0.0, &[]);
        let split_mm = (form.split * spacing_mm(&patches)).max(f64::MIN_POSITIVE);
        let merged = Merged::new(&samples, &patches);
        Self { bvh, samples, patches, tree, corners, receivers, points, split_mm, merged }
    }

    pub(super) fn surface<'a>(&'a self, scene: &'a Scene) -> Surface<'a> {
        Surface { domain: scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &self.patches }
    }

    /// Every sample.
    pub(super) fn sources(&self) -> Sources<'_> {
        (&self.patches, &self.samples.part_offsets)
    }

    /// Irradiance of every sample under one light, and of the pieces of those that are not lit evenly.
    pub(super) fn irradiance(
        &self,
        scene: &Scene,
        light: &Light,
        sampling: LightSampling,
    ) -> Result<(Vec<DVec3>, Pieces)> {
        sampled(&self.surface(scene), std::slice::from_ref(light), sampling, &Silent)
    }

    /// Largest distance between two points of one part, mm, or a little more.
    pub(super) fn reach_mm(&self, scene: &Scene) -> f64 {
        let extent =
            |part: usize| self.tree.root(part).map_or(0.0, |root| 2.0 * self.tree.cell(root, &self.patches).radius_mm);
        let reach = (0..scene.parts.parts.len()).map(extent).fold(0.0, f64::max);
        reach.clamp(self.split_mm * 2.0, scene.mesh.diagonal_mm().max(self.split_mm * 2.0))
    }
}
