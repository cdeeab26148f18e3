//! Lists of the sources close to each group of receivers, for every stage that sums close pairs in its own way.

use glam::DVec3;

use super::receivers::Receivers;
use super::surface::Surface;
use crate::geometry::cluster::Run;
use crate::geometry::samples::Patch;
use crate::parallel::*;

/// For each group of neighbouring points, the sources within reach of some of them.
#[derive(Clone, Debug, Default)]
pub struct ClosePairs {
    /// Sources of group `g` are `sources[offsets[g]..offsets[g + 1]]`.
    offsets: Vec<usize>,
    sources: Vec<u32>,
}

impl ClosePairs {
    /// Finds the sources that are nearer to some point of each group than their own reach, mm.
    pub fn new(sources: &[DVec3], reach_mm: impl Fn(usize) -> f64 + Sync, points: &[DVec3], groups: &[Run]) -> Self {
        Self::of_lists(&search((sources, 0), &reach_mm, points, groups))
    }

    /// Finds the samples of each group's own part that are nearer to some receiver of it than their reach, mm.
    pub fn of_samples(surface: &Surface, receivers: &Receivers, reach_mm: impl Fn(&Patch) -> f64 + Sync) -> Self {
        let centres: Vec<DVec3> = surface.patches.iter().map(|patch| patch.centre_mm).collect();
        let reach_mm = |sample: usize| reach_mm(&surface.patches[sample]);
        let mut lists = Vec::with_capacity(receivers.groups.len());
        for groups in receivers.groups.chunk_by(|a, b| a.part == b.part) {
            let samples = surface.samples.part(groups[0].part as usize);
            let runs: Vec<Run> = groups.iter().map(|group| group.run).collect();
            let first = samples.start;
            lists.extend(search((&centres[samples], first), &reach_mm, &receivers.positions, &runs));
        }
        Self::of_lists(&lists)
    }

    fn of_lists(lists: &[Vec<u32>]) -> Self {
        let ends = lists.iter().scan(0, |end, list| {
            *end += list.len();
            Some(*end)
        });
        Self { offsets: std::iter::once(0).chain(ends).collect(), sources: lists.concat() }
    }

    /// Sources of a group, ascending.
    #[inline]
    pub fn of(&self, group: usize) -> &[u32] {
        self.offsets.get(group..group + 2).and_then(|o| self.sources.get(o[0]..o[1])).unwrap_or(&[])
    }

    /// Offsets of the groups' lists, one more than there are groups, and the sources, list after list.
    #[cfg(feature = "gpu")]
    pub(crate) fn flat(&self) -> (&[usize], &[u32]) {
        (&self.offsets, &self.sources)
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.offsets.as_slice()) + size_of_val(self.sources.as_slice())
    }
}

/// Corners of a bounding box, mm.
type Bounds = (DVec3, DVec3);

fn bounds(boxes: impl Iterator<Item = Bounds>) -> Bounds {
    boxes.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), (c, d)| (a.min(c), b.max(d)))
}

/// Squared distance of two boxes, mm^2.
fn apart((low, high): &Bounds, (from, to): &Bounds) -> f64 {
    (*low - *to).max(*from - *high).max(DVec3::ZERO).length_squared()
}

/// The list of each group, ascending. Sources are numbered from `first` on, in an order that keeps neighbours together.
fn search(
    (sources, first): (&[DVec3], usize),
    reach_mm: &(impl Fn(usize) -> f64 + Sync),
    points: &[DVec3],
    groups: &[Run],
) -> Vec<Vec<u32>> {
    const RUN: usize = 16;
    let reach2: Vec<f64> = (first..first + sources.len()).map(|source| reach_mm(source).powi(2)).collect();
    let largest = |reach2: &[f64]| reach2.iter().copied().fold(0.0, f64::max);
    let of_run = |(run, reach2): (&[DVec3], &[f64])| (bounds(run.iter().map(|p| (*p, *p))), largest(reach2));
    let runs: Vec<(Bounds, f64)> = sources.chunks(RUN).zip(reach2.chunks(RUN)).map(of_run).collect();
    let of_runs = |runs: &[(Bounds, f64)]| {
        (bounds(runs.iter().map(|run| run.0)), runs.iter().map(|run| run.1).fold(0.0, f64::max))
    };
    let upper: Vec<(Bounds, f64)> = runs.chunks(RUN).map(of_runs).collect();
    let of_group = |run: &Run| {
        let members = &points[run.range()];
        let own = bounds(members.iter().map(|p| (*p, *p)));
        let is_near = |(_, (bounds, reach2)): &(usize, &(Bounds, f64))| apart(bounds, &own) < *reach2;
        let mut found = Vec::new();
        for (u, _) in upper.iter().enumerate().filter(is_near) {
            for (r, _) in runs.iter().enumerate().skip(u * RUN).take(RUN).filter(is_near) {
                let near = |i: &usize| members.iter().any(|p| p.distance_squared(sources[*i]) < reach2[*i]);
                let end = (r * RUN + RUN).min(sources.len());
                found.extend((r * RUN..end).filter(near).map(|i| (first + i) as u32));
            }
        }
        found
    };
    groups.par_iter().map(of_group).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{cluster, shapes};
    use crate::math::random::uniform;
    use crate::transport::receivers::Group;
    use crate::transport::test_scene::{Fixture, named};

    #[test]
    fn lists_are_what_all_pairs_say() {
        let points: Vec<DVec3> =
            (0..700).map(|i| DVec3::new(uniform(5, i, 0), uniform(5, i, 1), 0.2 * uniform(5, i, 2))).collect();
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let groups = cluster::groups(&mut order, &points, 16);
        let points: Vec<DVec3> = order.iter().map(|&i| points[i as usize]).collect();
        for reach in [0.0, 0.01, 0.1, 0.5, 10.0, f64::INFINITY] {
            // The same reach for all, and one for each.
            for spread in [0.0, 3.0] {
                let reach = |source: usize| reach * (1.0 + spread * uniform(6, source as u64, 0));
                let found = ClosePairs::new(&points, reach, &points, &groups);
                for (group, run) in groups.iter().enumerate() {
                    let near = |&i: &u32| {
                        points[run.range()].iter().any(|p| p.distance(points[i as usize]) < reach(i as usize))
                    };
                    let expected: Vec<u32> = (0..points.len() as u32).filter(near).collect();
                    assert_eq!(found.of(group), expected);
                }
                assert!(found.of(groups.len()).is_empty());
            }
        }
    }

    #[test]
    fn samples_are_close_to_receivers_of_their_own_part() {
        let mut fixture = Fixture::new(shapes::icosphere(2.0, 2), named("marble"), 600);
        let (half, all) = (250, fixture.patches.len() as u32);
        fixture.samples.part_offsets = vec![0, half, all];
        let positions: Vec<DVec3> = fixture.patches[..64].iter().map(|patch| patch.centre_mm).collect();
        let group = |first: u32, part| Group { run: Run { first, end: first + 16 }, part };
        let receivers = Receivers {
            positions,
            groups: vec![group(0, 0), group(16, 0), group(32, 1), group(48, 1)],
            ..Receivers::default()
        };
        let close = ClosePairs::of_samples(&fixture.surface(), &receivers, |_| 1e3);
        for (index, group) in receivers.groups.iter().enumerate() {
            let of_part = if group.part == 0 { 0..half } else { half..all };
            assert!(close.of(index).iter().copied().eq(of_part));
        }
    }
}
