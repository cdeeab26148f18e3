//! Charts of a mesh and their packing, by the crate `uvunwrap`: regions grown by their normals, flattened by least squares
//! conformal maps (Levy et al. 2002) that become as rigid as possible (Liu et al. 2008), split until nothing overlaps,
//! packed by their shape. It has one result on all processors and at any number of threads.
//!
//! Why this one: `xatlas`, which it follows, is C++ behind wrappers that are years old, and its charts are conformal.

use glam::DVec2;
use uvunwrap::{Density, MeshInput, Options, Packing};

use super::cut::{Codes, STEPS};
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;

/// No chart.
pub(super) const NONE: u32 = u32::MAX;

/// Texels around each chart: charts are twice as far apart, so that no texel has two.
const PADDING: u32 = 1;

/// Texels of a side of the largest page that is tried before charts go to several.
const LARGEST_PAGE: u32 = 8192;

/// A mesh cut into charts, each flattened by itself.
#[derive(Clone, Debug, Default)]
pub(super) struct Charts {
    /// Point of each corner of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Chart of each triangle; [`NONE`] where it is too thin to have one, its corners then lie in one place.
    pub of_triangle: Vec<u32>,
    /// Vertex of the mesh at each point.
    pub vertices: Vec<u32>,
    /// Place of each point, mm, one frame for each chart.
    pub places: Vec<DVec2>,
}

fn failed(error: &uvunwrap::Error) -> Error {
    Error::runtime(format!("the surface could not be unwrapped: {error}"))
}

/// Corners in steps of the unit square from points of a page.
fn codes(atlas: &uvunwrap::Atlas) -> Vec<Codes> {
    // Pages beside each other in a square; mostly there is one.
    let pages = f64::from(atlas.page_count.max(1)).sqrt().ceil();
    let size = DVec2::new(f64::from(atlas.width), f64::from(atlas.height));
    let unit = STEPS / (pages * size.max_element().max(1.0));
    let Some(out) = atlas.meshes.first() else { return Vec::new() };
    let code = |index: &u32| {
        let Some(vertex) = out.vertices.get(*index as usize) else { return [0; 2] };
        let page = f64::from(vertex.page.unwrap_or(0));
        let place = DVec2::new(page % pages, (page / pages).floor()) * size.max_element();
        let at = (place + DVec2::from(vertex.uv.map(f64::from)) * size) * unit;
        [at.x.round() as u16, at.y.round() as u16]
    };
    out.indices.as_chunks().0.iter().map(|corners: &[u32; 3]| [0, 1, 2].map(|c| code(&corners[c]))).collect()
}

/// Packs on one page of at least `page` texels a side, on several only where the largest is too small for the gutters.
fn packed(input: MeshInput<'_>, page: u32) -> Result<uvunwrap::Atlas> {
    let mut page_size = page.clamp(16, LARGEST_PAGE);
    loop {
        let density = Density::Auto { page_size };
        let options = Options { density, padding: PADDING, ..Options::default() };
        let atlas = uvunwrap::generate(&[input], &options).map_err(|e| failed(&e))?;
        if atlas.page_count <= 1 || page_size >= LARGEST_PAGE {
            return Ok(atlas);
        }
        page_size *= 2;
    }
}

/// The mesh with welded corners, as the library takes it.
struct Input {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl Input {
    fn new(mesh: &Mesh) -> Self {
        let indices = (0..mesh.triangles.len() as u32).flat_map(|t| mesh.welded(t)).collect();
        Self { positions: mesh.local_mm.iter().map(|p| p.to_array()).collect(), indices }
    }

    fn of<'a>(&'a self, mesh: &'a Mesh) -> MeshInput<'a> {
        // A texel then has one material, and mostly one part.
        let face_materials = Some(mesh.triangle_material.as_slice());
        MeshInput { face_materials, ..MeshInput::new(&self.positions, &self.indices) }
    }
}

/// The map that the library makes, as rigid as possible.
pub(super) fn rigid(mesh: &Mesh, page: u32) -> Result<Vec<Codes>> {
    Ok(codes(&packed(Input::new(mesh).of(mesh), page)?))
}

/// The charts of that map.
pub(super) fn charts(mesh: &Mesh) -> Result<Charts> {
    let input = Input::new(mesh);
    // Any density will do, since the charts are packed later.
    let texels_per_unit = (1024.0 / mesh.total_area_mm2().sqrt()) as f32;
    let density = Density::Fixed { texels_per_unit, page_size: None };
    let options = Options { density, padding: PADDING, packing: Packing::Fast, ..Options::default() };
    let atlas = uvunwrap::generate(&[input.of(mesh)], &options).map_err(|e| failed(&e))?;
    let size = DVec2::new(f64::from(atlas.width), f64::from(atlas.height)) / f64::from(texels_per_unit);
    let Some(out) = atlas.meshes.first() else { return Ok(Charts::default()) };
    let triangles: Vec<[u32; 3]> = out.indices.as_chunks().0.to_vec();
    let place = |point: u32| out.vertices.get(point as usize).map_or(DVec2::ZERO, |v| DVec2::from(v.uv.map(f64::from)) * size);
    let chart = |[a, b, c]: &[u32; 3]| {
        let chart = out.vertices.get(*a as usize).and_then(|v| v.chart);
        chart.filter(|_| (place(*b) - place(*a)).perp_dot(place(*c) - place(*a)) > 0.0).unwrap_or(NONE)
    };
    Ok(Charts {
        of_triangle: triangles.iter().map(chart).collect(),
        vertices: out.vertices.iter().map(|v| v.xref).collect(),
        places: (0..out.vertices.len() as u32).map(place).collect(),
        triangles,
    })
}

/// Packs charts, each scaled to its area on the surface. A chart that overlaps itself is flattened anew.
pub(super) fn repacked(mesh: &Mesh, charts: &Charts, page: u32) -> Result<Vec<Codes>> {
    let positions: Vec<[f32; 3]> = charts.vertices.iter().map(|v| mesh.local_mm[*v as usize].to_array()).collect();
    let uvs: Vec<[f32; 2]> = charts.places.iter().map(|p| p.as_vec2().to_array()).collect();
    let face_materials = Some(charts.of_triangle.as_slice());
    let input = MeshInput::new(&positions, charts.triangles.as_flattened());
    Ok(codes(&packed(MeshInput { existing_uvs: Some(&uvs), face_materials, ..input }, page)?))
}
