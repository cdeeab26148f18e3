//! Triangles of the unit square, cut by the squares ("texels") of a regular grid.

use glam::DVec2;
use rayon::slice::ParallelSliceMut;

use crate::parallel::*;

/// Texture coordinates of a triangle's corners in 1/65535.
pub(super) type Codes = [[u16; 2]; 3];

/// Steps of a texture coordinate from 0 to 1.
pub(super) const STEPS: f64 = 65_535.0;

/// Binary logarithm of the number of texels of a block, a square that is cut as one task.
const BLOCK_BITS: u32 = 12;

/// Texels of a block, of the same upper bits of the Morton code.
pub(super) const BLOCK: usize = 1 << BLOCK_BITS;

/// Most pieces that triangles are cut into: above what a bijective map of 4096 x 4096 texels has, some GB.
const MOST_PIECES: f64 = (1u64 << 26) as f64;

/// Least area of a piece, over that of its triangle or of the texel, whichever is smaller: below it is rounding.
const LEAST_AREA: f64 = 1e-9;

/// A piece of a triangle in a texel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Morton code of the texel, x in the even bits.
    pub texel: u32,
    /// Area in texels; 0 for a triangle without area.
    pub area: f64,
    /// Centroid in texels.
    pub centre: DVec2,
}

/// Twice the signed area of a triangle in steps squared, exact.
pub(super) fn doubled_area([a, b, c]: &Codes) -> i64 {
    let side = |p: &[u16; 2]| [0, 1].map(|i| i64::from(p[i]) - i64::from(a[i]));
    let ([bx, by], [cx, cy]) = (side(b), side(c));
    bx * cy - by * cx
}

/// Corners in texels.
pub(super) fn in_texels(codes: &Codes, resolution: u32) -> [DVec2; 3] {
    codes.map(|[x, y]| DVec2::new(f64::from(x), f64::from(y)) * (f64::from(resolution) / STEPS))
}

/// Morton code of two numbers below 2^16, the first in the even bits.
fn morton(x: u32, y: u32) -> u32 {
    let steps = [(8, 0x00ff_00ff), (4, 0x0f0f_0f0f), (2, 0x3333_3333), (1, 0x5555_5555)];
    let spread = |v: u32| steps.iter().fold(v, |v, (shift, mask)| (v | v << shift) & mask);
    spread(x) | spread(y) << 1
}

/// The numbers of a Morton code.
pub(super) fn from_morton(code: u32) -> [u32; 2] {
    [code, code >> 1].map(|v| {
        let steps = [(1, 0x3333_3333), (2, 0x0f0f_0f0f), (4, 0x00ff_00ff), (8, 0x0000_ffff)];
        steps.iter().fold(v & 0x5555_5555, |v, (shift, mask)| (v | v >> shift) & mask)
    })
}

/// A convex polygon of up to eight corners, counter-clockwise: a triangle that at most four lines cut has seven.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Polygon {
    corners: [DVec2; 8],
    count: usize,
}

impl Polygon {
    pub(super) fn corners(&self) -> &[DVec2] {
        &self.corners[..self.count]
    }

    fn push(&mut self, corner: DVec2) {
        if self.count < self.corners.len() {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// The part where `side * (coordinate - bound) >= 0` (Sutherland and Hodgman 1974).
    fn clipped(&self, axis: usize, bound: f64, side: f64) -> Self {
        let mut result = Self::default();
        let Some(mut before) = self.corners().last().copied() else { return result };
        for &corner in self.corners() {
            let [from, to] = [before, corner].map(|p| side * (p[axis] - bound));
            if (from < 0.0 && to > 0.0) || (from > 0.0 && to < 0.0) {
                let mut crossing = before + (corner - before) * (from / (from - to));
                crossing[axis] = bound;
                result.push(crossing);
            }
            if to >= 0.0 {
                result.push(corner);
            }
            before = corner;
        }
        result
    }

    /// The part between two parallels.
    fn strip(&self, axis: usize, from: f64, to: f64) -> Self {
        self.clipped(axis, from, 1.0).clipped(axis, to, -1.0)
    }

    /// Least and largest coordinate of the corners that pass.
    fn range(&self, axis: usize, pass: impl Fn(DVec2) -> bool) -> [f64; 2] {
        let values = self.corners().iter().filter(|p| pass(**p)).map(|p| p[axis]);
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    }

    /// Area and centroid.
    fn measured(&self) -> (f64, DVec2) {
        let [first, rest @ ..] = self.corners() else { return (0.0, DVec2::ZERO) };
        let (mut doubled, mut moment) = (0.0, DVec2::ZERO);
        for pair in rest.windows(2) {
            let (a, b) = (pair[0] - first, pair[1] - first);
            let cross = a.perp_dot(b);
            doubled += cross;
            moment += cross * (a + b);
        }
        let centre = if doubled > 0.0 { first + moment / (3.0 * doubled) } else { *first };
        (0.5 * doubled, centre)
    }
}

/// The texels from `from` up to, not including, the last that a range of coordinates touches, within bounds.
fn texels([low, high]: [f64; 2], bounds: [u32; 2]) -> std::ops::Range<u32> {
    (low.floor().max(0.0) as u32).max(bounds[0])..(high.ceil().max(0.0) as u32).min(bounds[1])
}

/// A triangle in texels, counter-clockwise; `None` without area.
fn polygon(codes: &Codes, resolution: u32) -> Option<Polygon> {
    let [a, b, c] = in_texels(codes, resolution);
    let ordered = match doubled_area(codes) {
        0 => return None,
        area if area > 0 => [a, b, c],
        _ => [a, c, b],
    };
    let mut polygon = Polygon::default();
    ordered.into_iter().for_each(|corner| polygon.push(corner));
    Some(polygon)
}

/// The piece of a triangle in a texel; `None` for a triangle without area, and where rounding leaves nothing.
pub(super) fn piece_in(codes: &Codes, resolution: u32, [x, y]: [u32; 2]) -> Option<Polygon> {
    let bounds = |first: u32| (f64::from(first), f64::from(first + 1));
    let ((left, right), (low, high)) = (bounds(x), bounds(y));
    let piece = polygon(codes, resolution)?.strip(1, low, high).strip(0, left, right);
    (piece.count >= 3).then_some(piece)
}

/// The one piece of a triangle without area.
fn flat(codes: &Codes, resolution: u32) -> Piece {
    let [a, b, c] = in_texels(codes, resolution);
    let centre = (a + b + c) / 3.0;
    let [x, y] = [centre.x, centre.y].map(|v| (v as u32).min(resolution - 1));
    Piece { texel: morton(x, y), area: 0.0, centre }
}

/// Whether cutting the triangles takes a sane number of pieces.
pub(super) fn is_bounded(codes: &[Codes], resolution: u32) -> bool {
    let scale = f64::from(resolution) / STEPS;
    let bound = |codes: &Codes| {
        let sides = [0, 1].map(|i| {
            let values = codes.map(|c| f64::from(c[i]));
            values.iter().fold(0.0, |m: f64, v| m.max(*v)) - values.iter().fold(STEPS, |m: f64, v| m.min(*v))
        });
        1.0 + scale * (sides[0] + sides[1]) + 0.5 * scale * scale * doubled_area(codes).unsigned_abs() as f64
    };
    codes.iter().map(bound).sum::<f64>() <= MOST_PIECES
}

/// Blocks of texels and the triangles that touch them, ascending: `(group << 32 | block, triangle)`. A triangle without
/// a group is left out.
pub(super) fn blocks(codes: &[Codes], resolution: u32, group: impl Fn(usize) -> Option<u32> + Sync) -> Vec<(u64, u32)> {
    let side = 1 << (BLOCK_BITS / 2);
    let of = |triangle: usize| {
        let mut found = Vec::new();
        let Some(group) = group(triangle) else { return found };
        let mut push = |block: u32| found.push((u64::from(group) << 32 | u64::from(block), triangle as u32));
        match polygon(&codes[triangle], resolution) {
            None => push(flat(&codes[triangle], resolution).texel >> BLOCK_BITS),
            Some(whole) => {
                let in_blocks = |range: [f64; 2]| texels(range.map(|v| v / f64::from(side)), [0, resolution]);
                for y in in_blocks(whole.range(1, |_| true)) {
                    let row = whole.strip(1, f64::from(y * side), f64::from((y + 1) * side));
                    in_blocks(row.range(0, |_| true)).for_each(|x| push(morton(x, y)));
                }
            }
        }
        found
    };
    let mut pairs: Vec<_> = (0..codes.len()).into_par_iter().flat_map_iter(of).collect();
    pairs.par_sort_unstable();
    pairs
}

/// Calls `emit` with the pieces of a triangle in a block.
pub(super) fn pieces(codes: &Codes, resolution: u32, block: u32, mut emit: impl FnMut(Piece)) {
    let Some(whole) = polygon(codes, resolution) else { return emit(flat(codes, resolution)) };
    let least = LEAST_AREA * whole.measured().0.min(1.0);
    let bounds = from_morton(block << BLOCK_BITS).map(|first| [first, resolution.min(first + (1 << (BLOCK_BITS / 2)))]);
    for y in texels(whole.range(1, |_| true), bounds[1]) {
        let (low, high) = (f64::from(y), f64::from(y + 1));
        let row = whole.strip(1, low, high);
        // Between the chords at both ends of the row everything is inside, since the triangle is convex.
        let (below, above) = (row.range(0, |p| p.y == low), row.range(0, |p| p.y == high));
        let inside = [below[0].max(above[0]), below[1].min(above[1])];
        for x in texels(row.range(0, |_| true), bounds[0]) {
            let (left, right) = (f64::from(x), f64::from(x + 1));
            let (area, centre) = if inside[0] <= left && right <= inside[1] {
                (1.0, DVec2::new(left + 0.5, low + 0.5))
            } else {
                row.strip(0, left, right).measured()
            };
            if area > least {
                emit(Piece { texel: morton(x, y), area, centre });
            }
        }
    }
}
