//! Gathers the flux of all samples at the receivers: B(x) = Int_A R_d(|x - y|) E(y) dA, all pairs or through the tree.
//!
//! A patch is integrated as flat triangles in closed form, at three points, or at its centroid, depending on its size
//! against its distance and the depth of the real source, because R_d is smooth on the scale of sqrt(d^2 + z_r^2). The
//! patch under the receiver is never skipped.

use std::ops::Range;

use glam::DVec3;
use serde::{Deserialize, Serialize};

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
use crate::parallel::*;
use crate::progress::Progress;

/// Organisation of the sum over samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Radius of a group of receivers above which what is near is summed for each alone, mm.
    narrow_mm: f64,
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

/// Sources that one group of receivers sees, and their sums.
#[derive(Default)]
pub(in crate::transport) struct Lists {
    sources: Sources,
    block: Block,
    /// Of a wide group: what is near some of its receivers, and what each has of that, gathered alone.
    around: Around,
    alone: Vec<DVec3>,
}

/// Points and triangles that are summed together.
#[derive(Default)]
struct Sources {
    points: Vec<PointSource>,
    /// Moments of the points, for kernels with a double layer.
    moments: Vec<Moment>,
    flats: Vec<FlatSource>,
}

impl Sources {
    /// Adds a point, a piece of surface with a normal; `layers` where the kernel has a double layer.
    fn add(&mut self, layers: bool, (at_mm, flux, normal): (DVec3, DVec3, DVec3), centre_mm: DVec3) {
        self.points.push(PointSource::new(at_mm, flux, centre_mm));
        if layers {
            self.moments.push(Moment::of_facet(flux, normal));
        }
    }

    fn clear(&mut self) {
        self.points.clear();
        self.moments.clear();
        self.flats.clear();
    }

    /// Adds some of other sources, by their points and their triangles.
    fn extend(&mut self, other: &Self, [points, flats]: [Range<usize>; 2]) {
        self.points.extend_from_slice(&other.points[points.clone()]);
        if !other.moments.is_empty() {
            self.moments.extend_from_slice(&other.moments[points]);
        }
        self.flats.extend_from_slice(&other.flats[flats]);
    }

    /// Numbers of points and triangles.
    fn lens(&self) -> [usize; 2] {
        [self.points.len(), self.flats.len()]
    }
}

/// Samples near some receivers of a wide group, each as a point, as points of its facets and as triangles, as the group sees them.
#[derive(Default)]
struct Around {
    sources: Sources,
    /// Each sample, and where its points and its triangles end: first as a whole, then as points, then as triangles.
    samples: Vec<(u32, [[usize; 2]; 3])>,
}

impl Around {
    fn clear(&mut self) {
        self.sources.clear();
        self.samples.clear();
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
            narrow_mm: near.narrow_mm(surface.patches),
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
        jobs.for_each_init(Lists::default, |lists, (group, out)| {
            let is_wide = receivers.sphere(*group).radius_mm > self.narrow_mm;
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
        receivers.groups.par_iter().map(|group| self.sources_of(receivers, *group, lit, scheme)).collect()
    }

    /// Sources of one group of receivers under a scheme.
    pub(in crate::transport) fn sources_of(
        &self,
        receivers: &Receivers,
        group: Group,
        lit: &Lit,
        scheme: Scheme,
    ) -> Vec<Source> {
        let mut sources = Vec::new();
        let (sphere, part) = (receivers.sphere(group), group.part as usize);
        if let Some(medium) = self.medium(part) {
            self.visit(part, lit, medium, scheme, &sphere, &mut |source| sources.push(source));
        }
        sources
    }

    /// Passes sources of a light to `take`, each with the radiosity, RGB, that it brings every receiver of a group for a
    /// flux of 1 (clusters) or an irradiance of 1 (samples) before any factors.
    pub(in crate::transport) fn weights(
        &self,
        receivers: &Receivers,
        group: Group,
        lit: &Lit,
        sources: &[Source],
        lists: &mut Lists,
        take: &mut impl FnMut(Source, &[[f32; 3]]),
    ) {
        let Some((_, medium, sphere)) = self.begin(receivers, group, lists) else { return };
        let mut weights = vec![[0.0; 3]; group.run.range().len()];
        let of_receivers: Vec<DVec3> = group.run.range().map(|i| receivers.factor(i)).collect();
        for &source in sources {
            match source {
                Source::Cluster(index) => {
                    let Cluster { centre_mm, flux, .. } = lit.clusters[index as usize];
                    lists.sources.points.push(PointSource::new(centre_mm, DVec3::ONE, sphere.centre_mm));
                    if let Some(moment) = lit.moments.get(index as usize) {
                        let of = |c: usize| if flux[c] > 0.0 { moment[c] / flux[c] } else { DVec3::ZERO };
                        lists.sources.moments.push(Moment::new([of(0), of(1), of(2)]));
                    }
                }
                Source::Patch(index) if lit.light.irradiance(index as usize) == DVec3::ZERO => continue,
                Source::Patch(index) => {
                    let (index, layered) = (index as usize, medium.layers().is_some());
                    let how = (self.pieces(index, medium, &sphere), layered, sphere.centre_mm);
                    self.add(index, DVec3::ONE, None, how, &mut lists.sources);
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
        }
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
        lists.sources.clear();
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
                lists.sources.points.push(PointSource::new(cluster.centre_mm, flux, sphere.centre_mm));
                if layered && let Some(moment) = lit.moments.get(index as usize) {
                    lists.sources.moments.push(Moment::new(moment.map(|m| lit.light.scaled(m))));
                }
            }
            Source::Patch(patch) => {
                let index = patch as usize;
                let e = lit.light.irradiance(index);
                let add = |pieces: Pieced, sources: &mut Sources| {
                    self.add(index, e, Some(&lit.light), (pieces, layered, sphere.centre_mm), sources);
                };
                let pieces = self.pieces(index, medium, &sphere);
                if is_wide && pieces == Pieced::Triangles {
                    let Around { sources, samples } = &mut lists.around;
                    let ends = [Pieced::Whole, Pieced::Points, Pieced::Triangles].map(|pieces| {
                        add(pieces, sources);
                        sources.lens()
                    });
                    samples.push((patch, ends));
                    return;
                }
                add(pieces, &mut lists.sources);
                self.drain(medium, lists, 4096);
            }
        });
        self.drain(medium, lists, 0);
        if lists.around.samples.is_empty() {
            return;
        }
        let (around, together) = (std::mem::take(&mut lists.around), std::mem::take(&mut lists.block));
        for receiver in receivers.of(group) {
            let place = Sphere { centre_mm: receiver.at_mm, radius_mm: 0.0 };
            lists.block.reset(sphere.centre_mm, std::iter::once(receiver));
            let mut first = [0, 0];
            for &(patch, [whole, points, triangles]) in &around.samples {
                let (from, to) = match self.pieces(patch as usize, medium, &place) {
                    Pieced::Whole => (first, whole),
                    Pieced::Points => (whole, points),
                    Pieced::Triangles => (points, triangles),
                };
                first = triangles;
                lists.sources.extend(&around.sources, [0, 1].map(|kind| from[kind]..to[kind]));
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
        let Lists { sources: Sources { points, moments, flats }, block, .. } = lists;
        if points.len() > limit {
            match medium.layers() {
                Some(layers) => layers.add_points(self.level, block, points, moments),
                None => medium.add_points(self.level, block, points),
            }
            points.clear();
            moments.clear();
        }
        if flats.len() > limit {
            match medium.layers() {
                Some(layers) => layers.add_triangles(self.level, block, flats),
                None => medium.add_triangles(self.level, block, flats),
            }
            flats.clear();
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

    /// Adds one patch of an irradiance to some sources, and its pieces under a light.
    fn add(
        &self,
        index: usize,
        e: DVec3,
        light: Option<&SampleLight>,
        (pieces, layered, centre): (Pieced, bool, DVec3),
        sources: &mut Sources,
    ) {
        if e == DVec3::ZERO {
            return;
        }
        let patch = &self.surface.patches[index];
        if pieces == Pieced::Whole {
            sources.add(layered, (patch.centre_mm, e * patch.area_mm2, patch.cross_mm2 / patch.area_mm2), centre);
            return;
        }
        let exact = pieces == Pieced::Triangles;
        for (deviation, corners) in light.and_then(|light| light.pieces(index)).into_iter().flatten() {
            let corners = corners.map(|c| patch.centre_mm + glam::Vec3::from_array(c).as_dvec3());
            if exact {
                sources.flats.extend(FlatSource::new(corners, deviation.as_vec3().to_array(), centre));
            } else {
                // A piece is small where its sample is three points.
                let flux = deviation * samples::area(corners);
                sources.add(
                    layered,
                    (corners.iter().sum::<DVec3>() / 3.0, flux, patch.cross_mm2 / patch.area_mm2),
                    centre,
                );
            }
        }
        for facet in self.surface.samples.patch(index) {
            let corners = facet.corners_local_mm(self.surface.domain.mesh);
            if exact {
                sources.flats.extend(FlatSource::new(corners, e.as_vec3().to_array(), centre));
            } else {
                let (points, third) = three_points(corners);
                let normal = if layered { self.surface.domain.mesh.normal(facet.triangle) } else { DVec3::ZERO };
                points.iter().for_each(|&at| sources.add(layered, (at, e * third, normal), centre));
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
