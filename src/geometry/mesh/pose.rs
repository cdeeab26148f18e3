//! Another pose of a mesh: the same connectivity, its vertices elsewhere.

use std::collections::{BTreeMap, HashMap, HashSet};

use glam::{DVec3, Vec3};

use super::build::{round_positions, sorted_corners};
use super::scale::{MAX_DIAGONAL_MM, MIN_DIAGONAL_MM};
use super::{Mesh, POSITION_RESOLUTION};
use crate::error::{Error, Result};
use crate::geometry::source::SourceModel;

/// Corners of a polygon at most that may be cut in another way in a pose.
const MOST_CUT: usize = 1024;

/// Area of a triangle over the least that a mesh keeps, below which it may have been left out: extents differ by what was left out.
const SLACK: f64 = 4.0;

/// The first triangle with each set of corners and orientation.
type Known = HashMap<([u32; 3], bool), usize>;

/// Where the vertices of a mesh are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Positions {
    /// World position of the local origin, mm.
    pub origin_mm: DVec3,
    /// Every source vertex relative to it, mm.
    pub local_mm: Vec<Vec3>,
}

impl Mesh {
    /// Refuses a model that is no pose of the mesh: one of other vertices or triangles. Triangles may be missing here that the mesh did not
    /// keep (of materials that it was baked without, without area, repeated), and polygons may be cut along other diagonals: readers choose
    /// these by the shape.
    ///
    /// # Errors
    /// Invalid input: numbers that differ, or the first triangle that does.
    pub fn check_pose(&self, model: &SourceModel) -> Result<()> {
        let (vertices, triangles) = (model.positions.len(), model.triangles.len());
        if vertices != self.local_mm.len() || triangles < self.triangles.len() {
            return Err(Error::input(format!(
                "it has {vertices} vertices and {triangles} triangles, and the mesh of the asset has {} and {}: a pose is the same mesh, in the \
                 same order, with its vertices elsewhere",
                self.local_mm.len(),
                self.triangles.len()
            )));
        }
        let is_baked = self.baked_materials();
        let mut known: Option<Known> = None;
        let (mut own, mut there) = (0, 0);
        while let Some(&theirs) = model.triangles.get(there) {
            let ours = self.triangles.get(own);
            let name = model.triangle_material.get(there).and_then(|&m| model.materials.get(m as usize));
            if ours.is_some_and(|ours| of_same_corners(*ours, theirs)) {
                (own, there) = (own + 1, there + 1);
            } else if name.is_some_and(|name| is_baked.get(name.as_str()) == Some(&false)) {
                there += 1;
            } else if let Some(count) = same_polygon(&self.triangles[own..], &model.triangles[there..]) {
                (own, there) = (own + count, there + count);
            } else if self.may_be_left_out(theirs, own, &mut known) {
                there += 1;
            } else {
                let [a, b, c] = theirs;
                let here = match ours {
                    Some([d, e, f]) => format!("{d} {e} {f}"),
                    None => "no triangle any more".to_owned(),
                };
                return Err(Error::input(format!(
                    "its triangle {there} has the vertices {a} {b} {c}, where the mesh of the asset has {here} (triangle {own}; counted from 0): \
                     a pose is the same mesh, in the same order, with its vertices elsewhere"
                )));
            }
        }
        match self.triangles.get(own) {
            None => Ok(()),
            Some([a, b, c]) => Err(Error::input(format!(
                "it ends before triangle {own} of the mesh of the asset, with the vertices {a} {b} {c} (counted from 0)"
            ))),
        }
    }

    /// Whether any triangle of each material was kept.
    fn baked_materials(&self) -> BTreeMap<&str, bool> {
        let mut used = vec![false; self.materials.len()];
        for &material in &self.triangle_material {
            if let Some(used) = used.get_mut(material as usize) {
                *used = true;
            }
        }
        self.materials.iter().map(String::as_str).zip(used).collect()
    }

    /// Whether a triangle of the source could be one that the mesh did not keep, before its triangle `own`.
    fn may_be_left_out(&self, corners: [u32; 3], own: usize, known: &mut Option<Known>) -> bool {
        let Some([a, b, c]) = self.welds_of(corners) else { return false };
        if a == b || b == c || c == a {
            return true;
        }
        let [p, q, r] = corners.map(|v| self.local_mm[v as usize].as_dvec3());
        let resolution_mm = POSITION_RESOLUTION * self.diagonal_mm();
        if (q - p).cross(r - p).length() <= SLACK * resolution_mm * resolution_mm {
            return true;
        }
        // Of a repeated triangle the first is kept.
        let all = || (0..self.triangles.len()).rev().map(|t| (sorted_corners(self.welded(t as u32)), t)).collect();
        known.get_or_insert_with(all).get(&sorted_corners([a, b, c])).is_some_and(|first| *first < own)
    }

    fn welds_of(&self, corners: [u32; 3]) -> Option<[u32; 3]> {
        let [a, b, c] = corners.map(|v| self.weld.get(v as usize).copied());
        Some([a?, b?, c?])
    }

    /// Positions of a pose, given in the units of the source. A vertex that has not moved by more than positions resolve is where it was.
    ///
    /// # Errors
    /// Invalid input: another number of vertices; a vertex of a triangle that is not finite; a diagonal outside 1e-6 to 1e9 mm.
    pub fn posed(&self, positions: &[DVec3], mm_per_unit: f64) -> Result<Positions> {
        if positions.len() != self.local_mm.len() {
            let (there, here) = (positions.len(), self.local_mm.len());
            return Err(Error::input(format!("{there} positions for the {here} vertices of the asset")));
        }
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for &vertex in corners {
                let p = positions[vertex as usize] * mm_per_unit;
                if !p.is_finite() {
                    return Err(Error::input(format!("vertex {vertex} of triangle {triangle} is not finite")));
                }
                (min, max) = (min.min(p), max.max(p));
            }
        }
        let diagonal_mm = (max - min).length();
        if !(MIN_DIAGONAL_MM..=MAX_DIAGONAL_MM).contains(&diagonal_mm) {
            return Err(Error::input(format!(
                "the diagonal of the pose is {diagonal_mm:.3e} mm, outside {MIN_DIAGONAL_MM:.0e} to {MAX_DIAGONAL_MM:.0e} mm"
            )));
        }
        // The origin of the rest pose serves as long as single precision resolves what is around it.
        let centre = 0.5 * (min + max);
        let is_near = centre.distance(self.origin_mm) <= 0.5 * diagonal_mm.max(self.diagonal_mm());
        let origin_mm = if is_near { self.origin_mm } else { centre };
        if !(origin_mm.is_finite() && origin_mm.abs().max_element() <= super::build::MAX_ORIGIN_MM) {
            return Err(Error::input("the pose is too far from the origin of the world for files"));
        }
        let resolution_mm = (2.0 * POSITION_RESOLUTION * self.diagonal_mm()) as f32;
        let rounded = round_positions(positions, mm_per_unit, origin_mm);
        let place = |(rest, posed): (&Vec3, Option<Vec3>)| match posed {
            Some(posed) if is_near && (posed - *rest).abs().max_element() <= resolution_mm => *rest,
            other => other.unwrap_or_default(),
        };
        Ok(Positions { origin_mm, local_mm: self.local_mm.iter().zip(rounded).map(place).collect() })
    }

    /// The mesh with its vertices elsewhere; without shading normals, which were those of the rest pose.
    pub fn in_pose(&self, positions: &Positions) -> Self {
        let Positions { origin_mm, local_mm } = positions.clone();
        Self { origin_mm, local_mm, normals: None, ..self.clone() }
    }
}

/// Whether two triangles have the same corners, in any order: parts may have been turned round.
fn of_same_corners(mut a: [u32; 3], mut b: [u32; 3]) -> bool {
    a.sort_unstable();
    b.sort_unstable();
    a == b
}

/// How many triangles at the beginning of both lists have one outline in both, so that they are one polygon cut in two ways; either may be
/// turned round.
fn same_polygon(ours: &[[u32; 3]], theirs: &[[u32; 3]]) -> Option<usize> {
    // Edges of both, counted by their direction; those inside cancel.
    let mut alike: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    let mut turned = alike.clone();
    let count = |edges: &mut BTreeMap<[u32; 2], i32>, [a, b, c]: [u32; 3], sign: i32| {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let (edge, sign) = if from < to { ([from, to], sign) } else { ([to, from], -sign) };
            let sum = edges.entry(edge).or_insert(0);
            *sum += sign;
            if *sum == 0 {
                edges.remove(&edge);
            }
        }
    };
    for (index, (&own, &there)) in ours.iter().zip(theirs).take(MOST_CUT).enumerate() {
        for (edges, sign) in [(&mut alike, -1), (&mut turned, 1)] {
            count(edges, own, 1);
            count(edges, there, sign);
        }
        if index > 0 && (alike.is_empty() || turned.is_empty()) {
            return is_polygon(&ours[..=index]).then_some(index + 1);
        }
    }
    None
}

/// Whether triangles may be the cut of one polygon: they have at most two corners more than there are triangles, all on their outline.
fn is_polygon(triangles: &[[u32; 3]]) -> bool {
    let edges = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]];
    let all: HashSet<[u32; 2]> = triangles.iter().flat_map(edges).collect();
    let outline = all.iter().filter(|[from, to]| !all.contains(&[*to, *from]));
    let on_outline: HashSet<u32> = outline.flatten().copied().collect();
    let corners: HashSet<u32> = triangles.iter().flatten().copied().collect();
    corners.len() <= triangles.len() + 2 && corners == on_outline
}
