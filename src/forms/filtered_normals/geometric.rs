//! Sums of normals over the vertices nearby, weighted by an exponential of the distance through space (Patro 2007, equation 3).
//!
//! Boxes of a kd-tree stand for their vertices where the exponential and the direction hardly vary over them.

use glam::DVec3;

use super::points::Points;
use super::settings::Weights;
use crate::geometry::cluster::{groups, partition};
use crate::parallel::*;

/// Vertices of a leaf.
const LEAF: usize = 8;

/// A cluster stands for its vertices where its radius is below this share of the distance and this many reciprocals of sigma.
const OPENING: f64 = 0.25;

/// Vertices whose sums are one task.
const CHUNK: usize = 64;

struct Node {
    first: u32,
    end: u32,
    /// The second child; 0 for a leaf. The first follows at once.
    second: u32,
    centre: DVec3,
    radius: f64,
    normal: DVec3,
    weight: f64,
}

/// The vertices in trees, one for each part.
pub(super) struct Sums<'a> {
    points: &'a Points,
    order: Vec<u32>,
    nodes: Vec<Node>,
    weights: Vec<f64>,
    roots: Vec<u32>,
    root_of: Vec<u32>,
}

impl<'a> Sums<'a> {
    pub(super) fn new(points: &'a Points, weights: Weights) -> Self {
        let mean = points.areas.iter().sum::<f64>() / points.len().max(1) as f64;
        let weights = match weights {
            Weights::Count => vec![1.0; points.len()],
            Weights::Area => points.areas.iter().map(|a| if mean > 0.0 { a / mean } else { 0.0 }).collect(),
        };
        let mut sums = Self {
            points,
            order: Vec::new(),
            nodes: Vec::new(),
            weights,
            roots: Vec::new(),
            root_of: vec![0; points.len()],
        };
        for part in points.receivers.groups.chunk_by(|a, b| a.part == b.part) {
            let (first, end) = (part[0].run.first, part[part.len() - 1].run.end);
            let mut order: Vec<u32> = (first..end).collect();
            groups(&mut order, &points.receivers.positions, LEAF);
            let base = sums.order.len() as u32;
            sums.order.extend(order);
            sums.root_of[first as usize..end as usize].fill(sums.roots.len() as u32);
            let root = sums.grow(base, base + (end - first));
            sums.roots.push(root);
        }
        sums
    }

    fn grow(&mut self, first: u32, end: u32) -> u32 {
        let at = &self.points.receivers.positions;
        if (end - first) as usize > LEAF {
            let half = (end - first) as usize / 2;
            partition(&mut self.order[first as usize..end as usize], at, half);
        }
        let own = &self.order[first as usize..end as usize];
        let weight: f64 = own.iter().map(|&i| self.weights[i as usize]).sum();
        let normal = own.iter().map(|&i| self.weights[i as usize] * self.points.normals[i as usize]).sum();
        let centre = own.iter().map(|&i| at[i as usize]).sum::<DVec3>() / f64::from(end - first);
        let radius = own.iter().map(|&i| at[i as usize].distance(centre)).fold(0.0, f64::max);
        let node = self.nodes.len() as u32;
        self.nodes.push(Node { first, end, second: 0, centre, radius, normal, weight });
        if (end - first) as usize > LEAF {
            let middle = first + (end - first) / 2;
            self.grow(first, middle);
            self.nodes[node as usize].second = self.grow(middle, end);
        }
        node
    }

    /// For every point the sum of the normals within `reach / sigma` and that of their weights, sigma in 1/mm.
    pub(super) fn at(&self, sigma: f64, reach: f64) -> Vec<(DVec3, f64)> {
        let mut out = vec![(DVec3::ZERO, 0.0); self.points.len()];
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, out)| {
            for (i, out) in out.iter_mut().enumerate() {
                let point = chunk * CHUNK + i;
                let root = self.roots[self.root_of[point] as usize];
                self.visit(root, self.points.receivers.positions[point], (sigma, reach / sigma), out);
            }
        });
        out
    }

    fn visit(&self, node: u32, from: DVec3, (sigma, reach): (f64, f64), out: &mut (DVec3, f64)) {
        let Node { first, end, second, centre, radius, normal, weight } = &self.nodes[node as usize];
        let distance = from.distance(*centre);
        if distance - radius >= reach {
            return;
        }
        let far = *radius < OPENING * distance && radius * sigma < OPENING && distance + radius < reach;
        if far {
            let fall = (-sigma * distance).exp();
            out.0 += fall * *normal;
            out.1 += fall * weight;
        } else if *second == 0 {
            for &i in &self.order[*first as usize..*end as usize] {
                let distance = from.distance(self.points.receivers.positions[i as usize]);
                if distance < reach {
                    let fall = self.weights[i as usize] * (-sigma * distance).exp();
                    out.0 += fall * self.points.normals[i as usize];
                    out.1 += fall;
                }
            }
        } else {
            self.visit(node + 1, from, (sigma, reach), out);
            self.visit(*second, from, (sigma, reach), out);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::geometry::shapes;

    #[test]
    fn trees_give_the_sums_of_all_pairs() {
        let scene = crate::forms::test_scene::scene(shapes::bumpy_head(10.0, 4), "marble");
        let points = Points::new(&scene);
        for weights in [Weights::Count, Weights::Area] {
            let sums = Sums::new(&points, weights);
            for (sigma, reach) in [(0.1, 5.0), (0.8, 4.6), (5.0, 2.0)] {
                let found = sums.at(sigma, reach);
                for i in (0..points.len()).step_by(97) {
                    let from = points.receivers.positions[i];
                    let mut expected = (DVec3::ZERO, 0.0);
                    for (j, at) in points.receivers.positions.iter().enumerate() {
                        let distance = from.distance(*at);
                        if distance < reach / sigma {
                            let fall = sums.weights[j] * (-sigma * distance).exp();
                            expected = (expected.0 + fall * points.normals[j], expected.1 + fall);
                        }
                    }
                    let error = (found[i].0 - expected.0).length() / expected.1 + (found[i].1 / expected.1 - 1.0).abs();
                    assert!(error < 0.01, "{weights:?} {sigma}: {error}");
                }
            }
        }
    }
}
