//! Truncation and quantisation of the far field: the largest threshold that keeps the asked error on some receivers,
//! under some lights of the tuning half, for every published material and the scene's own.

use glam::DVec3;
use rayon::slice::ParallelSliceMut;

use super::ordered_samples::Work;
use super::sources::FarRadiosity;
use super::subset::{OfFunctions, Projected, Subset};
use crate::compress::blocks;
use crate::light::Light;
use crate::parallel::*;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::far_field::{FarTransport, LANES, Precision, Rows};
use crate::transport::receivers::Group;

/// Groups of receivers that choices are made by.
pub(super) const GROUPS: usize = 16;

/// Lights that choices are made by, of those that a bake gets.
const LIGHTS: usize = 8;

/// Least threshold, over the asked error.
const FLOOR: f64 = 0.003;

/// Factor between thresholds of the search.
const STEP: f64 = 1.04;

/// Share of the asked error that is aimed at: these lights are many and the worst of them counts.
const TARGET: f64 = 1.0;

/// Threshold of the coefficients and their quantiser steps.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct Choice {
    pub(super) threshold: f64,
    /// Quantiser step of each basis function; raised for values that would not fit.
    pub(super) steps: Vec<f64>,
}

/// One coefficient of one function.
struct Coefficient {
    /// Squared significance, summed over the receivers of the group.
    significance2: f64,
    node: u32,
    k: u32,
    /// Place of its values: class, group and row.
    class: u32,
    group: u32,
    row: u32,
}

/// Irradiance of the samples under a light, and its details.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct Tuning {
    pub(super) irradiance: Vec<DVec3>,
    pub(super) details: LightDetails,
}

/// Indices of some lights, spread over those that choices may look at.
pub(super) fn tuning_lights(lights: &[Light]) -> impl Iterator<Item = usize> {
    (0..lights.len()).step_by(lights.len().div_ceil(LIGHTS).max(1))
}

impl Choice {
    pub(super) fn new(work: Work, transport: &FarTransport, lights: &[Tuning]) -> Self {
        let Work { scene, ordered, form, basis, .. } = work;
        let floor = FLOOR * form.truncation;
        let precision = Precision { opening: form.opening, threshold: floor, keep: 0.0 };
        let trial = FarTransport { precision, ..*transport };
        let subsets = Subset::of_functions(scene, &ordered.points, (GROUPS, 0));
        let materials = Subset::materials(work);
        let classes: Vec<Class> =
            subsets.into_iter().map(|of| Class::new(work, of, &trial, (&materials, lights))).collect();
        let lose = |lost: &mut [FarRadiosity], light: &Tuning, entry: &Coefficient| {
            let class = &classes[entry.class as usize];
            let run = class.of.subset.receivers.groups[entry.group as usize].run;
            let detail = f64::from(light.details.details[entry.node as usize][0]) * light.details.scale;
            let values = &class.rows[entry.group as usize].values[entry.row as usize];
            for (lost, value) in lost[entry.class as usize][run.range()].iter_mut().zip(values) {
                lost[entry.k as usize] += f64::from(*value) * detail;
            }
        };
        let floor2 = floor * floor;
        // Most are so small that they are dropped where they lie; the others from the smallest on.
        let below_the_floor = |light: &Tuning| -> Vec<FarRadiosity> {
            let nothing = |class: &Class| vec![vec![0.0; basis.terms()]; class.of.subset.receivers.len()];
            let mut lost: Vec<FarRadiosity> = classes.iter().map(nothing).collect();
            let small = |e: &Coefficient| e.significance2 < floor2;
            classes.iter().zip(0..).for_each(|(class, index)| {
                class.entries(transport, index).filter(small).for_each(|e| lose(&mut lost, light, &e));
            });
            lost
        };
        let mut lost: Vec<Vec<FarRadiosity>> = lights.par_iter().map(below_the_floor).collect();
        let large = |(class, index): (&Class, u32)| -> Vec<Coefficient> {
            class.entries(transport, index).filter(|e| e.significance2 >= floor2).collect()
        };
        let mut entries: Vec<Coefficient> = classes.iter().zip(0..).flat_map(large).collect();
        // Ties in the order of the groups: the same on any number of threads.
        entries.par_sort_by(|a, b| a.significance2.total_cmp(&b.significance2));
        let mut threshold = floor;
        let mut rest = entries.as_slice();
        loop {
            let next = threshold * STEP;
            let dropped = rest.partition_point(|e| e.significance2 < next * next);
            let (now, later) = rest.split_at(dropped);
            rest = later;
            lost.par_iter_mut().zip(lights).for_each(|(lost, light)| now.iter().for_each(|e| lose(lost, light, e)));
            let of_light = |(index, lost): (usize, &Vec<FarRadiosity>)| {
                let of_material = |material: usize| {
                    // A vertex sums what all rows lose, of one function or another: errors that know nothing of each other.
                    let of_class = |(class, lost): (&Class, &FarRadiosity)| {
                        let truth = &class.truths[index][material];
                        let values = materials[material].add(lost, truth.clone());
                        class.of.subset.points.error(&values, truth).rms.powi(2)
                    };
                    classes.iter().zip(lost).map(of_class).sum::<f64>()
                };
                (0..materials.len()).map(of_material).fold(0.0, f64::max).sqrt()
            };
            let worst: Vec<f64> = lost.par_iter().enumerate().map(of_light).collect();
            if worst.into_iter().fold(0.0, f64::max) > TARGET * form.truncation || rest.is_empty() {
                break;
            }
            threshold = next;
        }

        // Rounding meets the light where coefficients are kept.
        let kept = entries.iter().filter(|e| e.significance2 > threshold * threshold);
        let gains = kept.map(|e| {
            let light = f64::from(transport.expected[e.node as usize]);
            let receivers = &classes[e.class as usize].of.subset.receivers;
            let share = receivers.groups[e.group as usize].run.range().len() as f64 / receivers.len().max(1) as f64;
            share * light * light
        });
        let step = blocks::step(gains.sum::<f64>(), form.quantiser);
        let steps = transport.spread.iter().map(|s| step / s.max(f64::MIN_POSITIVE)).collect();
        Self { threshold, steps }
    }
}

/// Rows with the same functions, on which choices are made.
struct Class {
    of: OfFunctions,
    /// Rows of each group.
    rows: Vec<Rows>,
    /// Radiosity `[light][material][receiver]`.
    truths: Vec<Vec<Vec<DVec3>>>,
}

impl Class {
    fn new(work: Work, of: OfFunctions, trial: &FarTransport, (materials, lights): (&[Projected], &[Tuning])) -> Self {
        let subset = &of.subset;
        let (positions, terms) = (&subset.receivers.positions, trial.spread.len());
        let of_group = |group: &Group| trial.rows(&positions[group.run.range()], group.part as usize, of.functions);
        let rows: Vec<Rows> = subset.receivers.groups.par_iter().map(of_group).collect();
        let others: Vec<usize> = (0..terms).filter(|k| of.functions >> k & 1 == 0).collect();
        let exact = match others.as_slice() {
            [] => Vec::new(),
            _ => {
                let irradiances: Vec<&[DVec3]> = lights.iter().map(|light| light.irradiance.as_slice()).collect();
                work.ordered.merged.far_radiosity(trial.table, &subset.receivers, &irradiances)
            }
        };
        let near = subset.near(work, materials);
        let under = |(index, light): (usize, &Tuning)| -> Vec<Vec<DVec3>> {
            let mut far = subset.rebuilt(&rows, terms, &light.details);
            for (far, exact) in far.iter_mut().zip(exact.get(index).into_iter().flatten()) {
                others.iter().for_each(|&k| far[k] = exact[k]);
            }
            materials.iter().zip(near.under(&light.irradiance)).map(|(m, near)| m.add(&far, near)).collect()
        };
        let truths = lights.iter().enumerate().map(under).collect();
        Self { of, rows, truths }
    }

    /// Every coefficient.
    fn entries<'a>(&'a self, transport: &'a FarTransport, class: u32) -> impl Iterator<Item = Coefficient> + 'a {
        let terms = transport.spread.len();
        self.rows.iter().zip(0..).flat_map(move |(rows, group)| {
            let of_row = move |(&node, &mask): (&u32, &u16)| {
                (0..terms).filter(move |k| mask >> k & 1 == 1).map(move |k| (node, k))
            };
            let entry = move |((row, values), (node, k)): ((u32, &[f32; LANES]), (u32, usize))| {
                let gain = transport.spread[k] * f64::from(transport.expected[node as usize]);
                let squares = values.iter().map(|v| (f64::from(*v) * gain).powi(2));
                Coefficient { significance2: squares.sum(), node, k: k as u32, class, group, row }
            };
            (0..).zip(&rows.values).zip(rows.nodes.iter().zip(&rows.masks).flat_map(of_row)).map(entry)
        })
    }
}
