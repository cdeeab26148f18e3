//! Hat functions that are fine enough for factors of points: those of the mesh, and where its edges are many mean free paths
//! long, those of its triangles cut into smaller ones.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::transport::domain::Domain;
use crate::transport::random_walk::tally::{Hats, NONE};

/// Longest edge in mean free paths of the channel with the shortest.
const LONGEST: f64 = 3.0;

/// Triangles of one part at most, about, unless its mesh has more.
const MOST: f64 = 16_384.0;

/// Rounds of cuts at most; each halves the edges.
const MOST_ROUNDS: usize = 16;

/// A triangle of the mesh or a piece of one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    slots: [u32; 3],
    /// Weights of the second and third corner of the triangle at the corners of the piece.
    corners: [[f64; 2]; 3],
    /// First of its own pieces, and their number.
    pieces: (u32, u32),
}

/// One hat function for each slot: a welded vertex of a part, or a point on an edge of one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lattice {
    /// Triangles of the mesh first, the pieces of each together.
    pieces: Vec<Piece>,
    /// Place of each slot relative to the origin of the mesh, mm.
    pub at_mm: Vec<DVec3>,
    /// Mean normal of the pieces around each slot by their areas, unit.
    pub normal: Vec<DVec3>,
    /// Part of each slot.
    pub part: Vec<u32>,
    /// Integral of each hat function, mm^2.
    pub mass_mm2: Vec<f64>,
    /// The slot of each source vertex, that of the first of its parts; [`NONE`] without area.
    pub of_vertex: Vec<u32>,
}

impl Lattice {
    /// The hat functions of the parts of a domain that light enters.
    pub fn new(domain: Domain) -> Self {
        let Domain { mesh, parts, .. } = domain;
        let hats = Hats::new(mesh, parts);
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let pieces = hats.corners.iter().map(|&slots| Piece { slots, corners, pieces: (0, 0) }).collect();
        let at_mm: Vec<DVec3> = hats.vertex.iter().map(|&v| mesh.local_mm[v as usize].as_dvec3()).collect();
        let mut part = vec![NONE; at_mm.len()];
        for (slots, &of_triangle) in hats.corners.iter().zip(&parts.triangle_part) {
            for &slot in slots {
                if let Some(part) = part.get_mut(slot as usize) {
                    *part = of_triangle;
                }
            }
        }
        let mut result = Self { pieces, at_mm, part, of_vertex: hats.of_vertex, ..Self::default() };
        let longest = longest_edges(domain);
        for _ in 0..MOST_ROUNDS {
            if !result.cut(&longest) {
                break;
            }
        }
        result.weigh();
        result
    }

    /// Number of slots.
    pub fn len(&self) -> usize {
        self.at_mm.len()
    }

    /// True if there are no slots.
    pub fn is_empty(&self) -> bool {
        self.at_mm.is_empty()
    }

    /// Slots of the corners of the smallest pieces.
    fn smallest(&self) -> impl Iterator<Item = [u32; 3]> {
        self.pieces.iter().filter(|piece| piece.pieces.1 == 0 && piece.slots[0] != NONE).map(|piece| piece.slots)
    }

    /// Slots and places (mm) of the corners of the smallest pieces.
    pub fn triangles(&self) -> impl Iterator<Item = ([u32; 3], [DVec3; 3])> {
        self.smallest().map(|slots| (slots, slots.map(|slot| self.at_mm[slot as usize])))
    }

    /// The middle of each smallest piece with its part, where all its slots have one, and its unit normal.
    pub fn middles(&self, place: impl Fn(u32) -> Option<(u32, DVec3)>) -> (Vec<Option<(u32, DVec3)>>, Vec<DVec3>) {
        let middle = |(slots, corners): ([u32; 3], [DVec3; 3])| {
            let [part, ..] = slots.map(|slot| place(slot).map(|(part, _)| part));
            let [a, b, c] = corners;
            (part.map(|part| (part, (a + b + c) / 3.0)), (b - a).cross(c - a).normalize_or_zero())
        };
        self.triangles().map(middle).unzip()
    }

    /// Means over the hat function of each slot of values in the middles of the smallest pieces.
    pub fn means(&self, of_pieces: &[DVec3]) -> Vec<DVec3> {
        let mut sums = vec![DVec3::ZERO; self.len()];
        for ((slots, [a, b, c]), value) in self.triangles().zip(of_pieces) {
            let share = (b - a).cross(c - a).length() / 6.0 * *value;
            slots.into_iter().for_each(|slot| sums[slot as usize] += share);
        }
        let mean = |(sum, mass): (DVec3, &f64)| if *mass > 0.0 { sum / *mass } else { DVec3::ZERO };
        sums.into_iter().zip(&self.mass_mm2).map(mean).collect()
    }

    /// Slots around a point of a triangle of the mesh, given by the weights of its second and third corner, and the weights of
    /// their hat functions there; none on opaque triangles.
    pub fn at(&self, triangle: u32, u: f64, v: f64) -> Option<([u32; 3], [f64; 3])> {
        let mut piece = self.pieces.get(triangle as usize).filter(|piece| piece.slots[0] != NONE)?;
        loop {
            let (first, count) = piece.pieces;
            let own = self.pieces.get(first as usize..(first + count) as usize)?;
            let inside = |piece: &&Piece| weights(&piece.corners, [u, v]).into_iter().fold(f64::INFINITY, f64::min);
            match own.iter().max_by(|a, b| inside(a).total_cmp(&inside(b))) {
                Some(smaller) => piece = smaller,
                None => return Some((piece.slots, weights(&piece.corners, [u, v]))),
            }
        }
    }

    /// Cuts all edges that are longer than those of their part may be; false if there are none.
    fn cut(&mut self, longest_mm: &[f64]) -> bool {
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let smallest: Vec<[u32; 3]> = self.smallest().collect();
        for slots in smallest {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (slots[i].min(slots[j]), slots[i].max(slots[j]))) {
                let (from, to, part) = (self.at_mm[a as usize], self.at_mm[b as usize], self.part[a as usize]);
                let longest = longest_mm.get(part as usize).copied().unwrap_or(f64::INFINITY);
                if from.distance(to) > longest && !middles.contains_key(&[a, b]) {
                    middles.insert([a, b], self.at_mm.len() as u32);
                    self.at_mm.push(0.5 * (from + to));
                    self.part.push(part);
                }
            }
        }
        if middles.is_empty() {
            return false;
        }
        for index in 0..self.pieces.len() {
            let piece = self.pieces[index];
            if piece.pieces.1 > 0 || piece.slots[0] == NONE {
                continue;
            }
            let first = self.pieces.len() as u32;
            self.pieces.extend(halved(&piece, &middles));
            self.pieces[index].pieces = (first, self.pieces.len() as u32 - first);
        }
        true
    }

    /// Masses and normals of the slots.
    fn weigh(&mut self) {
        let (mut normal, mut mass) = (vec![DVec3::ZERO; self.len()], vec![0.0; self.len()]);
        for (slots, [a, b, c]) in self.triangles() {
            let cross = (b - a).cross(c - a);
            for slot in slots {
                normal[slot as usize] += cross;
                mass[slot as usize] += cross.length() / 6.0;
            }
        }
        self.normal = normal.into_iter().map(|n| n.normalize_or_zero()).collect();
        self.mass_mm2 = mass;
    }
}

/// Longest edge of each part, mm.
fn longest_edges(domain: Domain) -> Vec<f64> {
    let of_part = |part: &crate::geometry::part_table::PartEntry| {
        let medium = domain.media.get(part.medium? as usize)?;
        let free_path = medium.properties.mean_free_path_mm().min_element();
        // Equilateral triangles of an edge have sqrt(3) / 4 of its square.
        Some((LONGEST * free_path).max((part.area_mm2 * 4.0 / (3f64.sqrt() * MOST)).sqrt()))
    };
    domain.parts.parts.iter().map(|part| of_part(part).filter(|l| *l > 0.0).unwrap_or(f64::INFINITY)).collect()
}

/// The pieces of a piece whose edges have middles; none where no edge has one.
fn halved(piece: &Piece, middles: &BTreeMap<[u32; 2], u32>) -> Vec<Piece> {
    let Piece { slots, corners, .. } = *piece;
    let middle = |i: usize| {
        let j = (i + 1) % 3;
        let slot = *middles.get(&[slots[i].min(slots[j]), slots[i].max(slots[j])])?;
        let at = [0, 1].map(|axis| 0.5 * (corners[i][axis] + corners[j][axis]));
        Some((slot, at))
    };
    let of = [middle(0), middle(1), middle(2)];
    let corner = |i: usize| (slots[i % 3], corners[i % 3]);
    let made = |three: [(u32, [f64; 2]); 3]| Piece {
        slots: three.map(|(slot, _)| slot),
        corners: three.map(|(_, at)| at),
        pieces: (0, 0),
    };
    match of {
        [Some(ab), Some(bc), Some(ca)] => {
            let (a, b, c) = (corner(0), corner(1), corner(2));
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]].map(made).to_vec()
        }
        _ => {
            // From the corner between two cut edges, or that before the only one.
            let Some(start) = (0..3).find(|&i| of[i].is_some() && of[(i + 1) % 3].is_none()) else {
                return Vec::new();
            };
            let (a, b, c) = (corner(start), corner(start + 1), corner(start + 2));
            match (of[start], of[(start + 2) % 3]) {
                (Some(ab), Some(ca)) => [[a, ab, ca], [ab, b, c], [ab, c, ca]].map(made).to_vec(),
                (Some(ab), None) => [[a, ab, c], [ab, b, c]].map(made).to_vec(),
                _ => Vec::new(),
            }
        }
    }
}

/// Weights of the corners of a flat triangle at a point.
fn weights(corners: &[[f64; 2]; 3], at: [f64; 2]) -> [f64; 3] {
    let [a, b, c] = corners;
    let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let from_a = |p: &[f64; 2]| [p[0] - a[0], p[1] - a[1]];
    let (ab, ac, way) = (from_a(b), from_a(c), from_a(&at));
    let whole = cross(ab, ac);
    let (v, w) = (cross(way, ac) / whole, cross(ab, way) / whole);
    [1.0 - v - w, v, w]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::math::random::uniform;
    use crate::transport::test_scene::{Fixture, named};

    #[test]
    fn long_edges_are_cut_and_short_ones_stay() {
        let cube = Fixture::new(shapes::cuboid(DVec3::splat(11.0), 1), named("marble"), 64);
        let domain = cube.scene.domain();
        let lattice = Lattice::new(domain);
        let longest = longest_edges(domain)[0];
        let mut area = 0.0;
        for (_, [a, b, c]) in lattice.triangles() {
            assert!(a.distance(b).max(b.distance(c)).max(c.distance(a)) <= longest);
            area += 0.5 * (b - a).cross(c - a).length();
        }
        let whole = domain.parts.parts[0].area_mm2;
        assert!((area / whole - 1.0).abs() < 1e-6, "{area} {whole}");
        assert!((lattice.mass_mm2.iter().sum::<f64>() / whole - 1.0).abs() < 1e-6);
        assert!(lattice.len() > 1000 && lattice.triangles().count() < 40_000, "{}", lattice.len());
        // Neighbours share the slots of the edge between them: a closed surface of genus 0.
        let mut edges: Vec<[u32; 2]> = lattice
            .triangles()
            .flat_map(|([a, b, c], _)| [[a, b], [b, c], [c, a]].map(|[i, j]| [i.min(j), i.max(j)]))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        assert_eq!(lattice.len() + lattice.triangles().count(), edges.len() + 2);

        let fine = Fixture::new(shapes::icosphere(2.0, 4), named("marble"), 64);
        let lattice = Lattice::new(fine.scene.domain());
        assert_eq!(lattice.triangles().count(), fine.scene.mesh.triangles.len());
    }

    #[test]
    fn a_point_is_found_in_the_piece_that_it_lies_in() {
        let fixture = Fixture::new(shapes::cuboid(DVec3::new(9.0, 5.0, 13.0), 1), named("skin1"), 64);
        let domain = fixture.scene.domain();
        let lattice = Lattice::new(domain);
        for i in 0..2000 {
            let triangle = i % domain.mesh.triangles.len() as u64;
            let [p, q] = [0, 1].map(|d| uniform(5, i, d));
            let (u, v) = if p + q > 1.0 { (1.0 - p, 1.0 - q) } else { (p, q) };
            let (slots, weights) = lattice.at(triangle as u32, u, v).unwrap();
            assert!(weights.iter().all(|w| *w > -1e-9));
            let found: DVec3 = slots.iter().zip(weights).map(|(s, w)| w * lattice.at_mm[*s as usize]).sum();
            let [a, b, c] = domain.mesh.corners_local_mm(triangle as u32);
            assert!(found.distance(a * (1.0 - u - v) + b * u + c * v) < 1e-5);
        }
        assert!(lattice.at(u32::MAX, 0.3, 0.3).is_none());
    }
}
