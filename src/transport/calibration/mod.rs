//! The calibrated kernel: the answer of the volume in the form of a sum over the surface.
//!
//! The dipole knows a half space. A few walks through the body itself tell what is different: between a point where
//! light enters and one where it leaves,
//!
//! `K(o, i) = s_o s_i R_d(r) (a(r) + b(r) h)`,
//!
//! with the heights h of each point over the tangent plane of the other, two radial functions of each part and channel
//! ([`layers`]), and one factor a point. The functions come from pairs of entry and exit of walks with diffuse entry, the
//! factors from the light that leaves at each vertex where irradiance is the same everywhere: row sums. K is symmetric,
//! as the volume is. Both hold the orders of scattering that were asked for, no others.
//!
//! Parts that let light out (openings) keep their dipole, and say so.

mod body;
mod fit;
pub mod lattice;
pub mod layers;
mod pairs;
mod smoothing;
pub mod surface;
mod walks;

use std::sync::Arc;

use glam::DVec3;

use self::body::Body;
use self::lattice::Lattice;
use self::layers::{Layers, Splines};
use super::domain::Domain;
use super::gather::{Criterion, Gather, Scheme};
use super::kernel::medium::MediumKernel;
use super::moved_entry::MovedEntry;
use super::near_rule::NearField;
use super::random_walk::exitance::MOST_LOST;
use super::random_walk::walk::WalkMedium;
use super::receivers::Receivers;
use super::surface::Surface;
use super::tree::SampleTree;
use crate::error::{Error, Result};
use crate::geometry::bvh::Bvh;
use crate::geometry::part_table::PartEntry;
use crate::geometry::samples::{self, Facet, Samples};
use crate::math::random::mix;
use crate::medium::fresnel::{BoundaryFit, CosineTransmittance};
use crate::medium::material::Medium;
use crate::medium::profile::{Orders, Profile};
use crate::parallel::*;
use crate::progress::{Progress, Silent};

/// Settings of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Walks {
    /// Photons of each channel of a part.
    pub photons: u64,
    /// Scattering events of each channel at most: bodies of many mean free paths get fewer photons.
    pub collisions: u64,
    /// Seed of the walks.
    pub seed: u64,
    /// Orders that the kernel holds.
    pub orders: Orders,
}

impl Default for Walks {
    fn default() -> Self {
        Self { photons: 200_000, collisions: 20_000_000, seed: 0, orders: Orders::FromOne }
    }
}

/// Photons that tell how many events each takes.
const PILOT: u64 = 2048;

/// Photons of each channel: fewer tell nothing, and more would fill the memory.
pub const PHOTONS: std::ops::RangeInclusive<u64> = PILOT..=1 << 28;

/// The first knot of the layers over the mean free path, and the factor between knots.
const FIRST: f64 = 0.25;
const RATIO: f64 = 1.6;

/// What walks through one part tell.
#[derive(Clone, Debug)]
pub struct PartLayers {
    /// Layers of each channel.
    pub layers: [Layers; 3],
    /// Photons of each channel.
    pub photons: [u64; 3],
}

/// The layers of every part, and what leaves at each vertex under the same irradiance everywhere.
#[derive(Clone, Debug)]
pub struct Told {
    /// Hat functions of the scene.
    pub lattice: Arc<Lattice>,
    /// Layers of each part; none for opaque parts, and for those that keep their dipole.
    pub parts: Vec<Option<PartLayers>>,
    /// Exitance of each slot under an irradiance of 1, RGB, by two independent halves of the walks.
    pub halves: [Vec<DVec3>; 2],
    /// Largest share of the light that was lost in each part.
    pub lost: Vec<f64>,
}

impl Told {
    /// Nothing told about a domain: every part keeps its dipole.
    pub fn nothing(domain: Domain) -> Self {
        let lattice = Arc::new(Lattice::new(domain));
        let (slots, count) = (lattice.len(), domain.parts.parts.len());
        let halves = [vec![DVec3::ZERO; slots], vec![DVec3::ZERO; slots]];
        Self { lattice, parts: vec![None; count], halves, lost: vec![0.0; count] }
    }
}

/// Walks through every part of a domain.
pub fn walked(domain: Domain, walks: Walks, progress: &dyn Progress) -> Told {
    let mut told = Told::nothing(domain);
    for (part, entry) in domain.parts.parts.iter().enumerate() {
        let Some(medium) = entry.medium.and_then(|m| domain.media.get(m as usize)) else { continue };
        let media = [0, 1, 2].map(|c| WalkMedium::new(&medium.properties, c));
        let free_path = media.iter().map(|m| m.free_path_mm).fold(f64::INFINITY, f64::min);
        let body = Body::new(domain, part as u32, free_path);
        let (area, diagonal) = (body.area_mm2(), body.diagonal_mm);
        if !(area > 0.0 && diagonal > 0.0) {
            continue;
        }
        let entrance = CosineTransmittance::new(medium.properties.eta_inside_over_outside);
        let dipoles = medium.properties.dipoles(BoundaryFit::Published);
        let free_paths = medium.properties.mean_free_path_mm();
        let mut layers = Vec::with_capacity(3);
        let mut photons = [0; 3];
        for c in 0..3 {
            let seed = mix(mix(walks.seed ^ 0xca11_b8a7e) ^ (3 * part as u64 + c as u64));
            let first = (FIRST * free_paths[c]).clamp(1e-4 * diagonal, 0.1 * diagonal);
            let splines = Splines::new(first, diagonal, RATIO);
            let (place, how) = ((&body, told.lattice.as_ref()), (&media[c], &entrance));
            let pilot = walks::told(place, how, &splines, (PILOT, !seed), &Silent);
            if pilot.lost > MOST_LOST {
                told.lost[part] = pilot.lost;
                break;
            }
            let events = pilot.collisions as f64 / PILOT as f64;
            photons[c] = walks.photons.min((walks.collisions as f64 / events.max(1.0)) as u64).max(PILOT);
            progress.start("walks", photons[c]);
            let of_channel = walks::told(place, how, &splines, (photons[c], seed), progress);
            progress.finish();
            told.lost[part] = of_channel.lost.max(told.lost[part]);
            let of_orders = |sums: &[[f64; 2]; 2]| match walks.orders {
                Orders::FromOne => [sums[0][0] + sums[1][0], sums[0][1] + sums[1][1]],
                Orders::FromTwo => sums[1],
            };
            let photon_mm2 = area / of_channel.photons as f64;
            let pairs: Vec<[f64; 2]> =
                of_channel.pairs.iter().map(|sums| of_orders(sums).map(|s| s * photon_mm2)).collect();
            let profile: &dyn Profile = &dipoles[c];
            let moments = pairs::moments(&body, profile, &splines, seed);
            layers.push(fit::layers(splines, &moments, &pairs, photon_mm2));
            for (sums, half) in told.halves.iter_mut().zip(&of_channel.halves) {
                for ((sum, of_slot), mass) in sums.iter_mut().zip(half).zip(&told.lattice.mass_mm2) {
                    let weight = match walks.orders {
                        Orders::FromOne => of_slot[0] + of_slot[1],
                        Orders::FromTwo => of_slot[1],
                    };
                    if *mass > 0.0 {
                        sum[c] += weight * 2.0 * photon_mm2 / mass;
                    }
                }
            }
        }
        if told.lost[part] <= MOST_LOST
            && let Ok(layers) = layers.try_into()
        {
            told.parts[part] = Some(PartLayers { layers, photons });
        }
    }
    told
}

/// True if a part of a domain keeps light inside, so that walks can calibrate it: told by a few of them.
pub fn any_is_closed(domain: Domain) -> bool {
    let lattice = Lattice::new(domain);
    let is_closed = |(part, entry): (usize, &PartEntry)| {
        let Some(medium) = entry.medium.and_then(|m| domain.media.get(m as usize)) else { return false };
        let walked = WalkMedium::new(&medium.properties, 0);
        let body = Body::new(domain, part as u32, walked.free_path_mm);
        let entrance = CosineTransmittance::new(medium.properties.eta_inside_over_outside);
        let splines = Splines::new(0.1 * body.diagonal_mm, body.diagonal_mm, RATIO);
        body.diagonal_mm > 0.0
            && walks::told((&body, &lattice), (&walked, &entrance), &splines, (PILOT, 0), &Silent).lost <= MOST_LOST
    };
    domain.parts.parts.iter().enumerate().any(is_closed)
}

/// The kernels of a scene, calibrated.
pub struct Calibrated {
    /// Layers of each part; none for opaque parts, and for those that keep their dipole.
    pub parts: Vec<Option<PartLayers>>,
    /// Kernels, and which of them each part has.
    pub kernels: (Vec<MediumKernel>, Vec<Option<u32>>),
    /// The factor of each slot, RGB.
    pub scale: Vec<DVec3>,
    /// Hat functions of the slots.
    pub lattice: Arc<Lattice>,
}

/// Calibrated kernels on the samples of a surface.
pub struct CalibratedSamples {
    /// Kernels, and factors of points.
    pub calibrated: Arc<Calibrated>,
    /// The factor of each sample, RGB.
    pub factors: Vec<DVec3>,
    /// What the moving of light needs of the samples.
    pub entry: MovedEntry,
}

impl CalibratedSamples {
    /// Kernels on the samples of a surface.
    pub fn new(calibrated: Arc<Calibrated>, surface: &Surface) -> Self {
        Self { factors: calibrated.of_samples(surface), entry: calibrated.entry(surface), calibrated }
    }
}

/// Largest change of a factor after which the iteration ends, and the most rounds.
const SOLVED: f64 = 1e-4;
const MOST_ROUNDS: usize = 40;

/// Slots that share a traversal of the samples: few, since those that factors are solved for are far apart.
const GROUP: usize = 8;

/// Points that factors are solved for at most; factors are smooth, and the other points follow from their row sums.
const SOLVING: usize = 8192;

/// Samples of those sums at most: as many as triangles, since what is near is summed triangle by triangle.
const MOST_SUMMED: usize = 1 << 17;

/// Solid angle of clusters in those sums, sr, and the relative error that their near field is made for.
const SOLVING_ANGLE: f64 = 0.03;
const SOLVING_ERROR: f64 = 0.01;

impl Calibrated {
    /// Walks through the parts of a domain, and what they tell as kernels and factors. `bvh` holds the triangles of its mesh.
    ///
    /// # Errors
    /// A dipole that cannot be tabulated.
    pub fn by_walks(domain: Domain, bvh: &Bvh, walks: Walks, progress: &dyn Progress) -> Result<Self> {
        Self::new(domain, bvh, walked(domain, walks, progress), progress)
    }

    /// Kernels from layers, and factors that give the row sums.
    ///
    /// # Errors
    /// A dipole that cannot be tabulated.
    pub fn new(domain: Domain, bvh: &Bvh, told: Told, progress: &dyn Progress) -> Result<Self> {
        let count = domain.mesh.triangles.len().clamp(SOLVING, MOST_SUMMED);
        let samples = Samples::new(domain.mesh, domain.parts, count);
        let patches = samples::patches(domain.mesh, &samples);
        let tree = SampleTree::new(&samples, &patches);
        let surface = Surface { domain, bvh, samples: &samples, patches: &patches };
        let Told { lattice, parts, halves, .. } = told;
        let kernels = kernels(domain, &parts)?;
        let mut result = Self { kernels, scale: vec![DVec3::ONE; lattice.len()], lattice, parts };
        result.solve(&surface, &tree, &halves, progress);
        Ok(result)
    }

    /// Kernels and factors that were kept.
    ///
    /// # Errors
    /// Another number of parts or of factors than the domain has; a dipole that cannot be tabulated.
    pub fn kept(domain: Domain, parts: Vec<Option<PartLayers>>, scale: Vec<DVec3>) -> Result<Self> {
        let lattice = Arc::new(Lattice::new(domain));
        let (there, needed) = ((parts.len(), scale.len()), (domain.parts.parts.len(), lattice.len()));
        if there != needed {
            let message = format!("a calibration of {there:?} parts and points of a scene that has {needed:?}");
            return Err(Error::input(message));
        }
        Ok(Self { kernels: kernels(domain, &parts)?, parts, scale, lattice })
    }

    /// Finds factors s with the row sums s K s of the walks ([`Chebyshev`]): of all slots, or where there are many of one slot in each of some
    /// clusters of the surface, and of the others at the end.
    fn solve(&mut self, surface: &Surface, tree: &SampleTree, halves: &[Vec<DVec3>; 2], progress: &dyn Progress) {
        if self.parts.iter().all(Option::is_none) {
            return;
        }
        let (lattice, parts) = (Arc::clone(&self.lattice), self.parts.clone());
        let is_calibrated = |slot: usize| parts.get(lattice.part[slot] as usize).is_some_and(|part| part.is_some());
        let place = |slot: usize| is_calibrated(slot).then(|| (lattice.part[slot], lattice.at_mm[slot]));
        let slots: Vec<u32> = (0..lattice.len() as u32).collect();
        let at = |slots: &[u32]| {
            let places: Vec<_> = slots.iter().map(|&slot| place(slot as usize)).collect();
            let normals: Vec<DVec3> = slots.iter().map(|&slot| lattice.normal[slot as usize]).collect();
            Receivers::oriented(&places, &normals, GROUP)
        };
        let scheme = Scheme::Hierarchical { criterion: Criterion::SolidAngle(SOLVING_ANGLE) };
        let gather =
            Gather::with_kernels_of_parts(surface, tree, self.kernels.clone(), NearField::for_error(SOLVING_ERROR));
        let sums = |receivers: &Receivers, factors: &[DVec3]| {
            receivers.expand(&gather.radiosity(receivers, &gather.light(factors), scheme, &Silent))
        };
        progress.start("row sums", MOST_ROUNDS as u64);
        let all = at(&slots);
        let ones = vec![DVec3::ONE; surface.samples.len()];
        let clusters = (slots.len() > SOLVING).then(|| self.clusters(surface));
        // Walks tell means over hat functions. Sums dip at edges and corners, less far than wide hat functions reach.
        let guess = match &clusters {
            Some(_) => sums(&all, &ones),
            None => {
                let (places, normals) = lattice.middles(|slot| place(slot as usize));
                lattice.means(&sums(&Receivers::oriented(&places, &normals, GROUP), &ones))
            }
        };
        let wanted = smoothing::smoothed(&lattice, halves, &guess);
        let mut steps = Chebyshev::default();
        let Some(Clusters { slots: few, of_sample }) = clusters else {
            for _ in 0..MOST_ROUNDS {
                let there = sums(&all, &self.of_samples(surface));
                let change = steps.take(&mut self.scale, wanted.iter().copied().zip(there), is_calibrated);
                progress.advance(1);
                if change < SOLVED {
                    break;
                }
            }
            return progress.finish();
        };
        let chosen = at(&few);
        let mut of_few = vec![DVec3::ONE; few.len()];
        let of_samples = |of_few: &[DVec3]| -> Vec<DVec3> { of_sample.iter().map(|&c| of_few[c as usize]).collect() };
        for _ in 0..MOST_ROUNDS {
            let there = sums(&chosen, &of_samples(&of_few));
            let of = |slot: &u32| wanted[*slot as usize];
            let is_free = |i: usize| is_calibrated(few[i] as usize);
            let change = steps.take(&mut of_few, few.iter().map(of).zip(there), is_free);
            progress.advance(1);
            if change < SOLVED {
                break;
            }
        }
        let there = sums(&all, &of_samples(&of_few));
        for (slot, ((scale, wanted), there)) in self.scale.iter_mut().zip(&wanted).zip(there).enumerate() {
            for c in (0..3).filter(|&c| is_calibrated(slot) && wanted[c] > 0.0 && there[c] > 0.0) {
                scale[c] = wanted[c] / there[c];
            }
        }
        progress.finish();
    }

    /// Clusters of a surface whose samples are finer.
    fn clusters(&self, surface: &Surface) -> Clusters {
        let domain = surface.domain;
        let samples = Samples::new(domain.mesh, domain.parts, SOLVING);
        let patches = samples::patches(domain.mesh, &samples);
        let slots = self.slots_of_samples(&Surface { samples: &samples, patches: &patches, ..*surface });
        let mut of_triangle: Vec<(u32, u32)> = (0..samples.len())
            .flat_map(|cluster| samples.patch(cluster).iter().map(move |facet| (facet.triangle, cluster as u32)))
            .collect();
        of_triangle.sort_unstable();
        of_triangle.dedup();
        let cluster = |sample: usize| {
            let centre = surface.patches[sample].centre_mm;
            let around = surface.samples.patch(sample).iter().flat_map(|facet| {
                let from = of_triangle.partition_point(|(triangle, _)| *triangle < facet.triangle);
                of_triangle[from..].iter().take_while(|(triangle, _)| *triangle == facet.triangle)
            });
            let distance = |cluster: u32| patches[cluster as usize].centre_mm.distance_squared(centre);
            around.map(|(_, cluster)| *cluster).min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)))
        };
        let of_sample = (0..surface.samples.len()).map(|sample| cluster(sample).unwrap_or(0)).collect();
        Clusters { slots, of_sample }
    }

    /// What the moving of light needs of a surface: light moves in calibrated parts.
    pub fn entry(&self, surface: &Surface) -> MovedEntry {
        MovedEntry::new(surface, |part| self.parts.get(part).is_some_and(Option::is_some))
    }

    /// A slot of each sample, that of the corner nearest to its centre.
    fn slots_of_samples(&self, surface: &Surface) -> Vec<u32> {
        let of = |sample: usize| {
            let centre = surface.patches[sample].centre_mm;
            let corners = surface.samples.patch(sample).iter().filter_map(|facet| self.around(surface, facet));
            let nearest = corners.flat_map(|(slots, _)| slots).min_by(|&a, &b| {
                let [from_a, from_b] = [a, b].map(|slot| self.lattice.at_mm[slot as usize].distance_squared(centre));
                from_a.total_cmp(&from_b).then(a.cmp(&b))
            });
            nearest.unwrap_or(0)
        };
        (0..surface.samples.len()).map(of).collect()
    }

    /// Slots around the centroid of a facet, and their weights.
    fn around(&self, surface: &Surface, facet: &Facet) -> Option<([u32; 3], [f64; 3])> {
        let corners = surface.domain.mesh.corners_local_mm(facet.triangle);
        let own = facet.corners_local_mm(surface.domain.mesh);
        let [_, u, v] = barycentric(corners, own.iter().sum::<DVec3>() / 3.0);
        self.lattice.at(facet.triangle, u, v)
    }

    /// The factor of each sample, RGB.
    pub fn of_samples(&self, surface: &Surface) -> Vec<DVec3> {
        let mesh = surface.domain.mesh;
        let of_patch = |patch: usize| {
            let (mut sum, mut area) = (DVec3::ZERO, 0.0);
            for facet in surface.samples.patch(patch) {
                let a = samples::area(facet.corners_local_mm(mesh));
                sum += a * self.of(self.around(surface, facet));
                area += a;
            }
            if area > 0.0 { sum / area } else { DVec3::ONE }
        };
        (0..surface.samples.len()).into_par_iter().map(of_patch).collect()
    }

    /// The factor at a point of a triangle (weights of its second and third corner), RGB.
    pub fn at(&self, triangle: u32, [u, v]: [f64; 2]) -> DVec3 {
        self.of(self.lattice.at(triangle, u, v))
    }

    /// The normal at a point of a triangle, between those of the slots around it; zero on opaque parts.
    pub fn normal_at(&self, triangle: u32, [u, v]: [f64; 2]) -> DVec3 {
        let Some((slots, weights)) = self.lattice.at(triangle, u, v) else { return DVec3::ZERO };
        let of = |slot: u32| self.lattice.normal.get(slot as usize).copied().unwrap_or_default();
        slots.into_iter().zip(weights).map(|(slot, weight)| weight * of(slot)).sum::<DVec3>().normalize_or_zero()
    }

    fn of(&self, there: Option<([u32; 3], [f64; 3])>) -> DVec3 {
        let Some((slots, weights)) = there else { return DVec3::ONE };
        let of = |slot: u32| self.scale.get(slot as usize).copied().unwrap_or(DVec3::ONE);
        slots.into_iter().zip(weights).map(|(slot, weight)| weight * of(slot)).sum()
    }

    /// Receivers at the vertices with their factors, and with the normals that these were solved for: where long edges are cut, a corner's
    /// is that of the pieces around it, which may be far from that of its triangles.
    pub fn at_vertices(&self, receivers: Receivers) -> Receivers {
        let of = |values: &[DVec3], none: DVec3| -> Vec<DVec3> {
            self.lattice.of_vertex.iter().map(|&slot| values.get(slot as usize).copied().unwrap_or(none)).collect()
        };
        let [factors, normals] = [of(&self.scale, DVec3::ONE), of(&self.lattice.normal, DVec3::ZERO)];
        receivers.with_factors(&factors).with_normals(&normals)
    }
}

/// Clusters of the samples of a surface, each with one factor while factors are solved for.
struct Clusters {
    /// A slot of each cluster.
    slots: Vec<u32>,
    /// Cluster of each sample.
    of_sample: Vec<u32>,
}

/// Steps towards factors s whose row sums s K s are those that are wanted, t. The step `s (t / (s K s))^(2/3)` alone leaves a third of any
/// error: those of smooth factors count twice in row sums, those of rough ones once. Chebyshev's recurrence over the steps, in logarithms,
/// leaves a sixth.
#[derive(Default)]
struct Chebyshev {
    /// The factors before the last step, and its weight.
    before: Option<(Vec<DVec3>, f64)>,
}

impl Chebyshev {
    /// One step, given what is wanted and what is there; the largest change.
    fn take(
        &mut self,
        factors: &mut [DVec3],
        wanted_and_there: impl Iterator<Item = (DVec3, DVec3)>,
        is_free: impl Fn(usize) -> bool,
    ) -> f64 {
        const LEFT: f64 = 1.0 / 3.0;
        let weight = match self.before {
            None => 1.0,
            Some((_, 1.0)) => 1.0 / (1.0 - 0.5 * LEFT * LEFT),
            Some((_, weight)) => 1.0 / (1.0 - 0.25 * LEFT * LEFT * weight),
        };
        let now = factors.to_vec();
        let mut change: f64 = 0.0;
        for (index, (factor, (wanted, there))) in factors.iter_mut().zip(wanted_and_there).enumerate() {
            for c in 0..3 {
                if is_free(index) && wanted[c] > 0.0 && there[c] > 0.0 {
                    let step = (wanted[c] / (factor[c] * there[c])).cbrt().powi(2);
                    let before = self.before.as_ref().map_or(factor[c], |(before, _)| before[index][c]);
                    factor[c] = before * (factor[c] * step / before).powf(weight);
                    change = change.max((step - 1.0).abs());
                }
            }
        }
        self.before = Some((now, weight));
        change
    }
}

/// Weights of the corners of a triangle at a point in its plane.
fn barycentric([a, b, c]: [DVec3; 3], point: DVec3) -> [f64; 3] {
    let cross = (b - a).cross(c - a);
    let square = cross.length_squared();
    if square <= 0.0 {
        return [1.0 / 3.0; 3];
    }
    let v = (point - a).cross(c - a).dot(cross) / square;
    let w = (b - a).cross(point - a).dot(cross) / square;
    [1.0 - v - w, v, w]
}

/// The kernels of a domain with layers of its parts, and which of them each part has.
fn kernels(domain: Domain, layers: &[Option<PartLayers>]) -> Result<(Vec<MediumKernel>, Vec<Option<u32>>)> {
    let reach = domain.mesh.diagonal_mm();
    let (mut kernels, mut of_part) = (Vec::new(), Vec::new());
    for (entry, layers) in domain.parts.parts.iter().zip(layers) {
        let medium = entry.medium.and_then(|m| domain.media.get(m as usize));
        of_part.push(medium.map(|_| kernels.len() as u32));
        let Some(medium) = medium else { continue };
        kernels.push(match layers {
            Some(of) => kernel(medium, &of.layers, reach)?,
            None => MediumKernel::new(medium),
        });
    }
    Ok((kernels, of_part))
}

/// The kernel of a medium with its layers.
fn kernel(medium: &Medium, layers: &[Layers; 3], reach_mm: f64) -> Result<MediumKernel> {
    let dipoles = medium.properties.dipoles(BoundaryFit::Published);
    let single = |c: usize| Ok(Arc::new(layers[c].profile(&dipoles[c], reach_mm)?) as Arc<dyn Profile>);
    let double = [0, 1, 2].map(|c| Arc::new(layers[c].double(dipoles[c])) as Arc<dyn Profile>);
    let varies_mm = layers.iter().map(|layers| layers.splines.fade_mm()).fold(f64::INFINITY, f64::min);
    Ok(MediumKernel::of_layers([single(0)?, single(1)?, single(2)?], (double, varies_mm), reach_mm))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
