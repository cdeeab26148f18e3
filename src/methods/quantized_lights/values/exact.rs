//! Radiosity of every receiver under every light of a set: the scalar integral q or the vector integral Q.

use glam::DVec3;
use rayon::prelude::*;

use super::super::encoding::Integral;
use super::super::lights::LightSet;
use super::super::seen::{Seen, irradiance_of_seen, neighbours, radiosity_of_set};
use super::CHANNELS;
use super::matrix::{Cells, Matrix};
use crate::error::Result;
use crate::methods::stage::Stage;
use crate::progress::{Progress, Silent};
use crate::transport::irradiance::LightSampling;
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::visibility::Observer;

/// Components of a vector.
const COMPONENTS: usize = 3;

/// Lights whose vectors are gathered together; each takes four columns.
const RUN: usize = 16;

/// Values `[receiver][plane][light]`: planes are channels, or three components for each.
pub(super) fn values(
    stage: &Stage,
    transfer: &ManyLights,
    set: &LightSet,
    integral: Integral,
    progress: &dyn Progress,
) -> Result<Matrix> {
    let columns = set.lights.count();
    let (planes, cells) = match integral {
        Integral::Scalar => {
            (CHANNELS, radiosity_of_set(stage, transfer, &set.lights, stage.receivers.len(), progress)?)
        }
        Integral::Vector => (CHANNELS * COMPONENTS, vectors(stage, transfer, set, progress)),
    };
    Ok(Matrix { planes, columns, cells: Cells::Floats(cells) })
}

/// The vectors Q of parallel lights: the sum of the normals of what is lit, weighted as radiosity weights it but for the cosine,
/// whose product with the light's direction is the radiosity.
fn vectors(stage: &Stage, transfer: &ManyLights, set: &LightSet, progress: &dyn Progress) -> Vec<f32> {
    let directions = &set.lights.directions;
    let (count, receivers) = (directions.count(), stage.receivers.len());
    let mut values = vec![0.0f32; receivers * CHANNELS * COMPONENTS * count];
    let seen = Seen::new(stage, &set.lights, progress);
    progress.start("lights", count as u64);
    for run in neighbours(directions, 1) {
        for run in run.chunks(RUN) {
            let columns = columns(stage, &irradiance_of_seen(stage, &seen, run), run, directions.directions());
            let rows = transfer.radiosity(&columns, &Silent).values;
            let out = values.par_chunks_exact_mut((COMPONENTS * count).max(1));
            out.zip(rows.par_chunks_exact(columns.lights.max(1))).for_each(|(out, row)| {
                let (sums, base) = row.split_at(COMPONENTS * run.len());
                for (k, sums) in sums.chunks_exact(run.len()).enumerate() {
                    for ((&light, sum), base) in run.iter().zip(sums).zip(base) {
                        out[k * count + light as usize] = sum - base;
                    }
                }
            });
            progress.advance(run.len() as u64);
        }
    }
    progress.finish();
    values
}

/// Irradiance of parallel lights over its cosine, times 1 + each component of the normal and then alone: none is negative, so that
/// clusters have centroids, and all columns share them, so that components add up to what the transfer makes of the whole.
fn columns(stage: &Stage, rows: &IrradianceRows, run: &[u32], directions: &[DVec3]) -> IrradianceRows {
    let (own, all) = (run.len(), (COMPONENTS + 1) * run.len());
    let mut values = vec![0.0f32; stage.samples.len() * all];
    let samples = values.par_chunks_exact_mut(all.max(1)).zip(rows.values.par_chunks_exact(own.max(1)));
    samples.enumerate().for_each(|(sample, (out, row))| {
        let normal = Observer::of(&stage.scene.mesh, stage.samples.patch(sample)).normal;
        for (i, (value, &light)) in row.iter().zip(run).enumerate() {
            let cosine = directions.get(light as usize).map_or(0.0, |d| normal.dot(*d));
            if *value > 0.0 && cosine > 0.0 {
                let bare = f64::from(*value) / cosine;
                (0..COMPONENTS).for_each(|k| out[k * own + i] = (bare * (1.0 + normal[k])) as f32);
                out[COMPONENTS * own + i] = bare as f32;
            }
        }
    });
    IrradianceRows { lights: all, values }
}

/// How light reaches samples where a bake looks at it.
pub(super) fn irradiance(stage: &Stage, light: &crate::light::Light, sampling: LightSampling) -> Result<Vec<DVec3>> {
    let etas: Vec<f64> = stage.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    let one = std::slice::from_ref(light);
    Ok(crate::transport::irradiance::Illumination::new(&stage.surface(), one, &etas, sampling)?.all(&Silent))
}
