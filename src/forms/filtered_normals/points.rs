//! The vertices of translucent parts as points that carry normals, their order in the asset, and the Laplacian over them.

use glam::DVec3;
use translux_format::filtered_normals::Earlier;

use crate::error::Result;
use crate::geometry::bvh::{Bvh, NO_TRIANGLE};
use crate::geometry::laplacian::Laplacian;
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::irradiance::{Illumination, LightSampling, SurfacePoint};
use crate::transport::receivers::{NONE, Receivers};
use crate::transport::surface::Surface;

/// Receivers that share a traversal; only their grouping by place is used here.
const GROUP: usize = 16;

/// Directions that openness is measured with: a constant light takes a quarter of them.
const OPENNESS: LightSampling = LightSampling { directions: 512, ..LightSampling::FAST };

/// Quantiser steps for each octave of a sum of weights.
pub(super) const STEPS_OF_OCTAVE: f64 = 16.0;

/// Error of the implicit steps, about: far below a step of the quantiser.
pub(super) const TOLERANCE: f64 = 1e-4;

/// The points of a scene.
pub(super) struct Points {
    pub(super) receivers: Receivers,
    /// Medium of each point.
    pub(super) medium: Vec<u32>,
    /// Unit normal weighted by area; zero where there is none.
    pub(super) normals: Vec<DVec3>,
    /// A third of the area around each, mm^2.
    pub(super) areas: Vec<f64>,
    /// Receivers in the order of the asset: by the first vertex that takes their value.
    pub(super) order: Vec<u32>,
    /// Corners of the triangles of the translucent parts.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Points {
    pub(super) fn new(scene: &Scene) -> Self {
        let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
        let mut part = vec![NONE; receivers.len()];
        for group in &receivers.groups {
            part[group.run.range()].fill(group.part);
        }
        let medium_of = |part: &u32| scene.parts.parts.get(*part as usize).and_then(|p| p.medium).unwrap_or(0);
        let (mut normals, mut triangles) = (vec![DVec3::ZERO; receivers.len()], Vec::new());
        for (index, corners) in scene.mesh.triangles.iter().enumerate() {
            let of = corners.map(|v| receivers.of_vertex[v as usize]);
            // A vertex that two parts share belongs to one of them; no light crosses there.
            let own = Some(scene.parts.triangle_part[index]);
            if of.iter().all(|r| part.get(*r as usize).copied() == own) {
                triangles.push(of);
                of.iter().for_each(|r| normals[*r as usize] += scene.mesh.cross_mm2(index as u32));
            }
        }
        normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
        let (mut order, mut seen) = (Vec::with_capacity(receivers.len()), vec![false; receivers.len()]);
        for &r in receivers.of_vertex.iter().filter(|r| **r != NONE) {
            if !std::mem::replace(&mut seen[r as usize], true) {
                order.push(r);
            }
        }
        let areas = receivers.areas_mm2(&scene.mesh);
        let medium = part.iter().map(medium_of).collect();
        Self { receivers, medium, normals, areas, order, triangles }
    }

    pub(super) fn len(&self) -> usize {
        self.normals.len()
    }

    /// Neighbours among the rows of the asset.
    pub(super) fn earlier(&self) -> Earlier {
        let mut row = vec![0u32; self.len()];
        self.order.iter().enumerate().for_each(|(i, r)| row[*r as usize] = i as u32);
        Earlier::new(self.len(), self.triangles.iter().map(|t| t.map(|r| row[r as usize])))
    }

    pub(super) fn laplacian(&self) -> Laplacian {
        let at = &self.receivers.positions;
        Laplacian::new(self.len(), self.triangles.iter().map(|t| (*t, t.map(|r| at[r as usize]))))
    }

    /// Points for rays, with their media.
    pub(super) fn surface_points(&self) -> Vec<(SurfacePoint, u32)> {
        let of = |((at, normal), medium): ((&DVec3, &DVec3), &u32)| {
            (SurfacePoint { at: *at, normal: *normal, triangle: NO_TRIANGLE }, *medium)
        };
        self.receivers.positions.iter().zip(&self.normals).zip(&self.medium).map(of).collect()
    }

    /// Irradiance of every point behind the surface by rays, for media of some indices of refraction.
    pub(super) fn irradiance(
        &self,
        (scene, bvh): (&Scene, &Bvh),
        lights: &[Light],
        etas: &[f64],
        sampling: LightSampling,
        progress: &dyn Progress,
    ) -> Result<Vec<DVec3>> {
        let part_offsets = vec![0; scene.parts.parts.len() + 1];
        let samples = Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets };
        let surface = Surface { domain: scene.domain(), bvh, samples: &samples, patches: &[] };
        Ok(Illumination::new(&surface, lights, etas, sampling)?.at_points(&self.surface_points(), progress))
    }

    /// Share of the sky over each point that it sees, by cosine.
    pub(super) fn openness(&self, scene: &Scene, bvh: &Bvh, progress: &dyn Progress) -> Result<Vec<f64>> {
        let light = [Light::constant(DVec3::splat(1.0 / std::f64::consts::PI))?];
        let etas = vec![1.0; scene.media.len().max(1)];
        let seen = self.irradiance((scene, bvh), &light, &etas, OPENNESS, progress)?;
        Ok(seen.iter().map(|e| e.x.clamp(0.0, 1.0)).collect())
    }
}
