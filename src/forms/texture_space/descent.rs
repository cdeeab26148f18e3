//! Samples for each group of receivers by the product of irradiance and R_d: a descent of the hierarchy that stops where a node, as a
//! point, is off by less than a limit. The paper names it as future work.

use glam::DVec3;
use rayon::prelude::*;

use super::light::LitMap;
use super::map::{Patch, TexelMap};
use crate::math::simd::InstructionSet;
use crate::scene::Scene;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::kernel::{Block, FlatSource, PointSource, Receiver};
use crate::transport::near_rule::{NearField, near_square};
use crate::transport::receivers::{Group, Receivers, Sphere};

/// What a group of receivers gathers from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// A node of the hierarchy, as a point.
    Node(u32),
    /// A patch on its own.
    Patch(u32),
}

/// Share of what even light brings to a place that one point may; weights have three channels of about 1.
const MOST_OF_A_POINT: f64 = 0.1 * 3.0;

/// Steps of a [`Falloff`].
const STEPS: usize = 1024;

/// R_d of the channel where it is largest, in a table: the error of a point in a node's place is about in proportion to it and to the second moment
/// of the node's flux. (Bounds on the derivatives of R_d, and points in pairs, were tried: they choose worse samples where the material is dense, and hardly
/// better ones elsewhere.)
struct Falloff {
    /// Values at distances `smooth t / (1 - t)`, t in equal steps, 1/mm^2.
    values: Vec<f64>,
    smooth_mm: f64,
    /// Largest weight times R_d of a point, however few samples are asked for: one that brings more than this to a place is a bright spot there.
    most: f64,
}

impl Falloff {
    fn new(kernel: &MediumKernel) -> Self {
        let smooth_mm = kernel.smooth_mm().max(f64::MIN_POSITIVE.sqrt());
        let at = |step: usize| {
            let t = step as f64 / STEPS as f64;
            let r = smooth_mm * t / (1.0 - t);
            kernel.profiles().iter().map(|profile| profile.reflectance(r)).fold(0.0, f64::max)
        };
        let total = kernel.total().max_element();
        Self { values: (0..STEPS).map(at).collect(), smooth_mm, most: MOST_OF_A_POINT * total }
    }

    fn at(&self, distance_mm: f64) -> f64 {
        let t = distance_mm / (distance_mm + self.smooth_mm);
        // The value before is the larger one.
        self.values.get((t * STEPS as f64) as usize).copied().unwrap_or(0.0)
    }
}

/// Kernels of the media, with what the descent needs of them.
pub(super) struct Kernels {
    media: Vec<(MediumKernel, Falloff)>,
}

impl Kernels {
    pub(super) fn new(kernels: Vec<MediumKernel>) -> Self {
        let with = |kernel: MediumKernel| {
            let falloff = Falloff::new(&kernel);
            (kernel, falloff)
        };
        Self { media: kernels.into_iter().map(with).collect() }
    }

    pub(super) fn of_part(&self, scene: &Scene, part: u32) -> Option<&MediumKernel> {
        self.at(scene, part).map(|(kernel, _)| kernel)
    }

    fn at(&self, scene: &Scene, part: u32) -> Option<&(MediumKernel, Falloff)> {
        let medium = scene.parts.parts.get(part as usize)?.medium?;
        self.media.get(medium as usize)
    }

    /// The least length on which a kernel changes, mm.
    pub(super) fn smooth_mm(&self) -> f64 {
        self.media.iter().map(|(kernel, _)| kernel.smooth_mm()).fold(f64::INFINITY, f64::min)
    }
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

/// The sources of a group, and its receivers.
#[derive(Default)]
struct Lists {
    points: Vec<(DVec3, DVec3)>,
    flats: Vec<FlatSource>,
    sources: Vec<PointSource>,
    block: Block,
}

impl Descent<'_> {
    /// Passes the sources of a group of receivers to `take`; a limit of 0 gives every patch.
    fn visit(&self, part: u32, sphere: &Sphere, limit: f64, mut take: impl FnMut(Source)) {
        let Some(root) = self.map.roots.get(part as usize).copied().flatten() else { return };
        let Some((_, falloff)) = self.kernels.at(self.scene, part) else { return };
        let mut stack = vec![root];
        while let Some(index) = stack.pop() {
            let (node, flux) = (&self.map.nodes[index as usize], &self.lit.nodes[index as usize]);
            if flux.rgb == DVec3::ZERO {
                continue;
            }
            let distance = flux.at_mm.distance(sphere.centre_mm) - sphere.radius_mm;
            let nearby = falloff.at(distance.max(0.0));
            if flux.moment * nearby < limit && flux.weight() * nearby < falloff.most {
                take(Source::Node(index));
            } else if node.is_texel {
                node.children.clone().for_each(|patch| take(Source::Patch(patch)));
            } else {
                stack.extend(node.children.clone().rev());
            }
        }
    }

    /// The limit with which receivers see `count` sources in the mean, about; 0 where every patch that is lit is no more.
    pub(super) fn limit(&self, receivers: &Receivers, count: usize) -> f64 {
        let patches = self.lit.irradiance.par_iter().filter(|e| **e != DVec3::ZERO).count();
        if patches <= count {
            return 0.0;
        }
        // The more each of them sees, the fewer say how many it is.
        let probes = (PROBES * FEW / count.max(1)).clamp(PROBES / 8, PROBES);
        let step = receivers.groups.len().div_ceil(probes).max(1);
        let probes: Vec<_> = receivers.groups.iter().step_by(step).map(|g| (g.part, receivers.sphere(*g))).collect();
        let mean = |limit: f64| {
            let of = |(part, sphere): &(u32, Sphere)| {
                let mut sources = 0usize;
                self.visit(*part, sphere, limit, |_| sources += 1);
                sources
            };
            probes.par_iter().map(of).sum::<usize>() as f64 / probes.len().max(1) as f64
        };
        let whole = (0..self.map.roots.len()).filter_map(|part| {
            let (_, falloff) = self.kernels.at(self.scene, part as u32)?;
            Some(self.lit.of_part(self.map, part).moment * falloff.at(0.0))
        });
        let largest = whole.fold(0.0, f64::max);
        // Between all patches and one point, by the logarithms of limit and number, which are nearly in proportion.
        let excess = |number: f64| (number.max(0.5) / count as f64).log2();
        let (mut low, mut high) = ((-DIGITS, excess(patches as f64)), (1.0, excess(1.0)));
        for _ in 0..STEPS_OF_LIMIT {
            let share = (low.1 / (low.1 - high.1)).clamp(0.1, 0.9);
            let middle = low.0 + share * (high.0 - low.0);
            let found = excess(mean(largest * middle.exp2()));
            if found.abs() < CLOSE {
                return largest * middle.exp2();
            }
            if found > 0.0 { low = (middle, found) } else { high = (middle, found) }
        }
        largest * high.0.exp2()
    }

    /// Sources of each group of receivers, in the order in which [`Self::radiosity`] sums them.
    #[cfg(feature = "gpu")]
    pub(super) fn sources(&self, receivers: &Receivers, limit: f64) -> Vec<Vec<Source>> {
        let of_group = |group: &Group| {
            let mut sources = Vec::new();
            self.visit(group.part, &receivers.sphere(*group), limit, |source| sources.push(source));
            sources
        };
        receivers.groups.par_iter().map(of_group).collect()
    }

    /// Radiosity of every receiver, RGB.
    pub(super) fn radiosity(&self, receivers: &Receivers, limit: f64) -> Vec<DVec3> {
        let of_group = |lists: &mut Lists, group: &Group| {
            let sphere = receivers.sphere(*group);
            let Some(kernel) = self.kernels.of_part(self.scene, group.part) else {
                return vec![DVec3::ZERO; group.run.range().len()];
            };
            lists.points.clear();
            lists.flats.clear();
            self.visit(group.part, &sphere, limit, |source| match source {
                Source::Node(index) => {
                    let flux = &self.lit.nodes[index as usize];
                    lists.points.push((flux.at_mm, flux.rgb));
                }
                Source::Patch(index) => self.patch(index, (kernel, &sphere), lists),
            });
            let sums = lists.sums((kernel, &sphere), receivers.of(*group));
            sums.iter().map(|sum| self.lit.unit * *sum).collect()
        };
        let of_groups: Vec<Vec<DVec3>> = receivers.groups.par_iter().map_init(Lists::default, of_group).collect();
        of_groups.into_iter().flatten().collect()
    }

    /// Adds one patch as finely as its distance requires.
    fn patch(&self, index: u32, (kernel, sphere): (&MediumKernel, &Sphere), lists: &mut Lists) {
        let (patch, e) = (&self.map.patches[index as usize], self.lit.irradiance[index as usize]);
        if e == DVec3::ZERO {
            return;
        }
        let Patch { centre_mm, area_mm2, radius_mm, .. } = *patch;
        let distance = (centre_mm.distance(sphere.centre_mm) - sphere.radius_mm).max(0.0);
        if distance * distance >= near_square(self.near.exact_below * radius_mm, kernel.smooth_mm()) {
            lists.points.push((centre_mm, e * area_mm2));
            return;
        }
        let irradiance = e.as_vec3().to_array();
        let triangles = self.map.outline(self.scene, patch);
        lists.flats.extend(triangles.triangles().filter_map(|t| FlatSource::new(t, irradiance, sphere.centre_mm)));
    }
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
            self.sources.clear();
            self.sources.extend(self.points.iter().map(|(at, flux)| PointSource::new(*at, *flux, centre)));
            kernel.add_points(level, &mut self.block, &self.sources);
            kernel.add_triangles(level, &mut self.block, &self.flats);
            return (0..count).map(|i| self.block.sum(i)).collect();
        }
        // R_d is the same both ways: the points side by side receive from one receiver that is on its own.
        let of_one = |receiver: Receiver, lists: &mut Self| {
            lists
                .block
                .reset(centre, lists.points.iter().map(|(at_mm, _)| Receiver { at_mm: *at_mm, normal: DVec3::ZERO }));
            kernel.add_points(level, &mut lists.block, &[PointSource::new(receiver.at_mm, DVec3::ONE, centre)]);
            let sum: DVec3 = lists.points.iter().enumerate().map(|(i, (_, flux))| *flux * lists.block.sum(i)).sum();
            lists.block.reset(centre, std::iter::once(receiver));
            kernel.add_triangles(level, &mut lists.block, &lists.flats);
            sum + lists.block.sum(0)
        };
        receivers.map(|receiver| of_one(receiver, self)).collect()
    }
}
