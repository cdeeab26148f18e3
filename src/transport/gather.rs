//! Gathers the flux of all samples at the receivers: B(x) = Int_A R_d(|x - y|) E(y) dA, all pairs or through the tree.
//!
//! How a patch is integrated follows from its size against its distance and the depth of the real source, because R_d
//! is smooth on the scale of sqrt(d^2 + z_r^2): as flat triangles in closed form, at three points, or at its centroid.
//! The patch under the receiver is never skipped.

use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use super::balanced_tree::power_of_two_near;
use super::irradiance::Pieces;
use super::kernel::radial_table::{self, RadialTable};
use super::kernel::{self, Block, FlatSource, KernelRgb, PointSource};
use super::receivers::{Group, Receivers, Sphere};
use super::surface::Surface;
use super::tree::{Cluster, SampleTree, Visit};
use crate::error::{Error, Result};
use crate::math::simd::Level;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::Medium;
use crate::medium::profile::Profile;
use crate::medium::profiles::model::LoadedProfile;
use crate::progress::Progress;

/// When a patch counts as near, in units of its radius.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NearField {
    /// Closed form below this distance over radius.
    pub exact_below: f64,
    /// Three points on each facet below this distance over radius, the centroid beyond.
    pub three_points_below: f64,
}

impl NearField {
    /// Refuses settings out of range.
    ///
    /// # Errors
    /// Invalid input.
    pub fn validate(&self) -> Result<()> {
        let Self { exact_below, three_points_below } = *self;
        if !(exact_below >= 0.0 && three_points_below >= exact_below && three_points_below <= 1e3) {
            return Err(Error::input(format!("a near field of {exact_below} and {three_points_below} radii")));
        }
        Ok(())
    }

    /// Errors of 1e-5 of the total reflectance, worst receiver of a plane: for the truth.
    pub const REFERENCE: Self = Self { exact_below: 6.0, three_points_below: 24.0 };
    /// Errors of 8e-4 of the total reflectance (worst receiver of a plane) at 0.3 mean free paths between samples, less
    /// elsewhere: 3e-4 at 0.1, 4e-4 at 1, 2e-4 at 3.
    pub const FAST: Self = Self { exact_below: 3.0, three_points_below: 6.0 };

    /// For an asked error of the whole result: [`Self::FAST`] at 0.5 %. The error of a rule falls with the square of
    /// distance over size.
    pub fn for_error(relative_rms: f64) -> Self {
        let reach = (0.005 / relative_rms).sqrt();
        let Self { exact_below, three_points_below } = Self::FAST;
        Self {
            exact_below: (exact_below * reach).clamp(1.5, Self::REFERENCE.exact_below),
            three_points_below: (three_points_below * reach).clamp(3.0, Self::REFERENCE.three_points_below),
        }
    }
}

/// How the sum over samples is organised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scheme {
    /// Every sample with every receiver.
    AllPairs,
    /// Clusters that look small from the receivers stand for their samples (Jensen & Buhler 2002).
    Hierarchical {
        /// Which clusters look small.
        criterion: Criterion,
    },
}

/// Which clusters may stand for their samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Area / distance^2 below this many steradians (Jensen & Buhler 2002).
    SolidAngle(f64),
    /// A bound on the second-order error of the cluster's kernel below this fraction of the total reflectance times the
    /// part's mean irradiance: flux R_d(d) (radius (sigma_tr + 3 / d))^2 / 6, d the shortest distance.
    KernelBound(f64),
}

/// The diffuse profiles and the single-precision kernel of one medium.
#[derive(Clone)]
pub struct MediumKernel {
    profiles: [Arc<dyn Profile>; 3],
    kernel: Kernel,
    /// The decay of each channel far away, 1/mm.
    sigma_per_mm: [f64; 3],
    /// On the scale of this length the profiles are smooth, mm: the depth of the shallowest real source.
    smooth_mm: f64,
}

/// How a medium's profiles are evaluated.
#[derive(Clone)]
enum Kernel {
    /// Dipoles, by their poles.
    Poles(KernelRgb),
    /// Any profile.
    Table(Arc<RadialTable>),
}

impl MediumKernel {
    /// Of a medium.
    pub fn new(medium: &Medium) -> Self {
        let dipoles = medium.properties.dipoles(BoundaryFit::Published);
        let smooth_mm = dipoles.iter().flat_map(|p| p.poles()).map(|p| p.z_mm).fold(f64::MAX, f64::min);
        Self {
            kernel: Kernel::Poles(KernelRgb::new(dipoles.map(|p| p.poles()))),
            sigma_per_mm: dipoles.map(|p| p.poles()[0].sigma_per_mm),
            profiles: dipoles.map(|p| Arc::new(p) as Arc<dyn Profile>),
            smooth_mm,
        }
    }

    /// Of a medium with other profiles, over an object in which no two points are further apart than `reach_mm`.
    ///
    /// # Errors
    /// As [`LoadedProfile::channels`].
    pub fn with_profile(medium: &Medium, profile: &LoadedProfile, reach_mm: f64) -> Result<Self> {
        let profiles: [Arc<dyn Profile>; 3] = profile.channels(&medium.properties)?.map(Arc::from);
        let table = RadialTable::new(&profiles, reach_mm);
        Ok(Self {
            sigma_per_mm: profiles.each_ref().map(|p| decay_per_mm(p.as_ref(), reach_mm)),
            smooth_mm: table.smooth_mm,
            kernel: Kernel::Table(Arc::new(table)),
            profiles,
        })
    }

    /// The profiles of the three channels.
    pub fn profiles(&self) -> &[Arc<dyn Profile>; 3] {
        &self.profiles
    }

    /// On the scale of this length the profiles are smooth, mm.
    pub fn smooth_mm(&self) -> f64 {
        self.smooth_mm
    }

    /// Total diffuse reflectance, RGB.
    pub fn total(&self) -> DVec3 {
        DVec3::from_array(self.profiles.each_ref().map(|p| p.total()))
    }
}

/// Everything a gather needs besides the light.
pub struct Gather<'a> {
    surface: &'a Surface<'a>,
    tree: &'a SampleTree,
    media: Vec<MediumKernel>,
    near: NearField,
    level: Level,
}

/// Irradiance of the samples and what the tree makes of it.
pub struct Lit<'a> {
    irradiance: &'a [DVec3],
    /// Samples that are not lit evenly.
    pieces: Option<&'a Pieces>,
    clusters: Vec<Cluster>,
    /// A power of two that brings the brightest irradiance near 1, into the range of single precision.
    scale: f64,
}

/// Something that a group of receivers gathers from.
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
    flats: Vec<FlatSource>,
    block: Block,
}

impl<'a> Gather<'a> {
    /// With the media given (a change of material is another `Gather`).
    pub fn new(surface: &'a Surface<'a>, tree: &'a SampleTree, media: &[Medium], near: NearField) -> Self {
        Self::with_kernels(surface, tree, media.iter().map(MediumKernel::new).collect(), near)
    }

    /// With kernels of the media that are there already.
    pub fn with_kernels(
        surface: &'a Surface<'a>,
        tree: &'a SampleTree,
        media: Vec<MediumKernel>,
        near: NearField,
    ) -> Self {
        Self { surface, tree, media, near, level: Level::detect() }
    }

    /// Uses narrower instructions than this processor offers: the results are the same to the bit.
    #[must_use]
    pub fn with_level(mut self, level: Level) -> Self {
        self.level = level;
        self
    }

    /// Prepares the tree for one irradiance per sample, RGB.
    pub fn light<'b>(&self, irradiance: &'b [DVec3]) -> Lit<'b> {
        let brightest = irradiance.iter().map(|e| e.max_element()).fold(0.0, f64::max);
        let scale = power_of_two_near(brightest).recip();
        Lit { irradiance, pieces: None, clusters: self.tree.light(self.surface.patches, irradiance), scale }
    }

    /// The same, with what is known of samples that are not lit evenly.
    pub fn light_with_pieces<'b>(&self, irradiance: &'b [DVec3], pieces: &'b Pieces) -> Lit<'b> {
        Lit { pieces: Some(pieces), ..self.light(irradiance) }
    }

    /// Radiosity of every receiver, RGB. A receiver's value depends on its own group only.
    pub fn radiosity(&self, receivers: &Receivers, lit: &Lit, scheme: Scheme, progress: &dyn Progress) -> Vec<DVec3> {
        progress.start("transfer", receivers.len() as u64);
        let mut result = vec![DVec3::ZERO; receivers.len()];
        let mut rest = result.as_mut_slice();
        let mut jobs = Vec::with_capacity(receivers.groups.len());
        for group in &receivers.groups {
            let (mine, others) = rest.split_at_mut(group.run.range().len());
            rest = others;
            jobs.push((group, mine));
        }
        jobs.into_par_iter().for_each_init(Lists::default, |lists, (group, out)| {
            self.group(receivers, *group, lit, scheme, lists);
            for (i, value) in out.iter_mut().enumerate() {
                *value = lists.block.sum(i) / lit.scale;
            }
            progress.advance(out.len() as u64);
        });
        progress.finish();
        result
    }

    /// The clusters of a light: flux over its scale and what stands for it where.
    pub fn clusters<'b>(&self, lit: &'b Lit) -> (&'b [Cluster], f64) {
        (&lit.clusters, lit.scale)
    }

    /// What each group of receivers gathers from under a scheme, group after group; the order is that of [`Self::radiosity`].
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

    /// What every source of a light brings the receivers of a group for a flux of 1 (clusters) or an irradiance of 1
    /// (samples): RGB of each receiver.
    pub(in crate::transport) fn weights(
        &self,
        receivers: &Receivers,
        group: Group,
        lit: &Lit,
        scheme: Scheme,
        lists: &mut Lists,
        take: &mut impl FnMut(Source, &[[f32; 3]]),
    ) {
        let members = &receivers.positions[group.run.range()];
        let sphere = receivers.sphere(group);
        lists.block.reset(sphere.centre_mm, members);
        lists.points.clear();
        lists.flats.clear();
        let part = group.part as usize;
        let Some(medium) = self.medium(part) else { return };
        let mut weights = vec![[0.0; 3]; members.len()];
        self.visit(part, lit, medium, scheme, &sphere, &mut |source| {
            match source {
                Source::Cluster(index) => {
                    let at = lit.clusters[index as usize].centre_mm;
                    lists.points.push(point(at, DVec3::ONE, &sphere));
                }
                Source::Patch(index) if lit.irradiance[index as usize] == DVec3::ZERO => return,
                Source::Patch(index) => {
                    self.patch(index as usize, (DVec3::ONE, 1.0), None, medium, &sphere, lists);
                }
            }
            self.drain(medium, lists, 0);
            lists.block.take(&mut weights);
            take(source, &weights);
        });
    }

    /// Patches of the surface.
    pub(in crate::transport) fn patches(&self) -> &[crate::geometry::samples::Patch] {
        self.surface.patches
    }

    fn group(&self, receivers: &Receivers, group: Group, lit: &Lit, scheme: Scheme, lists: &mut Lists) {
        let members = &receivers.positions[group.run.range()];
        let sphere = receivers.sphere(group);
        lists.block.reset(sphere.centre_mm, members);
        lists.points.clear();
        lists.flats.clear();
        let part = group.part as usize;
        let Some(medium) = self.medium(part) else { return };
        self.visit(part, lit, medium, scheme, &sphere, &mut |source| match source {
            Source::Cluster(index) => {
                let cluster = &lit.clusters[index as usize];
                lists.points.push(point(cluster.centre_mm, cluster.flux * lit.scale, &sphere));
            }
            Source::Patch(index) => {
                let index = index as usize;
                self.patch(index, (lit.irradiance[index], lit.scale), lit.pieces, medium, &sphere, lists);
                self.drain(medium, lists, 4096);
            }
        });
        self.drain(medium, lists, 0);
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
            match &medium.kernel {
                Kernel::Poles(poles) => kernel::add_points(self.level, &mut lists.block, poles, &lists.points),
                Kernel::Table(table) => radial_table::add_points(self.level, &mut lists.block, table, &lists.points),
            }
            lists.points.clear();
        }
        if lists.flats.len() > limit {
            match &medium.kernel {
                Kernel::Poles(poles) => kernel::add_triangles(self.level, &mut lists.block, poles, &lists.flats),
                Kernel::Table(table) => radial_table::add_triangles(self.level, &mut lists.block, table, &lists.flats),
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
        let mean_flux = self.part_flux(part, lit) / scale;
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
        self.media.get(self.surface.domain.parts.parts[part].medium? as usize)
    }

    fn part_flux(&self, part: usize, lit: &Lit) -> DVec3 {
        let mut total = DVec3::ZERO;
        self.tree.walk(part, &lit.clusters, |visit| {
            if let Visit::Node(_, cluster) = visit {
                total = cluster.flux;
            }
            true
        });
        total
    }

    /// Adds one patch to the lists, as finely as its distance asks for.
    fn patch(
        &self,
        index: usize,
        (e, scale): (DVec3, f64),
        pieces: Option<&Pieces>,
        medium: &MediumKernel,
        sphere: &Sphere,
        lists: &mut Lists,
    ) {
        if e == DVec3::ZERO {
            return;
        }
        let e = e * scale;
        let patch = &self.surface.patches[index];
        let distance = (patch.centre_mm.distance(sphere.centre_mm) - sphere.radius_mm).max(0.0);
        let reach2 = distance * distance + medium.smooth_mm * medium.smooth_mm;
        let below = |radii: f64| reach2 < (radii * patch.radius_mm) * (radii * patch.radius_mm);
        if !below(self.near.three_points_below) {
            lists.points.push(point(patch.centre_mm, e * patch.area_mm2, sphere));
            return;
        }
        let exact = below(self.near.exact_below);
        let mesh = self.surface.domain.mesh;
        if let Some(pieces) = pieces.and_then(|p| p.of(index)) {
            for (deviation, corners) in pieces {
                let e = deviation * scale;
                let corners = corners.map(|c| patch.centre_mm + glam::Vec3::from_array(c).as_dvec3());
                if exact {
                    lists.flats.extend(FlatSource::new(corners, e.as_vec3().to_array(), sphere.centre_mm));
                } else {
                    // A piece is small where its sample is three points.
                    let centre = corners.iter().sum::<DVec3>() / 3.0;
                    lists.points.push(point(centre, e * crate::geometry::samples::area(corners), sphere));
                }
            }
        }
        for facet in self.surface.samples.patch(index) {
            let corners = facet.corners_local_mm(mesh);
            if exact {
                let irradiance = e.as_vec3().to_array();
                lists.flats.extend(FlatSource::new(corners, irradiance, sphere.centre_mm));
            } else {
                let centre = corners.iter().sum::<DVec3>() / 3.0;
                let flux = e * (crate::geometry::samples::area(corners) / 3.0);
                lists.points.extend(corners.map(|c| point(0.5 * (centre + c), flux, sphere)));
            }
        }
    }
}

/// The decay of a profile where a hundredth of it is left, or as much as lies within reach: of exp(-sigma r) / r^2.
fn decay_per_mm(profile: &dyn Profile, reach_mm: f64) -> f64 {
    let far = profile.range_mm(0.01).min(reach_mm);
    let near = 0.5 * far;
    let ratio = 0.25 * profile.reflectance(near) / profile.reflectance(far);
    let decay = ratio.ln() / (far - near);
    if decay.is_finite() { decay.max(0.0) } else { 0.0 }
}

/// Bound of [`Criterion::KernelBound`], worst channel.
fn bound(medium: &MediumKernel, cluster: &Cluster, distance: f64, mean_irradiance: DVec3) -> f64 {
    let mut worst: f64 = 0.0;
    for (channel, profile) in medium.profiles.iter().enumerate() {
        let scale = profile.total() * mean_irradiance[channel];
        if scale > 0.0 {
            let sigma = medium.sigma_per_mm[channel];
            let slope = cluster.radius_mm * (sigma + 3.0 / distance);
            let error = cluster.flux[channel] * profile.reflectance(distance) * slope * slope / 6.0;
            worst = worst.max(error / scale);
        }
    }
    worst
}

fn point(at: DVec3, flux: DVec3, sphere: &Sphere) -> PointSource {
    PointSource { at: (at - sphere.centre_mm).as_vec3().to_array(), flux: flux.as_vec3().to_array() }
}

#[cfg(test)]
#[path = "gather_tests.rs"]
mod tests;
