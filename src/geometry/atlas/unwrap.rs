//! Charts of a mesh and their packing, by the crate `uvunwrap`: regions grown by their normals, flattened by least squares
//! conformal maps (Levy et al. 2002) that become as rigid as possible (Liu et al. 2008), split until nothing overlaps,
//! packed by their shape. It has one result on all processors and at any number of threads.
//!
//! Why this one: `xatlas`, which it follows, is C++ behind wrappers that are years old, and its charts are conformal.

use glam::DVec2;
use uvunwrap::{Density, MeshInput, Options, OutputMesh, OutputVertex, Packing};

use super::cut::{Codes, STEPS};
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;

/// No chart.
pub(super) const NONE: u32 = u32::MAX;

/// Texels around each chart: charts are twice as far apart, so that no texel has two.
const PADDING: u32 = 1;

/// Texels of a side of the largest page that is tried before charts go to several.
const LARGEST_PAGE: u32 = 8192;

/// Height of a triangle over the diagonal of the mesh below which the library leaves it out; with a margin.
const THINNEST: f64 = 2e-6;

/// Share of the surface that thin triangles may have before each becomes a chart. Mostly they have next to none, and
/// lie in one place; a mesh of small parts that are far apart has no others.
const MOST_THIN: f64 = 1e-4;

/// Triangles of a chart at most, about: the time of flattening grows faster than they do. 70,000 triangles take 7 s without a limit, 1.2 s
/// with this one, and are cut into 188 charts instead of 69.
const TRIANGLES_OF_A_CHART: f64 = 2000.0;

/// The same for meshes of more triangles than [`HUGE`]: a dragon of 202,000 takes less than half of the time, has 4,997 charts in place
/// of 4,454, and covers 48 % of the square in place of 50 %.
const TRIANGLES_OF_A_SMALL_CHART: f64 = 500.0;

/// Triangles beyond which charts are small.
const HUGE: usize = 100_000;

/// Triangles beyond which charts are packed by their rows.
const MANY_TRIANGLES: usize = 50_000;

/// Largest area of a chart, in squares of the mesh's unit.
fn largest_chart(mesh: &Mesh) -> f32 {
    let triangles = mesh.triangles.len();
    let most = if triangles > HUGE { TRIANGLES_OF_A_SMALL_CHART } else { TRIANGLES_OF_A_CHART };
    let share = most / triangles.max(1) as f64;
    if share < 1.0 { (share * mesh.total_area_mm2()) as f32 } else { 0.0 }
}

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

/// Corners in steps of the unit square from points of pages; thin triangles are the meshes after the first.
fn codes(atlas: &uvunwrap::Atlas, input: &Input) -> Vec<Codes> {
    // Pages beside each other in a square; mostly there is one.
    let pages = f64::from(atlas.page_count.max(1)).sqrt().ceil();
    let size = DVec2::new(f64::from(atlas.width), f64::from(atlas.height));
    let unit = STEPS / (pages * size.max_element().max(1.0));
    let code = |vertex: &OutputVertex| {
        let page = f64::from(vertex.page.unwrap_or(0));
        let place = DVec2::new(page % pages, (page / pages).floor()) * size.max_element();
        let at = (place + DVec2::from(vertex.uv.map(f64::from)) * size) * unit;
        [at.x.round() as u16, at.y.round() as u16]
    };
    let of = |mesh: &OutputMesh| -> Vec<Codes> {
        let corner = |index: u32| mesh.vertices.get(index as usize).map_or([0; 2], code);
        mesh.indices.as_chunks().0.iter().map(|corners: &[u32; 3]| corners.map(corner)).collect()
    };
    let mut meshes = atlas.meshes.iter().map(of);
    let mut result = meshes.next().unwrap_or_default();
    for (triangle, codes) in input.thin.iter().zip(meshes) {
        if let (Some(corners), [codes]) = (result.get_mut(*triangle as usize), codes.as_slice()) {
            *corners = *codes;
        }
    }
    result
}

/// A mesh as the library takes it.
struct Input {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
    /// Triangles that the library would leave out, and the corners of each.
    thin: Vec<u32>,
    thin_corners: Vec<[[f32; 3]; 3]>,
}

impl Input {
    /// The mesh with welded corners.
    fn new(mesh: &Mesh) -> Self {
        let indices = (0..mesh.triangles.len() as u32).flat_map(|t| mesh.welded(t)).collect();
        let least = THINNEST * mesh.diagonal_mm();
        let is_thin = |t: &u32| {
            let [a, b, c] = mesh.corners_local_mm(*t);
            mesh.cross_mm2(*t).length() < least * a.distance(b).max(b.distance(c)).max(c.distance(a))
        };
        let mut thin: Vec<u32> = (0..mesh.triangles.len() as u32).filter(is_thin).collect();
        if thin.iter().map(|t| mesh.area_mm2(*t)).sum::<f64>() < MOST_THIN * mesh.total_area_mm2() {
            thin.clear();
        }
        let corners = |t: &u32| mesh.triangles[*t as usize].map(|v| mesh.local_mm[v as usize].to_array());
        let thin_corners = thin.iter().map(corners).collect();
        Self { positions: mesh.local_mm.iter().map(|p| p.to_array()).collect(), indices, thin, thin_corners }
    }

    /// The map of the mesh, whose charts each have triangles of one `material`, and either are given or made.
    fn unwrapped(&self, materials: &[u32], uvs: Option<&[[f32; 2]]>, options: &Options) -> Result<uvunwrap::Atlas> {
        let mut ignored = vec![false; self.indices.len() / 3];
        self.thin.iter().for_each(|t| ignored[*t as usize] = true);
        let whole = MeshInput {
            face_materials: Some(materials),
            ignored_faces: Some(&ignored),
            existing_uvs: uvs,
            ..MeshInput::new(&self.positions, &self.indices)
        };
        let thin = self.thin_corners.iter().map(|corners| MeshInput::new(corners, &[0, 1, 2]));
        let meshes: Vec<MeshInput<'_>> = std::iter::once(whole).chain(thin).collect();
        uvunwrap::generate(&meshes, options)
            .map_err(|error| Error::runtime(format!("the surface could not be unwrapped: {error}")))
    }

    /// The map on one page of at least `page` texels a side, on several only where the largest has no room for gutters.
    fn packed(
        &self,
        materials: &[u32],
        uvs: Option<&[[f32; 2]]>,
        (page, max_chart_area): (u32, f32),
    ) -> Result<Vec<Codes>> {
        let mut page_size = page.clamp(16, LARGEST_PAGE);
        loop {
            let density = Density::Auto { page_size };
            // Charts in the thousands take seconds to nest into each other.
            let packing = if self.indices.len() > 3 * MANY_TRIANGLES { Packing::Fast } else { Packing::Shape };
            let options = Options { density, padding: PADDING, max_chart_area, packing, ..Options::default() };
            let atlas = self.unwrapped(materials, uvs, &options)?;
            if atlas.page_count <= 1 || page_size >= LARGEST_PAGE {
                return Ok(codes(&atlas, self));
            }
            page_size *= 2;
        }
    }
}

/// The map that the library makes, as rigid as possible. A texel then has one material, and mostly one part.
pub(super) fn rigid(mesh: &Mesh, page: u32) -> Result<Vec<Codes>> {
    Input::new(mesh).packed(&mesh.triangle_material, None, (page, largest_chart(mesh)))
}

/// The charts of that map.
pub(super) fn charts(mesh: &Mesh) -> Result<Charts> {
    // Any density will do, since the charts are packed later.
    let texels_per_unit = (1024.0 / mesh.total_area_mm2().sqrt()) as f32;
    let density = Density::Fixed { texels_per_unit, page_size: None };
    let max_chart_area = largest_chart(mesh);
    let options = Options { density, padding: PADDING, max_chart_area, packing: Packing::Fast, ..Options::default() };
    let atlas = Input::new(mesh).unwrapped(&mesh.triangle_material, None, &options)?;
    let size = DVec2::new(f64::from(atlas.width), f64::from(atlas.height)) / f64::from(texels_per_unit);
    let Some(out) = atlas.meshes.first() else { return Ok(Charts::default()) };
    let places: Vec<DVec2> = out.vertices.iter().map(|v| DVec2::from(v.uv.map(f64::from)) * size).collect();
    let triangles: Vec<[u32; 3]> = out.indices.as_chunks().0.to_vec();
    let chart = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|corner| places[corner as usize]);
        let chart = out.vertices[corners[0] as usize].chart;
        chart.filter(|_| (b - a).perp_dot(c - a) > 0.0).unwrap_or(NONE)
    };
    let of_triangle = triangles.iter().map(chart).collect();
    let vertices = out.vertices.iter().map(|v| v.xref).collect();
    Ok(Charts { of_triangle, vertices, places, triangles })
}

/// Packs charts, each scaled to its area on the surface. A chart that overlaps itself is flattened anew.
pub(super) fn repacked(mesh: &Mesh, charts: &Charts, page: u32) -> Result<Vec<Codes>> {
    let uvs: Vec<[f32; 2]> = charts.places.iter().map(|p| p.as_vec2().to_array()).collect();
    let positions = charts.vertices.iter().map(|v| mesh.local_mm[*v as usize].to_array()).collect();
    let indices = charts.triangles.as_flattened().to_vec();
    Input { positions, indices, ..Input::new(mesh) }.packed(&charts.of_triangle, Some(&uvs), (page, 0.0))
}
