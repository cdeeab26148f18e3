//! Splitting points into spatially compact groups of equal count: a kd-tree over positions, median by count.

use glam::DVec3;

/// A contiguous run of a permutation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Run {
    /// First position in the permutation.
    pub first: u32,
    /// One past the last.
    pub end: u32,
}

impl Run {
    /// The positions as a range of indices.
    pub fn range(self) -> std::ops::Range<usize> {
        self.first as usize..self.end as usize
    }
}

/// Axis along which the points extend most.
fn longest_axis(points: impl Iterator<Item = DVec3>) -> usize {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = points.fold(none, |(low, high), p| (low.min(p), high.max(p)));
    (high - low).max_position()
}

/// Reorders `order` (indices into `points`) so that its `k` first entries are not beyond the others along the longest
/// axis. Ties break by index, so the result depends on the points alone.
pub fn partition(order: &mut [u32], points: &[DVec3], k: usize) {
    let axis = longest_axis(order.iter().map(|&i| points[i as usize]));
    if k > 0 && k < order.len() {
        order.select_nth_unstable_by(k, |&a, &b| {
            points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
        });
    }
}

/// Sorts `order` (indices into `points`) into groups of at most `capacity` that lie close together.
///
/// All groups but the last of the recursion are full. The result does not depend on the number of threads.
pub fn groups(order: &mut [u32], points: &[DVec3], capacity: usize) -> Vec<Run> {
    fn split(order: &mut [u32], points: &[DVec3], capacity: usize, first: usize) -> Vec<Run> {
        if order.len() <= capacity {
            order.sort_unstable();
            let run = Run { first: first as u32, end: (first + order.len()) as u32 };
            return if order.is_empty() { Vec::new() } else { vec![run] };
        }
        let k = (order.len() / 2).next_multiple_of(capacity).min(order.len() - 1);
        partition(order, points, k);
        let (left, right) = order.split_at_mut(k);
        let (mut runs, rest) =
            rayon::join(|| split(left, points, capacity, first), || split(right, points, capacity, first + k));
        runs.extend(rest);
        runs
    }
    split(order, points, capacity.max(1), 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;

    #[test]
    fn groups_are_full_compact_and_a_permutation() {
        let points: Vec<DVec3> =
            (0..1000).map(|i| DVec3::new(uniform(1, i, 0), uniform(1, i, 1), uniform(1, i, 2))).collect();
        let mut order: Vec<u32> = (0..1000).collect();
        let runs = groups(&mut order, &points, 16);
        assert_eq!(runs.len(), 1000usize.div_ceil(16));
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(i, &v)| i == v as usize));
        let radius: f64 = runs
            .iter()
            .map(|r| {
                let members = &order[r.range()];
                let mean = members.iter().map(|&i| points[i as usize]).sum::<DVec3>() / members.len() as f64;
                members.iter().map(|&i| points[i as usize].distance(mean)).fold(0.0, f64::max)
            })
            .sum::<f64>()
            / runs.len() as f64;
        assert!(radius < 0.3, "mean radius {radius}");
    }

    #[test]
    fn equal_points_and_an_empty_set_are_fine() {
        let points = vec![DVec3::ONE; 40];
        let mut order: Vec<u32> = (0..40).collect();
        assert_eq!(groups(&mut order, &points, 16).len(), 3);
        assert!(groups(&mut [], &points, 16).is_empty());
    }
}
