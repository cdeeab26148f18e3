//! Gathers the flux of all samples at the receivers: B(x) = Int_A R_d(|x - y|) E(y) dA, all pairs or through the tree.
//!
//! A patch is integrated as flat triangles in closed form, at three points, or at its centroid, depending on its size
//! against its distance and the depth of the real source, because R_d is smooth on the scale of sqrt(d^2 + z_r^2). The
//! patch under the receiver is never skipped.

use glam::DVec3;
use rayon::prelude::*;

use super::irradiance::Pieces;
use super::kernel::double_layer::Moment;
use super::kernel::medium::{KernelsOfParts, MediumKernel};
use super::kernel::{Block, FlatSource, PointSource};
use super::near_rule::{NearField, near_square, three_points};
use super::receivers::{Group, Receivers, Sphere};
use super::sample_light::SampleLight;
use super::surface::Surface;
use super::tree::{Cluster, SampleTree, Visit};
use crate::geometry::samples;
use crate::math::simd::InstructionSet;
use crate::medium::material::Medium;
use crate::progress::Progress;

/// Organisation of the sum over samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scheme {
    /// Every sample with every receiver.
    AllPairs,
    /// Clusters that look small from the receivers stand for their samples (Jensen & Buhler 2002).
    Hierarchical {
        /// Condition under which a cluster is small enough.
        criterion: Criterion,
    },
}

/// Condition under which a cluster may stand for its samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Area / distance^2 below this many steradians (Jensen & Buhler 2002).
    SolidAngle(f64),
    /// A bound on the second-order error of the cluster's kernel below this fraction of the total reflectance times the
    /// part's mean irradiance: flux R_d(d) (radius (sigma_tr + 3 / d))^2 / 6, d the shortest distance.
    KernelBound(f64),
}

/// Surface, tree and media of a gather, without the light.
pub struct Gather<'a> {
    surface: Surface<'a>,
    tree: &'a SampleTree,
    /// Kernels, and which of them each part has.
    kernels: Vec<MediumKernel>,
    of_part: Vec<Option<u32>>,
    /// Factors of the samples, RGB; empty where there are none.
    factors: &'a [DVec3],
    near: NearField,
    /// Whether what is near some of the receivers of a wide group is summed for each alone.
    one_by_one: bool,
    level: InstructionSet,
}

/// Light on the samples and in the clusters of the tree.
pub struct Lit<'a> {
    light: SampleLight<'a>,
    clusters: Vec<Cluster>,
    /// Flux times normal of each cluster, by channel, where a kernel has a double layer; else empty.
    moments: Vec<[DVec3; 3]>,
    /// Mean factor of the samples of each cluster, RGB; empty where there are none.
    factors: Vec<DVec3>,
}

/// Source that a group of receivers gathers from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A cluster of the light's tree, by its index.
    Cluster(u32),
    /// A sample.
    Patch(u32),
}

/// Sources that one group of receivers sees.
#[derive(Default)]
pub(in crate::transport) struct Lists {
    points: Vec<PointSource>,
    /// Moments of the points, for kernels with a double layer.
    moments: Vec<Moment>,
    flats: Vec<FlatSource>,
    block: Block,
    /// Of receivers that are far apart: what is near some of them, and what each has of that, gathered alone.
    around: Vec<u32>,
    alone: Vec<DVec3>,
}

impl Lists {
    /// Adds a point, a piece of surface with a normal; `layers` where the kernel has a double layer.
    fn add(&mut self, layers: bool, (at_mm, flux, normal): (DVec3, DVec3, DVec3), centre_mm: DVec3) {
        self.points.push(PointSource::new(at_mm, flux, centre_mm));
        if layers {
            self.moments.push(Moment::of_facet(flux, normal));
        }
    }
}

impl<'a> Gather<'a> {
    /// A gather in the given media (a change of material is another `Gather`).
    pub fn new(surface: &Surface<'a>, tree: &'a SampleTree, media: &[Medium], near: NearField) -> Self {
        Self::with_kernels(surface, tree, MediumKernel::of_media(media), near)
    }

    /// [`Self::new`] with existing kernels of the media.
    pub fn with_kernels(
        surface: &Surface<'a>,
        tree: &'a SampleTree,
        media: Vec<MediumKernel>,
        near: NearField,
    ) -> Self {
        let of_part = surface.domain.parts.parts.iter().map(|part| part.medium).collect();
        Self::with_kernels_of_parts(surface, tree, (media, of_part), near)
    }

    /// [`Self::new`] with kernels, and which of them each part has.
    pub fn with_kernels_of_parts(
        surface: &Surface<'a>,
        tree: &'a SampleTree,
        (kernels, of_part): (Vec<MediumKernel>, Vec<Option<u32>>),
        near: NearField,
    ) -> Self {
        Self {
            surface: *surface,
            tree,
            kernels,
            of_part,
            factors: &[],
            near,
            one_by_one: false,
            level: InstructionSet::detect(),
        }
    }

    /// A gather with calibrated kernels, and which of them each part has; `factors` are those of the samples, RGB.
    pub fn calibrated(
        surface: &Surface<'a>,
        tree: &'a SampleTree,
        (kernels, factors): (&KernelsOfParts, &'a [DVec3]),
        near: NearField,
    ) -> Self {
        Self { factors, ..Self::with_kernels_of_parts(surface, tree, kernels.clone(), near) }
    }

    /// The same for receivers that may be far apart: what is near some of a group is no nearer than it is to each.
    #[must_use]
    pub fn one_by_one(self) -> Self {
        Self { one_by_one: true, ..self }
    }

    /// Prepares the tree for one irradiance per sample, RGB.
    pub fn light<'b>(&self, irradiance: &'b [DVec3]) -> Lit<'b>
    where
        'a: 'b,
    {
        self.lit(SampleLight::even(irradiance), irradiance)
    }

    /// [`Self::light`] with the pieces of samples that are not lit evenly.
    pub fn light_with_pieces<'b>(&self, irradiance: &'b [DVec3], pieces: &'b Pieces) -> Lit<'b>
    where
        'a: 'b,
    {
        self.lit(SampleLight::new(irradiance, pieces), irradiance)
    }

    fn lit<'b>(&self, light: SampleLight<'b>, irradiance: &[DVec3]) -> Lit<'b>
    where
        'a: 'b,
    {
        let (light, lit_by) = (light.with_factors(self.factors), irradiance);
        let scaled: Vec<DVec3> = irradiance.iter().zip(self.factors).map(|(e, factor)| *e * *factor).collect();
        let irradiance = if self.factors.is_empty() { irradiance } else { &scaled };
        let clusters = self.tree.light(self.surface.patches, irradiance);
        let moments = if self.has_layers() { self.tree.moments(self.surface.patches, irradiance) } else { Vec::new() };
        let factors = if self.factors.is_empty() { Vec::new() } else { self.mean_factors(&clusters, lit_by) };
        Lit { light, clusters, moments, factors }
    }

    /// Mean factor of the samples of each cluster under an irradiance.
    fn mean_factors(&self, clusters: &[Cluster], irradiance: &[DVec3]) -> Vec<DVec3> {
        let plain = self.tree.light(self.surface.patches, irradiance);
        let of = |(with, without): (&Cluster, &Cluster)| {
            let of_channel = |c: usize| if without.flux[c] > 0.0 { with.flux[c] / without.flux[c] } else { 1.0 };
            DVec3::from_array([0, 1, 2].map(of_channel))
        };
        clusters.iter().zip(&plain).map(of).collect()
    }

    /// Radiosity of every receiver, RGB. A receiver's value depends on its own group only.
    pub fn radiosity(&self, receivers: &Receivers, lit: &Lit, scheme: Scheme, progress: &dyn Progress) -> Vec<DVec3> {
        progress.start("transfer", receivers.len() as u64);
        let mut result = vec![DVec3::ZERO; receivers.len()];
        let jobs = receivers.groups.par_iter().zip(receivers.cut(&mut result, 1));
        // Wider groups would share more of what is near than a receiver alone has.
        let narrow_mm = if self.one_by_one { self.near.exact_below * self.mean_radius_mm() } else { f64::INFINITY };
        jobs.for_each_init(Lists::default, |lists, (group, out)| {
            let is_wide = self.one_by_one && receivers.sphere(*group).radius_mm > narrow_mm;
            self.group(receivers, *group, lit, (scheme, is_wide), lists);
            for (i, value) in out.iter_mut().enumerate() {
                let sum = lists.block.sum(i) + lists.alone.get(i).copied().unwrap_or_default();
                *value = lit.light.radiosity(sum) * receivers.factor(group.run.range().start + i);
            }
            progress.advance(out.len() as u64);
        });
        progress.finish();
        result
    }

    /// Centre of each cluster of a light, mm, its flux and, by channel, flux times normal, scaled; the latter zero where no kernel
    /// has a double layer.
    pub fn clusters<'b>(&self, lit: &'b Lit) -> impl Iterator<Item = (DVec3, DVec3, [DVec3; 3])> + use<'b> {
        lit.clusters.iter().enumerate().map(|(index, cluster)| {
            let moments = lit.moments.get(index).copied().unwrap_or_default();
            (cluster.centre_mm, lit.light.scaled(cluster.flux), moments.map(|moment| lit.light.scaled(moment)))
        })
    }

    /// Sources of each group of receivers under a scheme, in the order in which [`Self::radiosity`] sums them.
    pub fn sources(&self, receivers: &Receivers, lit: &Lit, scheme: Scheme) -> Vec<Vec<Source>> {
        let of_group = |group: &Group| {
            let mut sources = Vec::new();
            let sphere = receivers.sphere(*group);
            let part = group.part as usize;
            if let Some(medium) = self.medium(part) {
                self.visit(part, lit, medium, scheme, &sphere, &mut |source| sources.push(source));
            }
            sources
        };
        receivers.groups.par_iter().map(of_group).collect()
    }

    /// Passes every source of a light to `take`, with the radiosity, RGB, that it brings each receiver of a group for a
    /// flux of 1 (clusters) or an irradiance of 1 (samples) before any factors.
    pub(in crate::transport) fn weights(
        &self,
        receivers: &Receivers,
        group: Group,
        lit: &Lit,
        scheme: Scheme,
        lists: &mut Lists,
        take: &mut impl FnMut(Source, &[[f32; 3]]),
    ) {
        let Some((part, medium, sphere)) = self.begin(receivers, group, lists) else { return };
        let mut weights = vec![[0.0; 3]; group.run.range().len()];
        let of_receivers: Vec<DVec3> = group.run.range().map(|i| receivers.factor(i)).collect();
        self.visit(part, lit, medium, scheme, &sphere, &mut |source| {
            match source {
                Source::Cluster(index) => {
                    let Cluster { centre_mm, flux, .. } = lit.clusters[index as usize];
                    lists.points.push(PointSource::new(centre_mm, DVec3::ONE, sphere.centre_mm));
                    if let Some(moment) = lit.moments.get(index as usize) {
                        let of = |c: usize| if flux[c] > 0.0 { moment[c] / flux[c] } else { DVec3::ZERO };
                        lists.moments.push(Moment::new([of(0), of(1), of(2)]));
                    }
                }
                Source::Patch(index) if lit.light.irradiance(index as usize) == DVec3::ZERO => return,
                Source::Patch(index) => {
                    let (index, layered) = (index as usize, medium.layers().is_some());
                    let how = (self.pieces(index, medium, &sphere), layered, sphere.centre_mm);
                    self.add(index, DVec3::ONE, None, how, lists);
                }
            }
            self.drain(medium, lists, 0);
            lists.block.take(&mut weights);
            let factor = match source {
                Source::Cluster(index) => lit.factors.get(index as usize),
                Source::Patch(index) => self.factors.get(index as usize),
            };
            if let Some(factor) = factor {
                for (weights, of_receiver) in weights.iter_mut().zip(&of_receivers) {
                    let both = (*factor * *of_receiver).as_vec3();
                    weights.iter_mut().zip(both.to_array()).for_each(|(weight, factor)| *weight *= factor);
                }
            }
            take(source, &weights);
        });
    }

    /// True if a kernel has a double layer.
    pub(in crate::transport) fn has_layers(&self) -> bool {
        self.kernels.iter().any(|kernel| kernel.layers().is_some())
    }

    /// Patches of the surface.
    pub(in crate::transport) fn patches(&self) -> &[samples::Patch] {
        self.surface.patches
    }

    /// Empties the lists for a group of receivers; its part, medium and place.
    fn begin(&self, receivers: &Receivers, group: Group, lists: &mut Lists) -> Option<(usize, &MediumKernel, Sphere)> {
        let sphere = receivers.sphere(group);
        lists.block.reset(sphere.centre_mm, receivers.of(group));
        lists.points.clear();
        lists.moments.clear();
        lists.flats.clear();
        lists.around.clear();
        lists.alone.clear();
        let part = group.part as usize;
        Some((part, self.medium(part)?, sphere))
    }

    /// Sums of a group of receivers; of a wide one what is near some of them is summed for each alone.
    fn group(
        &self,
        receivers: &Receivers,
        group: Group,
        lit: &Lit,
        (scheme, is_wide): (Scheme, bool),
        lists: &mut Lists,
    ) {
        let Some((part, medium, sphere)) = self.begin(receivers, group, lists) else { return };
        let layered = medium.layers().is_some();
        self.visit(part, lit, medium, scheme, &sphere, &mut |source| match source {
            Source::Cluster(index) => {
                let cluster = &lit.clusters[index as usize];
                let flux = lit.light.scaled(cluster.flux);
                lists.points.push(PointSource::new(cluster.centre_mm, flux, sphere.centre_mm));
                if layered && let Some(moment) = lit.moments.get(index as usize) {
                    lists.moments.push(Moment::new(moment.map(|m| lit.light.scaled(m))));
                }
            }
            Source::Patch(index) => {
                let index = index as usize;
                let pieces = match self.pieces(index, medium, &sphere) {
                    Pieced::Triangles if is_wide => {
                        lists.around.push(index as u32);
                        Pieced::Points
                    }
                    pieces => pieces,
                };
                let e = lit.light.irradiance(index);
                self.add(index, e, Some((&lit.light, 1.0)), (pieces, layered, sphere.centre_mm), lists);
                self.drain(medium, lists, 4096);
            }
        });
        self.drain(medium, lists, 0);
        if lists.around.is_empty() {
            return;
        }
        let (around, together) = (std::mem::take(&mut lists.around), std::mem::take(&mut lists.block));
        for receiver in receivers.of(group) {
            let place = Sphere { centre_mm: receiver.at_mm, radius_mm: 0.0 };
            lists.block.reset(place.centre_mm, std::iter::once(receiver));
            for index in around.iter().map(|&index| index as usize) {
                if self.pieces(index, medium, &place) == Pieced::Triangles {
                    // In the place of the points.
                    for (pieces, sign) in [(Pieced::Points, -1.0), (Pieced::Triangles, 1.0)] {
                        let e = sign * lit.light.irradiance(index);
                        self.add(index, e, Some((&lit.light, sign)), (pieces, layered, place.centre_mm), lists);
                    }
                }
            }
            self.drain(medium, lists, 0);
            lists.alone.push(lists.block.sum(0));
        }
        (lists.around, lists.block) = (around, together);
    }

    /// What a patch is summed as by receivers in a sphere.
    fn pieces(&self, index: usize, medium: &MediumKernel, sphere: &Sphere) -> Pieced {
        let patch = &self.surface.patches[index];
        let distance = (patch.centre_mm.distance(sphere.centre_mm) - sphere.radius_mm).max(0.0);
        let below = |radii: f64| distance * distance < near_square(radii * patch.radius_mm, medium.smooth_mm());
        if !below(self.near.three_points_below) {
            Pieced::Whole
        } else if !below(self.near.exact_below) {
            Pieced::Points
        } else {
            Pieced::Triangles
        }
    }

    /// Mean radius of the patches, mm.
    fn mean_radius_mm(&self) -> f64 {
        self.surface.patches.iter().map(|patch| patch.radius_mm).sum::<f64>() / self.surface.patches.len().max(1) as f64
    }

    fn visit(
        &self,
        part: usize,
        lit: &Lit,
        medium: &MediumKernel,
        scheme: Scheme,
        sphere: &Sphere,
        take: &mut impl FnMut(Source),
    ) {
        match scheme {
            Scheme::AllPairs => self.surface.samples.part(part).for_each(|patch| take(Source::Patch(patch as u32))),
            Scheme::Hierarchical { criterion } => self.descend(part, lit, medium, criterion, sphere, take),
        }
    }

    /// Runs the kernels over the lists if they hold more than `limit` sources.
    fn drain(&self, medium: &MediumKernel, lists: &mut Lists, limit: usize) {
        if lists.points.len() > limit {
            match medium.layers() {
                Some(layers) => layers.add_points(self.level, &mut lists.block, &lists.points, &lists.moments),
                None => medium.add_points(self.level, &mut lists.block, &lists.points),
            }
            lists.points.clear();
            lists.moments.clear();
        }
        if lists.flats.len() > limit {
            match medium.layers() {
                Some(layers) => layers.add_triangles(self.level, &mut lists.block, &lists.flats),
                None => medium.add_triangles(self.level, &mut lists.block, &lists.flats),
            }
            lists.flats.clear();
        }
    }

    fn descend(
        &self,
        part: usize,
        lit: &Lit,
        medium: &MediumKernel,
        criterion: Criterion,
        sphere: &Sphere,
        take: &mut impl FnMut(Source),
    ) {
        let scale = self.surface.domain.parts.parts[part].area_mm2.max(f64::MIN_POSITIVE);
        let flux = self.tree.root(part).map_or(DVec3::ZERO, |root| lit.clusters[root as usize].flux);
        let mean_flux = flux / scale;
        self.tree.walk(part, &lit.clusters, |visit| match visit {
            Visit::Node(index, cluster) => {
                let distance = cluster.centre_mm.distance(sphere.centre_mm) - sphere.radius_mm;
                if distance <= cluster.radius_mm {
                    return false;
                }
                let accepted = match criterion {
                    Criterion::SolidAngle(limit) => cluster.area_mm2 < limit * (distance * distance),
                    Criterion::KernelBound(limit) => bound(medium, cluster, distance, mean_flux) < limit,
                };
                if accepted {
                    take(Source::Cluster(index));
                }
                accepted
            }
            Visit::Leaf(members) => {
                members.iter().for_each(|&patch| take(Source::Patch(patch)));
                true
            }
        });
    }

    fn medium(&self, part: usize) -> Option<&MediumKernel> {
        self.kernels.get((*self.of_part.get(part)?)? as usize)
    }

    /// Adds one patch of an irradiance to the lists, and its pieces under a light, times a sign.
    fn add(
        &self,
        index: usize,
        e: DVec3,
        light: Option<(&SampleLight, f64)>,
        (pieces, layered, centre): (Pieced, bool, DVec3),
        lists: &mut Lists,
    ) {
        if e == DVec3::ZERO {
            return;
        }
        let patch = &self.surface.patches[index];
        if pieces == Pieced::Whole {
            lists.add(layered, (patch.centre_mm, e * patch.area_mm2, patch.cross_mm2 / patch.area_mm2), centre);
            return;
        }
        let exact = pieces == Pieced::Triangles;
        let uneven = light.and_then(|(light, sign)| Some((light.pieces(index)?, sign)));
        for (deviation, corners) in uneven.into_iter().flat_map(|(of, sign)| of.map(move |(d, at)| (sign * d, at))) {
            let corners = corners.map(|c| patch.centre_mm + glam::Vec3::from_array(c).as_dvec3());
            if exact {
                lists.flats.extend(FlatSource::new(corners, deviation.as_vec3().to_array(), centre));
            } else {
                // A piece is small where its sample is three points.
                let flux = deviation * samples::area(corners);
                lists.add(
                    layered,
                    (corners.iter().sum::<DVec3>() / 3.0, flux, patch.cross_mm2 / patch.area_mm2),
                    centre,
                );
            }
        }
        for facet in self.surface.samples.patch(index) {
            let corners = facet.corners_local_mm(self.surface.domain.mesh);
            if exact {
                lists.flats.extend(FlatSource::new(corners, e.as_vec3().to_array(), centre));
            } else {
                let (points, third) = three_points(corners);
                let normal = if layered { self.surface.domain.mesh.normal(facet.triangle) } else { DVec3::ZERO };
                points.iter().for_each(|&at| lists.add(layered, (at, e * third, normal), centre));
            }
        }
    }
}

/// What a patch is summed as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pieced {
    /// A point at its centre.
    Whole,
    /// Three points on each of its facets.
    Points,
    /// Its facets, in closed form.
    Triangles,
}

/// Bound of [`Criterion::KernelBound`], worst channel.
fn bound(medium: &MediumKernel, cluster: &Cluster, distance: f64, mean_irradiance: DVec3) -> f64 {
    let mut worst: f64 = 0.0;
    for (channel, profile) in medium.profiles().iter().enumerate() {
        let scale = profile.total() * mean_irradiance[channel];
        if scale > 0.0 {
            let sigma = medium.sigma_per_mm()[channel];
            let slope = cluster.radius_mm * (sigma + 3.0 / distance);
            let error = cluster.flux[channel] * profile.reflectance(distance) * slope * slope / 6.0;
            worst = worst.max(error / scale);
        }
    }
    worst
}

#[cfg(test)]
#[path = "gather_tests.rs"]
mod tests;
