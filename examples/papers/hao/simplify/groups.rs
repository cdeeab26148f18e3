//! The set of parts that meet at each vertex, and the component that it belongs to.

use std::collections::HashMap;

use super::complex::{Complex, NONE};
use super::input::Input;

/// Sets of parts, one for each vertex; vertices of the same set share it.
pub(super) struct PartSets {
    of_vertex: Vec<u32>,
    sets: Vec<Vec<u32>>,
}

impl PartSets {
    pub(super) fn new(input: &Input, complex: &Complex) -> Self {
        let mut index: HashMap<Vec<u32>, u32> = HashMap::new();
        let mut sets = vec![Vec::new()];
        index.insert(Vec::new(), 0);
        let mut set = Vec::new();
        let of_vertex = (0..input.positions.len() as u32)
            .map(|v| {
                set.clear();
                set.extend(complex.around(v).map(|(t, _, _)| input.part(t as usize)));
                set.sort_unstable();
                set.dedup();
                index.get(&set).copied().unwrap_or_else(|| {
                    let id = sets.len() as u32;
                    sets.push(set.clone());
                    index.insert(set.clone(), id);
                    id
                })
            })
            .collect();
        Self { of_vertex, sets }
    }

    /// Parts at a vertex, ascending.
    pub(super) fn of(&self, vertex: u32) -> &[u32] {
        self.of_vertex.get(vertex as usize).and_then(|&set| self.sets.get(set as usize)).map_or(&[], Vec::as_slice)
    }

    /// Whether every part at `vertex` is at `other` too.
    pub(super) fn within(&self, vertex: u32, other: u32) -> bool {
        let (a, b) = (self.of_vertex[vertex as usize], self.of_vertex[other as usize]);
        a == b || self.of(vertex).iter().all(|part| self.of(other).binary_search(part).is_ok())
    }
}

/// Connected components by shared vertices, with how many vertices each has left.
pub(super) struct Components {
    of_vertex: Vec<u32>,
    left: Vec<u32>,
}

impl Components {
    pub(super) fn new(vertices: usize, complex: &Complex) -> Self {
        let mut of_vertex = vec![NONE; vertices];
        let mut left = Vec::new();
        let mut open = Vec::new();
        for start in 0..vertices as u32 {
            if of_vertex[start as usize] != NONE || !complex.used(start) {
                continue;
            }
            let component = left.len() as u32;
            left.push(0);
            of_vertex[start as usize] = component;
            open.push(start);
            while let Some(v) = open.pop() {
                left[component as usize] += 1;
                for w in complex.around(v).flat_map(|(_, simplex, _)| simplex).filter(|&w| w != NONE) {
                    if of_vertex[w as usize] == NONE {
                        of_vertex[w as usize] = component;
                        open.push(w);
                    }
                }
            }
        }
        Self { of_vertex, left }
    }

    /// Vertices left of the component of a vertex in use.
    pub(super) fn left(&self, vertex: u32) -> u32 {
        self.left[self.of_vertex[vertex as usize] as usize]
    }

    pub(super) fn remove(&mut self, vertex: u32) {
        self.left[self.of_vertex[vertex as usize] as usize] -= 1;
    }
}
