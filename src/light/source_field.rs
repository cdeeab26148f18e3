//! The radiance that a rectangle sends into the space around it, precomputed (source radiance field: Zhou, Hu, Lin, Guo and Shum
//! 2005, "Precomputed shadow fields for dynamic scenes"; Wang et al. 2008, section 3, use it for local area lights).
//!
//! At points of concentric spheres around the rectangle the field holds a cube map of the radiance that arrives there,
//! as sparse Haar coefficients. A place between them interpolates eight maps, and the product with an irradiance row is
//! a sparse dot product for each: the light may move, change size and radiance without a ray or a new field.
//!
//! - The points lie over the half space in front (behind, a one-sided rectangle is dark): a square grid on the octahedral map of the
//!   hemisphere, on spheres whose radii grow by the square root of 2. The innermost has that many half diagonals; nearer places get
//!   their own map instead of an interpolated one, which is exact, and where the rectangle fills much of it takes as long as a hundred
//!   shadow rays. Beyond the outermost, where the rectangle is smaller than a texel, the map is that of the outermost.
//! - A map is held over its solid angle, and the interpolated product is multiplied by the exact solid angle of the
//!   place: interpolation errs in directions alone. That halves the error of the irradiance or better (`16 x 16` points
//!   on a hemisphere: 0.7 to 1.0 % in place of 1.5 to 2.1 %; 32 x 32: 0.2 to 0.5 %; unoccluded, normals up to grazing).
//! - The maps are in world axes, as rows are. A turned rectangle is another field.

use glam::DVec3;

pub use super::validate::POINTS;

use super::rectangle_map::{RectangleMaps, Seen, UnitRectangle};
use crate::error::{Error, Result};
use crate::parallel::*;

/// Share of the sum of the squares of a map's coefficients that is dropped, the smallest first.
const DROPPED: f64 = 1e-4;

/// Height of the points at the horizon over their distance: exactly there a rectangle fills nothing.
const LEAST_HEIGHT: f64 = 1e-3;

/// Levels of the quantiser of a map's coefficients, of each sign.
const LEVELS: f64 = 32767.0;

/// The source radiance field of a rectangle of unit radiance.
pub struct SourceField {
    rectangle: UnitRectangle,
    maps: RectangleMaps,
    points: usize,
    spheres: usize,
    /// Map `i` has the coefficients `offsets[i]..offsets[i + 1]`: sphere by sphere, row by row.
    offsets: Vec<u32>,
    /// Indices of the kept coefficients of each map, ascending.
    indices: Vec<u16>,
    /// Their values, in units of the map's entry in `steps`.
    values: Vec<i16>,
    steps: Vec<f32>,
}

/// Position of a place in a field.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    /// Behind the rectangle or so far away that nothing arrives.
    Dark,
    /// Nearer than the innermost sphere.
    Near,
    /// Between these maps, with their weights.
    Among([(usize, f64); 8]),
}

impl SourceField {
    /// The field of a rectangle: cube maps of `side` texels and a grid of `points` steps along an edge.
    ///
    /// # Errors
    /// A side that is no power of two, or points out of range (exit 5).
    pub fn new(rectangle: UnitRectangle, side: usize, points: u16) -> Result<Self> {
        if !POINTS.contains(&points) {
            return Err(Error::unsupported(format!("source radiance fields have 4 to 64 points, not {points}")));
        }
        let (maps, points) = (RectangleMaps::new(side)?, usize::from(points));
        // Until the diagonal is as wide as a texel.
        let outermost = 4.0 * side as f64 / std::f64::consts::PI;
        let spheres = (1..).find(|&k| radius(k - 1) >= outermost).unwrap_or(1).max(2);
        let row = points + 1;
        let lines: Vec<Vec<Sparse>> = (0..spheres * row)
            .into_par_iter()
            .map_init(
                || maps.memory(),
                |seen, line| {
                    let map = |x: usize| {
                        let at = radius(line / row) * direction(&rectangle, points, [x, line % row]);
                        maps.see(&rectangle, at, seen);
                        Sparse::of(seen, rectangle.solid_angle(at))
                    };
                    (0..row).map(map).collect()
                },
            )
            .collect();
        let mut field = Self {
            rectangle,
            maps,
            points,
            spheres,
            offsets: vec![0],
            indices: Vec::new(),
            values: Vec::new(),
            steps: Vec::new(),
        };
        for map in lines.into_iter().flatten() {
            field.indices.extend(map.indices);
            field.values.extend(map.values);
            field.steps.push(map.step);
            field.offsets.push(field.indices.len() as u32);
        }
        Ok(field)
    }

    /// True if it is the field of this rectangle, side and number of points.
    pub fn is_of(&self, rectangle: &UnitRectangle, side: usize, points: u16) -> bool {
        self.rectangle == *rectangle && self.maps.side() == side && self.points == usize::from(points)
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice())
            + size_of_val(self.indices.as_slice())
            + size_of_val(self.values.as_slice())
            + size_of_val(self.steps.as_slice())
    }

    /// Memory of one thread for products.
    pub fn memory(&self) -> Seen {
        self.maps.memory()
    }

    /// Product of a row (all Haar coefficients, weighted by the square root of solid angles) with the radiance that
    /// arrives at a place, given in half diagonals from the centre.
    pub fn product(&self, at: DVec3, row: &[f32], memory: &mut Seen) -> f64 {
        match self.place(at) {
            Place::Dark => 0.0,
            Place::Near => self.exact(at, row, memory),
            Place::Among(maps) => {
                let sum: f64 = maps.iter().map(|&(map, weight)| weight * self.product_of_map(map, row)).sum();
                sum * self.rectangle.solid_angle(at)
            }
        }
    }

    /// [`Self::product`] with the map of the place itself, against which the interpolation is measured.
    pub fn exact(&self, at: DVec3, row: &[f32], memory: &mut Seen) -> f64 {
        if self.rectangle.solid_angle(at) <= 0.0 {
            return 0.0;
        }
        self.maps.see(&self.rectangle, at, memory);
        let face = self.maps.side() * self.maps.side();
        let faces = memory.coefficients.chunks_exact(face).zip(row.chunks_exact(face)).zip(&memory.lit);
        faces
            .filter(|(_, lit)| **lit)
            .flat_map(|((map, row), _)| map.iter().zip(row))
            .map(|(a, b)| f64::from(a * b))
            .sum()
    }

    fn product_of_map(&self, map: usize, row: &[f32]) -> f64 {
        let (Some(&from), Some(&end)) = (self.offsets.get(map), self.offsets.get(map + 1)) else { return 0.0 };
        let range = from as usize..end as usize;
        let (indices, values) = (&self.indices[range.clone()], &self.values[range]);
        // Two chains of sums in a fixed order.
        let mut sums = [0.0f32; 2];
        let mut pairs = indices.chunks_exact(2).zip(values.chunks_exact(2));
        for (index, value) in &mut pairs {
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum += f32::from(value[k]) * row.get(usize::from(index[k])).unwrap_or(&0.0);
            }
        }
        let odd = indices.len() % 2;
        for (index, value) in indices.iter().zip(values).rev().take(odd) {
            sums[0] += f32::from(*value) * row.get(usize::from(*index)).unwrap_or(&0.0);
        }
        f64::from(sums[0] + sums[1]) * f64::from(self.steps.get(map).copied().unwrap_or(0.0))
    }

    fn place(&self, at: DVec3) -> Place {
        let [u, v, n] = self.rectangle.axes();
        let square = at.length_squared();
        let height = at.dot(n);
        if !(height > 0.0 && square.is_finite()) {
            return Place::Dark;
        }
        if square <= radius(0) * radius(0) {
            return Place::Near;
        }
        // The octahedral map of the hemisphere, turned by 45 degrees so that it fills a square.
        let (x, y) = (at.dot(u), at.dot(v));
        let sum = x.abs() + y.abs() + height;
        let cell = |p: f64| {
            let p = (0.5 * (p + 1.0) * self.points as f64).clamp(0.0, self.points as f64);
            let first = (p as usize).min(self.points - 1);
            (first, p - first as f64)
        };
        let (column, row) = (cell((x + y) / sum), cell((x - y) / sum));
        let outwards = (square.log2() - 1.0).clamp(0.0, (self.spheres - 1) as f64);
        let sphere = (outwards as usize).min(self.spheres - 2);
        let sphere = (sphere, outwards - sphere as f64);
        let along =
            |(first, share): (usize, f64), bit: usize| (first + bit, if bit == 1 { share } else { 1.0 - share });
        Place::Among(std::array::from_fn(|k| {
            let [(s, a), (r, b), (c, d)] = [along(sphere, k >> 2), along(row, k >> 1 & 1), along(column, k & 1)];
            let line = self.points + 1;
            ((s * line + r) * line + c, a * b * d)
        }))
    }
}

/// Radius of a sphere in half diagonals.
fn radius(sphere: usize) -> f64 {
    (0.5 * (sphere + 1) as f64).exp2()
}

/// Unit direction of a point of the grid, in world axes.
fn direction(rectangle: &UnitRectangle, points: usize, place: [usize; 2]) -> DVec3 {
    let [p, q] = place.map(|k| 2.0 * k as f64 / points as f64 - 1.0);
    let (x, y) = (0.5 * (p + q), 0.5 * (p - q));
    let inside = DVec3::new(x, y, (1.0 - x.abs() - y.abs()).max(0.0)).normalize();
    let [u, v, n] = rectangle.axes();
    (inside.x * u + inside.y * v + inside.z.max(LEAST_HEIGHT) * n).normalize()
}

/// One map: its kept coefficients, quantised.
struct Sparse {
    indices: Vec<u16>,
    values: Vec<i16>,
    step: f32,
}

impl Sparse {
    /// The largest coefficients of a map over the solid angle in sr, quantised.
    fn of(seen: &Seen, solid_angle: f64) -> Self {
        let face = seen.coefficients.len() / seen.lit.len();
        let faces = seen.coefficients.chunks_exact(face).enumerate().filter(|(i, _)| seen.lit[*i]);
        let all = faces.flat_map(|(i, values)| values.iter().enumerate().map(move |(k, v)| (i * face + k, *v)));
        let mut all: Vec<(usize, f32)> = all.filter(|(_, v)| *v != 0.0).collect();
        // The first coefficient of a face tells its sum: it comes first, the others by size.
        let key = |&(index, value): &(usize, f32)| (index % face != 0, std::cmp::Reverse(value.abs().to_bits()), index);
        all.sort_unstable_by_key(key);
        let square = |(_, value): &(usize, f32)| f64::from(*value) * f64::from(*value);
        let mut left: f64 = all.iter().map(square).sum();
        let least = DROPPED * left;
        let count = all.iter().take_while(|entry| {
            let go_on = left > least;
            left -= square(entry);
            go_on
        });
        let count = count.count();
        all.truncate(count);
        all.sort_unstable_by_key(|(index, _)| *index);
        let largest = all.iter().map(|(_, value)| f64::from(value.abs())).fold(0.0, f64::max);
        let step = largest / LEVELS;
        let level = |value: f32| if step > 0.0 { (f64::from(value) / step).round_ties_even() as i16 } else { 0 };
        Self {
            indices: all.iter().map(|(index, _)| *index as u16).collect(),
            values: all.iter().map(|(_, value)| level(*value)).collect(),
            step: if solid_angle > 0.0 { (step / solid_angle) as f32 } else { 0.0 },
        }
    }
}

#[cfg(test)]
#[path = "source_field_tests.rs"]
mod tests;
