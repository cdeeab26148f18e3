//! Uniformly distributed directions: the entries of a quantised light set at one distance.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::math::sphere::{SphericalDelaunay, unit};

/// Allowed numbers of directions of a set.
pub const COUNTS: RangeInclusive<usize> = 4..=4096;

/// Shifts the lattice towards the poles by this part of a step. Of the offsets from 0 to 1.2 in steps of 0.01, 1/4 has the
/// smallest covering radius from 150 points on (5 % less than the midpoints' 1/2) and is within 0.5 % of it from 50 on.
const POLE_OFFSET: f64 = 0.25;

/// Directions all around, with their triangulation.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionSet {
    triangulation: SphericalDelaunay,
}

/// A direction of a set and its angle from the one asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// Index in the set.
    pub index: usize,
    /// Angle from the direction asked for, in radians.
    pub angle: f64,
}

impl DirectionSet {
    /// A spherical Fibonacci lattice of `count` directions: the i-th at y = 1 - 2 (i + 1/4) / (count - 1/2), turned about +Y by
    /// i golden angles. The offset of 1/4 gives the smallest covering radius of the family (i + e) / (count - 1 + 2 e).
    ///
    /// Measured covering radii (largest angle to the nearest direction), beside the offset 1/2 that is common elsewhere and the
    /// bound that hexagonal packing sets:
    ///
    /// | directions | 50 | 100 | 150 | 200 | 400 | 800 |
    /// | --- | --- | --- | --- | --- | --- | --- |
    /// | covering radius, degrees | 21.32 | 14.95 | 12.17 | 10.53 | 7.44 | 5.26 |
    /// | offset 1/2 | 22.13 | 15.64 | 12.77 | 11.06 | 7.82 | 5.53 |
    /// | sqrt(8 pi / (3 sqrt 3 count)) | 17.82 | 12.60 | 10.29 | 8.91 | 6.30 | 4.46 |
    ///
    /// # Errors
    /// A count outside [`COUNTS`] (exit 3).
    pub fn fibonacci(count: usize) -> Result<Self> {
        if !COUNTS.contains(&count) {
            return Err(Error::input(format!(
                "a light set has {} to {} directions, not {count}",
                COUNTS.start(),
                COUNTS.end()
            )));
        }
        Self::new(lattice(count, POLE_OFFSET))
    }

    /// The set of these unit vectors.
    ///
    /// # Errors
    /// Those of [`SphericalDelaunay::new`] (exit 3).
    pub fn new(directions: Vec<DVec3>) -> Result<Self> {
        Ok(Self { triangulation: SphericalDelaunay::new(directions)? })
    }

    /// Number of directions.
    pub fn count(&self) -> usize {
        self.directions().len()
    }

    /// Unit vectors towards the lights.
    pub fn directions(&self) -> &[DVec3] {
        self.triangulation.points()
    }

    /// Their Delaunay triangulation.
    pub fn triangulation(&self) -> &SphericalDelaunay {
        &self.triangulation
    }

    /// The `k` directions nearest to `direction` (any length but zero), nearest first, at equal distance the lower index first.
    pub fn nearest(&self, direction: DVec3, k: usize) -> Vec<Near> {
        let direction = unit(direction);
        let mut found: Vec<(f64, usize)> = Vec::with_capacity(k.min(self.count()) + 1);
        for (index, other) in self.directions().iter().enumerate() {
            let squared = direction.distance_squared(*other);
            if found.len() < k || found.last().is_some_and(|last| squared < last.0) {
                let at = found.partition_point(|f| f.0 <= squared);
                found.insert(at, (squared, index));
                found.truncate(k);
            }
        }
        let angle = |squared: f64| 2.0 * (0.5 * squared.sqrt()).min(1.0).asin();
        found.into_iter().map(|(squared, index)| Near { index, angle: angle(squared) }).collect()
    }
}

/// A spherical Fibonacci lattice with an offset of `offset` steps from the poles.
pub fn lattice(count: usize, offset: f64) -> Vec<DVec3> {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    (0..count)
        .map(|i| {
            let y = 1.0 - 2.0 * (i as f64 + offset) / (count as f64 - 1.0 + 2.0 * offset);
            let radius = (1.0 - y * y).max(0.0).sqrt();
            let (sin, cos) = (TAU * (i as f64 * golden).fract()).sin_cos();
            DVec3::new(radius * sin, y, radius * cos)
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::sphere::random_direction;

    #[test]
    fn the_covering_radii_are_those_of_the_documentation() {
        let table = [
            (50, 21.32, 22.13),
            (100, 14.95, 15.64),
            (150, 12.17, 12.77),
            (200, 10.53, 11.06),
            (400, 7.44, 7.82),
            (800, 5.26, 5.53),
        ];
        for (count, quarter, half) in table {
            let set = |offset| DirectionSet::new(lattice(count, offset)).unwrap();
            let radius = |offset| set(offset).triangulation().covering_radius().to_degrees();
            assert!((radius(0.25) - quarter).abs() < 0.006 && (radius(0.5) - half).abs() < 0.006, "{count}");
            assert!(count < 150 || (1..9).all(|k| radius(0.05 * f64::from(k)) >= radius(0.25)), "{count}");
        }
    }

    #[test]
    fn every_count_has_a_set_of_that_size_and_others_are_refused() {
        for count in (4..200).chain([333, 1024, 2047, 4096]) {
            let set = DirectionSet::fibonacci(count).unwrap();
            assert_eq!((set.count(), set.triangulation().triangles().len()), (count, 2 * count - 4));
        }
        for count in [0, 3, 4097, usize::MAX] {
            assert!(DirectionSet::fibonacci(count).is_err());
        }
    }

    #[test]
    fn the_nearest_are_those_of_a_full_sort() {
        let set = DirectionSet::fibonacci(150).unwrap();
        for i in 0..200 {
            let direction = random_direction(1, i);
            let mut all: Vec<usize> = (0..150).collect();
            all.sort_by(|a, b| {
                let angle = |k: usize| direction.angle_between(set.directions()[k]);
                angle(*a).total_cmp(&angle(*b))
            });
            let near = set.nearest(direction * 7.0, 4);
            assert_eq!(near.iter().map(|n| n.index).collect::<Vec<_>>(), all[..4]);
            assert!(near.iter().all(|n| (n.angle - direction.angle_between(set.directions()[n.index])).abs() < 1e-7));
        }
        assert_eq!(set.nearest(DVec3::Y, 1000).len(), 150);
        assert!(set.nearest(DVec3::Y, 0).is_empty() && set.nearest(DVec3::NAN, 3).len() == 3);
    }
}
