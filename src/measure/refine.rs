//! Meshes refined for their media: edges split until what is drawn between vertices is near to what is there.

use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;

use glam::Vec3;

use super::between_vertices::{TOO_COARSE, between_vertices, too_coarse};
use crate::error::{Error, Result};
use crate::geometry::edge_split::{Split, split_long_edges};
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::geometry::source::CornerAttribute;
use crate::math::statistics::VertexError;
use crate::progress::{Progress, Silent, stage};
use crate::render::normals::ShadingNormals;
use crate::scene::Scene;

/// What a refinement aims at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// Error between the vertices.
    pub rms: f64,
    /// Triangles that are made for it at most.
    pub most_triangles: usize,
}

impl Goal {
    /// Of [`Refine::Auto`].
    pub const BAKED: Self = Self { rms: 0.02, most_triangles: 1 << 20 };

    /// Of frames, which wait for light at every vertex: what a mesh is accepted with.
    pub const SHOWN: Self = Self { rms: TOO_COARSE, most_triangles: 1 << 16 };
}

/// Triangles of a scene with edges of an asked length.
const MOST_ASKED: usize = 1 << 22;

/// Coarsest and finest edges that are tried, in halves of halvings of the diffusion length.
const COARSEST: i32 = -8;
const FINEST: i32 = 24;

/// A finer mesh is worth its triangles where the error is smaller than this share of what it was.
const WORTH: f64 = 0.9;

/// Whether and how far a mesh is refined.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Refine {
    /// The mesh of the source.
    #[default]
    Off,
    /// As far as the error between vertices asks for, where it is above [`super::between_vertices::TOO_COARSE`].
    Auto,
    /// Edges of translucent parts of at most this length, mm.
    EdgesMm(f64),
}

impl FromStr for Refine {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "off" => Ok(Self::Off),
            "auto" => Ok(Self::Auto),
            length => match length.parse() {
                Ok(mm) if f64::is_finite(mm) && mm > 0.0 => Ok(Self::EdgesMm(mm)),
                _ => Err("auto, off or a length above 0 in mm is needed".to_owned()),
            },
        }
    }
}

impl fmt::Display for Refine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Auto => f.write_str("auto"),
            Self::EdgesMm(mm) => write!(f, "{mm}"),
        }
    }
}

/// A refined scene: the same surface, parts and media; the vertices of the coarse one come first, in their order.
#[derive(Clone, Debug)]
pub struct RefinedScene {
    /// The scene.
    pub scene: Scene,
    /// The triangle of the coarse mesh that each triangle is a piece of.
    pub of_triangle: Vec<u32>,
    /// Longest edge of translucent parts that was left, mm; the shortest of the parts' where they differ.
    pub longest_mm: f64,
    /// Error between the vertices, before and after; only measured under [`Refine::Auto`].
    pub error: Option<[VertexError; 2]>,
}

impl RefinedScene {
    /// Whether more triangles than are made would be needed for what [`Refine::Auto`] aims at.
    pub fn is_short(&self) -> bool {
        self.error.is_some_and(|[_, after]| after.rms > Goal::BAKED.rms)
    }

    fn is_finer_than(&self, scene: &Scene) -> bool {
        self.scene.mesh.triangles.len() > scene.mesh.triangles.len()
    }
}

/// Refines a scene; none where nothing is to be split.
///
/// # Errors
/// Command line: a length for which more triangles would be needed than are allowed. Failures of the measurement.
pub fn refine(scene: &Scene, how: Refine, progress: &dyn Progress) -> Result<Option<RefinedScene>> {
    match how {
        Refine::Off => Ok(None),
        Refine::EdgesMm(mm) => stage(progress, "refine", || to_length(scene, mm)),
        Refine::Auto => refine_until(scene, Goal::BAKED, progress),
    }
}

/// Refines a scene that is too coarse as far as the goal asks for; none where it is not too coarse.
///
/// # Errors
/// Failures of the measurement.
pub fn refine_until(scene: &Scene, goal: Goal, progress: &dyn Progress) -> Result<Option<RefinedScene>> {
    match too_coarse(scene, None, progress)? {
        None => Ok(None),
        Some(before) => stage(progress, "refine", || as_needed(scene, before, goal)),
    }
}

fn to_length(scene: &Scene, mm: f64) -> Result<Option<RefinedScene>> {
    let (fine, of_triangle) = finer(scene, |_| mm, MOST_ASKED).ok_or_else(|| {
        Error::command_line(format!(
            "--refine {mm}: edges of that length are more than {MOST_ASKED} triangles; the object is {:.3} mm across",
            scene.mesh.diagonal_mm()
        ))
    })?;
    let refined = RefinedScene { scene: fine, of_triangle, longest_mm: mm, error: None };
    Ok(Some(refined).filter(|refined| refined.is_finer_than(scene)))
}

/// The coarsest scene whose error is good; where none is, the coarsest of those that are hardly worse than the best.
fn as_needed(
    scene: &Scene,
    before: VertexError,
    Goal { rms: good, most_triangles }: Goal,
) -> Result<Option<RefinedScene>> {
    let diffusion_mm: Vec<f64> =
        scene.media.iter().map(|medium| medium.properties.diffusion_length_mm().min_element()).collect();
    let shortest_mm = diffusion_mm.iter().copied().fold(f64::INFINITY, f64::min);
    let at = |rung: i32| -> Result<Option<RefinedScene>> {
        let factor = (-0.5 * f64::from(rung)).exp2();
        let length = |medium: u32| diffusion_mm.get(medium as usize).map_or(f64::INFINITY, |mm| factor * mm);
        let Some((fine, of_triangle)) = finer(scene, length, most_triangles) else { return Ok(None) };
        let mut refined =
            RefinedScene { scene: fine, of_triangle, longest_mm: factor * shortest_mm, error: Some([before; 2]) };
        if refined.is_finer_than(scene) {
            refined.error = Some([before, between_vertices(&refined.scene, &Silent)?]);
        }
        Ok(Some(refined))
    };
    let rms = |refined: &RefinedScene| refined.error.map_or(0.0, |[_, after]| after.rms);
    let mut best: Option<RefinedScene> = None;
    let mut rung = 0;
    while let Some(found) = (rung <= FINEST).then(|| at(rung)).transpose()?.flatten() {
        let is_good = rms(&found) <= good;
        if best.as_ref().is_none_or(|best| is_good || rms(&found) < WORTH * rms(best)) {
            best = Some(found);
        }
        if is_good {
            break;
        }
        rung += 1;
    }
    // The diffusion length itself may be finer than what is needed, or more triangles than are allowed.
    while let Some(coarser) = (rung <= 0 && rung > COARSEST).then(|| at(rung - 1)).transpose()?.flatten() {
        if best.is_some() && rms(&coarser) > good {
            break;
        }
        best = Some(coarser);
        rung -= 1;
    }
    Ok(best.filter(|best| best.is_finer_than(scene)))
}

/// A scene whose translucent triangles have edges of at most the length for their medium, and the triangle that each of its triangles is a
/// piece of; none beyond `most` triangles.
fn finer(scene: &Scene, longest_mm: impl Fn(u32) -> f64, most: usize) -> Option<(Scene, Vec<u32>)> {
    let medium = |t: usize| {
        let part = *scene.parts.triangle_part.get(t)?;
        scene.parts.parts.get(part as usize)?.medium
    };
    let longest: Vec<f64> =
        (0..scene.mesh.triangles.len()).map(|t| medium(t).map_or(f64::INFINITY, &longest_mm)).collect();
    // No triangle of such edges is larger than the equilateral one, so that many lengths are refused before the work.
    let largest_mm2 = |length: f64| 0.25 * 3f64.sqrt() * length * length;
    let least: f64 = longest.iter().zip(0..).map(|(&length, t)| scene.mesh.area_mm2(t) / largest_mm2(length)).sum();
    if least > most as f64 {
        return None;
    }
    let Split { mesh, of_triangle } = split_long_edges(&with_shown_normals(scene), &longest, most)?;
    let part = |t: &u32| scene.parts.triangle_part.get(*t as usize).copied().unwrap_or(u32::MAX);
    let entries = scene.parts.parts.iter().map(|part| (part.name.clone(), part.medium)).collect();
    let parts = PartTable::new(&mesh, of_triangle.iter().map(part).collect(), entries);
    Some((Scene { mesh, parts, media: scene.media.clone() }, of_triangle))
}

/// The mesh with the normals that pictures show: smooth ones are made of the triangles around a vertex, which are others once they are
/// split, so that what was round would show its facets.
fn with_shown_normals(scene: &Scene) -> Mesh {
    let normals = ShadingNormals::new(scene);
    let (mut values, mut known) = (Vec::new(), HashMap::new());
    let mut index = |normal: Vec3| {
        *known.entry(normal.to_array().map(f32::to_bits)).or_insert_with(|| {
            values.push(normal);
            values.len() as u32 - 1
        })
    };
    let corners = (0..scene.mesh.triangles.len() as u32).map(|t| normals.at_corners(t).map(&mut index)).collect();
    let normals = Some(CornerAttribute { values, corners });
    Mesh { normals, ..scene.mesh.clone() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::HashSet;

    use glam::DVec3;

    use super::*;
    use crate::geometry::mesh::{Placement, Scale};
    use crate::geometry::part_table::PartEntry;
    use crate::geometry::shapes::{compose, cuboid, icosphere};
    use crate::geometry::source::SourceModel;
    use crate::import::materials::MaterialChoice;
    use crate::import::{ImportOptions, Source};
    use crate::medium::material::{Medium, preset};

    fn scene(model: SourceModel) -> Scene {
        let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
        let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".to_owned(), Some(0))]);
        let media = vec![Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() }];
        Scene { mesh, parts, media }
    }

    #[test]
    fn a_cube_is_refined_until_it_is_right_between_its_vertices_and_a_fine_ball_is_left() {
        let cube = scene(cuboid(DVec3::splat(20.0), 1));
        let fine = refine(&cube, Refine::Auto, &Silent).unwrap().unwrap();
        let [before, after] = fine.error.unwrap();
        let Scene { mesh, parts, .. } = &fine.scene;
        println!("edges of {:.2} mm, {} triangles: {before:?}, {after:?}", fine.longest_mm, mesh.triangles.len());
        assert!(before.rms > 0.3 && after.rms <= Goal::BAKED.rms, "{before:?} {after:?}");
        assert_eq!(mesh.local_mm[..8], cube.mesh.local_mm[..]);
        assert!((parts.parts[0].area_mm2 / cube.parts.parts[0].area_mm2 - 1.0).abs() < 1e-6);
        // Sharp edges stay sharp.
        let normals = ShadingNormals::new(&fine.scene);
        for t in 0..mesh.triangles.len() as u32 {
            assert!(normals.at(t, [0.2, 0.3, 0.5]).dot(mesh.normal(t)) > 1.0 - 1e-6);
        }
        // What is refined needs no more.
        assert!(refine(&fine.scene, Refine::Auto, &Silent).unwrap().is_none());
        let ball = scene(icosphere(10.0, 5));
        assert!(refine(&ball, Refine::Auto, &Silent).unwrap().is_none());
        assert!(refine(&ball, Refine::Off, &Silent).unwrap().is_none());
    }

    #[test]
    fn holes_stay_as_they_are_and_what_the_import_turned_round_stays_turned() {
        let mut model = cuboid(DVec3::splat(20.0), 2);
        model.triangles.remove(5);
        model.triangle_material.remove(5);
        model.triangles[20].swap(0, 1);
        let materials = MaterialChoice { texts: vec!["marble".to_owned()], ..MaterialChoice::default() };
        let scale = Some(Scale::MillimetresPerUnit(1.0));
        let options = ImportOptions { materials, scale, ..ImportOptions::default() };
        let coarse = Source { model, inputs: Vec::new() }.import(&options, &Silent).unwrap().scene;
        let fine = refine(&coarse, Refine::EdgesMm(1.7), &Silent).unwrap().unwrap().scene;
        // Directed edges without one in the other direction, and their length.
        let border = |mesh: &Mesh| {
            let all: Vec<[u32; 2]> = (0..mesh.triangles.len() as u32)
                .flat_map(|t| {
                    let [a, b, c] = mesh.welded(t);
                    [[a, b], [b, c], [c, a]]
                })
                .collect();
            let known: HashSet<[u32; 2]> = all.iter().copied().collect();
            assert_eq!(known.len(), all.len(), "an edge is run along twice in one direction");
            let single = all.iter().filter(|[a, b]| !known.contains(&[*b, *a]));
            single.map(|[a, b]| mesh.position_mm(*a).distance(mesh.position_mm(*b))).sum::<f64>()
        };
        let [before, after] = [&coarse.mesh, &fine.mesh].map(border);
        assert!((before - (20.0 + 200f64.sqrt())).abs() < 1e-4 && (after - before).abs() < 1e-4, "{before} {after}");
        let area = |scene: &Scene| scene.parts.parts[0].area_mm2;
        assert!((area(&fine) / area(&coarse) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn opaque_parts_are_cut_only_where_they_touch() {
        let slab = SourceModel { materials: vec!["stand".to_owned()], ..cuboid(DVec3::splat(8.0), 1) };
        let ball = SourceModel { materials: vec!["ball".to_owned()], ..icosphere(4.0, 0) };
        let model = compose(&[(ball, DVec3::new(0.0, 20.0, 0.0)), (slab, DVec3::ZERO)]);
        let materials = MaterialChoice { texts: vec!["marble".to_owned()], ..MaterialChoice::default() };
        let scale = Some(Scale::MillimetresPerUnit(1.0));
        let opaque = vec!["stand".to_owned()];
        let options = ImportOptions { materials, scale, opaque, ..ImportOptions::default() };
        let coarse = Source { model, inputs: Vec::new() }.import(&options, &Silent).unwrap().scene;
        let fine = refine(&coarse, Refine::EdgesMm(1.0), &Silent).unwrap().unwrap().scene;
        let counts = |scene: &Scene| {
            let of = |part: &&PartEntry| !part.transfers();
            (scene.parts.parts.iter().find(of).unwrap().triangle_count, scene.mesh.triangles.len())
        };
        assert_eq!((counts(&coarse).0, counts(&fine).0), (12, 12));
        assert!(counts(&fine).1 > 500);
    }

    #[test]
    fn round_bodies_keep_their_round_normals() {
        let ball = scene(icosphere(10.0, 1));
        let fine = refine(&ball, Refine::EdgesMm(2.0), &Silent).unwrap().unwrap();
        let normals = ShadingNormals::new(&fine.scene);
        for t in 0..fine.scene.mesh.triangles.len() as u32 {
            let centre = fine.scene.mesh.corners_local_mm(t).iter().sum::<DVec3>().normalize();
            assert!(normals.at(t, [1.0 / 3.0; 3]).dot(centre) > 0.99);
        }
    }

    #[test]
    fn lengths_are_kept_and_too_short_ones_refused() {
        let cube = scene(cuboid(DVec3::splat(20.0), 1));
        assert!(refine(&cube, Refine::EdgesMm(30.0), &Silent).unwrap().is_none());
        let fine = refine(&cube, Refine::EdgesMm(3.0), &Silent).unwrap().unwrap();
        assert_eq!((fine.longest_mm, fine.error), (3.0, None));
        assert!(refine(&cube, Refine::EdgesMm(1e-3), &Silent).unwrap_err().message().contains("--refine 0.001"));
        for (text, expected) in [("off", Refine::Off), ("auto", Refine::Auto), ("0.5", Refine::EdgesMm(0.5))] {
            assert_eq!((text.parse(), expected.to_string()), (Ok(expected), text.to_owned()));
        }
        for text in ["0", "-1", "inf", "nan", "", "fine"] {
            assert!(text.parse::<Refine>().is_err(), "{text}");
        }
    }
}
