//! The paper's Figure 5: image error against the number of lights, for each interpolation between them.
//!
//! Interpolation and transport are both linear, so that values under the lights of a set need not be made: the irradiance that the
//! set would have at each sample is interpolated, and goes through the transport together with that of the light itself. The
//! difference of the two is the interpolation's error alone.

use glam::DVec3;
use rayon::prelude::*;
use translux::error::Result;
use translux::geometry::bvh::Bvh;
use translux::geometry::samples::{self, Samples};
use translux::light::quantised::interpolation::{Interpolator, Scheme};
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::gather::Gather;
use translux::transport::irradiance::{Illumination, LightSampling};
use translux::transport::many_lights::{IrradianceRows, ManyLights};
use translux::transport::near_rule::NearField;
use translux::transport::receivers::Receivers;
use translux::transport::surface::Surface;
use translux::transport::tree::SampleTree;

use crate::bench::{self, Context, LIGHTS, directions_of, met, parallel, summary, table, thousandths};
use crate::encodings::cells;
use crate::views::{Spread, Views};

/// The paper's meshes or the nearest to them.
pub(crate) const MODELS: [&str; 4] = ["horse", "santa", "bunny_closed", "dragon_50k"];

/// The materials of all figures.
pub(crate) const MATERIALS: [&str; 2] = ["marble", "skin1"];

const COUNTS: [usize; 5] = [50, 100, 200, 400, 800];

/// One shadow ray for each sample, as the bake has it.
const SAMPLING: LightSampling = LightSampling { points_per_patch: 1, ..LightSampling::FAST };

/// Asked error of the near field and of the hierarchy: the light and its interpolation share both.
const NEAR_RMS: f64 = 0.03;
const HIERARCHY_RMS: f64 = 0.005;

/// Image RMS that is wanted at 200 lights.
const WANTED: f64 = 4e-3;

/// Surface samples.
const SAMPLES: usize = 32_768;

/// Samples that are worked on together.
const CHUNK: usize = 256;

/// Receivers that share a traversal.
const GROUP: usize = 16;

/// Error of one interpolation from so many lights.
pub(crate) struct Found {
    pub(crate) scheme: Scheme,
    pub(crate) count: usize,
    pub(crate) error: Spread,
}

/// Irradiance of all samples under one light.
fn irradiance(surface: &Surface, etas: &[f64], from: DVec3) -> Result<Vec<f32>> {
    let light = [parallel(from)];
    let all = Illumination::new(surface, &light, etas, SAMPLING)?.all(&Silent);
    Ok(all.iter().map(|e| e.x as f32).collect())
}

/// Errors of every interpolation from each number of lights.
pub(crate) fn measure(scene: &Scene, counts: &[usize], lights: &[DVec3], views: &Views) -> Result<Vec<Found>> {
    let samples = Samples::new(&scene.mesh, &scene.parts, SAMPLES);
    let (bvh, patches) = (Bvh::new(&scene.mesh), samples::patches(&scene.mesh, &samples));
    let tree = SampleTree::new(&samples, &patches);
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let areas = receivers.areas_mm2(&scene.mesh);
    let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
    let gather = Gather::new(&surface, &tree, &scene.media, NearField::for_error(NEAR_RMS));
    let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    let mut transfer = ManyLights::new(&gather, &tree, &receivers, &areas);

    let own: Vec<Vec<f32>> = lights.iter().map(|from| irradiance(&surface, &etas, *from)).collect::<Result<_>>()?;
    let columns = lights.len();
    let values = (0..samples.len()).flat_map(|s| own.iter().map(move |e| e[s])).collect();
    let truth = IrradianceRows { lights: columns, by_channel: false, values };
    transfer.tune(HIERARCHY_RMS, &truth);

    // The lights, each interpolation from each number of lights, and their magnitude: clusters have the centroid of all columns
    // together, which negative weights must not move out of them.
    let width = columns * (1 + counts.len() * Scheme::ALL.len()) + 1;
    let mut rows = vec![0.0f32; samples.len() * width];
    rows.chunks_exact_mut(width)
        .zip(truth.values.chunks_exact(columns))
        .for_each(|(row, own)| row[..columns].copy_from_slice(own));
    for (step, &count) in counts.iter().enumerate() {
        let set = directions_of(count)?;
        let of_set: Vec<Vec<f32>> =
            set.directions().iter().map(|from| irradiance(&surface, &etas, *from)).collect::<Result<_>>()?;
        let first = columns * (1 + step * Scheme::ALL.len());
        let weights = weights(&set, lights)?;
        let used = columns * Scheme::ALL.len();
        rows.par_chunks_mut(CHUNK * width).enumerate().for_each(|(chunk, rows)| {
            for (e, weights) in of_set.iter().zip(weights.chunks_exact(used)) {
                for (row, e) in rows.chunks_exact_mut(width).zip(&e[chunk * CHUNK..]).filter(|(_, e)| **e != 0.0) {
                    row[first..first + used].iter_mut().zip(weights).for_each(|(sum, w)| *sum += w * e);
                }
            }
        });
    }
    for row in rows.chunks_exact_mut(width) {
        row[width - 1] = row.iter().map(|v| v.abs()).sum();
    }
    let found = transfer.radiosity(&IrradianceRows { lights: width, by_channel: false, values: rows }, &Silent);
    let under = |column: usize| {
        let values: Vec<DVec3> = found.under(column).into_iter().map(|v| v.max(DVec3::ZERO)).collect();
        receivers.expand(&values)
    };
    let references: Vec<_> = (0..columns).map(|light| views.reference(&under(light))).collect();
    let mut result = Vec::new();
    for (step, &count) in counts.iter().enumerate() {
        for (index, scheme) in Scheme::ALL.into_iter().enumerate() {
            let first = columns * (1 + step * Scheme::ALL.len() + index);
            let errors: Vec<_> =
                references.iter().enumerate().map(|(light, r)| views.worst(&under(first + light), r)).collect();
            result.push(Found { scheme, count, error: Spread::of(&errors) });
        }
    }
    Ok(result)
}

/// `[light of the set][scheme][light]`.
fn weights(set: &translux::light::quantised::directions::DirectionSet, lights: &[DVec3]) -> Result<Vec<f32>> {
    let used = Scheme::ALL.len() * lights.len();
    let mut all = vec![0.0; set.count() * used];
    let mut own = Vec::new();
    for (index, scheme) in Scheme::ALL.into_iter().enumerate() {
        let interpolator = Interpolator::new(set, scheme)?;
        for (light, from) in lights.iter().enumerate() {
            interpolator.weights(*from, &mut own);
            own.iter().enumerate().for_each(|(j, w)| all[j * used + index * lights.len() + light] = *w as f32);
        }
    }
    Ok(all)
}

/// The figure: tables, charts.
pub(crate) fn run(context: &Context) -> Result<String> {
    let models: Vec<&str> = if context.quick { vec!["bunny_3k"] } else { MODELS.to_vec() };
    let (lights, counts) = (context.lights(), context.some(&COUNTS, 2));
    let mut text = String::new();
    for material in context.some(&MATERIALS, 1) {
        let mut scatter = Scatter {
            title: format!("Image error against the number of lights, {material}, {} mm", bench::SIZE_MM),
            axes: ["lights in the set".to_owned(), "image RMS with background, median light, worst view".to_owned()],
            units: [Unit::Number, Unit::Number],
            points: Vec::new(),
            lines: vec![(3e-3, "the paper at 200 lights".to_owned())],
            front: Front::Left,
        };
        let mut tables = [const { Vec::new() }; 3];
        let mut all = Vec::new();
        for model in &models {
            let scene = context.scene(model, material)?;
            let views = Views::new(&scene, context.views())?;
            all.push((*model, measure(&scene, &counts, &lights, &views)?));
            context.say(&format!("figure 5: {model}, {material}"));
        }
        for scheme in Scheme::ALL {
            for (model, found) in &all {
                let mut rows = [const { Vec::new() }; 3].map(|mut row: Vec<String>| {
                    row.extend([scheme.name().to_owned(), (*model).to_owned()]);
                    row
                });
                for f in found.iter().filter(|f| f.scheme == scheme) {
                    rows.iter_mut().zip(cells(f.error)).for_each(|(row, cell)| row.push(cell));
                    if matches!(scheme, Scheme::Nearest4 | Scheme::Rbf) {
                        let series = format!("{model}, {}", scheme.name());
                        scatter.points.push(Point { series, x: f.count as f64, y: f.error.median.with_background });
                    }
                }
                tables.iter_mut().zip(rows).for_each(|(table, row)| table.push(row));
            }
        }
        let name = format!("quantized_figure5_{material}.svg");
        translux::io::atomic::write(&context.pictures.join(&name), as_svg(&scatter)?.as_bytes())?;
        let at = |scheme: Scheme| -> Vec<Spread> {
            let of_model = |(_, found): &(&str, Vec<Found>)| {
                found.iter().find(|f| f.scheme == scheme && f.count == LIGHTS).map(|f| f.error)
            };
            all.iter().filter_map(of_model).collect()
        };
        if let Some(line) = in_short(material, &at(Scheme::Nearest4), &at(Scheme::Rbf)) {
            text.push_str(&line);
        }
        let powers: Vec<String> = Scheme::ALL.iter().map(|s| format!("{} {}", s.name(), exponents(&all, *s))).collect();
        let counts: Vec<String> = counts.iter().map(|c| format!("{c} lights")).collect();
        let head: Vec<&str> = ["interpolation", "model"].into_iter().chain(counts.iter().map(String::as_str)).collect();
        text.push_str(&format!("![Image error against the number of lights, {material}](pictures/{name})\n\n"));
        text.push_str(&format!(
            "The error is proportional to this power of the number of lights (median light, worst light; mean of the models): \
             {}.\n\n",
            powers.join("; ")
        ));
        let what = [
            "with background, as the paper has it",
            "covered pixels only",
            "with background, one exposure for all views of a light",
        ];
        for (what, rows) in what.iter().zip(&tables) {
            text.push_str(&format!("**{material}**, {what}:\n\n{}\n", table(&head, rows)));
        }
    }
    Ok(text)
}

/// The row of the page's first table: the least and the largest median over the models, and the worst light.
fn in_short(material: &str, nearest: &[Spread], smooth: &[Spread]) -> Option<String> {
    let largest = |all: &[Spread], figure: fn(&Spread) -> f64| all.iter().map(figure).fold(0.0, f64::max);
    let text = |all: &[Spread]| {
        let least = all.iter().map(|s| s.median.with_background).fold(f64::INFINITY, f64::min);
        format!(
            "{} to {}, worst {} ({} with one exposure)",
            thousandths(least),
            thousandths(largest(all, |s| s.median.with_background)),
            thousandths(largest(all, |s| s.worst.with_background)),
            thousandths(largest(all, |s| s.worst.one_exposure)),
        )
    };
    let reached = largest(smooth, |s| s.worst.with_background) <= WANTED;
    (!smooth.is_empty()).then(|| {
        summary(
            &format!("image RMS at 200 lights, {material}, four meshes, with background, 1e-3"),
            "3",
            "<= 4 with the default interpolation",
            &format!("`nearest4`: {}; `rbf`: {}; {}", text(nearest), text(smooth), met(reached)),
        )
    })
}

/// Fitted powers of the number of lights, means over the models: of the median light's error and of the worst light's.
fn exponents(all: &[(&str, Vec<Found>)], scheme: Scheme) -> String {
    let fitted = |figure: fn(&Spread) -> f64| {
        let of_model = |(_, found): &(&str, Vec<Found>)| {
            let own = found.iter().filter(|f| f.scheme == scheme);
            slope(&own.map(|f| ((f.count as f64).ln(), figure(&f.error).ln())).collect::<Vec<_>>())
        };
        all.iter().map(of_model).sum::<f64>() / all.len().max(1) as f64
    };
    format!("{:.2}, {:.2}", fitted(|e| e.median.with_background), fitted(|e| e.worst.with_background))
}

/// Of the least-squares line.
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len().max(1) as f64;
    let mean = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0 / count, sum.1 + p.1 / count));
    let (above, below) = points.iter().fold((0.0, 0.0), |sum, p| {
        let x = p.0 - mean.0;
        (sum.0 + x * (p.1 - mean.1), sum.1 + x * x)
    });
    above / below
}
