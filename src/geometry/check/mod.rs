//! The mesh check: size, topology, defects, and whether the mesh is fine enough for its material.

mod measure;

use serde::Serialize;

use super::mesh::{Mesh, RepairReport};
use super::parts::{Analysis, Closure, Role};

pub use self::measure::{MeanFreePath, PartCheck, THICKNESS_SAMPLES, THIN_MEAN_FREE_PATHS, long_edge_areas_mm2};

/// Share of a part's area above which thin regions are worth a warning, and long edges a measurement.
pub const WARNING_SHARE: f64 = 0.05;

/// Findings of the mesh check.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct MeshCheck {
    /// Vertices of the source.
    pub vertices: usize,
    /// Distinct places of vertices that triangles use.
    pub welded_vertices_used: usize,
    /// Triangles after repairs.
    pub triangles: usize,
    /// Repairs of the source.
    pub repairs: RepairReport,
    /// Corners of the bounding box in world mm.
    pub bounds_mm: [[f64; 3]; 2],
    /// Its diagonal in mm.
    pub diagonal_mm: f64,
    /// Total area in mm^2.
    pub area_mm2: f64,
    /// Sum of the volumes of the parts in mm^3; none where one is open.
    pub volume_mm3: Option<f64>,
    /// Edges in all, by welded vertices.
    pub edges: usize,
    /// Edges with one triangle.
    pub boundary_edges: usize,
    /// Loops and open paths that those edges form.
    pub boundary_loops: usize,
    /// Loops of no width among those (a corner of one triangle lies on an edge of another): they leave no opening.
    pub slits: usize,
    /// Edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Vertices at which more than one fan of triangles meets.
    pub non_manifold_vertices: usize,
    /// Edges whose triangles do not pair up in opposite directions (borders aside).
    pub inconsistent_edges: usize,
    /// Connected components within one medium.
    pub components: usize,
    /// Closed components with their normals inwards, inside another closed component: bubbles.
    pub cavities: usize,
    /// Indices of closed parts whose signed volume is negative although inverted components were turned round.
    pub inverted_parts: Vec<usize>,
    /// Shortest, median and longest edge in mm.
    pub edge_mm: [f64; 3],
    /// 1st and 50th percentile of 4 sqrt(3) A / (a^2 + b^2 + c^2): 1 for an equilateral triangle, 0 for a line.
    pub quality: [f64; 2],
    /// The parts.
    pub parts: Vec<PartCheck>,
}

/// Measures a mesh. `mean_free_paths` is indexed by medium; media beyond its end are not judged.
pub fn check(
    mesh: &Mesh,
    analysis: &Analysis,
    repairs: &RepairReport,
    mean_free_paths: Option<&[MeanFreePath]>,
) -> MeshCheck {
    let edges = measure::edges(mesh, analysis);
    let shapes = measure::triangle_shapes(mesh);
    let parts = measure::parts(mesh, &analysis.parts, mean_free_paths.unwrap_or(&[]));
    let [min, max] = mesh.bounds_local_mm();
    let (welded_vertices_used, non_manifold_vertices) = measure::vertices(mesh);
    let volumes: Option<Vec<f64>> = parts.iter().map(|p| p.part.volume_mm3).collect();
    let inverted = |p: &PartCheck| p.part.closure == Closure::Closed && p.part.volume_mm3.is_some_and(|v| v < 0.0);
    let list = &analysis.components.list;
    MeshCheck {
        vertices: mesh.local_mm.len(),
        welded_vertices_used,
        triangles: mesh.triangles.len(),
        repairs: *repairs,
        bounds_mm: [min, max].map(|p| (mesh.origin_mm + p).to_array()),
        diagonal_mm: (max - min).length(),
        area_mm2: parts.iter().map(|p| p.part.area_mm2).sum(),
        volume_mm3: volumes.map(|v| v.iter().sum()),
        edges: edges.count,
        boundary_edges: edges.boundary,
        boundary_loops: edges.loops,
        slits: edges.slits,
        non_manifold_edges: edges.non_manifold,
        non_manifold_vertices,
        inconsistent_edges: list.iter().map(|c| c.inconsistent_edges).sum(),
        components: list.len(),
        cavities: list.iter().filter(|c| c.is_inverted()).count(),
        inverted_parts: (0..parts.len()).filter(|&p| inverted(&parts[p])).collect(),
        edge_mm: edges.lengths_mm,
        quality: shapes,
        parts,
    }
}

impl MeshCheck {
    /// Defects for which light is lost or taken in on the wrong side, one line each; `--strict` fails on them.
    pub fn faults(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let translucent = |p: &&PartCheck| p.part.role != Role::Opaque && p.part.inconsistent_edges > 0;
        for part in self.parts.iter().filter(translucent).map(|p| &p.part) {
            let (name, edges) = (&part.name, part.inconsistent_edges);
            let why: Vec<&str> = part.winding_doubts.iter().map(|doubt| doubt.reason()).collect();
            lines.push(format!(
                "part '{name}': {edges} edges join triangles of opposite winding, and one of their sides receives no light; which \
                 to turn over is not clear: {}",
                why.join("; ")
            ));
        }
        for p in self.inverted_parts.iter().filter(|&&p| self.parts[p].part.role != Role::Opaque) {
            let p = *p;
            lines.push(format!("the part '{}' is closed and its normals point inwards", self.parts[p].part.name));
        }
        lines
    }

    /// Warnings about other defects that make results on this mesh unreliable, one line each; a sound mesh has none.
    pub fn warnings(&self) -> Vec<String> {
        let mut lines = self.repairs.lines();
        let (openings, boundary) = (self.boundary_loops - self.slits, self.boundary_edges);
        let (slits, edges) = (self.slits, self.non_manifold_edges);
        let vertices = self.non_manifold_vertices;
        let open = "open surfaces receive light on the front side only";
        let counted = [
            (openings, format!("{openings} openings ({boundary} boundary edges): {open}")),
            (slits, format!("{slits} slits of no width, where vertices of one side are missing on the other")),
            (edges, format!("{edges} edges have more than two triangles")),
            (vertices, format!("at {vertices} vertices more than one fan of triangles meets")),
        ];
        lines.extend(counted.into_iter().filter(|(count, _)| *count > 0).map(|(_, line)| line));
        lines.extend(self.parts.iter().filter_map(|p| p.part.turned()));
        let thin = format!("is thinner than {THIN_MEAN_FREE_PATHS} mean free paths: diffusion is inaccurate there");
        lines.extend(self.share_of_parts(|p| p.thin_area_share, &thin));
        lines
    }

    /// One line about the translucent parts whose share is worth a warning.
    fn share_of_parts(&self, share: impl Fn(&PartCheck) -> Option<f64>, what: &str) -> Option<String> {
        let parts = self.parts.iter().filter(|p| p.part.role != Role::Opaque);
        let concerned: Vec<(f64, &str)> = parts
            .filter_map(|p| share(p).filter(|&s| s > WARNING_SHARE).map(|s| (100.0 * s, p.part.name.as_str())))
            .collect();
        let most = concerned.iter().map(|(share, _)| *share).fold(0.0, f64::max);
        match concerned[..] {
            [] => None,
            [(share, name)] => Some(format!("{share:.0} % of the part '{name}' {what}")),
            [(_, a), (_, b)] => Some(format!("up to {most:.0} % of the parts '{a}' and '{b}' {what}")),
            [(_, a), .., (_, z)] => {
                Some(format!("up to {most:.0} % of {} parts ('{a}' ... '{z}') {what}", concerned.len()))
            }
        }
    }
}

#[cfg(test)]
mod tests;
