//! Delaunay triangulation of directions: the convex hull of points on the unit sphere.
//!
//! The hull grows point by point in a shuffled order that depends on nothing but the number of points. A point within
//! 1e-12 of a face's plane does not see it, so points on one circle give some triangulation of their polygon instead of
//! a failure. Points that cannot be triangulated over the whole sphere (all in a half space, two that coincide) are an
//! error.

use std::f64::consts::TAU;

use glam::DVec3;

use super::cube_map::{FACES, direction as texel_direction, texel_of};
use super::random;
use crate::error::{Error, Result};

/// Most points of a triangulation.
pub const MOST_POINTS: usize = 1 << 14;

/// Distances from a plane below this count as rounding, in units of the sphere's radius.
const COPLANAR: f64 = 1e-12;

/// Largest deviation of a point's length from 1.
const UNIT_TOLERANCE: f64 = 1e-9;

/// Stage of the counter-based random numbers that shuffle the points.
const SHUFFLE: u64 = 0x5b6e_21c4;

/// No face.
const NONE: u32 = u32::MAX;

/// Spherical Delaunay triangulation of a set of directions that covers the sphere.
#[derive(Clone, Debug, PartialEq)]
pub struct SphericalDelaunay {
    points: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// For every triangle the one across the edge from corner k to corner k + 1.
    neighbours: Vec<[u32; 3]>,
    covering_radius: f64,
    /// Texels along an edge of the cube map `starts`.
    side: usize,
    /// A triangle at or near the centre of every texel, where a walk starts.
    starts: Vec<u32>,
}

/// Location of a direction in the triangulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// Index of the triangle.
    pub triangle: usize,
    /// Planar barycentric coordinates of the direction's central projection, none negative, summing to 1.
    pub barycentric: [f64; 3],
}

impl SphericalDelaunay {
    /// Triangulates `points`, unit vectors.
    ///
    /// # Errors
    /// Fewer than 4 or more than [`MOST_POINTS`] points, one that is not a unit vector, two that coincide, points that all lie
    /// in one half space or in a plane (exit 3).
    pub fn new(points: Vec<DVec3>) -> Result<Self> {
        check(&points)?;
        let mut hull = Hull::new(&points)?;
        for index in shuffled(points.len()) {
            if !hull.simplex.contains(&index) {
                hull.insert(index)?;
            }
        }
        let (triangles, neighbours) = hull.finish()?;
        let mut covering_radius = 0.0_f64;
        for triangle in &triangles {
            let [a, b, c] = triangle.map(|i| points[i as usize]);
            let normal = (b - a).cross(c - a);
            if normal.dot(a) <= COPLANAR * normal.length() {
                return Err(Error::input(
                    "the directions leave a half of the sphere empty; a triangulation of the sphere needs them all around",
                ));
            }
            covering_radius = covering_radius.max(normal.cross(a).length().atan2(normal.dot(a)));
        }
        let mut side = 1;
        while 6 * side * side < points.len() / 2 {
            side *= 2;
        }
        let mut sphere = Self { points, triangles, neighbours, covering_radius, side, starts: Vec::new() };
        let mut at = 0;
        sphere.starts = (0..FACES * side * side)
            .map(|texel| {
                let (face, y, x) = (texel / (side * side), texel / side % side, texel % side);
                at = sphere.walk(at, texel_direction(side, face, x, y));
                at as u32
            })
            .collect();
        Ok(sphere)
    }

    /// The points as they were given.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Indices of the points of every triangle, counter-clockwise seen from outside; 2 n - 4 of them.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Largest angle in radians from any direction to the nearest point: the largest circumradius of a triangle.
    pub fn covering_radius(&self) -> f64 {
        self.covering_radius
    }

    /// The triangle that `direction` (any length) goes through. A vector without a direction counts as +Z.
    pub fn locate(&self, direction: DVec3) -> Location {
        let direction = unit(direction);
        let start = self.starts[texel_of(self.side, direction)];
        let triangle = self.walk(start as usize, direction);
        let sides = self.sides(triangle, direction).map(|s| s.max(0.0));
        let sum = sides[0] + sides[1] + sides[2];
        // Every side is positive in some triangle; a sum of zero would be a failure of rounding.
        if sum.is_nan() || sum <= 0.0 {
            return Location { triangle, barycentric: [1.0, 0.0, 0.0] };
        }
        // The corner across from the edge k, k + 1 is k + 2.
        let barycentric = [sides[1] / sum, sides[2] / sum, sides[0] / sum];
        Location { triangle, barycentric }
    }

    /// Signed distances of `direction` from the plane of every edge, positive inside, scaled by the edge.
    fn sides(&self, triangle: usize, direction: DVec3) -> [f64; 3] {
        let [a, b, c] = self.triangles[triangle].map(|i| self.points[i as usize]);
        [a.cross(b).dot(direction), b.cross(c).dot(direction), c.cross(a).dot(direction)]
    }

    /// Walks from the triangle `at` to the one that holds `direction`, across the edges that are most in the way.
    fn walk(&self, mut at: usize, direction: DVec3) -> usize {
        for _ in 0..self.triangles.len() {
            let sides = self.sides(at, direction);
            let edge = lowest(sides);
            if sides[edge] >= 0.0 {
                return at;
            }
            let next = self.neighbours[at][edge] as usize;
            // Rounding can send a direction on an edge to and fro.
            if sides[edge] > -COPLANAR && self.sides(next, direction).iter().all(|s| *s > -COPLANAR) {
                return at.min(next);
            }
            at = next;
        }
        let lowest_side = |t: usize| {
            let sides = self.sides(t, direction);
            sides[lowest(sides)]
        };
        (0..self.triangles.len()).fold(at, |best, t| if lowest_side(t) > lowest_side(best) { t } else { best })
    }
}

/// A direction of the uniform distribution over the sphere, random by key.
pub fn random_direction(stage: u64, index: u64) -> DVec3 {
    let (z, azimuth) = (1.0 - 2.0 * random::uniform(stage, index, 0), TAU * random::uniform(stage, index, 1));
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * azimuth.cos(), r * azimuth.sin(), z)
}

/// A unit vector along `direction`; +Z for the zero vector and vectors that are not finite.
pub fn unit(direction: DVec3) -> DVec3 {
    let largest = direction.abs().max_element();
    if direction.is_finite() && largest > 0.0 { (direction / largest).normalize() } else { DVec3::Z }
}

/// Index of the lowest of three numbers, the first of equal ones.
fn lowest(values: [f64; 3]) -> usize {
    let first = if values[1] < values[0] { 1 } else { 0 };
    if values[2] < values[first] { 2 } else { first }
}

fn check(points: &[DVec3]) -> Result<()> {
    if points.len() < 4 || points.len() > MOST_POINTS {
        return Err(Error::input(format!(
            "a triangulation of the sphere takes 4 to {MOST_POINTS} directions, not {}",
            points.len()
        )));
    }
    let is_unit = |p: &DVec3| (p.length() - 1.0).abs() < UNIT_TOLERANCE;
    match points.iter().position(|p| !is_unit(p)) {
        Some(i) => Err(Error::input(format!("direction {i} is not a unit vector: {}", points[i]))),
        None => Ok(()),
    }
}

/// 0..count in an order that is random and always the same: it keeps faces fat and few while the hull grows.
fn shuffled(count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|i| (random::bits(SHUFFLE, *i as u64, 0), *i));
    order
}

/// Three indices for each triangle.
type Triples = Vec<[u32; 3]>;

/// A face of the growing hull.
#[derive(Clone, Copy)]
struct Face {
    corners: [u32; 3],
    /// Faces across the edges from corner k to corner k + 1.
    across: [u32; 3],
}

/// The plane of a face; kept apart from it because every point is tested against all planes.
#[derive(Clone, Copy)]
struct Plane {
    normal: DVec3,
    offset: f64,
}

impl Plane {
    /// Plane of a face that no longer exists: nothing is above it.
    const GONE: Self = Self { normal: DVec3::ZERO, offset: f64::INFINITY };

    fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }
}

struct Hull<'a> {
    points: &'a [DVec3],
    simplex: [usize; 4],
    faces: Vec<Face>,
    planes: Vec<Plane>,
    unused: Vec<u32>,
    /// The new face whose first corner is this point, while a point is inserted.
    face_from: Vec<u32>,
    seen: Vec<u32>,
    horizon: Vec<(u32, u32, u32)>,
}

impl<'a> Hull<'a> {
    /// The tetrahedron of four points that are far apart.
    fn new(points: &'a [DVec3]) -> Result<Self> {
        let farthest = |measure: &dyn Fn(DVec3) -> f64| {
            let best =
                (0..points.len()).fold(0, |best, i| if measure(points[i]) > measure(points[best]) { i } else { best });
            (best, measure(points[best]))
        };
        let a = points[0];
        let (ib, _) = farthest(&|p| p.distance_squared(a));
        let b = points[ib];
        let (ic, area) = farthest(&|p| (p - a).cross(b - a).length());
        let normal = (b - a).cross(points[ic] - a).normalize_or_zero();
        let (id, height) = farthest(&|p| (p - a).dot(normal).abs());
        if !(area > COPLANAR && height > COPLANAR) {
            return Err(Error::input(
                "the directions lie in one plane; a triangulation of the sphere needs them all around",
            ));
        }
        let mut simplex = [0, ib, ic, id];
        if (points[id] - a).dot(normal) > 0.0 {
            simplex.swap(1, 2);
        }
        let [i, j, k, l] = simplex.map(|index| index as u32);
        let mut hull = Self {
            points,
            simplex,
            faces: Vec::new(),
            planes: Vec::new(),
            unused: Vec::new(),
            face_from: vec![NONE; points.len()],
            seen: Vec::new(),
            horizon: Vec::new(),
        };
        // Seen from outside, l is below the face i, j, k.
        hull.add(Face { corners: [i, j, k], across: [3, 1, 2] });
        hull.add(Face { corners: [j, l, k], across: [3, 2, 0] });
        hull.add(Face { corners: [k, l, i], across: [1, 3, 0] });
        hull.add(Face { corners: [i, l, j], across: [2, 1, 0] });
        Ok(hull)
    }

    fn add(&mut self, face: Face) -> u32 {
        let [a, b, c] = face.corners.map(|i| self.points[i as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let plane = Plane { normal, offset: normal.dot(a) };
        match self.unused.pop() {
            Some(slot) => {
                self.faces[slot as usize] = face;
                self.planes[slot as usize] = plane;
                slot
            }
            None => {
                self.faces.push(face);
                self.planes.push(plane);
                (self.faces.len() - 1) as u32
            }
        }
    }

    /// Replaces the faces that the point sees by a fan from their outline to the point.
    fn insert(&mut self, index: usize) -> Result<()> {
        let point = self.points[index];
        let mut top = (0, f64::NEG_INFINITY);
        for (face, plane) in self.planes.iter().enumerate() {
            let height = plane.height(point);
            if height > top.1 {
                top = (face as u32, height);
            }
        }
        if top.1 <= COPLANAR {
            return Err(self.coincides(index));
        }
        self.look(top.0, point);
        let mut fan = Vec::with_capacity(self.horizon.len());
        for (from, to, beyond) in std::mem::take(&mut self.horizon) {
            let face = self.add(Face { corners: [from, to, index as u32], across: [beyond, NONE, NONE] });
            if self.face_from[from as usize] != NONE {
                return Err(broken());
            }
            self.face_from[from as usize] = face;
            let edge = self.faces[beyond as usize].corners.iter().position(|c| *c == to).ok_or_else(broken)?;
            self.faces[beyond as usize].across[edge] = face;
            fan.push(face);
        }
        for face in &fan {
            let to = self.faces[*face as usize].corners[1];
            let next = self.face_from[to as usize];
            if next == NONE {
                return Err(broken());
            }
            self.faces[*face as usize].across[1] = next;
            self.faces[next as usize].across[2] = *face;
        }
        for face in fan {
            let from = self.faces[face as usize].corners[0];
            self.face_from[from as usize] = NONE;
        }
        Ok(())
    }

    /// Removes the faces that see `point`, from `top` outwards, and leaves the edges around them in `horizon`.
    fn look(&mut self, top: u32, point: DVec3) {
        self.seen.clear();
        self.horizon.clear();
        self.seen.push(top);
        self.planes[top as usize] = Plane::GONE;
        let mut next = 0;
        while let Some(&face) = self.seen.get(next) {
            next += 1;
            for beyond in self.faces[face as usize].across {
                let plane = &mut self.planes[beyond as usize];
                if plane.height(point) > COPLANAR {
                    *plane = Plane::GONE;
                    self.seen.push(beyond);
                }
            }
        }
        for face in &self.seen {
            let Face { corners, across } = self.faces[*face as usize];
            for (edge, &beyond) in across.iter().enumerate() {
                if self.planes[beyond as usize].offset.is_finite() {
                    self.horizon.push((corners[edge], corners[(edge + 1) % 3], beyond));
                }
            }
        }
        self.unused.extend(&self.seen);
    }

    /// The error for a point that sees no face: on a sphere it coincides with an earlier one.
    fn coincides(&self, index: usize) -> Error {
        let point = self.points[index];
        let distance = |i: usize| if i == index { f64::INFINITY } else { self.points[i].distance(point) };
        let nearest = (0..self.points.len()).fold(0, |best, i| if distance(i) < distance(best) { i } else { best });
        Error::input(format!("directions {} and {} coincide; give each once", index.min(nearest), index.max(nearest)))
    }

    /// Triangles and neighbours without gaps, after a check of the number of triangles and of every neighbour.
    fn finish(self) -> Result<(Triples, Triples)> {
        let mut number = vec![NONE; self.faces.len()];
        let mut kept = Vec::new();
        for (slot, face) in self.faces.iter().enumerate() {
            if self.planes[slot].offset.is_finite() {
                number[slot] = kept.len() as u32;
                kept.push(*face);
            }
        }
        let triangles: Triples = kept.iter().map(|face| face.corners).collect();
        let neighbours: Triples =
            kept.iter().map(|face| face.across.map(|a| number.get(a as usize).copied().unwrap_or(NONE))).collect();
        if triangles.len() != 2 * self.points.len() - 4 || neighbours.iter().flatten().any(|n| *n == NONE) {
            return Err(broken());
        }
        Ok((triangles, neighbours))
    }
}

fn broken() -> Error {
    Error::input(
        "some directions are too close to each other to be triangulated; give directions that are further apart",
    )
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::math::random::uniform;

    fn random_points(stage: u64, count: usize) -> Vec<DVec3> {
        (0..count).map(|i| random_direction(stage, i as u64)).collect()
    }

    /// Corners of a cube and other sets with many points on one circle.
    fn regular_sets() -> Vec<Vec<DVec3>> {
        let sign = |bit: usize| if bit & 1 == 0 { -1.0 } else { 1.0 };
        let cube = (0..8).map(|i| DVec3::new(sign(i), sign(i >> 1), sign(i >> 2)).normalize()).collect::<Vec<_>>();
        let octahedron = DVec3::AXES.iter().flat_map(|a| [*a, -*a]).collect();
        let turn = glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        let turned = cube.iter().map(|p| (turn * *p).normalize()).collect();
        let ring = |count: usize, z: f64| {
            (0..count).map(move |k| {
                let (sin, cos) = (TAU * k as f64 / count as f64).sin_cos();
                DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
            })
        };
        let poles = [DVec3::Z, DVec3::NEG_Z];
        let globe = (1..12).flat_map(|k| ring(24, (PI * f64::from(k) / 12.0).cos())).chain(poles).collect();
        let prism = ring(50, 0.3).chain(ring(50, -0.3)).collect();
        vec![cube, octahedron, turned, globe, prism, ring(200, 0.0).chain(poles).collect()]
    }

    #[test]
    fn triangulations_are_closed_and_no_circle_holds_a_point() {
        let random = [4, 5, 6, 10, 37, 200].map(|count| random_points(7 + count as u64, count));
        for points in regular_sets().into_iter().chain(random) {
            let count = points.len();
            let sphere = match SphericalDelaunay::new(points) {
                Ok(sphere) => sphere,
                // A few random points often leave a half of the sphere empty.
                Err(error) => {
                    assert!(count <= 10, "{error}");
                    continue;
                }
            };
            let mut solid_angle = 0.0;
            for (t, corners) in sphere.triangles().iter().enumerate() {
                let [a, b, c] = corners.map(|i| sphere.points()[i as usize]);
                let normal = (b - a).cross(c - a).normalize();
                assert!(sphere.points().iter().all(|p| (*p - a).dot(normal) < 2e-12), "{count}");
                solid_angle += 2.0 * a.dot(b.cross(c)).atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
                for (k, &other) in sphere.neighbours[t].iter().enumerate() {
                    let edge = [corners[(k + 1) % 3], corners[k]];
                    let back = (0..3).find(|&j| sphere.neighbours[other as usize][j] as usize == t).unwrap();
                    let there = sphere.triangles()[other as usize];
                    assert_eq!([there[back], there[(back + 1) % 3]], edge);
                }
            }
            assert!((solid_angle - 4.0 * PI).abs() < 1e-9, "{count}: {solid_angle}");
        }
    }

    #[test]
    fn the_covering_radius_is_the_largest_empty_circle() {
        let cube = SphericalDelaunay::new(regular_sets()[0].clone()).unwrap();
        assert!((cube.covering_radius() - (1.0 / 3.0_f64.sqrt()).acos()).abs() < 1e-12);
        for stage in 0..20 {
            let points = random_points(100 + stage, 30);
            let Ok(sphere) = SphericalDelaunay::new(points.clone()) else { continue };
            let mut largest = 0.0_f64;
            for a in 0..30 {
                for b in a + 1..30 {
                    for c in b + 1..30 {
                        let normal = (points[b] - points[a]).cross(points[c] - points[a]).normalize();
                        for centre in [normal, -normal] {
                            let cosine = centre.dot(points[a]);
                            if points.iter().all(|p| centre.dot(*p) < cosine + 1e-12) {
                                largest = largest.max(cosine.acos());
                            }
                        }
                    }
                }
            }
            assert!((sphere.covering_radius() - largest).abs() < 1e-7, "{} {largest}", sphere.covering_radius());
        }
    }

    #[test]
    fn a_direction_lies_in_the_triangle_that_is_found() {
        for points in regular_sets().into_iter().chain([random_points(3, 500)]) {
            let sphere = SphericalDelaunay::new(points.clone()).unwrap();
            let middles = sphere.triangles().iter().map(|t| points[t[0] as usize] + points[t[1] as usize]);
            let random = (0..2000).map(|i| random_direction(4, i) * 1e3_f64.powi(i as i32 % 5 - 2));
            for direction in points.iter().copied().chain(middles).chain(random).filter(|d| d.length() > 1e-9) {
                let Location { triangle, barycentric } = sphere.locate(direction);
                let corners = sphere.triangles()[triangle].map(|i| points[i as usize]);
                let at: DVec3 = (0..3).map(|k| barycentric[k] * corners[k]).sum();
                assert!(barycentric.iter().all(|b| *b >= 0.0));
                assert!((barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(at.normalize().distance(direction.normalize()) < 1e-9, "{direction}");
            }
            for strange in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY, DVec3::splat(f64::MAX), DVec3::splat(1e-300)] {
                assert!(sphere.locate(strange).barycentric.iter().all(|b| b.is_finite()));
            }
        }
    }

    #[test]
    fn what_cannot_be_triangulated_is_an_error() {
        let octahedron = regular_sets()[1].clone();
        let refused = |points: Vec<DVec3>, said: &str| {
            let error = SphericalDelaunay::new(points).unwrap_err();
            assert!(error.message().contains(said), "{error}");
        };
        refused(Vec::new(), "4 to");
        refused(octahedron[..3].to_vec(), "4 to");
        refused(vec![DVec3::X; MOST_POINTS + 1], "4 to");
        refused(vec![DVec3::X; 6], "plane");
        let ring = (0..40).map(|k| DVec3::new(f64::from(k).cos(), f64::from(k).sin(), 0.0));
        refused(ring.clone().collect(), "plane");
        refused(ring.chain([DVec3::Z]).collect(), "half");
        refused(random_points(1, 50).into_iter().map(|p| p.with_z(p.z.abs())).collect(), "half");
        for broken in [DVec3::ZERO, 2.0 * DVec3::X, DVec3::NAN, DVec3::INFINITY] {
            refused(octahedron.iter().copied().chain([broken]).collect(), "direction 6 is not");
        }
        refused(octahedron.iter().copied().chain([DVec3::Y]).collect(), "directions 2 and 6 coincide");
    }

    #[test]
    fn clusters_are_triangulated_or_refused_without_a_panic() {
        let mut triangulated = 0;
        for stage in 0..200 {
            let spread = 10f64.powf(-16.0 * uniform(stage, 0, 9));
            let mut points = regular_sets()[1].clone();
            points.extend((0..20).map(|i| (DVec3::X + spread * random_direction(stage, i)).normalize()));
            if let Ok(sphere) = SphericalDelaunay::new(points) {
                triangulated += 1;
                assert!(sphere.locate(random_direction(stage, 77)).barycentric.iter().all(|b| b.is_finite()));
            }
        }
        assert!(triangulated > 50, "{triangulated}");
    }

    #[test]
    fn thousands_of_points_take_a_moment() {
        let points = random_points(5, 4096);
        let start = std::time::Instant::now();
        let sphere = SphericalDelaunay::new(points.clone()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        println!("4096 directions in {seconds:.3} s");
        assert!(seconds < 5.0);
        assert_eq!(sphere, SphericalDelaunay::new(points).unwrap());
    }
}
