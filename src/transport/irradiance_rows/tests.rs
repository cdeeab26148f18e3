use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::*;
use crate::compress::rows::WholeRows;
use crate::geometry::shapes;
use crate::light::Light;
use crate::light::cube_light::CubeLight;
use crate::light::sky::sky;
use crate::medium::fresnel;
use crate::progress::Silent;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::test_scene::{Fixture, named, on_threads, relative_rms};

const ETA: f64 = 1.3;

fn settings(terms: usize, coefficients: usize) -> RowSettings {
    RowSettings { terms, coefficients, ..RowSettings::DEFAULT }
}

fn relight(fixture: &Fixture, settings: RowSettings, light: &Light, eta: f64) -> Vec<DVec3> {
    let surface = fixture.surface();
    let rows = RowBaker::new(&surface, settings).unwrap().all(&Silent).unwrap();
    let c = rows.entrance().project(eta).unwrap().coefficients;
    rows.irradiance(&CubeLight::new(light, settings.side()).unwrap(), |_| c).unwrap()
}

#[test]
fn constant_light_on_a_convex_body_is_the_closed_form() {
    let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), 2000);
    let radiance = DVec3::new(1.0, 2.0, 0.5);
    for eta in [1.0, 1.3, 1.7] {
        let expected = radiance * PI * fresnel::diffuse_transmittance(eta);
        let found = relight(&fixture, settings(2, FACES), &Light::Constant { radiance }, eta);
        let worst = found.iter().map(|e| (*e / expected - 1.0).abs().max_element()).fold(0.0, f64::max);
        println!("constant light, eta {eta}: {worst:.1e}");
        // What is left is the sub-texel sum at the horizon.
        assert!(worst < 2e-3, "{worst}");
    }
}

#[test]
fn all_coefficients_give_the_sum_over_texels() {
    let fixture = Fixture::knot(64);
    let (surface, light) = (fixture.surface(), Light::environment(Arc::new(sky()), 40.0, DVec3::ONE).unwrap());
    let all = settings(3, FACES * 32 * 32);
    let cube = CubeLight::new(&light, 32).unwrap();
    let (basis, angles) = (EntranceBasis::new(3), solid_angles_sr(32));
    let c = basis.project(ETA).unwrap().coefficients;
    let mut expected = Vec::new();
    let observers: Vec<Observer> =
        (0..64).map(|i| Observer::of(&fixture.scene.mesh, fixture.samples.patch(i))).collect();
    visit(&Occluders::new(&fixture.scene.mesh), &fixture.bvh, &observers, Resolution::Sub64, |i, visible| {
        let mut sum = DVec3::ZERO;
        for face in 0..FACES {
            for (y, x) in (0..64).flat_map(|y| (0..64).map(move |x| (y, x))) {
                if visible.bit(&visible.seen, face, x, y) {
                    let mu = observers[i].normal.dot(crate::math::cube_map::direction(64, face, x, y));
                    let texel = y / 2 * 32 + x / 2;
                    sum += cube.radiance()[face * 1024 + texel] * angles[texel] * 0.25 * basis.sum(&c, mu);
                }
            }
        }
        expected.push(sum);
    });
    let found = relight(&fixture, all, &light, ETA);
    let error = relative_rms(&found, &expected);
    println!("quantiser alone: {error:.1e}");
    assert!(error < 4e-3, "{error}");
    let whole = RowBaker::new(&surface, all).unwrap().range(0..64);
    assert!(whole.validate().is_ok());
}

#[test]
fn errors_fall_with_coefficients() {
    let fixture = Fixture::knot(3000);
    let (surface, light) = (fixture.surface(), Light::environment(Arc::new(sky()), 40.0, DVec3::ONE).unwrap());
    let lights = [light.clone()];
    let truth = Illumination::new(&surface, &lights, &[ETA], LightSampling { directions: 2048, ..LightSampling::FAST })
        .unwrap()
        .all(&Silent);
    let whole = relight(&fixture, settings(2, 6144), &light, ETA);
    let native = relative_rms(&whole, &truth);
    let cut = [32, 128, 512]
        .map(|coefficients| relative_rms(&relight(&fixture, settings(2, coefficients), &light, ETA), &whole));
    println!("sky: texels and one point for a patch {native:.3}; 32, 128, 512 coefficients {cut:.4?}");
    assert!(native < 0.12, "{native}");
    assert!(cut[0] < 0.1 && cut[1] < 0.6 * cut[0] && cut[2] < 0.6 * cut[1], "{cut:?}");
}

#[test]
fn ranges_threads_and_instructions_do_not_change_the_rows() {
    let fixture = Fixture::knot(2500);
    let surface = fixture.surface();
    let mut baker = RowBaker::new(&surface, settings(2, 64)).unwrap();
    let whole = baker.all(&Silent).unwrap().into_data();
    for level in InstructionSet::available() {
        baker.level = level;
        assert_eq!(baker.range(0..40).values, whole.values[..2 * whole.offsets[40] as usize], "{level:?}");
    }
    assert_eq!(on_threads(1, || baker.all(&Silent)).unwrap().data(), &whole);
    let part = baker.range(1000..1100);
    let (from, end) = (whole.offsets[1000] as usize, whole.offsets[1100] as usize);
    assert_eq!(part.indices, whole.indices[from..end]);
    assert_eq!(part.values, whole.values[2 * from..2 * end]);
    assert_eq!(part.scaling, whole.scaling[1000 * 12..1100 * 12]);
    assert!(whole.offsets.windows(2).all(|pair| pair[1] - pair[0] <= 58));
    let light = CubeLight::new(&Light::constant(DVec3::ONE).unwrap(), 32).unwrap();
    let (rows, c) = (Rows::new(whole, &[0, 2500]).unwrap(), EntranceBasis::new(2).project(ETA).unwrap().coefficients);
    let all = rows.irradiance(&light, |_| c).unwrap();
    assert_eq!(rows.irradiance_range(70..90, &light, |_| c).unwrap(), all[70..90]);
    assert!(rows.irradiance_range(9000..9001, &light, |_| c).unwrap().is_empty());
    let other = CubeLight::new(&Light::constant(DVec3::ONE).unwrap(), 64).unwrap();
    assert!(rows.irradiance(&other, |_| c).is_err());
}

#[test]
fn written_rows_are_those_that_are_multiplied() {
    let fixture = Fixture::knot(200);
    let surface = fixture.surface();
    let baker = RowBaker::new(&surface, settings(3, 64)).unwrap();
    for rows in [baker.all(&Silent).unwrap(), baker.in_blocks(&Silent).unwrap()] {
        let c = rows.entrance().project(ETA).unwrap().coefficients;
        let light = CubeLight::new(&Light::environment(Arc::new(sky()), 40.0, DVec3::ONE).unwrap(), 32).unwrap();
        let expected = rows.irradiance(&light, |_| c).unwrap();
        let (mut whole, mut row) = (WholeRows::default(), vec![0.0f32; FACES * 1024]);
        let mut patches = 0;
        for run in rows.runs() {
            rows.decode(*run, &c, &mut whole);
            assert_eq!(run[0], patches);
            patches = run[1];
            for patch in run[0]..run[1] {
                whole.write((patch - run[0]) as usize, &mut row);
                let product = |channel: usize| -> f64 {
                    let pairs = row.iter().zip(light.coefficients());
                    pairs.map(|(a, b)| f64::from(*a) * f64::from(b[channel])).sum::<f64>() * light.scale()
                };
                let (found, e) = (DVec3::from([0, 1, 2].map(product)), expected[patch as usize]);
                assert!((found - e).length() < 2e-5 * e.length().max(1e-2), "{patch}: {found} {e}");
            }
            whole.erase(&mut row);
            assert!(row.iter().all(|value| *value == 0.0));
        }
        assert_eq!(patches as usize, expected.len());
    }
}

/// A reader needs nothing but the sections.
#[test]
fn sections_hold_the_functions_of_the_angle() {
    let fixture = Fixture::knot(50);
    let surface = fixture.surface();
    let rows = RowBaker::new(&surface, settings(3, 32)).unwrap().all(&Silent).unwrap();
    assert!(*rows.entrance() == EntranceBasis::new(3));
    let mut sections = rows.data().to_sections().unwrap();
    assert!(Rows::from_sections(&sections, &[0, 50]).unwrap() == Some(rows));
    assert!(Rows::from_sections(&sections, &[0, 51]).is_err());
    assert!(Rows::from_sections(&[], &[0, 50]).unwrap().is_none());
    let functions = sections.iter_mut().find(|s| s.tag == translux_format::rows::tags::FUNCTIONS).unwrap();
    functions.bytes.fill(0);
    let refused = Rows::from_sections(&sections, &[0, 50]).unwrap_err();
    assert!(refused.message().contains("number 0 has the size 0e0"), "{}", refused.message());
}

/// Rows in blocks have about the error of rows of their own, in a fraction of the coefficients.
#[test]
fn blocks_keep_the_error_in_fewer_coefficients() {
    let fixture = Fixture::knot(6000);
    let surface = fixture.surface();
    let light = Light::environment(Arc::new(sky()), 40.0, DVec3::ONE).unwrap();
    let cube = CubeLight::new(&light, 32).unwrap();
    let whole = relight(&fixture, settings(2, 6144), &light, ETA);
    let c = EntranceBasis::new(2).project(ETA).unwrap().coefficients;
    for coefficients in [32, 128] {
        let baker = RowBaker::new(&surface, settings(2, coefficients)).unwrap();
        let (own, blocks) = (baker.all(&Silent).unwrap(), baker.in_blocks(&Silent).unwrap());
        assert!(own.blocks().is_empty() && blocks.blocks().len() == 128);
        let errors = [&own, &blocks].map(|rows| relative_rms(&rows.irradiance(&cube, |_| c).unwrap(), &whole));
        let counts = [&own, &blocks].map(|rows| rows.data().indices.len() as f64 / 6000.0);
        println!("{coefficients}: errors {errors:.4?}, details of a patch {counts:.1?}");
        assert!(errors[1] < 1.5 * errors[0], "{errors:?}");
        // These samples are far apart against the bends of the knot; on a scan a sixth is left.
        assert!(counts[1] < 0.9 * counts[0], "{counts:?}");
        assert!(blocks.data().bytes() < own.data().bytes());
    }
}

#[test]
fn blocks_are_the_same_from_threads_instructions_ranges_and_files() {
    let fixture = Fixture::knot(1500);
    let surface = fixture.surface();
    let mut baker = RowBaker::new(&surface, settings(2, 64)).unwrap();
    let rows = baker.in_blocks(&Silent).unwrap();
    for level in InstructionSet::available() {
        baker.level = level;
        assert!(baker.in_blocks(&Silent).unwrap() == rows, "{level:?}");
    }
    assert!(on_threads(1, || baker.in_blocks(&Silent)).unwrap() == rows);
    let sections = rows.data().to_sections().unwrap();
    assert!(Rows::from_sections(&sections, &[0, 1500]).unwrap().as_ref() == Some(&rows));
    // Parts that the blocks do not fit.
    assert!(Rows::from_sections(&sections, &[1, 1500]).is_err());
    let light = CubeLight::new(&Light::constant(DVec3::ONE).unwrap(), 32).unwrap();
    let c = EntranceBasis::new(2).project(ETA).unwrap().coefficients;
    let all = rows.irradiance(&light, |_| c).unwrap();
    for range in [0..1500, 70..90, 0..1, 1499..1500, 64..128] {
        assert_eq!(rows.irradiance_range(range.clone(), &light, |_| c).unwrap(), all[range]);
    }
    assert!(rows.irradiance_range(1500..1501, &light, |_| c).unwrap().is_empty());
}

/// Constant light needs the scaling coefficients alone, in blocks as well.
#[test]
fn constant_light_through_blocks_is_the_closed_form() {
    let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), 2000);
    let surface = fixture.surface();
    let rows = RowBaker::new(&surface, settings(2, 128)).unwrap().in_blocks(&Silent).unwrap();
    let c = rows.entrance().project(ETA).unwrap().coefficients;
    let light = CubeLight::new(&Light::constant(DVec3::ONE).unwrap(), 32).unwrap();
    let expected = PI * fresnel::diffuse_transmittance(ETA);
    let found = rows.irradiance(&light, |_| c).unwrap();
    let worst = found.iter().map(|e| (e.x / expected - 1.0).abs()).fold(0.0, f64::max);
    let mean = found.iter().map(|e| e.x).sum::<f64>() / 2000.0;
    println!("constant light through blocks: worst {worst:.1e}, mean {:.1e}", mean / expected - 1.0);
    assert!(worst < 1e-2 && (mean / expected - 1.0).abs() < 1e-3);
}

#[test]
fn impossible_settings_are_refused() {
    let fixture = Fixture::knot(10);
    let surface = fixture.surface();
    for (terms, coefficients) in [(0, 128), (5, 128), (2, 5), (2, 6145)] {
        assert!(RowBaker::new(&surface, settings(terms, coefficients)).is_err());
    }
}
