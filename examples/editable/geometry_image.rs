//! Geometry images (Gu, Gortler and Hoppe 2002): a surface resampled on a square grid, whose neighbours are neighbours on the surface.
//!
//! Here of closed shapes that are near a ball, by the octahedral map of directions: of each texel, the outermost point of the surface
//! that its direction from the middle of the bounding box meets. What lies behind it (folds, handles) is bridged: the result is the
//! star-shaped hull as seen from there, on which every method can be compared with and without the grid.

use glam::DVec3;

use translux::geometry::bvh::{Bvh, Ray};
use translux::geometry::mesh::Mesh;
use translux::geometry::source::SourceModel;

/// The direction in the middle of a texel of the octahedral map: +z in the middle of the square, -z at its corners.
fn direction(side: usize, x: usize, y: usize) -> DVec3 {
    let at = |i: usize| (2 * i + 1) as f64 / side as f64 - 1.0;
    let (u, v) = (at(x), at(y));
    let z = 1.0 - u.abs() - v.abs();
    let fold = |a: f64, b: f64| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
    DVec3::new(fold(u, v), fold(v, u), z).normalize()
}

/// A grid of `side * side` vertices (3 x 3 at least), row by row, made into a closed surface: texels at the edge of the square meet those on the
/// other half of that edge, where it is folded. `point` gives the vertex of a direction.
fn octahedral(side: usize, point: impl Fn(DVec3) -> DVec3) -> SourceModel {
    let side = side.max(3);
    let positions = (0..side * side).map(|i| point(direction(side, i % side, i / side))).collect();
    let at = |x: usize, y: usize| (y * side + x) as u32;
    let mut triangles = Vec::new();
    let mut quad = |[a, b, c, d]: [u32; 4]| {
        triangles.extend([[a, b, c], [a, c, d]].into_iter().filter(|[a, b, c]| a != b && b != c && c != a));
    };
    for y in 0..side - 1 {
        for x in 0..side - 1 {
            quad([at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    let last = side - 1;
    // Pairs of neighbours of an edge and the pair that they meet; in the middle of the edge a pair meets itself.
    for i in 0..(side - 1) / 2 {
        let j = last - i;
        quad([at(i + 1, 0), at(i, 0), at(j, 0), at(j - 1, 0)]);
        quad([at(i, last), at(i + 1, last), at(j - 1, last), at(j, last)]);
        quad([at(0, i), at(0, i + 1), at(0, j - 1), at(0, j)]);
        quad([at(last, i + 1), at(last, i), at(last, j), at(last, j - 1)]);
    }
    // The corners are one point of the map.
    quad([at(0, 0), at(0, last), at(last, last), at(last, 0)]);
    SourceModel::new(positions, triangles)
}

/// The geometry image of a mesh around the middle of its bounding box; the middle where a direction meets nothing.
pub(crate) fn of_mesh(mesh: &Mesh, bvh: &Bvh, side: usize) -> SourceModel {
    let [low, high] = mesh.bounds_local_mm();
    let (middle, far) = (0.5 * (low + high), (high - low).length().max(f64::MIN_POSITIVE));
    octahedral(side, |direction| {
        let from = (middle + far * direction).as_vec3();
        let hit = bvh.closest(&Ray { t_max: far as f32, ..Ray::new(from, (-direction).as_vec3()) });
        let at = hit.map_or(middle, |hit| from.as_dvec3() - f64::from(hit.t) * direction);
        mesh.origin_mm + at
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use translux::geometry::mesh::Placement;
    use translux::geometry::shapes;

    /// Where a vertex is on the grid, for checks.
    fn vertex(side: usize, direction: DVec3) -> usize {
        let d = direction / direction.abs().element_sum();
        let fold = |a: f64, b: f64| if d.z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
        let texel = |a: f64| (((a + 1.0) * 0.5 * side as f64) as usize).min(side - 1);
        texel(fold(d.y, d.x)) * side + texel(fold(d.x, d.y))
    }

    #[test]
    fn directions_are_units_and_find_their_texel() {
        for side in [2, 5, 16] {
            for i in 0..side * side {
                let direction = direction(side, i % side, i / side);
                assert!((direction.length() - 1.0).abs() < 1e-14);
                assert_eq!(vertex(side, direction), i, "{side}");
            }
        }
    }

    /// Every edge has two triangles that run along it in opposite directions, and one piece has Euler's 2.
    #[test]
    fn the_surface_is_closed_and_faces_outwards() {
        for side in [3, 4, 9, 16] {
            let source = octahedral(side, |direction| 10.0 * direction);
            let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
            for [a, b, c] in &source.triangles {
                for edge in [(*a, *b), (*b, *c), (*c, *a)] {
                    *edges.entry(edge).or_default() += 1;
                }
            }
            assert!(edges.iter().all(|((a, b), n)| *n == 1 && edges.get(&(*b, *a)) == Some(&1)), "{side}");
            let euler = source.positions.len() as i64 - edges.len() as i64 / 2 + source.triangles.len() as i64;
            assert_eq!(euler, 2, "{side}");
            let at = |i: u32| source.positions[i as usize];
            let volume: f64 = source.triangles.iter().map(|[a, b, c]| at(*a).cross(at(*b)).dot(at(*c)) / 6.0).sum();
            let ball = 4000.0 / 3.0 * std::f64::consts::PI;
            assert!(volume > 0.2 * ball && volume < ball, "{side}: {volume}");
            assert!(side < 16 || volume > 0.95 * ball, "{volume}");
        }
    }

    #[test]
    fn the_image_of_a_mesh_lies_on_it() {
        let (mesh, _) = Mesh::from_source(shapes::icosphere(7.0, 4), &Placement { mm_per_unit: 1.0 }).unwrap();
        let image = of_mesh(&mesh, &Bvh::new(&mesh), 12);
        assert!(image.positions.iter().all(|p| (p.length() - 7.0).abs() < 0.02));
    }
}
