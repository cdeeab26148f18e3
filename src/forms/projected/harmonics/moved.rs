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
    let rows = TexelBaker::new(&surface, resolution).harmonics(order, progress);
    if sampled.model.as_ref().is_none_or(|model| model.entry.is_still()) {
        return Ok(rows);
    }
    let functions = order * order;
    let of_channels = rows.values.chunks(functions.max(1)).flat_map(|row| [row; 3]).flatten().copied().collect();
    let mut rows = IrradianceRows { lights: functions, by_channel: true, values: of_channels };
    let set = parallel(
        sampled.scene,
        (std::env::var("PER").map_or(OF_A_HARMONIC, |s| s.parse().unwrap_or(2)) * functions).max(LEAST),
    )?;
    let seen = Seen::new(sampled, &set, progress);
    let solid_angle = 4.0 * std::f64::consts::PI / set.count() as f64;
    progress.start("entry", set.count() as u64);
    for run in neighbours(&set.directions, 1) {
        let lights: Vec<Light> = run.iter().filter_map(|&light| set.entry(light as usize)).collect();
        let before = irradiance_of_seen(sampled, &seen, &run);
        let after = sampled.moved_rows(&lights, before.clone());
        // Harmonics in the direction of each light, for a light that is so wide.
        let mut matrix = Vec::with_capacity(lights.len() * functions);
        for light in &lights {
            matrix.extend(coefficients(light, order)?.iter().map(|c| (c.x * solid_angle) as f32));
        }
        let level = InstructionSet::detect();
        let count = run.len().max(1);
        let changes = before.values.par_chunks(count).zip(after.values.par_chunks(3 * count));
        rows.values.par_chunks_mut((3 * functions).max(1)).zip(changes).for_each(|(rows, (before, after))| {
            for (row, after) in rows.chunks_exact_mut(functions.max(1)).zip(after.chunks_exact(count)) {
                add_changes(level, row, before, after, &matrix);
            }
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod diagnosis {
    use std::time::Instant;

    use glam::DVec3;

    use super::*;
    use crate::evaluate::{BakeSettings, Model};
    use crate::forms::sampled_scene::SampledScene;
    use crate::medium::profile::Orders;
    use crate::progress::Silent;
    use crate::transport::calibration::Walks;
    use crate::transport::near_rule::NearField;

    fn lights(count: usize) -> Vec<Light> {
        (0..count)
            .map(|i| {
                let z = 1.0 - 2.0 * ((i as f64 + 0.5) / count as f64);
                let phi = i as f64 * 2.399_963 + 0.3;
                let r = (1.0 - z * z).sqrt();
                Light::Directional { from: DVec3::new(r * phi.cos(), r * phi.sin(), z), irradiance: DVec3::ONE }
            })
            .collect()
    }

    #[test]
    #[ignore = "diagnosis"]
    fn where_calibrated_harmonics_lose() {
        let model = crate::geometry::test_data::obj("meshes/bunny_3k.obj").unwrap();
        let scene = {
            use crate::geometry::mesh::{Mesh, Scale, resolve_scale};
            use crate::geometry::part_table::PartTable;
            use crate::geometry::parts::{Analysis, MaterialRoles, PartsRule};
            let placement = resolve_scale(&model, Some(Scale::DiagonalMm(30.0))).unwrap();
            let (mut mesh, mut report) = Mesh::from_source(model, &placement).unwrap();
            let parts = Analysis::new(&mut mesh, &MaterialRoles::single(1), PartsRule::Auto, &mut report).parts;
            let parts = PartTable::of(&mesh, &parts);
            crate::scene::Scene { mesh, parts, media: vec![crate::forms::test_scene::medium("skin1")] }
        };
        let samples: usize = std::env::var("SAMPLES").map_or(16384, |s| s.parse().unwrap());
        let order: usize = std::env::var("ORDER").map_or(24, |s| s.parse().unwrap());
        let calibrated = std::env::var("DIPOLE").is_err();
        let mut settings = BakeSettings::new(0.01);
        if calibrated {
            settings.model = Model::Calibrated(Walks::default());
        }
        let sampled = SampledScene::new(&scene, samples);
        let (sampled, _) = sampled.with_model(&settings, Orders::FromOne, &Silent).unwrap();
        let lights = lights(24);
        sampled
            .with_transfer(NearField::for_error(0.01), |transfer| {
                let (some, points) = sampled.receivers.probe_points(&sampled.areas, (384, 0));
                let transfer = transfer.towards(&some, &points.areas_mm2);
                let of_rows = |rows: &IrradianceRows| {
                    let r = transfer.radiosity(rows, &Silent);
                    (0..rows.lights).map(|l| r.under(l)).collect::<Vec<_>>()
                };
                let report = |name: &str, found: &[Vec<DVec3>], truth: &[Vec<DVec3>]| {
                    let e: Vec<f64> = found.iter().zip(truth).map(|(f, t)| points.error(f, t).rms).collect();
                    let mean = (e.iter().map(|e| e * e).sum::<f64>() / e.len() as f64).sqrt();
                    let worst = e.iter().copied().fold(0.0, f64::max);
                    eprintln!("{name}: mean {:.2} % worst {:.2} %", 100.0 * mean, 100.0 * worst);
                };
                let from_rays = |values: &[Vec<DVec3>]| {
                    let n = values.len();
                    let mut rows = IrradianceRows {
                        lights: n,
                        by_channel: true,
                        values: vec![0.0; 3 * n * sampled.samples.len()],
                    };
                    for (l, e) in values.iter().enumerate() {
                        for (s, e) in e.iter().enumerate() {
                            (0..3).for_each(|c| rows.values[(s * 3 + c) * n + l] = e[c] as f32);
                        }
                    }
                    of_rows(&rows)
                };
                let t = Instant::now();
                sampled.by_rays(&lights[0]).unwrap();
                eprintln!("first {:.2} s", t.elapsed().as_secs_f64());
                let t = Instant::now();
                let truth = from_rays(&lights.iter().map(|l| sampled.by_rays(l).unwrap()).collect::<Vec<_>>());
                eprintln!("truth {:.1} s", t.elapsed().as_secs_f64());
                report("rows", &of_rows(&sampled.irradiance(&lights).unwrap()), &truth);
                let sky: Vec<Light> = crate::light::quantised::directions::lattice(400, 0.5)
                    .into_iter()
                    .map(|from| Light::Directional { from, irradiance: DVec3::splat(1.0 + from.y) })
                    .collect();
                for power in [0, 1, 4] {
                    let sum = |moved: bool| {
                        let mut all = vec![DVec3::ZERO; sampled.samples.len()];
                        for light in &sky {
                            let Light::Directional { from, .. } = light else { continue };
                            let of = Light::Directional {
                                from: *from,
                                irradiance: DVec3::splat((1.0 + from.y).powi(power)),
                            };
                            let e = if moved { sampled.by_rays(&of) } else { sampled.received(&of) }.unwrap();
                            all.iter_mut().zip(e).for_each(|(sum, e)| *sum += e);
                        }
                        all
                    };
                    let mut skyed = sum(false);
                    let mut radiance = vec![DVec3::ZERO; 9];
                    for light in &sky {
                        let Light::Directional { from, .. } = light else { continue };
                        let mut y = [0.0; 9];
                        crate::math::sh::real_sh(3, crate::light::harmonics::to_harmonics(*from), &mut y);
                        radiance
                            .iter_mut()
                            .zip(y)
                            .for_each(|(r, y)| *r += DVec3::splat(y * (1.0 + from.y).powi(power)));
                    }
                    sampled.model.as_ref().unwrap().entry.move_sky(&sampled.surface(), &radiance, &mut skyed);
                    report(
                        &format!("sky (1 + y)^{power}: by harmonics to moved"),
                        &from_rays(&[skyed]),
                        &from_rays(&[sum(true)]),
                    );
                    report(
                        &format!("sky (1 + y)^{power}: moved to plain"),
                        &from_rays(&[sum(true)]),
                        &from_rays(&[sum(false)]),
                    );
                }
                let t = Instant::now();
                let rows = irradiance(&sampled, (Resolution::Sub64, order), &Silent).unwrap();
                eprintln!("rows {:.1} s", t.elapsed().as_secs_f64());
                let r = transfer.radiosity(&rows, &Silent);
                let functions = order * order;
                for o in [8, 12, 16, 20, 24, 28, 32] {
                    if o > order {
                        break;
                    }
                    let harm: Vec<Vec<DVec3>> = lights
                        .iter()
                        .map(|l| {
                            crate::forms::projected::references::under(
                                &r.values,
                                functions,
                                &coefficients(l, o).unwrap(),
                            )
                        })
                        .collect();
                    report(&format!("harmonics {o} to truth"), &harm, &truth);
                }
                for (name, light) in [
                    ("constant", Light::Constant { radiance: DVec3::ONE }),
                    ("edge 0.17", Light::Directional { from: sampled.scene.grazing(0.17), irradiance: DVec3::ONE }),
                    ("edge 0.58", Light::Directional { from: sampled.scene.grazing(0.58), irradiance: DVec3::ONE }),
                    ("edge 0.0", Light::Directional { from: sampled.scene.grazing(0.0), irradiance: DVec3::ONE }),
                ] {
                    let truth = from_rays(&[sampled.by_rays(&light).unwrap()]);
                    let plain = from_rays(&[sampled.received(&light).unwrap()]);
                    let harm = crate::forms::projected::references::under(
                        &r.values,
                        functions,
                        &coefficients(&light, order).unwrap(),
                    );
                    report(&format!("{name}: plain to truth"), &plain, &truth);
                    report(&format!("{name}: harmonics to truth"), &[harm], &truth);
                }
                Ok(())
            })
            .unwrap();
    }
}
