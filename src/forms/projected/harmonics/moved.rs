//! Irradiance under harmonics of light that is moved to where it first scatters.

use crate::error::Result;
use crate::forms::projected::lights::{Seen, irradiance_of_seen, neighbours, parallel};
use crate::forms::sampled_scene::SampledScene;
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::parallel::*;
use crate::progress::Progress;
use crate::transport::irradiance_rows::texels::TexelBaker;
use crate::transport::many_lights::IrradianceRows;
use crate::transport::visibility::Resolution;

/// Directions for each harmonic, and their least number.
const OF_A_HARMONIC: usize = 4;
const LEAST: usize = 64;

/// True if light enters elsewhere than it arrives.
pub(super) fn moves(sampled: &SampledScene) -> bool {
    sampled.model.as_ref().is_some_and(|model| !model.entry.is_still())
}

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
    let rows = TexelBaker::new(&surface, resolution).harmonics(order, progress);
    if !moves(sampled) {
        return Ok(rows);
    }
    let functions = order * order;
    let of_channels = rows.values.chunks(functions.max(1)).flat_map(|row| [row; 3]).flatten().copied().collect();
    let mut rows = IrradianceRows { lights: functions, by_channel: true, values: of_channels };
    let set = parallel(sampled.scene, (OF_A_HARMONIC * functions).max(LEAST))?;
    let seen = Seen::new(sampled, &set, progress);
    let solid_angle = 4.0 * std::f64::consts::PI / set.count() as f64;
    progress.start("entry", set.count() as u64);
    for run in neighbours(&set.directions, 1) {
        let lights: Vec<Light> = run.iter().filter_map(|&light| set.entry(light as usize)).collect();
        let before = irradiance_of_seen(sampled, &seen, &run);
        let after = sampled.moved_rows(&lights, before.clone());
        // Harmonics in the direction of each light, for a light that is so wide.
        let mut harmonics = Vec::with_capacity(lights.len());
        for light in &lights {
            harmonics.push(coefficients(light, order)?.iter().map(|c| (c.x * solid_angle) as f32).collect());
        }
        let (level, blocks) = (InstructionSet::detect(), in_blocks(&harmonics));
        let count = run.len().max(1);
        let changes = before.values.par_chunks(count).zip(after.values.par_chunks(3 * count));
        rows.values.par_chunks_mut((3 * functions).max(1)).zip(changes).for_each_init(
            Vec::new,
            |changed: &mut Vec<Changed>, (rows, (before, after))| {
                changed.clear();
                changed.extend(before.iter().enumerate().filter_map(|(light, before)| {
                    let change = [0, 1, 2].map(|c| after[c * count + light] - before);
                    (change != [0.0; 3]).then_some((light, change))
                }));
                if !changed.is_empty() {
                    add_changes(level, rows, changed, &blocks, lights.len());
                }
            },
        );
        progress.advance(run.len() as u64);
    }
    progress.finish();
    Ok(rows)
}

/// A light that changes, and the change of irradiance in each channel.
type Changed = (usize, [f32; 3]);

/// Harmonics that are summed at once.
const BLOCK: usize = 16;

/// Harmonics of each light in blocks, `[block][light]`, the last one padded: what is read one after another lies so.
fn in_blocks(harmonics: &[Vec<f32>]) -> Vec<[f32; BLOCK]> {
    let count = harmonics.first().map_or(0, Vec::len).div_ceil(BLOCK);
    let of = |block: usize, all: &Vec<f32>| std::array::from_fn(|i| all.get(block * BLOCK + i).copied().unwrap_or(0.0));
    (0..count).flat_map(|block| harmonics.iter().map(move |all| of(block, all))).collect()
}

multiversion! {
    /// Adds to the rows of the channels of a sample the changes of irradiance times the harmonics of the lights, which are so many.
    fn add_changes(
        rows: &mut [f32],
        changed: &[Changed],
        blocks: &[[f32; BLOCK]],
        lights: usize,
    ) => add_changes_body
}

#[inline(always)]
fn add_changes_body(rows: &mut [f32], changed: &[Changed], blocks: &[[f32; BLOCK]], lights: usize) {
    let functions = rows.len() / 3;
    for (block, of_lights) in blocks.chunks_exact(lights.max(1)).enumerate() {
        // One variable each, so that they stay in registers.
        let [mut red, mut green, mut blue] = [[0.0f32; BLOCK]; 3];
        for (light, [r, g, b]) in changed {
            let harmonics = &of_lights[*light];
            add_scaled(&mut red, *r, harmonics);
            add_scaled(&mut green, *g, harmonics);
            add_scaled(&mut blue, *b, harmonics);
        }
        let columns = block * BLOCK..functions.min((block + 1) * BLOCK);
        for (row, sums) in rows.chunks_exact_mut(functions.max(1)).zip([red, green, blue]) {
            row[columns.clone()].iter_mut().zip(sums).for_each(|(value, sum)| *value += sum);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::evaluate::{BakeSettings, Model};
    use crate::forms::projected::references::under;
    use crate::forms::test_scene::scene;
    use crate::geometry::shapes;
    use crate::light::quantised::directions::lattice;
    use crate::medium::profile::Orders;
    use crate::progress::Silent;
    use crate::transport::calibration::Walks;
    use crate::transport::near_rule::NearField;

    #[test]
    fn harmonics_of_moved_light_give_what_suns_and_skies_do() {
        const ORDER: usize = 14;
        let scene = scene(shapes::bumpy_head(12.0, 3), "skin1");
        let settings = BakeSettings { model: Model::Calibrated(Walks::default()), ..BakeSettings::new(0.01) };
        let sampled = SampledScene::new(&scene, 6000);
        let (sampled, _) = sampled.with_model(&settings, Orders::FromOne, &Silent).unwrap();
        let suns: Vec<Light> = lattice(12, 0.5)
            .into_iter()
            .map(|from| Light::Directional { from, irradiance: DVec3::new(1.0, 0.5, 2.0) })
            .collect();
        sampled
            .with_transfer(NearField::for_error(0.01), |transfer| {
                let rows = irradiance(&sampled, (Resolution::Sub64, ORDER), &Silent)?;
                let rows = transfer.radiosity(&rows, &Silent);
                let probes = sampled.probes((0..sampled.receivers.len() as u32).collect());
                let error = |light: &Light| {
                    let by_rays: Vec<DVec3> = transfer.under(&sampled.by_rays(light)?);
                    let found = under(&rows.values, ORDER * ORDER, &coefficients(light, ORDER)?);
                    Ok(probes.error(&found, &by_rays).rms)
                };
                let of_suns: Vec<f64> = suns.iter().map(error).collect::<Result<_>>()?;
                let constant = error(&Light::Constant { radiance: DVec3::new(1.0, 0.2, 3.0) })?;
                println!("{of_suns:.4?} {constant:.4}");
                // What moving by the mean of the channels would be off by is 4 %.
                assert!(of_suns.iter().all(|error| *error < 0.03), "{of_suns:.4?}");
                assert!(constant < 0.005, "{constant}");
                Ok(())
            })
            .unwrap();
    }
}
