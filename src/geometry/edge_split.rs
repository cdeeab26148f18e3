//! Meshes with shorter edges: long ones are split in their middles until none is left, and the surface stays where it is.
//!
//! Whether an edge is split depends on the edge alone, so that both of its triangles split it and no vertex comes to lie on the side of a
//! triangle.

use std::collections::{HashMap, HashSet};

use glam::{Vec2, Vec3};

use super::mesh::Mesh;
use super::source::CornerAttribute;

/// A mesh whose edges were split.
#[derive(Clone, Debug)]
pub struct Split {
    /// The finer mesh: the vertices of the coarse one in their order, then the new ones.
    pub mesh: Mesh,
    /// The triangle of the coarse mesh that each triangle is a piece of, in ascending order.
    pub of_triangle: Vec<u32>,
}

/// Splits every edge that is longer than what a triangle at it puts up with, `longest_mm` of each triangle; infinite ones are split where
/// their neighbours are. None where more than `most` triangles would be needed.
///
/// Texture coordinates and normals are those of the coarse mesh at each place. Edges that single precision cannot split are left.
pub fn split_long_edges(mesh: &Mesh, longest_mm: &[f64], most: usize) -> Option<Split> {
    let of_triangle = (0..mesh.triangles.len() as u32).collect();
    let mut split = Split { mesh: mesh.clone(), of_triangle };
    loop {
        let long = long_edges(&split, longest_mm);
        if long.is_empty() {
            return Some(split);
        }
        // Each side that is split adds a piece. Counted before anything is made, so that what is refused takes no memory.
        if pieces_of(&split.mesh, &long) > most {
            return None;
        }
        split = once(&split, &long);
    }
}

fn pieces_of(mesh: &Mesh, long: &HashSet<Edge>) -> usize {
    let sides = |t: u32| {
        let [a, b, c] = mesh.welded(t);
        [edge(a, b), edge(b, c), edge(c, a)].iter().filter(|side| long.contains(*side)).count()
    };
    (0..mesh.triangles.len() as u32).map(|t| 1 + sides(t)).sum()
}

/// Welded vertices of an edge, the smaller first.
type Edge = [u32; 2];

fn edge<T: Ord>(a: T, b: T) -> [T; 2] {
    if a < b { [a, b] } else { [b, a] }
}

fn long_edges(Split { mesh, of_triangle }: &Split, longest_mm: &[f64]) -> HashSet<Edge> {
    let mut long = HashSet::new();
    for ((triangle, of), index) in mesh.triangles.iter().zip(of_triangle).zip(0..) {
        let most = longest_mm.get(*of as usize).copied().unwrap_or(f64::INFINITY);
        let (welded, places) = (mesh.welded(index), triangle.map(|v| mesh.local_mm[v as usize]));
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (p, q) = (places[a], places[b]);
            let middle = halfway(p, q);
            if p.as_dvec3().distance(q.as_dvec3()) > most && middle != p && middle != q {
                long.insert(edge(welded[a], welded[b]));
            }
        }
    }
    long
}

fn halfway(p: Vec3, q: Vec3) -> Vec3 {
    (0.5 * (p.as_dvec3() + q.as_dvec3())).as_vec3()
}

/// Splits each of these edges once.
fn once(Split { mesh, of_triangle }: &Split, long: &HashSet<Edge>) -> Split {
    let mut fine = Mesh { triangles: Vec::new(), triangle_material: Vec::new(), ..mesh.clone() };
    let mut from = Vec::new();
    // Vertices at one place, as at the two sides of a seam, have middles of their own there, welded to the first of them.
    let (mut middles, mut welds) = (HashMap::new(), HashMap::new());
    let mut normals = Values::new(mesh.normals.as_ref(), |a: Vec3, b: Vec3| (a + b).normalize_or_zero());
    let mut uvs = Values::new(mesh.uvs.as_ref(), |a: Vec2, b: Vec2| 0.5 * (a + b));
    for ((t, corners), of) in (0..).zip(&mesh.triangles).zip(of_triangle) {
        let welded = mesh.welded(t);
        let mut middle = |a: usize, b: usize| {
            let places = edge(welded[a], welded[b]);
            if !long.contains(&places) {
                return None;
            }
            let [p, q] = edge(corners[a], corners[b]);
            let next = fine.local_mm.len() as u32;
            let vertex = *middles.entry([p, q]).or_insert(next);
            if vertex == next {
                let at = halfway(fine.local_mm[p as usize], fine.local_mm[q as usize]);
                fine.local_mm.push(at);
                fine.weld.push(*welds.entry(places).or_insert(next));
            }
            Some(vertex)
        };
        let split = [middle(0, 1), middle(1, 2), middle(2, 0)];
        // Corners and middles of the sides that start at them.
        let [p, q, r] = [0, 1, 2].map(|k| mesh.local_mm[corners[k] as usize].as_dvec3());
        let shapes = pieces(split.map(|middle| middle.is_some()), |from, to| {
            let place = |point: Point| match point {
                Point::Corner(k) => [p, q, r][k],
                Point::Middle(k) => 0.5 * ([p, q, r][k] + [q, r, p][k]),
            };
            place(from).distance_squared(place(to))
        });
        let vertex = |point: Point| match point {
            Point::Corner(k) => corners[k],
            // Only middles that are there are named.
            Point::Middle(k) => split[k].unwrap_or(corners[k]),
        };
        for shape in shapes {
            fine.triangles.push(shape.map(vertex));
            fine.triangle_material.push(mesh.triangle_material.get(t as usize).copied().unwrap_or_default());
            from.push(*of);
            normals.push(t as usize, shape);
            uvs.push(t as usize, shape);
        }
    }
    fine.normals = normals.done();
    fine.uvs = uvs.done();
    Split { mesh: fine, of_triangle: from }
}

/// A corner of a triangle, or the middle of the side from that corner to the next.
#[derive(Clone, Copy)]
enum Point {
    Corner(usize),
    Middle(usize),
}

/// The pieces of a triangle of which these sides are split, wound as it is. Of the two ways to cut what is left by two sides, the one with
/// the shorter cut is taken.
fn pieces(split: [bool; 3], distance2: impl Fn(Point, Point) -> f64) -> Vec<[Point; 3]> {
    use Point::{Corner, Middle};
    let count = split.iter().filter(|split| **split).count();
    // The first side: the one that is split, or the first of the two.
    let first = (0..3).find(|&k| match count {
        1 => split[k],
        2 => split[k] && split[(k + 1) % 3],
        _ => true,
    });
    let k = first.unwrap_or_default();
    let (a, b, c) = (k, (k + 1) % 3, (k + 2) % 3);
    match count {
        0 => vec![[Corner(0), Corner(1), Corner(2)]],
        1 => vec![[Corner(a), Middle(a), Corner(c)], [Middle(a), Corner(b), Corner(c)]],
        2 => {
            let tip = [Middle(a), Corner(b), Middle(b)];
            if distance2(Corner(a), Middle(b)) < distance2(Middle(a), Corner(c)) {
                vec![tip, [Corner(a), Middle(a), Middle(b)], [Corner(a), Middle(b), Corner(c)]]
            } else {
                vec![tip, [Corner(a), Middle(a), Corner(c)], [Middle(a), Middle(b), Corner(c)]]
            }
        }
        _ => vec![
            [Corner(0), Middle(0), Middle(2)],
            [Middle(0), Corner(1), Middle(1)],
            [Middle(2), Middle(1), Corner(2)],
            [Middle(0), Middle(1), Middle(2)],
        ],
    }
}

/// An attribute while triangles are cut.
struct Values<'a, T, F> {
    coarse: Option<&'a CornerAttribute<T>>,
    fine: CornerAttribute<T>,
    known: HashMap<[u32; 2], u32>,
    mean: F,
}

impl<'a, T: Copy + Default, F: Fn(T, T) -> T> Values<'a, T, F> {
    fn new(coarse: Option<&'a CornerAttribute<T>>, mean: F) -> Self {
        let values = coarse.map_or_else(Vec::new, |coarse| coarse.values.clone());
        Self { coarse, fine: CornerAttribute { values, corners: Vec::new() }, known: HashMap::new(), mean }
    }

    /// The values of a piece of a triangle.
    fn push(&mut self, triangle: usize, piece: [Point; 3]) {
        let Some(coarse) = self.coarse else { return };
        let of = coarse.corners.get(triangle).copied().unwrap_or_default();
        let corners = piece.map(|point| match point {
            Point::Corner(k) => of[k],
            Point::Middle(k) => self.between(of[k], of[(k + 1) % 3]),
        });
        self.fine.corners.push(corners);
    }

    fn between(&mut self, a: u32, b: u32) -> u32 {
        if a == b {
            return a;
        }
        let values = &mut self.fine.values;
        *self.known.entry(edge(a, b)).or_insert_with(|| {
            let [a, b] = [a, b].map(|v| values.get(v as usize).copied().unwrap_or_default());
            values.push((self.mean)(a, b));
            values.len() as u32 - 1
        })
    }

    fn done(self) -> Option<CornerAttribute<T>> {
        self.coarse.map(|_| self.fine)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::mesh::EdgeTable;
    use crate::geometry::shapes::{cuboid, icosphere, plane};
    use crate::geometry::source::SourceModel;
    use crate::geometry::test_data::mesh_of;
    use glam::DVec3;

    fn volume(mesh: &Mesh) -> f64 {
        let of = |t: u32| {
            let [a, b, c] = mesh.corners_local_mm(t);
            a.dot(b.cross(c)) / 6.0
        };
        (0..mesh.triangles.len() as u32).map(of).sum()
    }

    fn longest(mesh: &Mesh) -> f64 {
        let of = |t: u32| {
            let [a, b, c] = mesh.corners_local_mm(t);
            a.distance(b).max(b.distance(c)).max(c.distance(a))
        };
        (0..mesh.triangles.len() as u32).map(of).fold(0.0, f64::max)
    }

    /// Edges by their number of triangles: with one, with two, with more.
    fn valences(mesh: &Mesh) -> [usize; 3] {
        let mut counts = [0; 3];
        EdgeTable::new(mesh).edges().for_each(|edge| counts[edge.valence().clamp(1, 3) - 1] += 1);
        counts
    }

    fn all(mesh: &Mesh, longest_mm: f64) -> Split {
        split_long_edges(mesh, &vec![longest_mm; mesh.triangles.len()], 1 << 20).unwrap()
    }

    #[test]
    fn closed_bodies_stay_closed_with_their_area_volume_and_first_vertices() {
        for (model, size) in [
            (cuboid(DVec3::new(20.0, 3.0, 7.0), 1), 1.3),
            (icosphere(5.0, 1), 0.7),
            (cuboid(DVec3::new(50.0, 0.1, 0.2), 1), 2.0),
        ] {
            let (mesh, _) = mesh_of(model);
            let fine = all(&mesh, size).mesh;
            assert!(longest(&fine) <= size && fine.triangles.len() > mesh.triangles.len());
            assert_eq!(valences(&fine)[0] + valences(&fine)[2], 0, "closed");
            assert_eq!(fine.local_mm[..mesh.local_mm.len()], mesh.local_mm[..]);
            assert!((fine.total_area_mm2() / mesh.total_area_mm2() - 1.0).abs() < 1e-5);
            assert!((volume(&fine) / volume(&mesh) - 1.0).abs() < 1e-5);
            assert_eq!(fine.weld.len(), fine.local_mm.len());
            assert_eq!(fine.triangle_material.len(), fine.triangles.len());
        }
    }

    #[test]
    fn only_triangles_that_ask_for_it_and_their_neighbours_are_cut() {
        let (mesh, _) = mesh_of(icosphere(5.0, 2));
        let mut asked = vec![f64::INFINITY; mesh.triangles.len()];
        asked[7] = 0.2;
        let split = split_long_edges(&mesh, &asked, 1 << 20).unwrap();
        assert_eq!(valences(&split.mesh)[0] + valences(&split.mesh)[2], 0);
        let counts = split.of_triangle.iter().fold(HashMap::new(), |mut counts, t| {
            *counts.entry(*t).or_insert(0) += 1;
            counts
        });
        assert_eq!(counts.len(), mesh.triangles.len());
        assert_eq!(counts.values().filter(|count| **count > 1).count(), 4, "the triangle and its three neighbours");
        // Every piece lies in the plane of its triangle, and faces as it does.
        for (piece, of) in (0..).zip(&split.of_triangle) {
            assert!(split.mesh.normal(piece).dot(mesh.normal(*of)) > 0.999);
        }
    }

    #[test]
    fn nothing_changes_where_nothing_is_long_and_too_much_is_refused() {
        let (mesh, _) = mesh_of(icosphere(5.0, 3));
        assert_eq!(all(&mesh, 100.0).mesh, mesh);
        assert!(split_long_edges(&mesh, &vec![1e-3; mesh.triangles.len()], 10_000).is_none());
        // Single precision ends before the asked length is reached.
        let (tiny, _) = mesh_of(plane(1.0, 1.0, 1));
        assert!(split_long_edges(&tiny, &[0.0; 2], 10_000).is_none());
    }

    #[test]
    fn seams_have_vertices_of_their_own_on_both_sides_and_borders_and_books_stay() {
        // Two triangles at one edge, whose ends are vertices of their own for each.
        let positions = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X, DVec3::ZERO, -DVec3::Y].map(|p| 4.0 * p);
        let mut model = SourceModel::new(positions.to_vec(), vec![[0, 1, 2], [3, 4, 5]]);
        let uv = |k: usize| Vec2::new(k as f32, 0.5 * k as f32);
        model.uvs = Some(CornerAttribute { values: (0..6).map(uv).collect(), corners: vec![[0, 1, 2], [3, 4, 5]] });
        let (mesh, _) = mesh_of(model);
        let fine = all(&mesh, 3.0).mesh;
        assert_eq!(valences(&mesh)[1], 1);
        // The edge of the seam is two edges now, each with two triangles.
        let on_seam = |v: u32| fine.local_mm[v as usize].y == fine.local_mm[0].y;
        let seam: Vec<_> = EdgeTable::new(&fine)
            .edges()
            .filter(|edge| edge.vertices.iter().all(|v| on_seam(*v)))
            .map(|edge| edge.valence())
            .collect();
        assert_eq!(seam, [2, 2]);
        let uvs = fine.uvs.as_ref().unwrap();
        assert_eq!(uvs.corners.len(), fine.triangles.len());
        // Each place of a triangle has the coordinates that were there: u is linear over each.
        for (corners, of) in fine.triangles.iter().zip(&uvs.corners) {
            for (vertex, uv) in corners.iter().zip(of) {
                let (at, uv) = (fine.position_mm(*vertex) / 4.0, uvs.values[*uv as usize]);
                let expected = if at.y > 0.0 || uv.x < 2.5 { at.x + 2.0 * at.y } else { 4.0 - at.x - at.y };
                assert!((f64::from(uv.x) - expected).abs() < 1e-6, "{at} {uv}");
            }
        }
        // Three sheets at one edge.
        let apexes = [DVec3::X, DVec3::Y, DVec3::NEG_X];
        let positions: Vec<DVec3> = [DVec3::ZERO, DVec3::Z].into_iter().chain(apexes).collect();
        let (book, _) = mesh_of(SourceModel::new(positions, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]));
        let fine = all(&book, 0.3).mesh;
        assert!((fine.total_area_mm2() - book.total_area_mm2()).abs() < 1e-6);
        assert_eq!(valences(&fine)[2], 4);
    }
}
