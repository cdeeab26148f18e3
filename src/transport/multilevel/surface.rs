//! Radiosity of a scene by multilevel summation: every part has its nets, every medium its tables. The errors of interpolation and of
//! discs depend on the roughness of the surface and on the shape of its samples, so the quality that keeps an asked error is measured,
//! against all pairs.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;

use super::compact::{Compact, Facets, Shine};
use super::double::Double;
use super::near::NearSamples;
use super::{FEW, Multilevel, Resolution, Tables};
use crate::geometry::cluster::Run;
use crate::geometry::samples::Patch;
use crate::geometry::scattered::OrientedPoint;
use crate::medium::profile::Profile;
use crate::parallel::*;
use crate::progress::Silent;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::irradiance::Pieces;
use crate::transport::kernel::medium::{KernelsOfParts, MediumKernel};
use crate::transport::kernel::radial_table::LinearTable;
use crate::transport::near_rule::{NearField, NearRule};
use crate::transport::receivers::{Group, Receivers};
use crate::transport::sample_light::SampleLight;
use crate::transport::surface::Surface;
use crate::transport::tree::SampleTree;

/// Softening at most.
const MOST_SOFTENING: f64 = 16.0;

/// Receivers that errors are measured on.
const PROBES: usize = 192;

/// Share of the asked error that is aimed at: other receivers and lights may fare worse.
const TARGET: f64 = 0.8;

/// Softening that is tried first, over that of [`Quality::for_error`], which rough surfaces need.
const SMOOTHEST: f64 = 0.72;

/// Factors from one trial to the next on the softening, and on the distances of the near rule.
const SOFTER: f64 = 1.15;
const NEARER: f64 = 1.35;

/// Trials at most, each in both ways.
const TRIALS: usize = 10;

/// Error over that before from which on neither way leads further.
const NO_GAIN: f64 = 0.97;

/// Distance over radius at most below which samples are integrated by points.
const MOST_NEAR: f64 = 24.0;

/// Accuracy of the sums against all pairs.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Quality {
    /// Asked relative error, RMS over the receivers.
    pub error: f64,
    /// Spacing of the finest net over that of the samples.
    pub spacing: f64,
    /// Radius of the compact part in spacings of the finest net.
    pub softening: f64,
    /// Integration of near samples.
    pub near: NearRule,
}

impl Quality {
    /// The quality for an asked error where the surface has not been measured ([`SurfaceNets::tuned`]). The error of a
    /// softened kernel's interpolation falls with the fourth power of the softening; under the worst of the probe
    /// lights it was 2.4e-3 (bunny, 100 mm, marble) to 8e-3 (noise on a coarsely sampled head) at 2.75.
    pub fn for_error(relative_rms: f64) -> Self {
        let softening = (2.75 * (8e-3 / (0.8 * relative_rms)).powf(0.25)).clamp(2.4, MOST_SOFTENING);
        let reach = 0.005 / relative_rms;
        let near = NearRule {
            facets_below: (2.2 * reach.powf(0.6)).clamp(1.5, 12.0),
            pieces_below: (5.0 * reach.sqrt()).clamp(2.0, 24.0),
        };
        Self { error: relative_rms, spacing: 2.0, softening, near }
    }

    /// The first quality from this one on whose measured error is small enough, or the last one tried.
    fn searched(self, error: f64, mut measured: impl FnMut(Self) -> f64) -> Self {
        let mut quality = self;
        let mut found = measured(quality);
        for _ in 0..TRIALS {
            if found <= TARGET * error {
                break;
            }
            let [softer, nearer] = [quality.softer(), quality.nearer()];
            // Another softening takes tables, and double layers nets, of its own.
            let of_nearer = measured(nearer);
            if of_nearer <= TARGET * error {
                return nearer;
            }
            let both = [measured(softer), of_nearer];
            if both[0].min(both[1]) > NO_GAIN * found {
                break;
            }
            // The softening costs more, so it has to bring more.
            (quality, found) = if both[0] < 0.95 * both[1] { (softer, both[0]) } else { (nearer, both[1]) };
            if quality.softening >= MOST_SOFTENING && quality.near.facets_below >= MOST_NEAR {
                break;
            }
        }
        quality
    }

    fn softer(self) -> Self {
        Self { softening: (SOFTER * self.softening).min(MOST_SOFTENING), ..self }
    }

    fn nearer(self) -> Self {
        let NearRule { facets_below, pieces_below } = self.near;
        let near = NearRule {
            facets_below: (NEARER * facets_below).min(MOST_NEAR),
            pieces_below: (NEARER * pieces_below).min(MOST_NEAR),
        };
        Self { near, ..self }
    }
}

/// The nets of a surface for its receivers.
pub struct SurfaceNets {
    pub(crate) parts: Vec<Part>,
    facets: Facets,
    quality: Quality,
    /// The receivers whose radiosity is asked for, ascending; all where there is no list. What is near others is left out.
    asked: Option<Vec<u32>>,
}

/// Whether the radiosity of each receiver of a part, given by their range among all, is asked for; empty where that of all is.
fn asked_of(asked: Option<&[u32]>, receivers: &Range<usize>) -> Vec<bool> {
    let Some(asked) = asked else { return Vec::new() };
    let mut of_part = vec![false; receivers.len()];
    for &receiver in asked {
        let own = (receiver as usize).checked_sub(receivers.start).and_then(|i| of_part.get_mut(i));
        own.into_iter().for_each(|own| *own = true);
    }
    of_part
}

/// One part that light enters.
pub(crate) struct Part {
    part: usize,
    groups: Vec<Run>,
    pub(crate) samples: Range<usize>,
    pub(crate) receivers: Range<usize>,
    pub(crate) nets: Multilevel,
    pub(crate) near: NearSamples,
    extent_mm: f64,
    /// Nets of double layers that were asked for last.
    doubled: Mutex<VecDeque<Arc<Multilevel>>>,
}

/// Nets of double layers that a part remembers: tuning goes back and forth between a few.
const DOUBLED: usize = 3;

impl Part {
    /// The nets of a double layer over the samples and for the receivers of the part.
    fn doubled(&self, surface: &Surface, receivers: &Receivers, resolution: Resolution) -> Arc<Multilevel> {
        let mut known = self.doubled.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known.iter().find(|nets| nets.resolution == resolution) {
            return Arc::clone(found);
        }
        let point = |at_mm: &DVec3| OrientedPoint { at_mm: *at_mm, normal: DVec3::ZERO };
        let sources: Vec<OrientedPoint> =
            surface.patches[self.samples.clone()].iter().map(|p| point(&p.centre_mm)).collect();
        let targets: Vec<OrientedPoint> = receivers.positions[self.receivers.clone()].iter().map(point).collect();
        let made = Arc::new(Multilevel::new(&sources, &targets, resolution));
        if known.len() == DOUBLED {
            known.pop_front();
        }
        known.push_back(Arc::clone(&made));
        made
    }
}

/// Radius of the compact part in spacings; the whole extent if there are few samples, which are summed one by one.
fn softening(quality: Quality, samples: usize, extent_mm: f64, spacing_mm: f64) -> f64 {
    if samples <= FEW { quality.softening.max(2.0 * extent_mm / spacing_mm) } else { quality.softening }
}

/// Tables of every part, which follow from the media, and the double layers of parts that have them.
pub struct SurfaceTables {
    pub(crate) parts: Vec<(Tables, Compact)>,
    pub(crate) doubles: Vec<Option<Double>>,
}

impl SurfaceNets {
    /// The nets of the samples of a surface, for receivers on it.
    pub fn new(surface: &Surface, receivers: &Receivers, quality: Quality) -> Self {
        Self::at_some(surface, receivers, quality, None)
    }

    /// [`Self::new`] where the radiosity of some receivers alone is asked for.
    pub fn at_some(surface: &Surface, receivers: &Receivers, quality: Quality, asked: Option<&[u32]>) -> Self {
        let asked = asked.map(|asked| {
            let mut asked = asked.to_vec();
            asked.sort_unstable();
            asked.dedup();
            asked
        });
        let centres: Vec<DVec3> = surface.patches.iter().map(|p| p.centre_mm).collect();
        let of_part = |groups: &[Group]| {
            let (first, last) = (groups.first()?, groups.last()?);
            let index = first.part as usize;
            surface.domain.parts.parts.get(index)?.medium?;
            let samples = surface.samples.part(index);
            let range = first.run.first as usize..last.run.end as usize;
            let asked = asked.as_deref();
            Some(Self::part(surface, (&centres, samples), (receivers, range, groups, asked), index, quality))
        };
        let parts = receivers.groups.chunk_by(|a, b| a.part == b.part).filter_map(of_part).collect();
        let facets = Facets::new(surface.domain.mesh, surface.samples, surface.patches);
        Self { parts, facets, quality, asked }
    }

    /// Nets of the coarsest quality of a few that keeps a relative error, RMS over receivers weighted by `areas`, in each set
    /// of media and under each light (irradiance of every sample and pieces of uneven ones); of the last one tried where
    /// none keeps it. The receivers that tell the error are those whose radiosity is asked for.
    pub fn tuned(
        (surface, media): (&Surface, &[KernelsOfParts]),
        (receivers, areas): (&Receivers, &[f64]),
        lights: &[(Vec<DVec3>, Pieces)],
        error: f64,
    ) -> Self {
        let (subset, points) = receivers.probe_points(areas, (PROBES, 0));
        let tree = SampleTree::default();
        let truths_in = |kernels: &KernelsOfParts| -> Vec<Vec<DVec3>> {
            let gather = Gather::with_kernels_of_parts(surface, &tree, kernels.clone(), NearField::REFERENCE);
            let truth = |(irradiance, pieces): &(Vec<DVec3>, Pieces)| {
                gather.radiosity(&subset, &gather.light_with_pieces(irradiance, pieces), Scheme::AllPairs, &Silent)
            };
            lights.iter().map(truth).collect()
        };
        let guess = Quality::for_error(error);
        let guess = Quality { softening: SMOOTHEST * guess.softening, ..guess };
        let mut nets = Self::at_some(surface, receivers, guess, Some(&points.indices));
        let media: Vec<&KernelsOfParts> =
            media.iter().filter(|(kernels, parts)| nets.resolve((kernels, parts))).collect();
        let probes = (receivers, Some(points.indices.as_slice()));
        let mut measured = |quality: Quality, media: &[(&KernelsOfParts, Vec<Vec<DVec3>>)]| {
            nets.set_quality(surface, receivers, quality);
            let in_media = |((kernels, of_part), truths): &(&KernelsOfParts, Vec<Vec<DVec3>>)| {
                let tables = nets.tables(surface, receivers, (kernels, of_part));
                let of_light = |((irradiance, pieces), truth): (&(Vec<DVec3>, Pieces), &Vec<DVec3>)| {
                    let all = nets.radiosity(surface, &tables, SampleLight::new(irradiance, pieces), probes);
                    points.error(&points.of(&all), truth).rms
                };
                lights.iter().zip(truths).map(of_light).fold(0.0, f64::max)
            };
            media.iter().map(in_media).fold(0.0, f64::max)
        };
        // Double layers have nets of their own, which take long to make: they are tried where single layers are near enough.
        let single: Vec<KernelsOfParts> = media
            .iter()
            .map(|(kernels, parts)| (kernels.iter().map(MediumKernel::single_layer).collect(), parts.clone()))
            .collect();
        let tried: Vec<_> = single.iter().map(|kernels| (kernels, truths_in(kernels))).collect();
        let quality = guess.searched(error, |quality| measured(quality, &tried));
        let layered = media.into_iter().filter(|(kernels, _)| kernels.iter().any(|kernel| kernel.layers().is_some()));
        let tried: Vec<_> = layered.map(|kernels| (kernels, truths_in(kernels))).collect();
        let quality =
            if tried.is_empty() { quality } else { quality.searched(error, |quality| measured(quality, &tried)) };
        nets.set_quality(surface, receivers, quality);
        nets
    }

    /// Their quality.
    pub fn quality(&self) -> Quality {
        self.quality
    }

    fn part(
        surface: &Surface,
        (centres, samples): (&[DVec3], Range<usize>),
        (receivers, range, groups, asked): (&Receivers, Range<usize>, &[Group], Option<&[u32]>),
        part: usize,
        quality: Quality,
    ) -> Part {
        let area: f64 = surface.patches[samples.clone()].iter().map(|p| p.area_mm2).sum();
        let spacing = (area / samples.len().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
        let points = || centres[samples.clone()].iter().chain(&receivers.positions[range.clone()]);
        let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        let extent_mm = (high - low).length();
        let spacing_mm = quality.spacing * spacing;
        let resolution = Resolution { spacing_mm, softening: softening(quality, samples.len(), extent_mm, spacing_mm) };
        // Softened kernels vary in space: which way the surface faces does not matter to them.
        let point = |at_mm: &DVec3| OrientedPoint { at_mm: *at_mm, normal: DVec3::ZERO };
        let sources: Vec<OrientedPoint> = centres[samples.clone()].iter().map(point).collect();
        let targets: Vec<OrientedPoint> = receivers.positions[range.clone()].iter().map(point).collect();
        let runs: Vec<Run> = groups
            .iter()
            .map(|g| Run { first: g.run.first - range.start as u32, end: g.run.end - range.start as u32 })
            .collect();
        let positions = &receivers.positions[range.clone()];
        let (nets, near) = rayon::join(
            || Multilevel::new(&sources, &targets, resolution),
            || {
                let asked = asked_of(asked, &range);
                NearSamples::new(&centres[samples.clone()], positions, (&runs, &asked), resolution.near_mm())
            },
        );
        Part { part, groups: runs, samples, receivers: range, nets, near, extent_mm, doubled: Mutex::default() }
    }

    /// Asks for the radiosity of some receivers, or of all, beside that of those that were asked for.
    pub fn ask(&mut self, surface: &Surface, receivers: &Receivers, asked: Option<&[u32]>) {
        let Some(known) = &self.asked else { return };
        let all = asked.map(|asked| {
            let mut all = [known.as_slice(), asked].concat();
            all.sort_unstable();
            all.dedup();
            all
        });
        if all.as_ref() != Some(known) {
            self.asked = all;
            self.find_near(surface, receivers);
        }
    }

    /// Sets another quality; nets and spacing stay.
    fn set_quality(&mut self, surface: &Surface, receivers: &Receivers, quality: Quality) {
        let softens = quality.softening != self.quality.softening;
        self.quality = Quality { spacing: self.quality.spacing, ..quality };
        if softens {
            for part in &mut self.parts {
                let spacing_mm = part.nets.resolution.spacing_mm;
                part.nets.soften(softening(quality, part.samples.len(), part.extent_mm, spacing_mm));
            }
            self.find_near(surface, receivers);
        }
    }

    /// Finds the samples near the receivers that are asked for.
    fn find_near(&mut self, surface: &Surface, receivers: &Receivers) {
        let asked = self.asked.as_deref();
        for part in &mut self.parts {
            let centres: Vec<DVec3> = surface.patches[part.samples.clone()].iter().map(|p| p.centre_mm).collect();
            let positions = &receivers.positions[part.receivers.clone()];
            let asked = asked_of(asked, &part.receivers);
            part.near = NearSamples::new(&centres, positions, (&part.groups, &asked), part.nets.resolution.near_mm());
        }
    }

    /// True if nets resolve the double layers of kernels of the parts, where they have any: those that vary within the spacing of
    /// the samples take sums of another kind.
    pub fn resolve(&self, (kernels, of_part): (&[MediumKernel], &[Option<u32>])) -> bool {
        let layers = |part: &Part| kernels.get(of_part.get(part.part).copied().flatten()? as usize)?.layers();
        let resolved = |part: &Part| {
            layers(part).is_none_or(|layers| Double::is_resolved(layers.varies_mm(), part.nets.resolution))
        };
        self.parts.iter().all(resolved)
    }

    /// Tables of kernels of the parts, which are those of [`Self::new`] on the same surface and for the same receivers.
    pub fn tables(
        &self,
        surface: &Surface,
        receivers: &Receivers,
        (kernels, of_part): (&[MediumKernel], &[Option<u32>]),
    ) -> SurfaceTables {
        let kernel = |part: &Part| of_part.get(part.part).copied().flatten().and_then(|k| kernels.get(k as usize));
        let double = |part: &Part| {
            let kernel = kernel(part)?;
            let layers = kernel.layers()?;
            let resolution = Double::resolution(layers.varies_mm(), part.nets.resolution);
            let nets = part.doubled(surface, receivers, resolution);
            Some(Double::new(nets, (layers.double(), layers.varies_mm()), part.extent_mm))
        };
        let of_part = |part: &Part| {
            let medium = kernel(part)?;
            let profiles: &[Arc<dyn Profile>; 3] = medium.profiles();
            let radius = part.nets.resolution.near_mm();
            let softened = medium.softened(radius);
            let square = self.facets.mean_square(part.samples.clone());
            let (tables, (point, disc)) = rayon::join(
                || part.nets.tables(&profiles.each_ref().map(AsRef::as_ref), part.extent_mm.max(2.0 * radius)),
                || {
                    rayon::join(
                        || LinearTable::compact(profiles, &softened, radius),
                        || LinearTable::compact_disc(profiles, &softened, radius, square),
                    )
                },
            );
            let smooth_mm = medium.smooth_mm();
            let split_below = self.split_below(profiles, square);
            let compact = Compact { point, disc, smooth_mm, rule: self.quality.near, split_below };
            Some((tables, compact))
        };
        SurfaceTables {
            parts: self.parts.par_iter().filter_map(of_part).collect(),
            doubles: self.parts.iter().map(double).collect(),
        }
    }

    /// Distance over radius below which facets are split. Six points of a triangle err by 0.8 % where it is 1.2 radii
    /// away, less with the fifth power of that distance; the weight of so near a sample is the share that a sample
    /// around the receiver returns.
    fn split_below(&self, profiles: &[Arc<dyn Profile>; 3], mean_square: f64) -> f32 {
        let share = |p: &Arc<dyn Profile>| p.disc((2.0 * mean_square).sqrt()) / p.total();
        let share = profiles.iter().map(share).filter(|s| s.is_finite()).fold(0.0, f64::max);
        (1.2 * (0.008 * share / (0.4 * self.quality.error)).powf(0.2)).clamp(1.0, 4.0) as f32
    }

    /// Radiosity of the receivers that are asked for, RGB, from the light on the samples: of all where there is no list. What others have
    /// is of no use.
    pub fn radiosity(
        &self,
        surface: &Surface,
        tables: &SurfaceTables,
        light: SampleLight,
        (receivers, asked): (&Receivers, Option<&[u32]>),
    ) -> Vec<DVec3> {
        const TASK: usize = 4096;
        let mut flux = vec![[0.0f32; 4]; surface.patches.len()];
        flux.par_iter_mut().zip(surface.patches).enumerate().with_min_len(TASK).for_each(|(i, (out, patch))| {
            *out = light.flux(i, patch).as_vec3().extend(0.0).to_array();
        });
        let mut result = vec![DVec3::ZERO; receivers.len()];
        let shine = Shine { flux: &flux, light };
        for ((part, (far, compact)), double) in self.parts.iter().zip(&tables.parts).zip(&tables.doubles) {
            let mut values = Vec::new();
            part.nets.sum(far, &flux[part.samples.clone()], &mut values);
            let asked = asked_of(asked, &part.receivers);
            part.near.add((compact, &self.facets), (shine, part.samples.start), &asked, &mut values);
            let range = part.receivers.clone();
            if let Some(double) = double {
                let normal = |p: &Patch| (p.cross_mm2 / p.area_mm2).as_vec3().to_array();
                let normals: Vec<[f32; 3]> = surface.patches[part.samples.clone()].iter().map(normal).collect();
                let of_receivers = receivers.normals.get(range.clone()).unwrap_or(&[]);
                double.add((&flux[part.samples.clone()], &normals), of_receivers, &mut values);
            }
            let out = &mut result[range.clone()];
            out.par_iter_mut().zip(&values).enumerate().with_min_len(TASK).for_each(|(i, (out, value))| {
                let sum = DVec3::new(value[0].into(), value[1].into(), value[2].into());
                *out = (light.radiosity(sum) * receivers.factor(range.start + i)).max(DVec3::ZERO);
            });
        }
        result
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        self.parts.iter().map(|part| part.nets.bytes() + part.near.bytes()).sum::<usize>() + self.facets.bytes()
    }
}
