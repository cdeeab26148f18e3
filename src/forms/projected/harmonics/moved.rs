//! Irradiance under harmonics of light that is moved to where it first scatters.

use rayon::prelude::*;

use crate::error::Result;
use crate::forms::projected::lights::{Seen, irradiance_of_seen, neighbours, parallel};
use crate::forms::sampled_scene::SampledScene;
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::math::simd::{InstructionSet, multiversion};
use crate::progress::Progress;
use crate::transport::irradiance_rows::texels::TexelBaker;
use crate::transport::many_lights::IrradianceRows;
use crate::transport::visibility::Resolution;

/// Directions for each harmonic, and their least number.
const OF_A_HARMONIC: usize = 2;
const LEAST: usize = 64;

/// Irradiance of every sample under each spherical harmonic of an order, as [`TexelBaker::harmonics`], where kernels are calibrated
/// moved to where it first scatters: what moving changes is summed over parallel light from directions all around.
///
/// # Errors
/// Those of a set of directions.
pub(super) fn irradiance(
    sampled: &SampledScene,
    (resolution, order): (Resolution, usize),
    progress: &dyn Progress,
) -> Result<IrradianceRows> {
    let surface = sampled.surface();
    let mut rows = TexelBaker::new(&surface, resolution).harmonics(order, progress);
    if sampled.model.is_none() {
        return Ok(rows);
    }
    let functions = order * order;
    let set = parallel(sampled.scene, (OF_A_HARMONIC * functions).max(LEAST))?;
    let seen = Seen::new(sampled, &set, progress);
    let solid_angle = 4.0 * std::f64::consts::PI / set.count() as f64;
    progress.start("entry", set.count() as u64);
    for run in neighbours(&set.directions, 1) {
        let lights: Vec<Light> = run.iter().filter_map(|&light| set.entry(light as usize)).collect();
        let before = irradiance_of_seen(sampled, &seen, &run);
        let mut after = before.clone();
        sampled.move_rows(&lights, &mut after);
        // Harmonics in the direction of each light, for a light that is so wide.
        let mut matrix = Vec::with_capacity(lights.len() * functions);
        for light in &lights {
            matrix.extend(coefficients(light, order)?.iter().map(|c| (c.x * solid_angle) as f32));
        }
        let level = InstructionSet::detect();
        let count = run.len().max(1);
        let changes = before.values.par_chunks(count).zip(after.values.par_chunks(count));
        rows.values.par_chunks_mut(functions.max(1)).zip(changes).for_each(|(row, (before, after))| {
            add_changes(level, row, before, after, &matrix);
        });
        progress.advance(run.len() as u64);
    }
    progress.finish();
    Ok(rows)
}

multiversion! {
    /// Adds the difference of irradiance under each light times the harmonics in its direction.
    fn add_changes(row: &mut [f32], before: &[f32], after: &[f32], matrix: &[f32]) => add_changes_body
}

#[inline(always)]
fn add_changes_body(row: &mut [f32], before: &[f32], after: &[f32], matrix: &[f32]) {
    for ((before, after), harmonics) in before.iter().zip(after).zip(matrix.chunks_exact(row.len().max(1))) {
        let change = after - before;
        if change != 0.0 {
            row.iter_mut().zip(harmonics).for_each(|(sum, value)| *sum += change * value);
        }
    }
}
