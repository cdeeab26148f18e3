use std::f64::consts::PI;
use std::sync::Arc;

use glam::DVec3;

use super::directions::DirectionSet;
use super::distances::{Blend, DistanceSet, QuantisedLights};
use super::interpolation::{Interpolator, Scheme};
use super::test_functions::Lit;
use super::vector::light_vector;
use crate::error::ExitCode;
use crate::light::Light;
use crate::light::environment::{EnvironmentMap, Rotation};
use crate::light::sky::sky;
use crate::math::random::uniform;
use crate::math::sphere::random_direction;

const CENTRE: DVec3 = DVec3::new(1.0, -2.0, 3.0);
const RADIUS: f64 = 10.0;

fn set(count: usize, scheme: Scheme) -> (QuantisedLights, Interpolator) {
    let directions = DirectionSet::fibonacci(count).unwrap();
    let interpolator = Interpolator::new(&directions, scheme).unwrap();
    let shells = DistanceSet::spread(CENTRE, RADIUS, 5, 2.0 / 3.0, Blend::Polynomial).unwrap();
    (QuantisedLights { directions, shells }, interpolator)
}

fn close(a: &[DVec3], b: &[DVec3], tolerance: f64) -> bool {
    let scale = b.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (*a - *b).abs().max_element() <= tolerance * scale)
}

#[test]
fn a_directional_light_is_its_weights_times_its_irradiance() {
    for scheme in Scheme::ALL {
        let (lights, interpolator) = set(50, scheme);
        let mut weights = Vec::new();
        for i in 0..10 {
            let (from, irradiance) = (random_direction(1, i), DVec3::new(1.0, 2.0, 0.0));
            let light = Light::directional(from, irradiance).unwrap();
            let vector = light_vector(&lights, &interpolator, &light).unwrap();
            interpolator.weights(from, &mut weights);
            let mut expected: Vec<DVec3> = weights.iter().map(|w| *w * irradiance).collect();
            expected.resize(250, DVec3::ZERO);
            assert!(close(&vector, &expected, 1e-11), "{scheme:?}");
        }
        for index in [0, 17, 49, 50, 120, 249] {
            let vector = light_vector(&lights, &interpolator, &lights.entry(index).unwrap()).unwrap();
            let expected: Vec<DVec3> = (0..250).map(|i| DVec3::splat(f64::from(u8::from(i == index)))).collect();
            assert!(scheme == Scheme::LeastSquares || close(&vector, &expected, 1e-9), "{scheme:?} {index}");
        }
    }
}

#[test]
fn distant_light_keeps_all_of_its_energy() {
    let mut sun = vec![[0.0; 3]; 64 * 32];
    sun[9 * 64 + 41] = [9e5, 8e5, 0.0];
    let bright = EnvironmentMap::new(4, 2, vec![[f32::MAX; 3]; 8]).unwrap();
    let dim = EnvironmentMap::new(4, 2, vec![[f32::from_bits(1); 3]; 8]).unwrap();
    let one = EnvironmentMap::new(1, 1, vec![[1.0, 2.0, 3.0]]).unwrap();
    for map in [sky(), one, EnvironmentMap::new(64, 32, sun).unwrap(), bright, dim].map(Arc::new) {
        for scheme in Scheme::ALL {
            let (lights, interpolator) = set(60, scheme);
            let scale = DVec3::new(2.0, 1.0, 0.5);
            let light = Light::environment(map.clone(), 33.0, scale).unwrap();
            let vector = light_vector(&lights, &interpolator, &light).unwrap();
            assert!(vector.len() == 300 && vector[60..].iter().all(|v| *v == DVec3::ZERO));
            let (sum, expected) = (vector.iter().sum::<DVec3>(), map.energy() * scale);
            assert!((sum - expected).abs().max_element() <= 1e-10 * expected.max_element(), "{scheme:?} {sum}");
        }
    }
    let (lights, interpolator) = set(60, Scheme::Rbf);
    let radiance = DVec3::new(1.0, 2.0, 3.0);
    let vector = light_vector(&lights, &interpolator, &Light::constant(radiance).unwrap()).unwrap();
    assert!((vector.iter().sum::<DVec3>() - 4.0 * PI * radiance).abs().max_element() < 1e-9);
    let map = Arc::new(EnvironmentMap::new(16, 8, vec![[1.0, 2.0, 3.0]; 128]).unwrap());
    let same = light_vector(&lights, &interpolator, &Light::environment(map, 10.0, DVec3::ONE).unwrap()).unwrap();
    assert!(close(&same, &vector, 1e-3));
    let black = Light::constant(DVec3::ZERO).unwrap();
    assert!(light_vector(&lights, &interpolator, &black).unwrap().iter().all(|v| *v == DVec3::ZERO));
}

#[test]
fn a_sun_of_one_pixel_stands_where_it_is() {
    let (lights, interpolator) = set(200, Scheme::Rbf);
    let (width, height) = (1024, 512);
    for i in 0..5 {
        let (x, y) = ((uniform(1, i, 0) * 1024.0) as usize, (uniform(1, i, 1) * 512.0) as usize);
        let mut pixels = vec![[0.0; 3]; width * height];
        pixels[y * width + x] = [3.0, 2.0, 1.0];
        let map = Arc::new(EnvironmentMap::new(width, height, pixels).unwrap());
        let direction = Rotation::from_degrees(70.0).to_world(map.pixel_direction(x, y));
        let sun = Light::directional(direction, map.energy()).unwrap();
        let light = Light::environment(map, 70.0, DVec3::ONE).unwrap();
        let [found, expected] = [light, sun].map(|light| light_vector(&lights, &interpolator, &light).unwrap());
        assert!(close(&found, &expected, 1e-9));
    }
}

#[test]
fn an_environment_gives_the_integral_over_its_pixels() {
    let (lights, interpolator) = set(200, Scheme::Rbf);
    let map = Arc::new(sky());
    let light = Light::environment(map.clone(), 120.0, DVec3::ONE).unwrap();
    let vector = light_vector(&lights, &interpolator, &light).unwrap();
    let rotation = Rotation::from_degrees(120.0);
    let (mut worst, mut most) = (0.0_f64, 0.0_f64);
    for i in 0..20 {
        let lit = Lit::new(i, 8.0, 30.0);
        let mut expected = DVec3::ZERO;
        for y in 0..map.height() {
            for x in 0..map.width() {
                let value = lit.at(rotation.to_world(map.pixel_direction(x, y)));
                expected += map.pixel(x, y) * map.pixel_solid_angle_sr(y) * value;
            }
        }
        let found: DVec3 = vector.iter().zip(lights.directions.directions()).map(|(w, d)| *w * lit.at(*d)).sum();
        worst = worst.max((found - expected).abs().max_element());
        most = most.max(expected.max_element());
    }
    assert!(worst < 2e-3 * most, "{worst} {most}");
}

#[test]
fn far_points_are_parallel_light_and_small_areas_are_points() {
    let (lights, interpolator) = set(100, Scheme::Rbf);
    let vector = |light: &Light| light_vector(&lights, &interpolator, light).unwrap();
    for i in 0..10 {
        let (from, amount) = (random_direction(5, i), DVec3::new(1.0, 0.5, 2.0));
        let sun = vector(&Light::directional(from, amount).unwrap());
        for distance in [1e9, 1e120] {
            let point = Light::point(CENTRE + distance * from, amount * distance * distance).unwrap();
            assert!(close(&vector(&point), &sun, 1e-6), "{distance}");
        }
        let at = CENTRE + 25.0 * from;
        let normal = (random_direction(6, i) - 1.5 * from).normalize();
        let area = vector(&Light::area(at, normal, [0.02, 0.01], amount, None).unwrap());
        let point = vector(&Light::point(at, amount * 2e-4 * normal.dot(-from)).unwrap());
        assert!(close(&area, &point, 1e-5));
        let behind = vector(&Light::area(at, from, [5.0, 5.0], amount, None).unwrap());
        assert!(behind.iter().all(|v| *v == DVec3::ZERO));
    }
}

#[test]
fn an_area_light_is_its_parts() {
    let (lights, interpolator) = set(100, Scheme::Rbf);
    let vector = |light: &Light| light_vector(&lights, &interpolator, light).unwrap();
    let part = |x: f64, y: f64, size: f64| {
        let at = CENTRE + DVec3::new(x, y, 30.0);
        vector(&Light::area(at, DVec3::NEG_Z, [size, size], DVec3::ONE, Some(DVec3::X)).unwrap())
    };
    let mut parts = vec![DVec3::ZERO; lights.count()];
    for i in 0..100 {
        let at = |k: i32| f64::from(k) * 2.0 - 9.0;
        parts.iter_mut().zip(part(at(i % 10), at(i / 10), 2.0)).for_each(|(sum, value)| *sum += value);
    }
    assert!(close(&part(0.0, 0.0, 20.0), &parts, 1e-5));
}

#[test]
fn vectors_are_linear_in_the_light() {
    let (lights, interpolator) = set(50, Scheme::Barycentric);
    let map = Arc::new(sky());
    let of = |amount: DVec3| {
        let at = CENTRE + DVec3::new(0.0, 30.0, 1.0);
        [
            Light::constant(amount),
            Light::directional(DVec3::ONE, amount),
            Light::point(at, amount),
            Light::area(at, DVec3::NEG_Y, [3.0, 4.0], amount, None),
            Light::environment(map.clone(), 5.0, amount),
        ]
        .map(|light| light_vector(&lights, &interpolator, &light.unwrap()).unwrap())
    };
    let (a, b) = (DVec3::new(1.0, 0.0, 2.0), DVec3::new(0.5, 3.0, 0.0));
    for ((a, b), both) in of(a).iter().zip(of(b)).zip(of(2.0 * a + b)) {
        let sum: Vec<DVec3> = a.iter().zip(b).map(|(a, b)| 2.0 * *a + b).collect();
        assert!(close(&both, &sum, 1e-12));
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let map = Arc::new(sky());
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            Scheme::ALL.map(|scheme| {
                let (lights, interpolator) = set(150, scheme);
                let light = Light::environment(map.clone(), 77.0, DVec3::ONE).unwrap();
                (light_vector(&lights, &interpolator, &light).unwrap(), interpolator)
            })
        })
    };
    assert!(on(1) == on(3));
}

/// A point light with its direction and its distance interpolated, against the truth at points of the surface.
#[test]
fn point_lights_are_as_good_as_directional_ones() {
    let (lights, interpolator) = set(200, Scheme::Rbf);
    let (mut sum, mut count) = (0.0, 0.0);
    for i in 0..40 {
        let lit = Lit::new(i, 8.0, 30.0);
        let place = random_direction(31, i) * (0.3 + 0.7 * uniform(32, i, 0));
        for k in 0..10 {
            let (direction, u) = (random_direction(33, 10 * i + k), 2.0 / 3.0 * uniform(34, 10 * i + k, 0));
            let distance = RADIUS / u;
            let light = Light::point(CENTRE + distance * direction, DVec3::splat(distance * distance)).unwrap();
            let vector = light_vector(&lights, &interpolator, &light).unwrap();
            let value = |index: usize| {
                let (shell, at) = (lights.shells.inverse()[index / 200], lights.directions.directions()[index % 200]);
                lit.at_point(place, at, shell)
            };
            let found: f64 = vector.iter().enumerate().map(|(index, w)| w.x * value(index)).sum();
            sum += (found - lit.at_point(place, direction, u)).powi(2);
            count += 1.0;
        }
    }
    let rms = f64::sqrt(sum / count);
    assert!(rms < 0.004, "{rms}");
}

#[test]
fn what_the_set_does_not_carry_is_an_error() {
    let (lights, interpolator) = set(50, Scheme::Barycentric);
    let near = Light::point(CENTRE + DVec3::X * 14.0, DVec3::ONE).unwrap();
    let error = light_vector(&lights, &interpolator, &near).unwrap_err();
    assert!(error.code() == ExitCode::Unsupported && error.message().contains("15.000 mm"), "{error}");
    let area = Light::area(CENTRE + DVec3::X * 14.0, DVec3::NEG_X, [1.0, 1.0], DVec3::ONE, None).unwrap();
    let error = light_vector(&lights, &interpolator, &area).unwrap_err();
    assert!(error.message().contains("area light") && error.message().contains("15.000 mm"), "{error}");
    for centre in [CENTRE, DVec3::MAX] {
        let error = light_vector(&lights, &interpolator, &Light::point(centre, DVec3::ONE).unwrap());
        assert!(error.is_err() || error.unwrap().iter().all(|v| v.is_finite()));
    }
    let (other, _) = set(51, Scheme::Barycentric);
    assert_eq!(light_vector(&other, &interpolator, &near).unwrap_err().code(), ExitCode::InvalidInput);
    for scheme in Scheme::ALL {
        let (lights, interpolator) = set(50, scheme);
        let endless = Light::constant(DVec3::splat(f64::MAX)).unwrap();
        match light_vector(&lights, &interpolator, &endless) {
            Ok(vector) => assert!(scheme != Scheme::Rbf && vector.iter().all(|v| v.is_finite())),
            Err(error) => assert_eq!(error.code(), ExitCode::Runtime),
        }
    }
}

#[test]
fn a_cone_that_holds_the_scene_is_a_point_and_one_that_ends_on_it_is_refused() {
    let (lights, interpolator) = set(100, Scheme::Rbf);
    let at = CENTRE + 40.0 * random_direction(8, 3);
    let vector = |light: Light| light_vector(&lights, &interpolator, &light);
    let spot = |to: DVec3, angle: f64| vector(Light::spot(at, to, angle, 0.2, DVec3::ONE).unwrap());
    let point = vector(Light::point(at, DVec3::ONE).unwrap()).unwrap();
    // asin(10 / 40) is 14.5 degrees, and the full light of 0.8 of the half angle holds it.
    assert_eq!(spot(CENTRE, 37.0).unwrap(), point);
    for angle in [35.0, 10.0, 0.1] {
        let refused = spot(CENTRE, angle).unwrap_err();
        assert_eq!(refused.code(), ExitCode::Unsupported, "{angle}");
        assert!(refused.message().contains("widen the cone"), "{refused}");
    }
    assert!(spot(2.0 * at - CENTRE, 60.0).unwrap().iter().all(|weight| *weight == DVec3::ZERO));
}
