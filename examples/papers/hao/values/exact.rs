//! Radiosity of every receiver under every light of a set: the scalar integral q or the vector integral Q.

use glam::DVec3;
use rayon::prelude::*;

use super::super::settings::Integral;
use super::CHANNELS;
use super::matrix::{Cells, Matrix};
use translux::error::Result;
use translux::forms::projected::lights::LightSet;
use translux::forms::projected::lights::{Seen, irradiance_of_seen, neighbours, radiosity_of_set};
use translux::forms::sampled_scene::SampledScene;
use translux::progress::{Progress, Silent};
use translux::transport::irradiance::LightSampling;
use translux::transport::many_lights::{IrradianceRows, ManyLights};
use translux::transport::visibility::Observer;

/// Components of a vector.
const COMPONENTS: usize = 3;

/// Lights whose vectors are gathered together; each takes four columns.
const RUN: usize = 16;

/// Values `[receiver][plane][light]`: planes are channels, or three components for each.
pub(super) fn values(
    sampled: &SampledScene,
    transfer: &ManyLights,
    set: &LightSet,
    integral: Integral,
    progress: &dyn Progress,
) -> Result<Matrix> {
    let columns = set.lights.count();
    let (planes, cells) = match integral {
        Integral::Scalar => {
            (CHANNELS, radiosity_of_set(sampled, transfer, &set.lights, sampled.receivers.len(), progress)?)
        }
        Integral::Vector => (CHANNELS * COMPONENTS, vectors(sampled, transfer, set, progress)),
    };
    Ok(Matrix { planes, columns, cells: Cells::Floats(cells) })
}

/// The vectors Q of parallel lights: the sum of the normals of what is lit, weighted as radiosity weights it but for the cosine,
/// whose product with the light's direction is the radiosity.
fn vectors(sampled: &SampledScene, transfer: &ManyLights, set: &LightSet, progress: &dyn Progress) -> Vec<f32> {
    let directions = &set.lights.directions;
    let (count, receivers) = (directions.count(), sampled.receivers.len());
    let mut values = vec![0.0f32; receivers * CHANNELS * COMPONENTS * count];
    let seen = Seen::new(sampled, &set.lights, progress);
    progress.start("lights", count as u64);
    for run in neighbours(directions, 1) {
        for run in run.chunks(RUN) {
            let columns = columns(sampled, &irradiance_of_seen(sampled, &seen, run), run, directions.directions());
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
fn columns(sampled: &SampledScene, rows: &IrradianceRows, run: &[u32], directions: &[DVec3]) -> IrradianceRows {
    let (own, all) = (run.len(), (COMPONENTS + 1) * run.len());
    let mut values = vec![0.0f32; sampled.samples.len() * all];
    let samples = values.par_chunks_exact_mut(all.max(1)).zip(rows.values.par_chunks_exact(own.max(1)));
    samples.enumerate().for_each(|(sample, (out, row))| {
        let normal = Observer::of(&sampled.scene.mesh, sampled.samples.patch(sample)).normal;
        for (i, (value, &light)) in row.iter().zip(run).enumerate() {
            let cosine = directions.get(light as usize).map_or(0.0, |d| normal.dot(*d));
            if *value > 0.0 && cosine > 0.0 {
                let bare = f64::from(*value) / cosine;
                (0..COMPONENTS).for_each(|k| out[k * own + i] = (bare * (1.0 + normal[k])) as f32);
                out[COMPONENTS * own + i] = bare as f32;
            }
        }
    });
    IrradianceRows { lights: all, by_channel: false, values }
}

/// How light reaches samples where a bake looks at it.
pub(super) fn irradiance(
    sampled: &SampledScene,
    light: &translux::light::Light,
    sampling: LightSampling,
) -> Result<Vec<DVec3>> {
    let etas: Vec<f64> = sampled.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    let one = std::slice::from_ref(light);
    Ok(translux::transport::irradiance::Illumination::new(&sampled.surface(), one, &etas, sampling)?.all(&Silent))
}
