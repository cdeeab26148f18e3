//! Triangles under collapse, with the simplices around each vertex as linked lists that splice without allocation.
//!
//! A triangle that loses a corner lives on as an edge where nothing else joins its two corners, so a component stays
//! in one piece down to its last vertex.

use super::input::Input;

/// No vertex, no corner.
pub(super) const NONE: u32 = u32::MAX;

/// A simplicial complex of triangles and dangling edges.
///
/// Corner `3 t + k` is slot k of simplex t. A slot that no longer names the vertex in whose list its corner hangs is
/// stale; lists are cleaned when they are next walked for good.
pub(super) struct Complex {
    /// Corners of each simplex: three for a triangle, two and a [`NONE`] for an edge, three [`NONE`] for a dead one.
    pub(super) simplices: Vec<[u32; 3]>,
    /// Next corner in the list of the same vertex.
    next: Vec<u32>,
    /// First corner of each vertex.
    head: Vec<u32>,
    /// Length of each list, stale corners included.
    length: Vec<u32>,
    /// Simplices that a collapse has just turned into edges.
    narrowed: Vec<u32>,
}

/// The other two slots of a corner.
pub(super) fn others(simplex: [u32; 3], slot: usize) -> [u32; 2] {
    [simplex[(slot + 1) % 3], simplex[(slot + 2) % 3]]
}

impl Complex {
    /// Takes the triangles that have three distinct finite corners; the others stay behind as dead simplices.
    pub(super) fn new(input: &Input) -> Self {
        let vertices = input.positions.len();
        let good = |t: &[u32; 3]| {
            t.iter().all(|&v| input.positions.get(v as usize).is_some_and(|p| p.is_finite()))
                && t[0] != t[1]
                && t[1] != t[2]
                && t[2] != t[0]
        };
        let simplices: Vec<[u32; 3]> = input.triangles.iter().map(|t| if good(t) { *t } else { [NONE; 3] }).collect();
        let mut complex = Self {
            next: vec![NONE; 3 * simplices.len()],
            head: vec![NONE; vertices],
            length: vec![0; vertices],
            simplices: Vec::new(),
            narrowed: Vec::new(),
        };
        // Backwards, so that each list runs in the order of the triangles.
        for (t, simplex) in simplices.iter().enumerate().rev() {
            for (slot, &v) in simplex.iter().enumerate().filter(|&(_, &v)| v != NONE) {
                complex.hang((3 * t + slot) as u32, v);
            }
        }
        complex.simplices = simplices;
        complex
    }

    fn hang(&mut self, corner: u32, vertex: u32) {
        self.next[corner as usize] = self.head[vertex as usize];
        self.head[vertex as usize] = corner;
        self.length[vertex as usize] += 1;
    }

    /// Whether any simplex was given this vertex.
    pub(super) fn used(&self, vertex: u32) -> bool {
        self.head[vertex as usize] != NONE
    }

    /// Number of simplices around a vertex, or a little more.
    pub(super) fn length(&self, vertex: u32) -> u32 {
        self.length[vertex as usize]
    }

    /// Simplices around a vertex, each with the slot of that vertex.
    pub(super) fn around(&self, vertex: u32) -> impl Iterator<Item = (u32, [u32; 3], usize)> {
        let mut corner = self.head[vertex as usize];
        std::iter::from_fn(move || {
            while corner != NONE {
                let (t, slot) = (corner / 3, (corner % 3) as usize);
                corner = self.next[corner as usize];
                let simplex = self.simplices[t as usize];
                if simplex[slot] == vertex {
                    return Some((t, simplex, slot));
                }
            }
            None
        })
    }

    /// Drops stale corners from the list of a vertex.
    pub(super) fn clean(&mut self, vertex: u32) {
        let mut corner = self.head[vertex as usize];
        let (mut last, mut length) = (NONE, 0);
        while corner != NONE {
            if self.simplices[(corner / 3) as usize][(corner % 3) as usize] == vertex {
                if last == NONE {
                    self.head[vertex as usize] = corner;
                } else {
                    self.next[last as usize] = corner;
                }
                last = corner;
                length += 1;
            }
            corner = self.next[corner as usize];
        }
        if last == NONE {
            self.head[vertex as usize] = NONE;
        } else {
            self.next[last as usize] = NONE;
        }
        self.length[vertex as usize] = length;
    }

    /// Whether a simplex other than `except` joins two vertices.
    pub(super) fn joined(&self, a: u32, b: u32, except: u32) -> bool {
        let (short, far) = if self.length(a) <= self.length(b) { (a, b) } else { (b, a) };
        self.around(short).any(|(t, simplex, _)| t != except && simplex.contains(&far))
    }

    /// Moves everything around `removed` to `onto`.
    pub(super) fn collapse(&mut self, removed: u32, onto: u32) {
        let mut corner = self.head[removed as usize];
        self.narrowed.clear();
        while corner != NONE {
            let (t, slot) = ((corner / 3) as usize, (corner % 3) as usize);
            let following = self.next[corner as usize];
            if self.simplices[t][slot] == removed {
                if self.simplices[t].contains(&onto) {
                    self.simplices[t][slot] = NONE;
                    self.narrowed.push(t as u32);
                } else {
                    self.simplices[t][slot] = onto;
                    self.hang(corner, onto);
                }
            }
            corner = following;
        }
        self.head[removed as usize] = NONE;
        self.length[removed as usize] = 0;
        for i in 0..self.narrowed.len() {
            let t = self.narrowed[i];
            let simplex = self.simplices[t as usize];
            let far = simplex.into_iter().find(|&v| v != NONE && v != onto);
            if far.is_none_or(|far| self.joined(onto, far, t)) {
                self.simplices[t as usize] = [NONE; 3];
            }
        }
    }
}
