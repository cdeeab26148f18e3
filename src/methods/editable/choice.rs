//! What is kept of the far field and how finely: the largest threshold that keeps the asked error on some receivers, under
//! some lights of the tuning half, for every published material and the scene's own.

use glam::DVec3;
use rayon::prelude::*;

use super::bake::Stage;
use super::plan::Plan;
use super::subset::Subset;
use crate::compress::blocks;
use crate::light::Light;
use crate::math::statistics::vertex_error;
use crate::medium::profile_basis::ProfileBasis;
use crate::transport::balanced_tree::LightDetails;
use crate::transport::far_field::{FarTransport, Precision};
use crate::transport::scene::Scene;

/// Groups of receivers that choices are made by.
const GROUPS: usize = 16;

/// Lights that choices are made by, of those that a bake gets.
const LIGHTS: usize = 8;

/// Significance below which nobody looks, over the asked error.
const FLOOR: f64 = 0.01;

/// Steps of the search.
const STEP: f64 = 1.2;

/// Share of the asked error that is aimed at: these lights are many and the worst of them counts.
const TARGET: f64 = 1.0;

/// What is kept, and how finely.
pub(super) struct Choice {
    pub(super) threshold: f64,
    /// Quantiser step of each basis function; raised for values that would not fit.
    pub(super) steps: Vec<f64>,
}

/// One coefficient of one function.
struct Entry {
    /// Square, summed over the receivers of the group.
    significance2: f64,
    node: u32,
    k: u32,
    /// Where its values are: group and row.
    group: u32,
    row: u32,
}

/// Irradiance of the samples under a light, and its details.
pub(super) struct Tuning {
    pub(super) irradiance: Vec<DVec3>,
    pub(super) details: LightDetails,
}

/// Some lights of those that choices may look at.
pub(super) fn tuning_lights(lights: &[Light]) -> impl Iterator<Item = usize> {
    (0..lights.len()).step_by(lights.len().div_ceil(LIGHTS).max(1))
}

impl Choice {
    pub(super) fn new(
        scene: &Scene,
        stage: &Stage,
        plan: &Plan,
        (basis, transport): (&ProfileBasis, &FarTransport),
        lights: &[Tuning],
    ) -> Self {
        let floor = FLOOR * plan.truncation;
        let precision = Precision { opening: plan.opening, threshold: floor, keep: 0.0 };
        let trial = FarTransport { precision, ..*transport };
        let subset = Subset::new(scene, &stage.points.receivers, GROUPS, 0);
        let groups = &subset.receivers.groups;
        let rows: Vec<_> = groups
            .par_iter()
            .map(|group| trial.rows(&subset.receivers.positions[group.run.range()], group.part as usize))
            .collect();
        let terms = basis.terms();
        let mut entries = Vec::new();
        for (group, rows) in rows.iter().enumerate() {
            let mut row = 0;
            for (&node, &mask) in rows.nodes.iter().zip(&rows.masks) {
                let light = f64::from(transport.expected[node as usize]);
                for k in (0..terms).filter(|k| mask >> k & 1 == 1) {
                    let gain = transport.spread[k] * light;
                    let squares = rows.values[row].iter().map(|v| (f64::from(*v) * gain).powi(2));
                    let (group, k) = (group as u32, k as u32);
                    entries.push(Entry { significance2: squares.sum(), node, k, group, row: row as u32 });
                    row += 1;
                }
            }
        }
        // Ties in the order of the groups: the same on any number of threads.
        entries.par_sort_by(|a, b| a.significance2.total_cmp(&b.significance2));

        let materials = subset.materials(scene, basis);
        let truths: Vec<Vec<Vec<DVec3>>> = lights
            .iter()
            .map(|light| {
                let far = subset.rebuilt(&rows, terms, &light.details);
                let near = subset.near(scene, stage, plan, &materials, &light.irradiance);
                materials.iter().zip(near).map(|(m, near)| m.add(&far, near)).collect()
            })
            .collect();

        let mut lost = vec![vec![vec![0.0f64; terms]; subset.receivers.positions.len()]; lights.len()];
        let mut threshold = floor;
        let mut rest = entries.as_slice();
        loop {
            let next = threshold * STEP;
            let dropped = rest.partition_point(|e| e.significance2 < next * next);
            let (now, later) = rest.split_at(dropped);
            rest = later;
            lost.par_iter_mut().zip(lights).for_each(|(lost, light)| {
                for entry in now {
                    let run = groups[entry.group as usize].run;
                    let detail = f64::from(light.details.details[entry.node as usize][0]) * light.details.scale;
                    let values = &rows[entry.group as usize].values[entry.row as usize];
                    for (lost, value) in lost[run.range()].iter_mut().zip(values) {
                        lost[entry.k as usize] += f64::from(*value) * detail;
                    }
                }
            });
            let worst = lost.par_iter().zip(&truths).map(|(lost, truths)| {
                let of_material = |(material, truth): (&super::subset::Projected, &Vec<DVec3>)| {
                    let values = material.add(lost, truth.clone());
                    vertex_error(&values, truth, &subset.areas).rms
                };
                materials.iter().zip(truths).map(of_material).fold(0.0, f64::max)
            });
            let worst = worst.collect::<Vec<f64>>().into_iter().fold(0.0, f64::max);
            if worst > TARGET * plan.truncation || rest.is_empty() {
                break;
            }
            threshold = next;
        }

        // Rounding meets the light where coefficients are kept.
        let kept = entries.iter().filter(|e| e.significance2 > threshold * threshold);
        let gains = kept.map(|e| {
            let light = f64::from(transport.expected[e.node as usize]);
            groups[e.group as usize].run.range().len() as f64 * light * light
        });
        let gain2 = gains.sum::<f64>() / subset.receivers.positions.len().max(1) as f64;
        let step = blocks::step(gain2, plan.quantiser);
        let steps = transport.spread.iter().map(|s| step / s.max(f64::MIN_POSITIVE)).collect();
        Self { threshold, steps }
    }
}
