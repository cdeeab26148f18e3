//! Splitting points into spatially compact groups of equal count: a kd-tree over positions, median by count.

use glam::DVec3;

/// A contiguous run of a permutation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
pub fn longest_axis(points: impl Iterator<Item = DVec3>) -> usize {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in points {
        low = low.min(p);
        high = high.max(p);
    }
    let extent = high - low;
    if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    }
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
    fn split(order: &mut [u32], points: &[DVec3], capacity: usize) {
        if order.len() <= capacity {
            order.sort_unstable();
            return;
        }
        let k = (order.len() / 2).next_multiple_of(capacity).min(order.len() - 1);
        partition(order, points, k);
        let (left, right) = order.split_at_mut(k);
        rayon::join(|| split(left, points, capacity), || split(right, points, capacity));
    }
    fn runs(first: usize, len: usize, capacity: usize, out: &mut Vec<Run>) {
        if len <= capacity {
            if len > 0 {
                out.push(Run { first: first as u32, end: (first + len) as u32 });
            }
            return;
        }
        let k = (len / 2).next_multiple_of(capacity).min(len - 1);
        runs(first, k, capacity, out);
        runs(first + k, len - k, capacity, out);
    }
    let capacity = capacity.max(1);
    split(order, points, capacity);
    let mut out = Vec::new();
    runs(0, order.len(), capacity, &mut out);
    out
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
