//! Bake of `filtered_normals`: a ladder of low-passed normals, and the openness of the vertices.

use glam::DVec3;
use translux_format::filtered_normals::{self as stored, Numbers};

use super::evaluate::{FilteredNormalsEvaluator, MEASURED, STAGE};
use super::fit::Fitted;
use super::geometric::Sums;
use super::points::{Points, STEPS_OF_OCTAVE, TOLERANCE};
use super::settings::{Bleeding, Filter, FilteredNormals};
use crate::compress::ledger::Ledger;
use crate::error::{Error, Result};
use crate::evaluate::stages::of_kinds;
use crate::evaluate::{AssetParts, BakeSettings};
use crate::geometry::bvh::Bvh;
use crate::geometry::laplacian::{Laplacian, NONE};
use crate::light::{Light, LightKind};
use crate::math::sparse::bands::{self, Found};
use crate::progress::{Progress, Silent, stage};
use crate::scene::Scene;

/// Widths of the first and the last rung: shares of the diagonal and of the mean edge.
const WIDEST: f64 = 0.25;
const NARROWEST: f64 = 0.4;

/// Quantiser steps for each unit of a normal.
const STEPS: f64 = 128.0;

/// Vertices that errors are measured on under suns that the fit might have seen.
const MEASURED_OF_FIT: usize = 512;

/// Turns of suns that graze the largest flat area, beside the probe lights: those are what the method is farthest off under.
pub(super) const GRAZING_TURNS: [f64; 8] = [0.04, 0.11, 0.24, 0.31, 0.44, 0.67, 0.76, 0.93];

/// Points nearby: bounding radii from the centre, towards the corners of a tetrahedron.
const NEAREST_RADII: f64 = 1.1;
const CORNERS: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];

/// The error that is told over the worst that was measured: the worst of a few dozen lights is not that of all, which was up to 12 % beyond it on bodies
/// of the stability suite.
pub(super) const BEYOND_PROBES: f64 = 1.15;

/// A ladder of fields over the points, and a note on its making.
pub(super) struct Fields {
    /// Vector of each point, rung after rung.
    vectors: Vec<Vec<DVec3>>,
    /// Sum of the weights of each point, where a plain sum needs it.
    sums: Option<Vec<Vec<f64>>>,
    note: String,
}

pub(super) fn bake(
    form: &FilteredNormals,
    scene: &Scene,
    settings: &BakeSettings,
    progress: &dyn Progress,
) -> Result<AssetParts> {
    let points = Points::new(scene);
    let bvh = Bvh::new(&scene.mesh);
    let laplacian = points.laplacian();
    let widths = widths_mm(scene, &laplacian, form.rungs as usize);
    let openness = points.openness(scene, &bvh, progress)?;
    let fields = match form.filter {
        Filter::Heat => stage(progress, "low passes", || heat(&points, &laplacian, &widths)),
        Filter::Spectral { wavelength } => spectral(&points, &laplacian, &widths, wavelength, progress)?,
        Filter::Geometric { weights, reach, .. } => {
            stage(progress, "sums of normals", || geometric(&Sums::new(&points, weights), &widths, reach))
        }
    };
    let numbers = Numbers {
        columns: if fields.sums.is_some() { 4 } else { 3 },
        rungs: widths,
        step: 1.0 / STEPS,
        alpha: form.alpha.unwrap_or(0.0),
        width: form.width.unwrap_or(1.0),
        samples: form.density.count(scene, settings.samples).min(u32::MAX as usize) as u32,
    };
    let open = |r: &u32| (openness[*r as usize] * 255.0).round() as u8;
    let mut asset = stored::FilteredNormals {
        codes: codes(&points, &fields),
        openness: points.order.iter().map(open).collect(),
        numbers,
    };
    let (earlier, mut note) = (points.earlier(), fields.note);
    let mut evaluator = FilteredNormalsEvaluator::new(form, scene, points, &asset)?;
    let fitted = form.bleeding == Bleeding::Off && (form.alpha.is_none() || form.width.is_none());
    if fitted && !settings.probes.tuning.is_empty() {
        let found = stage(progress, "fit", || evaluator.fit(&settings.probes.tuning))?;
        (asset.numbers.alpha, asset.numbers.width) = (found.alpha, found.width);
        let Fitted { alpha, width, error } = found;
        note += &format!("; fitted alpha {alpha:.2}, width {width:.2}: {:.1} % RMS on the probes", 100.0 * error);
    }
    let mut ledger = Ledger::default();
    if !settings.probes.unseen.is_empty() {
        let sets: Vec<_> = settings.probes.unseen.iter().map(|light| vec![light.clone()]).collect();
        let others: Vec<_> = beside_probes(scene, settings).into_iter().map(|light| vec![light]).collect();
        let error = stage(progress, "error", || {
            let error = evaluator.error_under(&sets, MEASURED, &Silent)?;
            Ok(error.max(evaluator.error_under(&others, MEASURED_OF_FIT, &Silent)?).scaled(BEYOND_PROBES))
        })?;
        let of = "against exact sums over samples, the worst of the probe lights and 15 % more for those between them";
        ledger.add(STAGE, error, format!("{of}; {note}"));
    }
    let sections = asset.to_sections(&earlier).map_err(|e| Error::runtime(format!("asset: {e}")))?;
    Ok(AssetParts::without_samples(scene, ledger, sections))
}

/// Lights that the error is measured under beside the unseen probes. It differs from light to light: those of the fit count too, which finds
/// two numbers that hold for all, and suns that graze; and where lamps may stand nearby, some just outside of the body.
pub(super) fn beside_probes(scene: &Scene, settings: &BakeSettings) -> Vec<Light> {
    let grazing = GRAZING_TURNS.map(|turn| Light::Directional { from: scene.grazing(turn), irradiance: DVec3::ONE });
    let nearby = [LightKind::Point, LightKind::Spot, LightKind::Area].iter().any(|kind| settings.is_for(*kind));
    let kinds = if nearby { &[LightKind::Directional, LightKind::Point][..] } else { &[LightKind::Directional] };
    let mut lights = of_kinds(&settings.probes.tuning, kinds);
    lights.extend(grazing);
    if nearby {
        let (centre, distance) = (scene.mesh.origin_mm, NEAREST_RADII * 0.5 * scene.mesh.diagonal_mm());
        lights.extend(CORNERS.map(|corner| Light::Point {
            at_mm: centre + distance * DVec3::from(corner).normalize(),
            intensity: DVec3::splat(distance * distance),
        }));
    }
    lights
}

/// Widths of the rungs, descending, from a share of the whole to one of an edge.
fn widths_mm(scene: &Scene, laplacian: &Laplacian, rungs: usize) -> Vec<f64> {
    let diagonal = scene.mesh.diagonal_mm().max(f64::MIN_POSITIVE.sqrt());
    let widest = WIDEST * diagonal;
    let narrowest = (NARROWEST * laplacian.mean_edge_mm).clamp(1e-4 * widest, 0.5 * widest);
    let last = rungs.saturating_sub(1).max(1) as f64;
    (0..rungs).map(|i| widest * (narrowest / widest).powf(i as f64 / last)).collect()
}

/// Implicit steps of the heat equation, each from the wider one before.
fn heat(points: &Points, laplacian: &Laplacian, widths: &[f64]) -> Fields {
    let normals: Vec<[f64; 3]> = laplacian.at_nodes(&points.normals).iter().map(|n| n.to_array()).collect();
    let mut values = normals.clone();
    let mut iterations = 0;
    // From narrow to wide: each is a good guess for the next.
    let mut vectors: Vec<Vec<DVec3>> = widths
        .iter()
        .rev()
        .map(|width| {
            iterations += laplacian.diffused(width * width, &normals, &mut values, TOLERANCE).iterations;
            vectors_of(points, laplacian, &values)
        })
        .collect();
    vectors.reverse();
    let flat = laplacian.flat_triangles;
    Fields { vectors, sums: None, note: format!("heat, {iterations} multigrid cycles, {flat} flat triangles") }
}

fn vectors_of(points: &Points, laplacian: &Laplacian, values: &[[f64; 3]]) -> Vec<DVec3> {
    let vectors: Vec<DVec3> = values.iter().map(|v| DVec3::from_array(*v)).collect();
    let mut all = laplacian.at_vertices(&vectors, DVec3::ZERO);
    // A vertex without area keeps its normal.
    all.iter_mut().zip(&laplacian.node).zip(&points.normals).for_each(|((v, node), n)| {
        if *node == NONE {
            *v = *n;
        }
    });
    all
}

/// Low passes of the normals in manifold harmonics; the remainder beyond the last of them is scaled by the mean of the
/// response over its frequencies (the paper's equation 11).
fn spectral(
    points: &Points,
    laplacian: &Laplacian,
    widths: &[f64],
    wavelength: f64,
    progress: &dyn Progress,
) -> Result<Fields> {
    let edge = laplacian.mean_edge_mm.max(f64::MIN_POSITIVE.sqrt());
    let omega = std::f64::consts::TAU / (wavelength * edge);
    let nyquist = std::f64::consts::PI / edge;
    let normals: Vec<[f64; 3]> = laplacian.at_nodes(&points.normals).iter().map(|n| n.to_array()).collect();
    let root: Vec<f64> = laplacian.mass_mm2.iter().map(|m| m.sqrt()).collect();
    let matrix = laplacian.symmetrised();
    let area: f64 = laplacian.mass_mm2.iter().sum();
    progress.start("manifold harmonics", (area * omega * omega / (2.0 * std::f64::consts::TAU)) as u64);
    // The normals' part in the harmonics, and each rung's.
    let mut kept = vec![DVec3::ZERO; normals.len()];
    let mut rungs = vec![kept.clone(); widths.len()];
    let mut found = Found::default();
    for component in matrix.components() {
        let weighted = |i: &u32| normals[*i as usize].map(|n| n * root[*i as usize]);
        let columns: Vec<[f64; 3]> = component.iter().map(weighted).collect();
        let block = matrix.block(&component);
        let of_part = bands::for_each_band(&block, omega * omega, progress, |band| {
            let coefficients = band.coefficients(&columns);
            for (row, &node) in component.iter().enumerate() {
                let node = node as usize;
                for (pair, coefficient) in coefficients.iter().enumerate() {
                    let value = DVec3::from_array(*coefficient) * (band.component(pair, row) / root[node]);
                    kept[node] += value;
                    for (rung, width) in rungs.iter_mut().zip(widths) {
                        rung[node] += value / (1.0 + width * width * band.values[pair].max(0.0));
                    }
                }
            }
            Ok(())
        })?;
        found = found.and(of_part);
    }
    progress.finish();
    let vectors = widths
        .iter()
        .zip(rungs)
        .map(|(width, mut rung)| {
            let span = (nyquist - omega).max(f64::MIN_POSITIVE);
            let gamma = ((width * nyquist).atan() - (width * omega).atan()) / (width * span);
            for ((value, normal), kept) in rung.iter_mut().zip(&normals).zip(&kept) {
                *value += gamma * (DVec3::from_array(*normal) - *kept);
            }
            let values: Vec<[f64; 3]> = rung.iter().map(|v| v.to_array()).collect();
            vectors_of(points, laplacian, &values)
        })
        .collect();
    let Found { pairs, residual, orthogonality } = found;
    let note = format!("{pairs} manifold harmonics, residual {residual:.0e}, orthogonality {orthogonality:.0e}");
    Ok(Fields { vectors, sums: None, note })
}

/// Weighted means over the neighbourhood, and the sums of the weights.
fn geometric(sums: &Sums, widths: &[f64], reach: f64) -> Fields {
    let (mut vectors, mut weights) = (Vec::new(), Vec::new());
    for width in widths {
        let all = sums.at(1.0 / width, reach);
        vectors.push(all.iter().map(|(n, w)| if *w > 0.0 { *n / *w } else { DVec3::ZERO }).collect());
        weights.push(all.iter().map(|(_, w)| *w).collect());
    }
    Fields { vectors, sums: Some(weights), note: "sums over neighbours".to_owned() }
}

fn codes(points: &Points, fields: &Fields) -> Vec<i16> {
    let mut codes = Vec::new();
    for r in points.order.iter().map(|r| *r as usize) {
        for (rung, vectors) in fields.vectors.iter().enumerate() {
            codes.extend(vectors[r].to_array().map(|v| (v * STEPS).round() as i16));
            if let Some(sums) = &fields.sums {
                let octave = sums[rung][r].max(1e-30).log2();
                codes.push((octave * STEPS_OF_OCTAVE).round() as i16);
            }
        }
    }
    codes
}
