//! What of integers at the vertices of a mesh is left when earlier neighbours are known.

use translux_format::coefficients::NO_ROW;

/// For each vertex those before it that share an edge with it; where there are none, the one before.
pub(super) struct Earlier {
    /// Where the neighbours of each vertex start.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Earlier {
    /// Of so many vertices; triangles that name others are left out.
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let edges = triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
        let mut pairs: Vec<[u32; 2]> = edges
            .map(|[a, b]| [a.max(b), a.min(b)])
            .filter(|[later, earlier]| later != earlier && (*later as usize) < vertices)
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        let (mut starts, mut neighbours) = (vec![0], Vec::with_capacity(pairs.len()));
        let mut pairs = pairs.into_iter().peekable();
        for vertex in 0..vertices as u32 {
            let first = neighbours.len();
            while let Some([_, earlier]) = pairs.next_if(|pair| pair[0] == vertex) {
                neighbours.push(earlier);
            }
            if neighbours.len() == first && vertex > 0 {
                neighbours.push(vertex - 1);
            }
            starts.push(neighbours.len() as u32);
        }
        Self { starts, neighbours }
    }

    fn vertices(&self) -> usize {
        self.starts.len() - 1
    }

    fn of(&self, vertex: usize) -> &[u32] {
        &self.neighbours[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }

    /// For each vertex and plane a row before that is similar.
    pub(super) fn similar(&self, planes: usize) -> Vec<u32> {
        let last = |vertex: usize| self.of(vertex).last().copied();
        (0..self.vertices())
            .flat_map(|vertex| {
                (0..planes).map(move |plane| last(vertex).map_or(NO_ROW, |v| v * planes as u32 + plane as u32))
            })
            .collect()
    }

    /// The rounded mean of the neighbours' rows.
    fn predict(&self, vertex: usize, known: &[i16], sums: &mut [i32]) {
        let (neighbours, size) = (self.of(vertex), sums.len());
        sums.fill(0);
        for &neighbour in neighbours {
            let row = &known[neighbour as usize * size..(neighbour as usize + 1) * size];
            sums.iter_mut().zip(row).for_each(|(sum, v)| *sum += i32::from(*v));
        }
        let count = neighbours.len().max(1) as i32;
        if count > 1 {
            sums.iter_mut().for_each(|sum| *sum = (*sum + count / 2).div_euclid(count));
        }
    }

    /// Values less their predictions, modulo 2^16; rows of `size`, one for each vertex.
    pub(super) fn residuals(&self, values: &[i16], size: usize) -> Vec<i16> {
        let mut sums = vec![0; size];
        let mut result = vec![0; values.len()];
        let rows = result.chunks_exact_mut(size.max(1)).zip(values.chunks_exact(size.max(1)));
        for (vertex, (out, own)) in rows.enumerate().take(self.vertices()) {
            self.predict(vertex, values, &mut sums);
            out.iter_mut().zip(own).zip(&sums).for_each(|((out, v), sum)| *out = v.wrapping_sub(*sum as i16));
        }
        result
    }

    /// Undoes [`Self::residuals`] in place.
    pub(super) fn restore(&self, values: &mut [i16], size: usize) {
        let mut sums = vec![0; size];
        for vertex in 0..self.vertices().min(values.len() / size.max(1)) {
            let (known, rest) = values.split_at_mut(vertex * size);
            self.predict(vertex, known, &mut sums);
            rest.iter_mut().zip(&sums).for_each(|(v, sum)| *v = v.wrapping_add(*sum as i16));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use translux::math::random::bits;

    #[test]
    fn any_values_come_back_and_smooth_ones_leave_little() {
        // Duplicate, degenerate and foreign triangles; vertex 9 has none.
        let triangles =
            [[0, 1, 2], [2, 1, 3], [3, 3, 4], [4, 5, 90], [5, 6, 7], [8, 7, 0], [0, 1, 2], [u32::MAX, 1, 10]];
        let earlier = Earlier::new(11, &triangles);
        assert_eq!(earlier.of(0), [0u32; 0]);
        assert_eq!((earlier.of(2), earlier.of(9), earlier.of(10)), (&[0, 1][..], &[8][..], &[1][..]));
        let values: Vec<i16> = (0..33).map(|i| bits(1, i, 0) as i16).collect();
        let mut restored = earlier.residuals(&values, 3);
        earlier.restore(&mut restored, 3);
        assert_eq!(restored, values);
        assert!(earlier.residuals(&[77; 33], 3)[3..].iter().all(|v| *v == 0));
        let similar = earlier.similar(3);
        assert_eq!((similar[0], similar[3], similar[29]), (NO_ROW, 0, 26));
        assert!(similar.iter().enumerate().all(|(i, s)| *s == NO_ROW || (*s as usize) < i));
        assert!(Earlier::new(0, &[]).similar(3).is_empty());
    }
}
