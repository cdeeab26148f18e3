//! Models with more vertices than they come with.

use std::collections::{BinaryHeap, HashMap};

use glam::DVec3;
use translux::geometry::source::SourceModel;

/// The model with its longest edges cut in two, one after the other, until it has so many vertices; materials of new triangles are
/// those of the cut ones. Attributes of corners are dropped.
pub(crate) fn longest_edges_cut(mut model: SourceModel, vertices: usize) -> SourceModel {
    // The triangle on the left of each edge.
    let mut left: HashMap<[u32; 2], u32> = HashMap::new();
    let mut queue = BinaryHeap::new();
    let length = |positions: &[DVec3], [a, b]: [u32; 2]| {
        // Bits of positive numbers are in their order.
        positions[a as usize].distance(positions[b as usize]).to_bits()
    };
    let edges = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]];
    for (index, triangle) in model.triangles.iter().enumerate() {
        for edge in edges(*triangle) {
            left.insert(edge, index as u32);
            queue.push((length(&model.positions, edge), edge));
        }
    }
    model.normals = None;
    model.uvs = None;
    while model.positions.len() < vertices {
        let Some((_, [a, b])) = queue.pop() else { break };
        if !left.contains_key(&[a, b]) {
            continue;
        }
        let middle = model.positions.len() as u32;
        model.positions.push(0.5 * (model.positions[a as usize] + model.positions[b as usize]));
        for [a, b] in [[a, b], [b, a]] {
            let Some(index) = left.remove(&[a, b]) else { continue };
            let corners = model.triangles[index as usize];
            let Some(opposite) = corners.into_iter().find(|v| *v != a && *v != b) else { continue };
            let new = model.triangles.len() as u32;
            model.triangles[index as usize] = [a, middle, opposite];
            model.triangles.push([middle, b, opposite]);
            model.triangle_material.push(model.triangle_material[index as usize]);
            for (triangle, own) in [(index, [a, middle, opposite]), (new, [middle, b, opposite])] {
                for edge in edges(own) {
                    // An edge that stays is in the queue already.
                    if left.insert(edge, triangle).is_none() {
                        queue.push((length(&model.positions, edge), edge));
                    }
                }
            }
        }
    }
    model
}
