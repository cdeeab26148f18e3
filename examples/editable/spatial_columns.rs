//! The columns of one kernel's transport, and what a threshold leaves of them.

use glam::DVec3;
use rayon::prelude::*;
use translux::error::Result;
use translux::geometry::bvh::Bvh;
use translux::geometry::samples::{Patch, Samples, patches};
use translux::geometry::scattered::{Kriging, OrientedPoint, Weights, choose};
use translux::light::Light;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::balanced_tree::{BalancedTree, LightDetails};
use translux::transport::irradiance::{Illumination, LightSampling};
use translux::transport::surface::Surface;

use crate::cdf97::Pictures;
use crate::common::bench::parallel;
use crate::surface_wavelet::SurfaceWavelet;

/// A kernel, of the square of the distance in mm^2.
pub(crate) type Basis = Box<dyn Fn(f64) -> f64 + Sync>;

/// Lights that errors are the worst of: two suns, and a lamp near the surface.
pub(crate) const LIGHTS: usize = 3;

/// Vertices that are transformed over the samples together, and columns of one task.
const TOGETHER: usize = 64;
const TASK: usize = 128;

/// Levels of the transform of a picture, and bisections of a threshold.
const LEVELS: u32 = 5;
const BISECTIONS: usize = 9;

/// Classes of coefficients whose entropies are of their own: levels of the tree over the samples.
const CLASSES: usize = 24;

/// Magnitudes beyond this cost their bits in full.
const SYMBOLS: usize = 256;

/// Vertices, samples and lights of one model.
pub(crate) struct Transport {
    points: Vec<OrientedPoint>,
    areas: Vec<f64>,
    samples: Vec<Patch>,
    /// Class of each coefficient, 1 over the norm of what it stands for on the samples, and its details under the lights.
    classes: Vec<usize>,
    inverse_norms: Vec<f64>,
    lights: Vec<[f64; LIGHTS]>,
}

impl Transport {
    pub(crate) fn new(scene: &Scene, count: usize) -> Result<Self> {
        let samples = Samples::new(&scene.mesh, &scene.parts, count).in_tree_order(&scene.mesh, &scene.parts);
        let patches = patches(&scene.mesh, &samples);
        let bvh = Bvh::new(&scene.mesh);
        let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
        let reach = scene.mesh.diagonal_mm();
        let lamp =
            Light::Point { at_mm: scene.mesh.origin_mm + DVec3::new(0.2, 0.3, 0.6) * reach, intensity: DVec3::ONE };
        let all = super::directions().map(parallel).into_iter().chain([lamp]);
        let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let mut lights = vec![[0.0; LIGHTS]; patches.len()];
        for (index, light) in all.enumerate() {
            let lit = Illumination::new(&surface, &[light], &etas, LightSampling::FAST)?.all(&Silent);
            let found = LightDetails::new(&samples, &patches, &lit);
            for (own, detail) in lights.iter_mut().zip(&found.details) {
                own[index] = f64::from(detail[1]);
            }
            lights[0][index] = f64::from(found.means[0][1]);
        }
        let mut normals = vec![DVec3::ZERO; scene.mesh.local_mm.len()];
        for (triangle, corners) in scene.mesh.triangles.iter().enumerate() {
            corners.iter().for_each(|&c| normals[c as usize] += scene.mesh.cross_mm2(triangle as u32));
        }
        let point = |(at, normal): (&glam::Vec3, &DVec3)| OrientedPoint {
            at_mm: at.as_dvec3(),
            normal: normal.normalize_or_zero(),
        };
        let points = scene.mesh.local_mm.iter().zip(&normals).map(point).collect();
        let area: f64 = patches.iter().map(|p| p.area_mm2).sum();
        let (mut classes, mut inverse_norms) = (vec![0; patches.len()], vec![area.sqrt().recip(); patches.len()]);
        let tree = BalancedTree::new(&samples, &patches);
        let mut stack: Vec<_> = tree.root(0).into_iter().map(|root| (root, 1)).collect();
        while let Some((node, depth)) = stack.pop() {
            if !node.is_leaf() {
                let [a, b] = node.children().map(|child| tree.cell(child, &patches).area_mm2);
                classes[node.name()] = depth.min(CLASSES - 1);
                inverse_norms[node.name()] = ((a + b) / (a * b).max(f64::MIN_POSITIVE)).sqrt();
                stack.extend(node.children().map(|child| (child, depth + 1)));
            }
        }
        Ok(Self { points, areas: scene.vertex_areas_mm2(), samples: patches, classes, inverse_norms, lights })
    }

    pub(crate) fn vertices(&self) -> usize {
        self.points.len()
    }

    fn area(&self) -> f64 {
        self.areas.iter().sum()
    }

    pub(crate) fn vertex_mm(&self) -> f64 {
        (self.area() / self.vertices() as f64).sqrt()
    }

    pub(crate) fn sample_mm(&self) -> f64 {
        (self.area() / self.samples.len() as f64).sqrt()
    }

    /// Relative RMS over the area, the worst light.
    pub(crate) fn error(&self, found: &[Vec<f64>], exact: &[Vec<f64>]) -> f64 {
        let of_light = |(found, exact): (&Vec<f64>, &Vec<f64>)| {
            let sum = |f: &dyn Fn(usize) -> f64| (0..exact.len()).map(|i| self.areas[i] * f(i).powi(2)).sum::<f64>();
            (sum(&|i| found[i] - exact[i]) / sum(&|i| exact[i]).max(f64::MIN_POSITIVE)).sqrt()
        };
        found.iter().zip(exact).map(of_light).fold(0.0, f64::max)
    }

    /// The most negative value over the largest exact one, the worst light.
    pub(crate) fn most_negative(&self, found: &[Vec<f64>], exact: &[Vec<f64>]) -> f64 {
        let of_light = |(found, exact): (&Vec<f64>, &Vec<f64>)| {
            let least = found.iter().copied().fold(0.0, f64::min);
            -least / exact.iter().copied().fold(f64::MIN_POSITIVE, f64::max)
        };
        found.iter().zip(exact).map(of_light).fold(0.0, f64::max)
    }
}

/// Whether values at points are transformed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lifted {
    No,
    Yes,
}

/// A transform of columns.
pub(crate) struct Spatial {
    name: String,
    /// Of each coefficient of a column: the norm of what it stands for on the surface, mm; 0 where there is none.
    norms: Vec<f64>,
    kind: Kind,
}

enum Kind {
    None,
    Cdf97(Pictures),
    Lifting(SurfaceWavelet),
    /// Weights over some of the vertices, these, and their wavelet.
    Points(Weights, Vec<u32>, Option<SurfaceWavelet>),
}

impl Spatial {
    pub(crate) fn none(transport: &Transport) -> Self {
        let norms = transport.areas.iter().map(|a| a.sqrt()).collect();
        Self { name: "every vertex".to_owned(), norms, kind: Kind::None }
    }

    pub(crate) fn cdf97(transport: &Transport, side: usize) -> Self {
        let norms = vec![transport.vertex_mm(); transport.vertices()];
        Self { name: "CDF 9/7".to_owned(), norms, kind: Kind::Cdf97(Pictures::new(side, side, LEVELS)) }
    }

    pub(crate) fn lifting(transport: &Transport) -> Self {
        let spacing = 1.4 * transport.vertex_mm();
        let wavelet = SurfaceWavelet::new(&transport.points, &transport.areas, spacing, Kriging::RADIOSITY);
        Self { name: "lifting".to_owned(), norms: wavelet.norms().to_vec(), kind: Kind::Lifting(wavelet) }
    }

    /// Fewer vertices, so many sample spacings apart, transformed by lifting where that is asked.
    pub(crate) fn points(transport: &Transport, spacings: f64, lifted: Lifted) -> Self {
        let spacing_mm = spacings * transport.sample_mm();
        let mut chosen = choose(&transport.points, spacing_mm).concat();
        chosen.sort_unstable();
        let sources: Vec<OrientedPoint> = chosen.iter().map(|&i| transport.points[i as usize]).collect();
        let weights = Weights::new(&sources, &transport.points, spacing_mm, Kriging::SMOOTH);
        let mut norms = vec![0.0; transport.vertices()];
        let area = transport.area() / chosen.len().max(1) as f64;
        let areas = vec![area; chosen.len()];
        let (wavelet, form) = match lifted {
            Lifted::No => (None, ""),
            Lifted::Yes => {
                let spacing_mm = 2.0 * spacing_mm;
                (Some(SurfaceWavelet::new(&sources, &areas, spacing_mm, Kriging::RADIOSITY)), ", lifted")
            }
        };
        for (k, &i) in chosen.iter().enumerate() {
            norms[i as usize] = wavelet.as_ref().map_or(area.sqrt(), |wavelet| wavelet.norms()[k]);
        }
        let name = format!("points {spacings} sample spacings apart{form}");
        Self { name, norms, kind: Kind::Points(weights, chosen, wavelet) }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    fn forward(&self, column: &mut [f64]) {
        match &self.kind {
            Kind::Cdf97(pictures) => pictures.forward(column),
            Kind::Lifting(wavelet) => wavelet.forward(column),
            Kind::Points(_, chosen, Some(wavelet)) => {
                let mut values: Vec<f64> = chosen.iter().map(|&i| column[i as usize]).collect();
                wavelet.forward(&mut values);
                chosen.iter().zip(values).for_each(|(&i, v)| column[i as usize] = v);
            }
            Kind::None | Kind::Points(_, _, None) => {}
        }
    }

    fn inverse(&self, column: &mut Vec<f64>) {
        match &self.kind {
            Kind::Cdf97(pictures) => pictures.inverse(column),
            Kind::Lifting(wavelet) => wavelet.inverse(column),
            Kind::Points(weights, chosen, wavelet) => {
                let mut values: Vec<f64> = chosen.iter().map(|&i| column[i as usize]).collect();
                wavelet.iter().for_each(|wavelet| wavelet.inverse(&mut values));
                let value = |(source, w): (u32, f32)| f64::from(w) * values[source as usize];
                *column = (0..column.len()).map(|v| weights.of(v).map(value).sum()).collect();
            }
            Kind::None => {}
        }
    }
}

/// Haar coefficients over the samples, `[coefficient][vertex]`.
pub(crate) struct Columns {
    vertices: usize,
    values: Vec<f32>,
}

/// What a threshold leaves: coefficients and bytes of a vertex, and the values under each light.
pub(crate) struct Found {
    pub(crate) kept: f64,
    pub(crate) entropy_bytes: f64,
    pub(crate) values: Vec<Vec<f64>>,
}

/// Sums of some columns.
struct Partial {
    kept: u64,
    energy: f64,
    /// Occurrences of each magnitude in each class; bits of signs and of magnitudes beyond.
    counts: Vec<[u64; SYMBOLS]>,
    bits: f64,
    values: Vec<[f64; LIGHTS]>,
}

impl Columns {
    pub(crate) fn new(transport: &Transport, function: &Basis) -> Self {
        let (vertices, samples) = (transport.vertices(), &transport.samples);
        let blocks: Vec<Vec<[f32; TOGETHER]>> = transport
            .points
            .par_chunks(TOGETHER)
            .map(|points| {
                let of_sample = |sample: &Patch| {
                    std::array::from_fn(|lane| {
                        let point = points.get(lane).map_or(sample.centre_mm, |p| p.at_mm);
                        (function(point.distance_squared(sample.centre_mm)) * sample.area_mm2) as f32
                    })
                };
                let mut rows: Vec<[f32; TOGETHER]> = samples.iter().map(of_sample).collect();
                haar(&mut rows, samples);
                rows
            })
            .collect();
        let mut values = vec![0.0; vertices * samples.len()];
        values.par_chunks_mut(vertices).enumerate().for_each(|(column, out)| {
            out.chunks_mut(TOGETHER).zip(&blocks).for_each(|(out, block)| {
                let count = out.len();
                out.copy_from_slice(&block[column][..count]);
            });
        });
        Self { vertices, values }
    }

    pub(crate) fn transformed(&self, spatial: &Spatial) -> Self {
        let mut values = self.values.clone();
        values.par_chunks_mut(self.vertices * TASK).for_each(|columns| {
            let mut scratch = vec![0.0; self.vertices];
            for column in columns.chunks_mut(self.vertices) {
                scratch.iter_mut().zip(&*column).for_each(|(s, v)| *s = f64::from(*v));
                spatial.forward(&mut scratch);
                column.iter_mut().zip(&scratch).for_each(|(v, s)| *v = *s as f32);
            }
        });
        Self { vertices: self.vertices, values }
    }

    /// The values under each light, nothing dropped.
    pub(crate) fn exact(&self, transport: &Transport) -> Vec<Vec<f64>> {
        self.at(transport, &Spatial::none(transport), 0.0).values
    }

    /// What is above a threshold, rounded to steps of it (at 0 all of it as it is).
    pub(crate) fn at(&self, transport: &Transport, spatial: &Spatial, threshold: f64) -> Found {
        self.sums(transport, spatial, threshold, threshold).0
    }

    /// The same at the largest threshold with an error; `None` where none has.
    pub(crate) fn at_error(
        &self,
        transport: &Transport,
        spatial: &Spatial,
        exact: &[Vec<f64>],
        error: f64,
    ) -> Option<(f64, Found)> {
        let largest = self.largest(transport, spatial);
        let (mut low, mut high) = (-9.0f64, 0.0f64);
        let mut best = None;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            let threshold = largest * 10f64.powf(middle);
            let found = self.at(transport, spatial, threshold);
            if transport.error(&found.values, exact) <= error {
                low = middle;
                best = Some((threshold, found));
            } else {
                high = middle;
            }
        }
        best
    }

    /// The largest coefficients that have a share of the energy, not rounded.
    pub(crate) fn at_energy(&self, transport: &Transport, spatial: &Spatial, share: f64) -> Found {
        let whole = self.sums(transport, spatial, 0.0, 0.0).1;
        let largest = self.largest(transport, spatial);
        let (mut low, mut high) = (-9.0f64, 0.0f64);
        for _ in 0..2 * BISECTIONS {
            let middle = 0.5 * (low + high);
            let energy = self.sums(transport, spatial, largest * 10f64.powf(middle), 0.0).1;
            if energy >= share * whole { low = middle } else { high = middle }
        }
        self.sums(transport, spatial, largest * 10f64.powf(low), 0.0).0
    }

    fn largest(&self, transport: &Transport, spatial: &Spatial) -> f64 {
        let of_column = |(j, column): (usize, &[f32])| {
            let largest = column.iter().zip(&spatial.norms).map(|(v, n)| f64::from(v.abs()) * n).fold(0.0, f64::max);
            largest * transport.inverse_norms[j]
        };
        self.values.par_chunks(self.vertices).enumerate().map(of_column).reduce(|| 0.0, f64::max)
    }

    fn sums(&self, transport: &Transport, spatial: &Spatial, threshold: f64, step: f64) -> (Found, f64) {
        let parts: Vec<Partial> = self
            .values
            .par_chunks(self.vertices * TASK)
            .enumerate()
            .map(|(task, columns)| self.partial(transport, spatial, (threshold, step), (task * TASK, columns)))
            .collect();
        let mut all = Partial::new(self.vertices);
        for part in parts {
            all.kept += part.kept;
            all.energy += part.energy;
            all.bits += part.bits;
            all.counts.as_flattened_mut().iter_mut().zip(part.counts.as_flattened()).for_each(|(a, b)| *a += b);
            let values = all.values.as_flattened_mut().iter_mut();
            values.zip(part.values.as_flattened()).for_each(|(a, b)| *a += b);
        }
        let of_light = |light: usize| {
            let mut column: Vec<f64> = all.values.iter().map(|v| v[light]).collect();
            spatial.inverse(&mut column);
            column
        };
        let entropy: f64 = all.counts.iter().map(entropy).sum();
        let vertices = self.vertices as f64;
        let values = (0..LIGHTS).map(of_light).collect();
        let found =
            Found { kept: all.kept as f64 / vertices, entropy_bytes: (entropy + all.bits) / 8.0 / vertices, values };
        (found, all.energy)
    }

    fn partial(
        &self,
        transport: &Transport,
        spatial: &Spatial,
        (threshold, step): (f64, f64),
        (first, columns): (usize, &[f32]),
    ) -> Partial {
        let mut part = Partial::new(self.vertices);
        for (j, column) in (first..).zip(columns.chunks(self.vertices)) {
            let (scale, light) = (transport.inverse_norms[j], transport.lights[j]);
            let counts = &mut part.counts[transport.classes[j]];
            for ((&value, &norm), sums) in column.iter().zip(&spatial.norms).zip(&mut part.values) {
                let significance = f64::from(value).abs() * norm * scale;
                if norm <= 0.0 {
                    continue;
                }
                if significance <= threshold {
                    counts[0] += 1;
                    continue;
                }
                part.kept += 1;
                part.energy += significance * significance;
                let mut value = f64::from(value);
                if step > 0.0 {
                    let size = (significance / step).round();
                    value = (size * step / (norm * scale)).copysign(value);
                    counts[(size as usize).min(SYMBOLS - 1)] += 1;
                    // The sign, and what is beyond the last symbol.
                    part.bits += 1.0 + 2.0 * (size / SYMBOLS as f64).max(1.0).log2();
                }
                sums.iter_mut().zip(light).for_each(|(sum, light)| *sum += value * light);
            }
        }
        part
    }
}

impl Partial {
    fn new(vertices: usize) -> Self {
        let (counts, values) = (vec![[0; SYMBOLS]; CLASSES], vec![[0.0; LIGHTS]; vertices]);
        Self { kept: 0, energy: 0.0, counts, bits: 0.0, values }
    }
}

fn entropy(counts: &[u64; SYMBOLS]) -> f64 {
    let all: u64 = counts.iter().sum();
    counts.iter().filter(|c| **c > 0).map(|&c| c as f64 * (all as f64 / c as f64).log2()).sum()
}

/// The area-weighted Haar transform over the tree of the samples, of [`TOGETHER`] vertices: the sum first, the detail of a node
/// by its name, as `transport/far_field.rs` has them. Returns the area.
fn haar(rows: &mut [[f32; TOGETHER]], samples: &[Patch]) -> f64 {
    let count = rows.len().min(samples.len());
    if count <= 1 {
        return samples.first().map_or(0.0, |s| s.area_mm2);
    }
    let half = count.div_ceil(2);
    let (left, right) = rows.split_at_mut(half);
    let (a, b) = (haar(left, &samples[..half]), haar(right, &samples[half..]));
    let (of_left, of_right) = ((b / (a + b)) as f32, (a / (a + b)) as f32);
    for (left, right) in left[0].iter_mut().zip(&mut right[0]) {
        (*left, *right) = (*left + *right, *left * of_left - *right * of_right);
    }
    a + b
}
