#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::*;
use crate::hao::simplify::{Costs, Hierarchy, Input, Signal};
use translux::geometry::mesh::{Mesh, Placement};
use translux::geometry::shapes::{self, cos_sin_of_turn};
use translux::math::random::{bits, uniform};
use translux::progress::Silent;

const LIGHTS: usize = 64;

/// A head of 10 mm with clamped cosines of its normals under 64 lights, blurred over the surface.
struct Head {
    mesh: Mesh,
    values: Vec<f32>,
}

impl Head {
    fn new(subdivisions: u32, blurs: usize) -> Self {
        let source = shapes::bumpy_head(10.0, subdivisions);
        let mesh = Mesh::from_source(source, &Placement { mm_per_unit: 1.0 }).unwrap().0;
        let mut normals = vec![DVec3::ZERO; mesh.local_mm.len()];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            corners.iter().for_each(|&v| normals[v as usize] += mesh.cross_mm2(t as u32));
        }
        let light = |i: usize| {
            let y = 1.0 - (2.0 * i as f64 + 1.0) / LIGHTS as f64;
            let c = cos_sin_of_turn(0.618_033_988_749_894_9 * i as f64) * (1.0 - y * y).sqrt();
            DVec3::new(c.x, y, c.y)
        };
        let mut values: Vec<f32> = normals
            .iter()
            .flat_map(|n| (0..LIGHTS).map(|i| n.normalize_or_zero().dot(light(i)).max(0.0) as f32))
            .collect();
        for _ in 0..blurs {
            values = Self::blurred(&mesh, &values);
        }
        Self { mesh, values }
    }

    /// Every value half itself and half the mean of its neighbours: many in a row are a Gaussian.
    fn blurred(mesh: &Mesh, values: &[f32]) -> Vec<f32> {
        let mut sums = vec![0.0f32; values.len()];
        let mut counts = vec![0.0f32; mesh.local_mm.len()];
        for t in &mesh.triangles {
            for k in 0..3 {
                let (v, w) = (t[k] as usize, t[(k + 1) % 3] as usize);
                counts[v] += 1.0;
                for l in 0..LIGHTS {
                    sums[v * LIGHTS + l] += values[w * LIGHTS + l];
                }
            }
        }
        values.iter().zip(&sums).enumerate().map(|(i, (own, sum))| 0.5 * own + 0.5 * sum / counts[i / LIGHTS]).collect()
    }

    fn input<'a>(&'a self, part: &'a [u32]) -> Input<'a> {
        Input { positions: &self.mesh.local_mm, triangles: &self.mesh.triangles, triangle_part: part }
    }

    fn level(&self, costs: &Costs, references: usize) -> Level {
        Hierarchy::new(&self.input(&[]), costs, &[references], &Silent).levels.remove(0)
    }

    fn predictions(&self, level: &Level, choice: Choice) -> Vec<Prediction> {
        let references = gather(&self.values, LIGHTS, &level.references);
        predictions(level, None, &self.values, &references, LIGHTS, choice)
    }

    /// RMS of the residuals.
    fn error(&self, level: &Level, predictions: &[Prediction]) -> f64 {
        let references = gather(&self.values, LIGHTS, &level.references);
        rms(&residuals(&self.values, LIGHTS, &references, predictions))
    }

    fn error_of(&self, level: &Level, choice: Choice) -> f64 {
        self.error(level, &self.predictions(level, choice))
    }
}

fn rms(values: &[f32]) -> f64 {
    (values.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

const CHOICES: [Choice; 5] = [
    Choice::Barycentric,
    Choice::Fitted(Bounds::Convex),
    Choice::Fitted(Bounds::Extrapolating),
    Choice::BestTriangle(Bounds::Convex),
    Choice::BestTriangle(Bounds::Extrapolating),
];

#[test]
fn stored_weights_come_back_and_add_up_to_one() {
    for a in (0..=u16::MAX).step_by(97).chain([u16::MAX]) {
        for b in (0..=u16::MAX).step_by(1009).chain([u16::MAX]) {
            let weights = Weights::from_stored([a, b]);
            let [u, v, w] = weights.values();
            assert_eq!(u + v + w, 1.0);
            assert_eq!(Weights::quantise([u, v, w].map(f64::from)), weights);
        }
    }
    for i in 0..20_000 {
        let (mut u, mut v) = (uniform(1, i, 0), uniform(1, i, 1));
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let weights = [u, v, 1.0 - u - v];
        let stored = Weights::quantise(weights).values();
        assert!(stored.iter().all(|s| *s >= 0.0));
        assert!(weights.iter().zip(stored).all(|(w, s)| (w - f64::from(s)).abs() <= 1.01 / 32768.0));
    }
    assert_eq!(Weights::quantise([1.0, 0.0, 0.0]).values(), [1.0, 0.0, 0.0]);
    assert_eq!(Weights::quantise([0.0, 0.0, 1.0]).values(), [0.0, 0.0, 1.0]);
    for wild in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        assert_eq!(Weights::quantise([wild; 3]).values().iter().sum::<f32>(), 1.0);
    }
}

#[test]
fn fitted_weights_are_the_best_of_all_allowed_ones() {
    for i in 0..200 {
        let row = |k: u64| -> Vec<f32> { (0..5).map(|j| uniform(2, i, 10 * k + j) as f32).collect() };
        let mut corners = [row(0), row(1), row(2)];
        let value: Vec<f32> = row(3).iter().map(|v| 2.0 * v - 0.5).collect();
        if i % 5 == 0 {
            corners[2] = corners[1].clone();
        }
        if i % 25 == 0 {
            corners[0] = corners[1].clone();
        }
        let rows = [&corners[0][..], &corners[1], &corners[2]];
        let error = |w: [f64; 3]| -> f64 {
            (0..5)
                .map(|j| {
                    let predicted: f64 = (0..3).map(|k| w[k] * f64::from(rows[k][j])).sum();
                    (predicted - f64::from(value[j])).powi(2)
                })
                .sum()
        };
        let start = [0.2, 0.3, 0.5];
        for bounds in [Bounds::Convex, Bounds::Extrapolating] {
            let least = bounds.least();
            let fit = fit(&value, rows, start, bounds);
            assert!((fit.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            assert!(fit.weights.iter().all(|w| *w >= least - 1e-12), "{fit:?}");
            assert!((fit.squared_error - error(fit.weights)).abs() < 1e-9);
            assert!(fit.squared_error <= error(start) + 1e-12);
            let steps = 30;
            for a in 0..=steps {
                for b in 0..=steps - a {
                    let side = 1.0 - 3.0 * least;
                    let [a, b] = [a, b].map(|s| least + side * f64::from(s) / f64::from(steps));
                    // The regularisation may cost this much.
                    assert!(fit.squared_error <= error([a, b, 1.0 - a - b]) + 2e-3, "{fit:?}");
                }
            }
        }
    }
    let flat = [1.0f32; 4];
    let fit = fit(&[3.0; 4], [&flat; 3], [0.5, 0.25, 0.25], Bounds::Convex);
    assert_eq!(fit.weights, [0.5, 0.25, 0.25]);
}

#[test]
fn fitted_weights_keep_those_of_the_triangle_where_the_values_leave_them_open() {
    // The first two references are the same: only the sum of their weights is fitted.
    let (a, c) = ([1.0f32, 0.0, 2.0], [0.0f32, 1.0, 0.5]);
    let value = [0.5f32, 0.5, 1.25];
    let weights = fit(&value, [&a, &a, &c], [0.3, 0.3, 0.4], Bounds::Convex).weights;
    assert!((weights[0] - weights[1]).abs() < 1e-9 && (weights[2] - 0.5).abs() < 1e-3, "{weights:?}");
}

#[test]
fn values_are_predictions_plus_residuals() {
    let head = Head::new(3, 2);
    let level = head.level(&Costs::default(), 80);
    let references = gather(&head.values, LIGHTS, &level.references);
    for choice in CHOICES {
        let predictions = head.predictions(&level, choice);
        let residuals = residuals(&head.values, LIGHTS, &references, &predictions);
        let mut row = [0.0; LIGHTS];
        for (v, prediction) in predictions.iter().enumerate() {
            predict(&references, prediction, &mut row);
            for l in 0..LIGHTS {
                assert!((row[l] + residuals[v * LIGHTS + l] - head.values[v * LIGHTS + l]).abs() < 1e-6);
            }
        }
        for &r in &level.references {
            assert!(residuals[r as usize * LIGHTS..][..LIGHTS].iter().all(|d| *d == 0.0));
        }
    }
    let nowhere = Prediction::from(&Anchor::NOWHERE);
    let mut row = [1.0; 3];
    predict(&[5.0, 6.0], &nowhere, &mut row);
    assert_eq!(row, [0.0; 3]);
    assert!(predictions(&level, None, &[], &[], 0, Choice::BestTriangle(Bounds::Convex)).len() == 642);
}

#[test]
fn references_are_predicted_from_the_next_coarser_level() {
    let head = Head::new(4, 10);
    let levels = Hierarchy::new(&head.input(&[]), &Costs::default(), &[640, 160], &Silent).levels;
    let finer = &levels[0].references;
    let references = gather(&head.values, LIGHTS, &levels[1].references);
    let own = gather(&head.values, LIGHTS, finer);
    let errors = CHOICES.map(|choice| {
        let predictions = predictions(&levels[1], Some(finer), &head.values, &references, LIGHTS, choice);
        assert_eq!(predictions.len(), 640);
        rms(&residuals(&own, LIGHTS, &references, &predictions))
    });
    assert!(errors[0] < 0.12 && errors[1] < errors[0] && errors[3] < errors[1], "{errors:?}");
}

#[test]
fn more_references_and_better_weights_mean_a_smaller_error() {
    let head = Head::new(5, 30);
    let mut last = [f64::INFINITY; 5];
    for references in [103, 410, 1638] {
        let level = head.level(&Costs::default(), references);
        let errors = CHOICES.map(|choice| head.error_of(&level, choice));
        eprintln!(
            "{references} references of 10242: barycentric {:.5}, fitted {:.5} / {:.5}, best triangle {:.5} / {:.5}",
            errors[0], errors[1], errors[2], errors[3], errors[4]
        );
        for (error, last) in errors.iter().zip(last) {
            // Linear interpolation of a smooth function: 4 times the references, a quarter of the error.
            assert!(
                last.is_infinite() || (2.5..7.0).contains(&(last / error)),
                "{references}: {errors:?} after {last:?}"
            );
        }
        assert!(errors[1] < errors[0] && errors[2] < errors[1] && errors[3] < errors[1] && errors[4] < errors[2]);
        last = errors;
    }
}

#[test]
fn fitted_weights_are_never_worse_at_any_vertex() {
    let head = Head::new(4, 4);
    let level = head.level(&Costs::default(), 150);
    let references = gather(&head.values, LIGHTS, &level.references);
    let [plain, fitted] = [Choice::Barycentric, Choice::Fitted(Bounds::Convex)].map(|choice| {
        let predictions = head.predictions(&level, choice);
        residuals(&head.values, LIGHTS, &references, &predictions)
    });
    for (v, (plain, fitted)) in plain.chunks(LIGHTS).zip(fitted.chunks(LIGHTS)).enumerate() {
        // Stored weights are rounded.
        assert!(rms(fitted) <= rms(plain) + 1e-4, "{v}: {} {}", rms(fitted), rms(plain));
    }
}

#[test]
fn references_by_illumination_follow_a_shadow_edge() {
    let mut head = Head::new(5, 10);
    // A shadow with a sharp edge falls across the head under half of the lights.
    for (v, p) in head.mesh.local_mm.iter().enumerate() {
        let light = (0.5 + 2.0 * (p.x + 0.4 * p.y - 1.0)).clamp(0.0, 1.0);
        head.values[v * LIGHTS..][..LIGHTS / 2].iter_mut().for_each(|q| *q *= light);
    }
    // The signal that a caller would reduce by principal components: here, every eighth light.
    let signal: Vec<f32> = head.values.iter().copied().step_by(8).collect();
    let plain = head.level(&Costs::default(), 410);
    let signal = Signal { values: &signal, dimension: 8, weight_mm2: 40.0 };
    let aware = head.level(&Costs { signal: Some(signal), ..Costs::default() }, 410);
    let errors = [&plain, &aware].map(|level| CHOICES.map(|choice| head.error_of(level, choice)));
    eprintln!("shadow edge, 4 % references: geometry {:.5?}, illumination too {:.5?}", errors[0], errors[1]);
    assert!(
        errors[1][0] < 0.65 * errors[0][0] && errors[1][1] < 0.85 * errors[0][1] && errors[1][4] < 0.92 * errors[0][4],
        "{errors:?}"
    );
    // The references are stored as a set; from it alone the reader finds triangles that are as good.
    let implied = Hierarchy::keeping(&head.input(&[]), &aware.references, &Silent).levels.remove(0);
    let again = CHOICES.map(|choice| head.error_of(&implied, choice));
    eprintln!("the same references, triangles found again from them {again:.5?}");
    assert!(again[1] < 1.3 * errors[1][1], "{again:?}");
}

#[test]
fn indices_that_geometry_implies_cost_nothing() {
    let head = Head::new(5, 10);
    let level = head.level(&Costs::default(), 410);
    let predicted_vertices = (head.mesh.local_mm.len() - 410) as f64;
    for choice in CHOICES {
        let predictions = head.predictions(&level, choice);
        let counted = counted_index_bytes(&predictions);
        let predicted = predicted_index_bytes(&head.mesh.triangles, &predictions, 410);
        let implied = implied_index_bytes(&level, &predictions);
        eprintln!(
            "{choice:?}: bytes for each of {predicted_vertices} vertices: counted {:.2}, predicted {:.2}, implied {:.2}",
            counted / predicted_vertices,
            predicted / predicted_vertices,
            implied / predicted_vertices
        );
        assert_eq!(counted, 12.0 * predicted_vertices);
        assert!(predicted < 0.25 * counted && implied < predicted);
        assert_eq!(implied == 0.0, !matches!(choice, Choice::BestTriangle(_)));
    }
    assert!((reference_set_bytes(10_242, 410) / 10_242.0 - 0.242 / 8.0).abs() < 1e-3);
    assert_eq!(reference_set_bytes(100, 100), 0.0);
}

#[test]
fn costs_of_indices_take_anything() {
    let level = Level::default();
    let predictions: Vec<Prediction> = (0..50)
        .map(|i| Prediction {
            corners: [0, 1, 2].map(|k| (bits(5, i, k) % 4) as u32),
            weights: Weights::quantise([0.5, 0.5, 0.0]),
        })
        .chain([Prediction::from(&Anchor::NOWHERE)])
        .collect();
    let triangles = [[0, 1, 2], [2, 1, 70], [3, 3, 3], [49, 50, 0]];
    assert!(predicted_index_bytes(&triangles, &predictions, 4).is_finite());
    assert_eq!(implied_index_bytes(&level, &predictions), 0.0);
    assert_eq!(predicted_index_bytes(&[], &[], 0), 0.0);
}

/// Values minus predictions, a row for each prediction.
fn residuals(values: &[f32], dimension: usize, references: &[f32], predictions: &[Prediction]) -> Vec<f32> {
    let mut rows = vec![0.0; predictions.len() * dimension];
    if dimension > 0 {
        rows.par_chunks_mut(dimension).enumerate().for_each(|(v, out)| {
            predict(references, &predictions[v], out);
            out.iter_mut().for_each(|o| *o = -*o);
            for (out, value) in out.iter_mut().zip(row(values, dimension, v as u32)) {
                *out += value;
            }
        });
    }
    rows
}

/// Bytes of the three indices of every predicted vertex written out, 4 bytes each. References need none.
fn counted_index_bytes(predictions: &[Prediction]) -> f64 {
    12.0 * predictions.iter().filter(|p| is_predicted(p)).count() as f64
}

/// Bytes of the set of references itself: one entropy-coded bit for each vertex.
fn reference_set_bytes(vertices: usize, references: usize) -> f64 {
    total_bits(&[references, vertices.saturating_sub(references)]) / 8.0
}

/// Bytes of the indices where a reader repeats the simplification and knows `level`: nothing for the triangle that
/// geometry implies, the rank among the [`candidates`] for another, by the entropy of these ranks over all vertices.
fn implied_index_bytes(level: &Level, predictions: &[Prediction]) -> f64 {
    let mut ranks: Vec<usize> = Vec::new();
    let mut written_out = 0;
    for (anchor, prediction) in level.anchors.iter().zip(predictions).filter(|(_, p)| is_predicted(p)) {
        let rank = if prediction.corners == anchor.corners {
            0
        } else {
            match candidates(level, anchor).iter().position(|face| *face == prediction.corners) {
                Some(rank) => rank + 2,
                None => {
                    written_out += 1;
                    1
                }
            }
        };
        if ranks.len() <= rank {
            ranks.resize(rank + 1, 0);
        }
        ranks[rank] += 1;
    }
    (total_bits(&ranks) + f64::from(written_out) * 3.0 * bits_of_index(level.references.len())) / 8.0
}

/// Bytes of the indices coded by what earlier neighbours have, for a reader who knows the mesh and nothing of the
/// simplification: the same three as one of them, three that share two with one of them and a new one, or all new; by
/// the entropy of these cases over all vertices. `triangles` are those of the mesh, `references` their number.
fn predicted_index_bytes(triangles: &[[u32; 3]], predictions: &[Prediction], references: usize) -> f64 {
    let mut earlier: Vec<[u32; 2]> = triangles
        .iter()
        .flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]])
        .map(|[a, b]| [a.max(b), a.min(b)])
        .filter(|[later, earlier]| later != earlier && (*later as usize) < predictions.len())
        .collect();
    earlier.sort_unstable();
    earlier.dedup();
    let mut cases = vec![0; 2];
    let mut bits = 0.0;
    let mut known: Vec<[u32; 3]> = Vec::new();
    let mut neighbours = earlier.iter().peekable();
    for (v, prediction) in predictions.iter().enumerate() {
        known.clear();
        while let Some(&[_, w]) = neighbours.next_if(|pair| pair[0] as usize == v) {
            let triple = sorted(predictions[w as usize].corners);
            if is_predicted(&predictions[w as usize]) && !known.contains(&triple) {
                known.push(triple);
            }
        }
        if !is_predicted(prediction) {
            continue;
        }
        let own = sorted(prediction.corners);
        if let Some(rank) = known.iter().position(|triple| *triple == own) {
            if cases.len() <= rank + 2 {
                cases.resize(rank + 3, 0);
            }
            cases[rank + 2] += 1;
        } else if known.iter().any(|triple| own.iter().filter(|c| triple.contains(c)).count() >= 2) {
            cases[1] += 1;
            // Which earlier triple, which of its corners goes, and what takes its place.
            bits += (3.0 * known.len() as f64).log2() + bits_of_index(references);
        } else {
            cases[0] += 1;
            bits += 3.0 * bits_of_index(references);
        }
    }
    (total_bits(&cases) + bits) / 8.0
}

fn is_predicted(prediction: &Prediction) -> bool {
    let [a, b, c] = prediction.corners;
    a != u32::MAX && !(a == b && b == c)
}

fn sorted(mut corners: [u32; 3]) -> [u32; 3] {
    corners.sort_unstable();
    corners
}

fn bits_of_index(count: usize) -> f64 {
    (count.max(1) as f64).log2()
}

/// Length of a message of symbols that occur so often, coded by their entropy.
fn total_bits(counts: &[usize]) -> f64 {
    let total: usize = counts.iter().sum();
    counts.iter().filter(|&&c| c > 0).map(|&c| c as f64 * (total as f64 / c as f64).log2()).sum()
}
