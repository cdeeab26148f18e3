//! A shape of an asset's object, the rest pose or another, with exact sums over the same pieces of its surface.

use std::sync::OnceLock;

use glam::DVec3;

use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::single_scattering::{LitScene, Traced};
use crate::forms::gathered::model::of_scene;
use crate::geometry::bvh::Bvh;
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::geometry::refinement::Refinement;
use crate::geometry::samples::{Patch, Samples, area, patches};
use crate::light::Light;
use crate::measure::exact_sums::TRUE_NEAR;
use crate::medium::material::Medium;
use crate::medium::profile::Orders;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::{Progress, Silent};
use crate::scene::Scene;
use crate::transport::calibration::Calibrated;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::{Illumination, LightSampling, Pieces};
use crate::transport::kernel::medium::{KernelsOfParts, MediumKernel};
use crate::transport::moved_entry::MovedEntry;
use crate::transport::receivers::{NONE, Receivers};
use crate::transport::single_scattering::{ExitPoint, vertex_points};
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Receivers that share a traversal of the samples.
const GROUP: usize = 16;

/// What all shapes of an object share.
pub(super) struct Object<'a> {
    pub(super) asset: &'a Asset,
    /// Media in force.
    pub(super) media: Vec<Medium>,
    /// Profile in the dipole's place.
    pub(super) profile: Option<LoadedProfile>,
    /// Orders of scattering that the radiosity holds in the dipole's place, where single scattering is apart.
    pub(super) orders: Orders,
    /// Single scattering that is part of the radiosity.
    pub(super) single: Option<Traced>,
    /// The pieces of the surface.
    pub(super) pieces: Refinement,
    /// Source vertices at which radiosity is summed, each welded place once.
    pub(super) vertices: Vec<u32>,
    pub(super) sampling: LightSampling,
    /// Largest distance of two points in any of the shapes, mm.
    pub(super) reach_mm: f64,
}

/// Light that has entered a shape.
pub(super) struct Entered {
    /// Irradiance of every piece of the surface, RGB, and of parts of those that are not lit evenly.
    irradiance: Vec<DVec3>,
    uneven: Pieces,
    /// Single scattering at the vertices, RGB; empty where it is no part of the radiosity.
    single: Vec<DVec3>,
}

/// A shape of the object.
pub(super) struct Shape<'a> {
    object: &'a Object<'a>,
    /// The mesh as the asset has it, in this shape.
    pub(super) scene: Scene,
    /// The same cut into pieces.
    mesh: Mesh,
    parts: PartTable,
    bvh: Bvh,
    patches: Vec<Patch>,
    tree: SampleTree,
    kernels: KernelsOfParts,
    /// Of calibrated kernels: factors of the pieces, and the moving of light that enters.
    calibrated: Option<(Vec<DVec3>, MovedEntry)>,
    receivers: Receivers,
    /// Area around each vertex, mm^2.
    pub(super) areas_mm2: Vec<f64>,
    /// Places of single scattering, and what hides lights from them.
    exits: OnceLock<(Bvh, Vec<(u64, ExitPoint)>)>,
}

impl<'a> Shape<'a> {
    /// A shape of the object whose mesh this is.
    pub(super) fn new(object: &'a Object<'a>, mesh: Mesh, progress: &dyn Progress) -> Result<Self> {
        let own = &object.asset.scene.parts;
        let entries = own.parts.iter().map(|part| (part.name.clone(), part.medium)).collect();
        let of_mesh = PartTable::new(&mesh, own.triangle_part.clone(), entries);
        let scene = Scene { mesh, parts: of_mesh, media: object.media.clone() };
        let mesh = object.pieces.mesh(&scene.mesh);
        let parts = object.pieces.parts(&mesh, &scene.parts);
        let samples = object.pieces.samples();
        let (bvh, patches) = rayon::join(|| Bvh::new(&mesh), || patches(&mesh, samples));
        let tree = SampleTree::new(samples, &patches);
        let all = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let areas = all.areas_mm2(&scene.mesh);
        let kept = of_scene(object.asset, &scene, progress)?;
        let all = kept.as_ref().map_or(all.clone(), |calibrated| calibrated.at_vertices(all));
        let receivers = chosen(&all, &object.vertices);
        let of_vertex = |v: &u32| all.of_vertex.get(*v as usize).and_then(|r| areas.get(*r as usize)).copied();
        let areas_mm2 = object.vertices.iter().map(|v| of_vertex(v).unwrap_or(0.0)).collect();
        let kernels = match &kept {
            Some(calibrated) => calibrated.kernels.clone(),
            None => (object.kernels()?, scene.parts.parts.iter().map(|part| part.medium).collect()),
        };
        let mut shape = Self {
            object,
            scene,
            mesh,
            parts,
            bvh,
            patches,
            tree,
            kernels,
            calibrated: None,
            receivers,
            areas_mm2,
            exits: OnceLock::new(),
        };
        shape.calibrated = kept.map(|kept| (shape.factors(&kept), kept.entry(&shape.surface())));
        Ok(shape)
    }

    fn surface(&self) -> Surface<'_> {
        let domain =
            crate::transport::domain::Domain { mesh: &self.mesh, parts: &self.parts, media: &self.scene.media };
        Surface { domain, bvh: &self.bvh, samples: self.object.pieces.samples(), patches: &self.patches }
    }

    /// Factors of calibrated kernels at the pieces: means by area of those at the centroids of their triangles.
    fn factors(&self, calibrated: &Calibrated) -> Vec<DVec3> {
        let pieces = &self.object.pieces;
        let samples: &Samples = pieces.samples();
        let of_patch = |patch: usize| {
            let (mut sum, mut total) = (DVec3::ZERO, 0.0);
            for facet in samples.patch(patch) {
                let Some((triangle, weights)) = pieces.centre(facet.triangle) else { continue };
                let own = area(self.mesh.corners_local_mm(facet.triangle));
                sum += own * calibrated.at(triangle, weights);
                total += own;
            }
            if total > 0.0 { sum / total } else { DVec3::ONE }
        };
        (0..samples.len()).map(of_patch).collect()
    }

    /// Light of some lights together, traced in this shape.
    ///
    /// # Errors
    /// Lights that rays do not serve.
    pub(super) fn entered(&self, lights: &[Light]) -> Result<Entered> {
        let surface = self.surface();
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let sampling = self.object.sampling;
        let (irradiance, uneven) = match &self.calibrated {
            Some((_, entry)) => entry.entered_by_rays(&surface, lights, (&etas, sampling), &Silent)?,
            None => Illumination::new(&surface, lights, &etas, sampling)?.all_with_pieces(&Silent),
        };
        let single = match self.object.single {
            Some(traced) => {
                let (bvh, points) = self.exits.get_or_init(|| self.exits());
                traced.at_points(LitScene { scene: &self.scene, bvh, lights }, points)?
            }
            None => Vec::new(),
        };
        Ok(Entered { irradiance, uneven, single })
    }

    fn exits(&self) -> (Bvh, Vec<(u64, ExitPoint)>) {
        let all = vertex_points(self.scene.domain());
        let of = |&vertex: &u32| Some((u64::from(vertex), *all.get(vertex as usize)?));
        (Bvh::new(&self.scene.mesh), self.object.vertices.iter().filter_map(of).collect())
    }

    /// Radiosity of the vertices by all pairs of them and the pieces of this shape, for light that entered it or another one, RGB.
    pub(super) fn radiosity(&self, entered: &Entered, progress: &dyn Progress) -> Vec<DVec3> {
        let surface = self.surface();
        let gather = match &self.calibrated {
            Some((factors, _)) => Gather::calibrated(&surface, &self.tree, (&self.kernels, factors), TRUE_NEAR),
            None => Gather::with_kernels_of_parts(&surface, &self.tree, self.kernels.clone(), TRUE_NEAR),
        };
        let lit = gather.light_with_pieces(&entered.irradiance, &entered.uneven);
        let sums = gather.radiosity(&self.receivers, &lit, Scheme::AllPairs, progress);
        let mut values = self.receivers.expand(&sums);
        values.iter_mut().for_each(|value| *value = value.max(DVec3::ZERO));
        values.iter_mut().zip(&entered.single).for_each(|(value, single)| *value += *single);
        values
    }

    /// Light that entered another shape, on the same pieces of this one.
    pub(super) fn carried(&self, entered: &Entered, from: &Self) -> Entered {
        let samples = self.object.pieces.samples();
        let uneven = entered.uneven.carried(|patch, corner| match samples.patch(patch) {
            [facet] => {
                let [there, here] = [from, self].map(|shape| shape.mesh.corners_local_mm(facet.triangle));
                if there == here { corner } else { in_plane(corner, edges(there), edges(here)) }
            }
            _ => corner,
        });
        Entered { irradiance: entered.irradiance.clone(), uneven, single: entered.single.clone() }
    }
}

impl Object<'_> {
    /// Kernels of the media without calibration.
    fn kernels(&self) -> Result<Vec<MediumKernel>> {
        match &self.profile {
            Some(profile) => {
                self.media.iter().map(|medium| MediumKernel::with_profile(medium, profile, self.reach_mm)).collect()
            }
            None => Ok(MediumKernel::of_orders(&self.media, self.orders, self.reach_mm)),
        }
    }
}

/// Some of the receivers of all vertices, in the order of the vertices; zero for those that have none.
fn chosen(all: &Receivers, vertices: &[u32]) -> Receivers {
    let mut part = vec![NONE; all.len()];
    for group in &all.groups {
        part[group.run.range()].fill(group.part);
    }
    let receiver = |v: &u32| all.of_vertex.get(*v as usize).copied().filter(|r| *r != NONE).map(|r| r as usize);
    let places: Vec<Option<(u32, DVec3)>> =
        vertices.iter().map(|v| receiver(v).map(|r| (part[r], all.positions[r]))).collect();
    let of = |values: &[DVec3], none: DVec3| -> Vec<DVec3> {
        vertices.iter().map(|v| receiver(v).and_then(|r| values.get(r)).copied().unwrap_or(none)).collect()
    };
    let receivers = Receivers::oriented(&places, &of(&all.normals, DVec3::ZERO), GROUP);
    if all.factors.is_empty() { receivers } else { receivers.with_factors(&of(&all.factors, DVec3::ONE)) }
}

/// Two edges of a triangle.
fn edges([a, b, c]: [DVec3; 3]) -> [DVec3; 2] {
    [b - a, c - a]
}

/// A vector in the plane of two edges, carried into that of two others.
fn in_plane(vector: DVec3, [e, f]: [DVec3; 2], [to_e, to_f]: [DVec3; 2]) -> DVec3 {
    let (ee, ef, ff) = (e.dot(e), e.dot(f), f.dot(f));
    let determinant = ee * ff - ef * ef;
    if determinant <= 0.0 {
        return DVec3::ZERO;
    }
    let (a, b) = (vector.dot(e), vector.dot(f));
    to_e * ((ff * a - ef * b) / determinant) + to_f * ((ee * b - ef * a) / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_corner_is_carried_with_its_triangle() {
        let (from, to) = ([DVec3::X, DVec3::new(1.0, 2.0, 0.0)], [DVec3::Z, DVec3::new(0.0, 3.0, 1.0)]);
        let there = 0.25 * from[0] - 0.5 * from[1];
        assert!(in_plane(there, from, to).distance(0.25 * to[0] - 0.5 * to[1]) < 1e-12);
        assert_eq!(in_plane(there, [DVec3::X, DVec3::X], to), DVec3::ZERO);
    }
}
