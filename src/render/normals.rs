//! Shading normals: the source's where they are usable, otherwise smooth ones from the triangles around a vertex.

use glam::{DVec3, Vec3};

use crate::geometry::mesh::Mesh;
use crate::parallel::*;
use crate::scene::Scene;

/// Cosine of the crease angle: an edge between triangles whose normals differ by more than 60 degrees stays sharp.
const CREASE_COSINE: f64 = 0.5;
/// Largest number of triangles around a vertex with a smooth normal: corners at others get the geometric normal, since
/// a smooth one would be meaningless there and comparing all pairs would take long.
const MAX_VALENCE: usize = 1024;

/// Shading normals of a scene, three for each triangle.
pub struct ShadingNormals {
    corners: Vec<[Vec3; 3]>,
    /// Geometric unit normals.
    triangles: Vec<DVec3>,
}

impl ShadingNormals {
    /// Computes the shading normals. A stored normal is used where it is finite, not zero and within 90 degrees of its
    /// triangle's. Elsewhere the corner gets the angle-weighted mean of the normals around its welded vertex, over the
    /// triangles of the same part that no crease separates from it.
    pub fn new(scene: &Scene) -> Self {
        let mesh = &scene.mesh;
        let around = Around::new(scene);
        let corners = (0..mesh.triangles.len() as u32)
            .into_par_iter()
            .map(|triangle| {
                let own = around.normals[triangle as usize];
                std::array::from_fn(|corner| {
                    let stored = stored(scene, triangle, corner).filter(|n| n.dot(own) > 0.0);
                    stored.unwrap_or_else(|| around.smooth(scene, triangle, corner)).as_vec3()
                })
            })
            .collect();
        Self { corners, triangles: around.normals }
    }

    /// The geometric unit normal of a triangle.
    #[inline]
    pub fn geometric(&self, triangle: u32) -> DVec3 {
        self.triangles[triangle as usize]
    }

    /// The normals at the corners of a triangle.
    #[inline]
    pub fn at_corners(&self, triangle: u32) -> [Vec3; 3] {
        self.corners[triangle as usize]
    }

    /// The unit normal at a point of a triangle; zero where the corners cancel.
    #[inline]
    pub fn at(&self, triangle: u32, weights: [f64; 3]) -> DVec3 {
        let [a, b, c] = self.corners[triangle as usize].map(|n| n.as_dvec3());
        (a * weights[0] + b * weights[1] + c * weights[2]).normalize_or_zero()
    }
}

/// Sum of the normals around each welded vertex, weighted by twice the areas of their triangles, mm^2.
pub(crate) fn welded_normals_mm2(mesh: &Mesh) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; mesh.weld.len()];
    for triangle in 0..mesh.triangles.len() as u32 {
        let cross = mesh.cross_mm2(triangle);
        for vertex in mesh.welded(triangle) {
            normals[vertex as usize] += cross;
        }
    }
    normals
}

/// The source's normal of a corner, unit length, if it is usable.
fn stored(scene: &Scene, triangle: u32, corner: usize) -> Option<DVec3> {
    let normals = scene.mesh.normals.as_ref()?;
    let index = normals.corners.get(triangle as usize)?[corner];
    let normal = normals.values.get(index as usize)?.as_dvec3();
    let unit = normal.normalize_or_zero();
    (normal.is_finite() && unit != DVec3::ZERO).then_some(unit)
}

/// The triangles around each welded vertex.
struct Around {
    /// Geometric unit normals.
    normals: Vec<DVec3>,
    /// First entry of each welded vertex in `entries`.
    offsets: Vec<u32>,
    /// Triangle and its angle at the vertex.
    entries: Vec<(u32, f32)>,
}

impl Around {
    fn new(scene: &Scene) -> Self {
        let mesh = &scene.mesh;
        let count = mesh.triangles.len() as u32;
        let normals = (0..count).into_par_iter().map(|t| mesh.normal(t)).collect();
        let mut offsets = vec![0u32; mesh.weld.len() + 1];
        for v in (0..count).flat_map(|t| mesh.welded(t)) {
            offsets[v as usize + 1] += 1;
        }
        for v in 1..offsets.len() {
            offsets[v] += offsets[v - 1];
        }
        let angles: Vec<[f32; 3]> = (0..count)
            .into_par_iter()
            .map(|t| {
                let p = mesh.corners_local_mm(t);
                std::array::from_fn(|corner| {
                    let edge = |other: usize| p[(corner + other) % 3] - p[corner];
                    let (a, b) = (edge(1), edge(2));
                    // The arctangent stays accurate for the flattest triangles.
                    a.cross(b).length().atan2(a.dot(b)) as f32
                })
            })
            .collect();
        let mut next = offsets.clone();
        let mut entries = vec![(0, 0.0); 3 * count as usize];
        for (t, angles) in (0..count).zip(&angles) {
            for (v, &angle) in mesh.welded(t).into_iter().zip(angles) {
                entries[next[v as usize] as usize] = (t, angle);
                next[v as usize] += 1;
            }
        }
        Self { normals, offsets, entries }
    }

    fn smooth(&self, scene: &Scene, triangle: u32, corner: usize) -> DVec3 {
        let own = self.normals[triangle as usize];
        let vertex = scene.mesh.welded(triangle)[corner] as usize;
        let around = &self.entries[self.offsets[vertex] as usize..self.offsets[vertex + 1] as usize];
        if around.len() > MAX_VALENCE {
            return own;
        }
        let part = |t: u32| scene.parts.triangle_part.get(t as usize);
        let sum: DVec3 = around
            .iter()
            .filter(|(t, _)| part(*t) == part(triangle))
            .map(|&(t, angle)| (self.normals[t as usize], f64::from(angle)))
            .filter(|(normal, _)| normal.dot(own) > CREASE_COSINE)
            .map(|(normal, angle)| normal * angle)
            .sum();
        let unit = sum.normalize_or_zero();
        if unit == DVec3::ZERO { own } else { unit }
    }
}
