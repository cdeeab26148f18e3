//! Lower bounds of the distance of every point of space from a surface: flights that are shorter need no ray.
//!
//! A grid over the bounding box. A cell that the surface may touch has no clearance; any other has the distance between
//! its box and the nearest of those, which is a lower bound for all of its points. Cells that are connected to the
//! border without the surface in between are outside.

use glam::{DVec3, UVec3};

use crate::geometry::samples::bisect;
use crate::parallel::*;

/// A lower bound of the distance of a point to the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Clearance {
    /// The surface is farther than this, in mm; 0 where it may be near.
    AtLeast(f64),
    /// The point is outside.
    Outside,
}

/// Lower bounds of the distance to a surface.
#[derive(Clone, Debug)]
pub(super) struct ClearanceGrid {
    low: DVec3,
    inverse_cell: f64,
    size: UVec3,
    /// Distance of each cell in units of `unit_mm`; [`OUTSIDE`] outside.
    codes: Vec<u8>,
    unit_mm: f64,
}

const OUTSIDE: u8 = 255;

/// Distances are known up to this many cells.
const REACH: usize = 24;

/// Codes in a cell's width; `REACH` times this fits below [`OUTSIDE`].
const UNITS_PER_CELL: f64 = 8.0;

/// Empty cells around the bounding box.
const BORDER: f64 = 3.0;

/// Cells for each triangle, and bounds of their number: most flights in a fine mesh need no ray, none costs memory.
const CELLS_PER_TRIANGLE: usize = 512;
const CELLS: std::ops::RangeInclusive<usize> = (1 << 16)..=(1 << 22);

/// A cell is this share of the mean free path where the bounds allow it.
const SHARE_OF_FREE_PATH: f64 = 0.2;

impl ClearanceGrid {
    /// A grid for triangles in mm and a medium whose mean free path is `free_path_mm` (infinite is fine).
    pub(super) fn new(triangles: &[[DVec3; 3]], free_path_mm: f64) -> Self {
        let grow = |(low, high): (DVec3, DVec3), c: &DVec3| (low.min(*c), high.max(*c));
        let (low, high) = triangles.iter().flatten().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), grow);
        if !(low.is_finite() && high.is_finite()) {
            return Self { low: DVec3::ZERO, inverse_cell: 1.0, size: UVec3::ZERO, codes: Vec::new(), unit_mm: 0.0 };
        }
        let extent = (high - low).max(DVec3::splat(1e-6 * (high - low).max_element())).max(DVec3::splat(1e-12));
        let most = (CELLS_PER_TRIANGLE.saturating_mul(triangles.len())).clamp(*CELLS.start(), *CELLS.end());
        let mut cell = (SHARE_OF_FREE_PATH * free_path_mm).min(extent.max_element() / 8.0);
        let count = |cell: f64| (extent / cell + 2.0 * BORDER + 1.0).map(f64::floor);
        while count(cell).element_product() > most as f64 {
            cell *= 1.05;
        }
        let size = count(cell).as_uvec3();
        let low = low - BORDER * cell;
        let mut grid = Self {
            low,
            inverse_cell: 1.0 / cell,
            size,
            codes: Vec::new(),
            // A little less than the truth, for the rounding of coordinates and codes.
            unit_mm: (1.0 - 1e-6) * cell / UNITS_PER_CELL,
        };
        let mut near = vec![false; (size.x * size.y * size.z) as usize];
        for triangle in triangles {
            grid.mark(*triangle, &mut near);
        }
        grid.codes = grid.encode(&near);
        grid
    }

    /// A lower bound of the distance of a point to the surface.
    #[inline(always)]
    pub(super) fn at(&self, point: DVec3) -> Clearance {
        let scaled = (point - self.low) * self.inverse_cell;
        // Negative values and NaN become 0, a cell of the border, which is outside.
        let (x, y, z) = (scaled.x as u32, scaled.y as u32, scaled.z as u32);
        if x >= self.size.x || y >= self.size.y || z >= self.size.z {
            return Clearance::Outside;
        }
        match self.codes.get(((z * self.size.y + y) * self.size.x + x) as usize) {
            Some(&code) if code != OUTSIDE => Clearance::AtLeast(f64::from(code) * self.unit_mm),
            _ => Clearance::Outside,
        }
    }

    /// The radius of a ball around a point that the surface does not enter, in mm; 0 where none is known.
    #[inline(always)]
    pub(super) fn free(&self, point: DVec3) -> f64 {
        match self.at(point) {
            Clearance::AtLeast(clear) => clear,
            Clearance::Outside => 0.0,
        }
    }

    fn index(&self, x: u32, y: u32, z: u32) -> usize {
        ((z * self.size.y + y) * self.size.x + x) as usize
    }

    /// Marks the cells around a triangle: those of the boxes around pieces of it, and their neighbours.
    ///
    /// Once the neighbours are marked, the distance between the nearest points of two cells is that between the indices of one
    /// and of the other's nearest neighbour, axis by axis.
    fn mark(&self, triangle: [DVec3; 3], near: &mut [bool]) {
        let mut stack = vec![triangle];
        while let Some(corners) = stack.pop() {
            let [a, b, c] = corners.map(|c| (c - self.low) * self.inverse_cell);
            let (low, high) = (a.min(b).min(c) - 1e-4, a.max(b).max(c) + 1e-4);
            if (high - low).max_element() > 1.0 {
                stack.extend(bisect(corners));
                continue;
            }
            let from = (low - 1.0).max(DVec3::ZERO).as_uvec3();
            let to = (high + 1.0).as_uvec3().min(self.size - 1);
            for z in from.z..=to.z {
                for y in from.y..=to.y {
                    let first = self.index(from.x, y, z);
                    near[first..=first + (to.x - from.x) as usize].fill(true);
                }
            }
        }
    }

    /// Codes of all cells: distances to the marked ones, [`OUTSIDE`] outside.
    fn encode(&self, near: &[bool]) -> Vec<u8> {
        let far = (REACH * REACH) as u16;
        let (nx, nxy) = (self.size.x as usize, (self.size.x * self.size.y) as usize);
        let mut squares: Vec<u16> = near.iter().map(|&n| if n { 0 } else { far }).collect();
        squares.par_chunks_mut(nx).for_each(distances_in_row);
        // Along y and z every row takes the least over its neighbours, whole rows at a time.
        squares = lower_along(&squares, nx, nxy);
        squares = lower_along(&squares, nxy, squares.len());
        let mut codes: Vec<u8> =
            squares.par_iter().map(|&s| (f64::from(s).sqrt() * UNITS_PER_CELL).floor() as u8).collect();
        self.flood(near, &mut codes);
        codes
    }

    /// Marks as outside the cells connected to the first one, a corner of the border.
    fn flood(&self, near: &[bool], codes: &mut [u8]) {
        let mut stack = vec![UVec3::ZERO];
        codes[0] = OUTSIDE;
        while let Some(cell) = stack.pop() {
            for axis in 0..3 {
                for step in [u32::MAX, 1] {
                    let mut next = cell;
                    next[axis] = next[axis].wrapping_add(step);
                    if next[axis] >= self.size[axis] {
                        continue;
                    }
                    let index = self.index(next.x, next.y, next.z);
                    if !near[index] && codes[index] != OUTSIDE {
                        codes[index] = OUTSIDE;
                        stack.push(next);
                    }
                }
            }
        }
    }
}

/// Lowers the values of a row to the squared distances to the row's nearest zero.
fn distances_in_row(row: &mut [u16]) {
    let mut distance = REACH;
    let mut next = |value: &mut u16| {
        distance = if *value == 0 { 0 } else { (distance + 1).min(REACH) };
        *value = (*value).min((distance * distance) as u16);
    };
    row.iter_mut().for_each(&mut next);
    row.iter_mut().rev().for_each(&mut next);
}

/// `min over k of values[i + k stride] + k^2` within blocks of `block` values.
fn lower_along(values: &[u16], stride: usize, block: usize) -> Vec<u16> {
    let mut result = values.to_vec();
    result.par_chunks_mut(stride).enumerate().for_each(|(row, out)| {
        let (first, rows) = (row * stride / block * block / stride, block / stride);
        let position = row - first;
        for other in position.saturating_sub(REACH)..(position + REACH + 1).min(rows) {
            let square = other.abs_diff(position).pow(2) as u16;
            let start = (first + other) * stride;
            for (out, value) in out.iter_mut().zip(&values[start..start + stride]) {
                *out = (*out).min(value + square);
            }
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::math::random::uniform;

    fn corners(model: &crate::geometry::source::SourceModel) -> Vec<[DVec3; 3]> {
        let mesh = crate::transport::test_scene::mesh_of(model.clone());
        (0..mesh.triangles.len() as u32).map(|t| mesh.corners_local_mm(t)).collect()
    }

    fn distance_to(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
        // By brute force over a fine lattice of the triangle, plus nothing: an upper bound of the distance.
        (0..=20)
            .flat_map(|i| (0..=20 - i).map(move |j| (f64::from(i) / 20.0, f64::from(j) / 20.0)))
            .map(|(u, v)| p.distance(a + u * (b - a) + v * (c - a)))
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn no_point_is_nearer_to_the_surface_than_its_clearance_says_and_the_bound_is_useful() {
        for (model, free) in [(shapes::bumpy_head(10.0, 2), 0.5), (shapes::cuboid(DVec3::new(9.0, 4.0, 6.0), 1), 0.3)] {
            let triangles = corners(&model);
            let grid = ClearanceGrid::new(&triangles, free);
            let (mut ratio, mut count) = (0.0, 0);
            for i in 0..400 {
                let p = 10.0 * (DVec3::from_array([0, 1, 2].map(|k| uniform(1, i, k))) - 0.5);
                let distance = triangles.iter().map(|t| distance_to(p, *t)).fold(f64::INFINITY, f64::min);
                if let Clearance::AtLeast(clear) = grid.at(p) {
                    assert!(clear <= distance, "{p}: {clear} {distance}");
                    ratio += clear / distance;
                    count += 1;
                }
            }
            assert!(count > 50 && ratio / f64::from(count) > 0.15, "{ratio} {count}");
        }
    }

    #[test]
    fn outside_is_outside_and_the_inside_is_not() {
        let grid = ClearanceGrid::new(&corners(&shapes::icosphere(10.0, 3)), 1.0);
        for i in 0..2000 {
            let p = 30.0 * (DVec3::from_array([0, 1, 2].map(|k| uniform(2, i, k))) - 0.5);
            match grid.at(p) {
                Clearance::Outside => assert!(p.length() > 9.8, "{p}"),
                Clearance::AtLeast(_) => assert!(p.length() < 12.0, "{p}"),
            }
        }
        assert_eq!(grid.at(DVec3::NAN), Clearance::Outside);
        assert_eq!(grid.at(DVec3::splat(1e300)), Clearance::Outside);
        assert_eq!(ClearanceGrid::new(&[], 1.0).at(DVec3::ZERO), Clearance::Outside);
    }
}
