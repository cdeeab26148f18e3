//! Samples for each group of receivers by the product of irradiance and R_d: a descent of the hierarchy that stops where a node, as a
//! point, is off by less than a limit. The paper names it as future work.

use std::f32::consts::TAU;

use glam::{DVec3, Vec3};

use super::falloff::{Falloff, Kernels};
use super::light::{LitMap, Walked};
use super::map::TexelMap;
use crate::error::Result;
use crate::math::simd::InstructionSet;
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::kernel::{Block, FlatSource, PointSource, Receiver};
use crate::transport::near_rule::{NearField, near_square};
use crate::transport::receivers::{Group, Receivers, Sphere};

/// What a group of receivers gathers from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// A node of the hierarchy, as a point.
    Node(u32),
    /// A patch on its own.
    Patch(u32),
}

/// Everything that a descent looks at.
#[derive(Clone, Copy)]
pub(super) struct Descent<'a> {
    pub(super) scene: &'a Scene,
    pub(super) map: &'a TexelMap,
    pub(super) lit: &'a LitMap,
    pub(super) kernels: &'a Kernels,
    pub(super) near: NearField,
}

/// Groups that the limit is found on.
const PROBES: usize = 96;

/// Sources that [`PROBES`] are for.
const FEW: usize = 400;

/// Trials of a limit at most, and how near the number has to be (binary logarithm of the ratio).
const STEPS_OF_LIMIT: usize = 12;
const CLOSE: f64 = 0.03;

/// Range of limits in binary digits below the error of the whole part as one point.
const DIGITS: f64 = 60.0;

/// Groups of receivers that tell how many sources a limit leaves: the more each of them sees, the fewer it takes.
pub(super) fn probes(receivers: &Receivers, count: usize) -> impl Iterator<Item = &Group> {
    let probes = (PROBES * FEW / count.max(1)).clamp(PROBES / 8, PROBES);
    let step = receivers.groups.len().div_ceil(probes).max(1);
    receivers.groups.iter().step_by(step)
}

/// The limit with which `mean`, the number of sources that receivers see with a limit, is `count`, about, between 0, with which they see
/// `patches`, and the `largest` error, that of all as one point; a guess is tried first.
///
/// # Errors
/// Those of `mean`.
pub(super) fn limit_for(
    count: usize,
    (patches, largest): (usize, f64),
    guess: Option<f64>,
    mut mean: impl FnMut(f64) -> Result<f64>,
) -> Result<f64> {
    if patches <= count {
        return Ok(0.0);
    }
    // Between all patches and one point, by the logarithms of limit and number, which are nearly in proportion.
    let excess = |number: f64| (number.max(0.5) / count as f64).log2();
    let (mut low, mut high) = ((-DIGITS, excess(patches as f64)), (1.0, excess(1.0)));
    let mut guess = guess.map(|limit| (limit / largest).log2()).filter(|digits| (low.0..high.0).contains(digits));
    for _ in 0..STEPS_OF_LIMIT {
        let share = (low.1 / (low.1 - high.1)).clamp(0.1, 0.9);
        let middle = guess.take().unwrap_or(low.0 + share * (high.0 - low.0));
        let found = excess(mean(largest * middle.exp2())?);
        if found.abs() < CLOSE {
            return Ok(largest * middle.exp2());
        }
        if found > 0.0 { low = (middle, found) } else { high = (middle, found) }
    }
    Ok(largest * high.0.exp2())
}

/// Extent of a node around the mean place of its light, in root-mean-square distances from there: 1.4 of a disc, 1.7 of a square, and light is
/// not spread evenly.
const EXTENT: f32 = 2.0;

/// What a disc of the node's mean square distance may bring to a place as if all of it were as near as its nearest point, over what a point may
/// bring (of three channels) before it is opened: little, so that nothing hangs on the last bit of a distance.
const MOST_OF_EXTENT: f32 = 0.25 / 3.0;

/// Neighbouring groups that look at the top of the hierarchy together.
const TOGETHER: usize = 16;

/// What neighbouring groups find at the top of the hierarchy together, in the order of a walk: nodes that are points to all of them, and nodes
/// that each has to look at.
type Frontier = Vec<(u32, bool)>;

/// The sources of a group relative to its centre, and its receivers.
#[derive(Default)]
struct Lists {
    frontier: Frontier,
    sources: Vec<PointSource>,
    flats: Vec<FlatSource>,
    block: Block,
}

/// A walk with a limit around a place.
struct Walk<'a> {
    walked: &'a [Walked],
    falloff: &'a Falloff,
    limit: f32,
}

impl Walk<'_> {
    /// True if a node that is so far away, mm, is no point.
    #[inline(always)]
    fn opens(&self, node: &Walked, distance_mm: f32) -> bool {
        let distance_mm = distance_mm.max(0.0);
        let nearby = self.falloff.at(distance_mm);
        if node.moment * nearby >= self.limit || node.weight * nearby >= self.falloff.most {
            return true;
        }
        // Where light leaves within less than a node's extent of where it enters, a place in the node gets nothing from its centre. Of how
        // bright the node is this says nothing, so that it is the same in every unit.
        let (square_mm2, most) = (node.moment / node.weight, MOST_OF_EXTENT * self.falloff.most);
        if TAU * square_mm2 * self.falloff.at(0.0) < most {
            return false;
        }
        TAU * square_mm2 * self.falloff.at((distance_mm - EXTENT * square_mm2.sqrt()).max(0.0)) >= most
    }

    /// Passes what is at and below a node to `take`, as a sphere sees it.
    #[inline(always)]
    fn below(&self, top: u32, (centre, radius): (Vec3, f32), take: &mut impl FnMut(Source)) {
        let Some(end) = self.walked.get(top as usize).map(|node| node.next) else { return };
        let mut index = top;
        while let Some(node) = self.walked.get(index as usize).filter(|_| index < end) {
            let [first, last] = node.patches;
            if node.weight <= 0.0 {
                index = node.next;
            } else if !self.opens(node, Vec3::from(node.at_mm).distance(centre) - radius) {
                take(Source::Node(index));
                index = node.next;
            } else if first < last {
                (first..last).for_each(|patch| take(Source::Patch(patch)));
                index = node.next;
            } else {
                index += 1;
            }
        }
    }

    /// What spheres inside another one have in common.
    fn frontier(&self, top: u32, (centre, radius): (Vec3, f32), out: &mut Frontier) {
        out.clear();
        let Some(end) = self.walked.get(top as usize).map(|node| node.next) else { return };
        let mut index = top;
        while let Some(node) = self.walked.get(index as usize).filter(|_| index < end) {
            let distance = Vec3::from(node.at_mm).distance(centre);
            let [first, last] = node.patches;
            if node.weight <= 0.0 {
                index = node.next;
            } else if !self.opens(node, distance - radius) {
                out.push((index, true));
                index = node.next;
            } else if first < last || !self.opens(node, distance + radius) {
                out.push((index, false));
                index = node.next;
            } else {
                index += 1;
            }
        }
    }
}

impl Descent<'_> {
    /// The walk of a part and its top; none of opaque or dark parts.
    fn walk(&self, part: u32, limit: f64) -> Option<(Walk<'_>, u32)> {
        let root = self.map.roots.get(part as usize).copied().flatten()?;
        let (_, falloff) = self.kernels.at(self.scene, part)?;
        Some((Walk { walked: &self.lit.walked, falloff, limit: limit as f32 }, root))
    }

    /// The limit with which receivers see `count` sources in the mean, about; 0 where every patch that is lit is no more. A guess is tried first.
    pub(super) fn limit(&self, receivers: &Receivers, count: usize, guess: Option<f64>) -> f64 {
        let patches = self.lit.irradiance.iter().filter(|e| **e != DVec3::ZERO).count();
        let whole = (0..self.map.roots.len()).filter_map(|part| {
            let (_, falloff) = self.kernels.at(self.scene, part as u32)?;
            Some(self.lit.of_part(self.map, part).moment * f64::from(falloff.at(0.0)))
        });
        let largest = whole.fold(0.0, f64::max);
        let probes: Vec<_> = probes(receivers, count).map(|g| (g.part, single(&receivers.sphere(*g)))).collect();
        let mean = |limit: f64| {
            let of = |(part, sphere): &(u32, (Vec3, f32))| {
                let mut sources = 0usize;
                if let Some((walk, root)) = self.walk(*part, limit) {
                    walk.below(root, *sphere, &mut |_| sources += 1);
                }
                sources
            };
            Ok(probes.par_iter().map(of).reduce(|| 0, usize::wrapping_add) as f64 / probes.len().max(1) as f64)
        };
        // Counting does not fail.
        limit_for(count, (patches, largest), guess, mean).unwrap_or(0.0)
    }

    /// Radiosity of every receiver, RGB; a limit of 0 takes every patch.
    pub(super) fn radiosity(&self, receivers: &Receivers, limit: f64) -> Vec<DVec3> {
        let of_groups = |lists: &mut Lists, groups: &&[Group]| {
            let mut out = Vec::new();
            for groups in groups.chunk_by(|a, b| a.part == b.part) {
                self.of_groups(lists, (receivers, groups), limit, &mut out);
            }
            out
        };
        let groups: Vec<&[Group]> = receivers.groups.chunks(TOGETHER).collect();
        let of_groups: Vec<Vec<DVec3>> = groups.par_iter().map_init(Lists::default, of_groups).collect();
        of_groups.into_iter().flatten().collect()
    }

    /// Appends the radiosity of neighbouring groups of a part.
    fn of_groups(
        &self,
        lists: &mut Lists,
        (receivers, groups): (&Receivers, &[Group]),
        limit: f64,
        out: &mut Vec<DVec3>,
    ) {
        let Some(part) = groups.first().map(|group| group.part) else { return };
        let (Some(kernel), Some((walk, root))) = (self.kernels.of_part(self.scene, part), self.walk(part, limit))
        else {
            let count = groups.iter().map(|group| group.run.range().len()).sum::<usize>();
            out.resize(out.len() + count, DVec3::ZERO);
            return;
        };
        let spheres: Vec<Sphere> = groups.iter().map(|group| receivers.sphere(*group)).collect();
        let centres: Vec<DVec3> = spheres.iter().map(|sphere| sphere.centre_mm).collect();
        let middle = Sphere::around(&centres).centre_mm;
        let around = |s: &Sphere| s.centre_mm.distance(middle) + s.radius_mm;
        let radius = spheres.iter().map(around).fold(0.0, f64::max);
        let mut frontier = std::mem::take(&mut lists.frontier);
        walk.frontier(root, (middle.as_vec3(), radius as f32), &mut frontier);
        for (group, sphere) in groups.iter().zip(&spheres) {
            lists.sources.clear();
            lists.flats.clear();
            let (centre, radius) = single(sphere);
            let mut take = |source: Source| match source {
                Source::Node(index) => {
                    let node = &self.lit.walked[index as usize];
                    let at = (Vec3::from(node.at_mm) - centre).to_array();
                    lists.sources.push(PointSource { at, flux: node.rgb });
                }
                Source::Patch(index) => self.patch(index, (kernel, sphere), lists),
            };
            for (node, is_point) in &frontier {
                if *is_point {
                    take(Source::Node(*node));
                } else {
                    walk.below(*node, (centre, radius), &mut take);
                }
            }
            let sums = lists.sums((kernel, sphere), receivers.of(*group));
            out.extend(sums.iter().map(|sum| self.lit.unit * *sum));
        }
        lists.frontier = frontier;
    }

    /// Adds one patch as finely as its distance requires.
    fn patch(&self, index: u32, (kernel, sphere): (&MediumKernel, &Sphere), lists: &mut Lists) {
        let lit = &self.lit.patches[index as usize];
        let [red, green, blue] = lit.flux;
        if red.max(green).max(blue) <= 0.0 {
            return;
        }
        let (centre, offset) = (sphere.centre_mm, DVec3::from(lit.at_mm.map(f64::from)) - sphere.centre_mm);
        let distance = (offset.length() - sphere.radius_mm).max(0.0);
        let length_mm = self.near.exact_below * f64::from(lit.radius_mm);
        if distance * distance >= near_square(length_mm, kernel.smooth_mm()) {
            lists.sources.push(PointSource { at: offset.as_vec3().to_array(), flux: lit.flux });
            return;
        }
        let (patch, e) = (&self.map.patches[index as usize], self.lit.irradiance[index as usize]);
        let irradiance = e.as_vec3().to_array();
        let triangles = self.map.outline(self.scene, patch);
        lists.flats.extend(triangles.triangles().filter_map(|t| FlatSource::new(t, irradiance, centre)));
    }
}

/// A sphere in single precision.
fn single(sphere: &Sphere) -> (Vec3, f32) {
    (sphere.centre_mm.as_vec3(), sphere.radius_mm as f32)
}

impl Lists {
    /// What the sources bring to some receivers.
    fn sums(
        &mut self,
        (kernel, sphere): (&MediumKernel, &Sphere),
        receivers: impl ExactSizeIterator<Item = Receiver>,
    ) -> Vec<DVec3> {
        let (level, centre, count) = (InstructionSet::detect(), sphere.centre_mm, receivers.len());
        if count > 1 {
            self.block.reset(centre, receivers);
            kernel.add_points(level, &mut self.block, &self.sources);
            kernel.add_triangles(level, &mut self.block, &self.flats);
            return (0..count).map(|i| self.block.sum(i)).collect();
        }
        // R_d is the same both ways: the points side by side receive from one receiver that is on its own.
        let of_one = |receiver: Receiver, lists: &mut Self| {
            let point = |s: &PointSource| Receiver { at_mm: s.at.map(f64::from).into(), normal: DVec3::ZERO };
            lists.block.reset(DVec3::ZERO, lists.sources.iter().map(point));
            kernel.add_points(level, &mut lists.block, &[PointSource::new(receiver.at_mm, DVec3::ONE, centre)]);
            let flux = lists.sources.iter().map(|s| DVec3::from(s.flux.map(f64::from)));
            let sum: DVec3 = flux.enumerate().map(|(i, flux)| flux * lists.block.sum(i)).sum();
            lists.block.reset(centre, std::iter::once(receiver));
            kernel.add_triangles(level, &mut lists.block, &lists.flats);
            sum + lists.block.sum(0)
        };
        receivers.map(|receiver| of_one(receiver, self)).collect()
    }
}
