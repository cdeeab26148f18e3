use std::sync::Arc;

use super::*;
use crate::geometry::samples::area;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::light::environment::{EnvironmentMap, Rotation};
use crate::progress::Silent;
use crate::transport::test_scene::{Fixture, named, on_threads};

const ETA: f64 = 1.5;

fn illuminate(fixture: &Fixture, light: Light) -> Vec<DVec3> {
    illuminate_with(fixture, light, LightSampling::REFERENCE)
}

fn illuminate_with(fixture: &Fixture, light: Light, sampling: LightSampling) -> Vec<DVec3> {
    let (surface, lights) = (fixture.surface(), [light]);
    Illumination::new(&surface, &lights, &[ETA], sampling).unwrap().all(&Silent)
}

/// A square of 40 mm in y = 0 facing up.
fn floor(samples: usize) -> Fixture {
    Fixture::new(shapes::plane(40.0, 40.0, 8), named("marble"), samples)
}

fn rectangle(x: [f64; 2], z: [f64; 2], y: f64) -> SourceModel {
    let positions = [(x[0], z[0]), (x[0], z[1]), (x[1], z[1]), (x[1], z[0])].map(|(x, z)| DVec3::new(x, y, z)).to_vec();
    SourceModel::new(positions, vec![[0, 1, 2], [0, 2, 3]])
}

fn arriving(cosine: f64) -> f64 {
    if cosine > 0.0 { cosine * fresnel::transmittance(ETA, cosine) } else { 0.0 }
}

/// The mean over a patch of a function of the place, by its facets cut into 256 pieces.
fn mean_over(fixture: &Fixture, patch: usize, f: impl Fn(DVec3) -> f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for facet in fixture.samples.patch(patch) {
        let corners = facet.corners_local_mm(&fixture.scene.mesh);
        let weight = area(corners);
        pieces(corners, 256, &mut |c| {
            sum += weight * f(c.iter().sum::<DVec3>() / 3.0 + fixture.scene.mesh.origin_mm);
            count += weight;
        });
    }
    sum / count
}

fn relative_rms(values: &[f64], exact: &[f64]) -> f64 {
    let errors: f64 = values.iter().zip(exact).map(|(a, b)| (a - b) * (a - b)).sum();
    (errors / exact.iter().map(|b| b * b).sum::<f64>()).sqrt()
}

#[test]
fn even_light_on_a_convex_body_is_the_closed_form() {
    let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), 3000);
    let radiance = DVec3::new(1.0, 2.0, 0.5);
    let expected = radiance * PI * fresnel::diffuse_transmittance(ETA);
    let worst = illuminate(&fixture, Light::Constant { radiance })
        .iter()
        .map(|e| (*e / expected - 1.0).abs().max_element())
        .fold(0.0, f64::max);
    println!("constant light on a sphere: {worst:.1e}");
    assert!(worst < 1e-6, "{worst}");
}

#[test]
fn parallel_light_on_a_plane_is_the_closed_form_and_the_back_stays_dark() {
    let fixture = floor(500);
    for direction in [DVec3::Y, DVec3::new(0.3, 0.8, -0.5), DVec3::new(1.0, 0.02, 0.0)] {
        let from = direction.normalize();
        let irradiance = DVec3::new(3.0, 1.0, 0.0);
        for e in illuminate(&fixture, Light::Directional { from, irradiance }) {
            assert!((e - irradiance * arriving(from.y)).abs().max_element() < 1e-12, "{e}");
        }
        let below = Light::Directional { from: -from, irradiance };
        assert!(illuminate(&fixture, below).iter().all(|e| *e == DVec3::ZERO));
    }
    let at_mm = DVec3::new(0.0, -3.0, 0.0);
    let below = Light::Point { at_mm, intensity: DVec3::ONE };
    assert!(illuminate(&fixture, below).iter().all(|e| *e == DVec3::ZERO), "open surfaces receive in front only");
    let below = Light::area(at_mm, DVec3::Y, [5.0, 5.0], DVec3::ONE, None).unwrap();
    assert!(illuminate(&fixture, below).iter().all(|e| *e == DVec3::ZERO));
}

#[test]
fn a_point_light_over_a_plane_is_the_closed_form() {
    let fixture = floor(20_000);
    let at_mm = DVec3::new(3.0, 4.0, -2.0);
    let values = illuminate(&fixture, Light::Point { at_mm, intensity: DVec3::splat(100.0) });
    let exact: Vec<f64> = (0..fixture.patches.len())
        .map(|patch| {
            mean_over(&fixture, patch, |p| {
                let d = at_mm - p;
                100.0 * arriving(d.y / d.length()) / d.length_squared()
            })
        })
        .collect();
    let error = relative_rms(&values.iter().map(|e| e.x).collect::<Vec<_>>(), &exact);
    println!("point light: {error:.1e}");
    assert!(error < 1e-4, "{error}");
}

/// Half of a light just above a plane falls on it, whatever the samples' spacing: I 2 pi Int_0^1 F_t(mu) dmu, here over
/// samples that lie 1.8 mm apart.
#[test]
fn no_light_is_lost_where_a_point_light_is_nearer_than_the_spacing() {
    let fixture = floor(500);
    let steps = 20_000;
    let middle = |k: i32| (f64::from(k) + 0.5) / f64::from(steps);
    let transmitted = (0..steps).map(|k| fresnel::transmittance(ETA, middle(k))).sum::<f64>() / f64::from(steps);
    for sampling in [LightSampling::REFERENCE, LightSampling::FAST] {
        for height in [1e-3, 0.01, 0.1, 0.4] {
            let at_mm = DVec3::new(0.31, height, -0.17);
            let values = illuminate_with(&fixture, Light::Point { at_mm, intensity: DVec3::ONE }, sampling);
            let flux: f64 = values.iter().zip(&fixture.patches).map(|(e, patch)| e.x * patch.area_mm2).sum();
            // What passes by the edges of the floor, 20 mm away, grazes it: half a percent of it at most.
            let ratio = flux / (TAU * transmitted);
            println!("{height} mm above, {} points: {ratio}", sampling.points_per_patch);
            assert!((0.98..1.01).contains(&ratio), "{height} mm: {ratio}");
        }
    }
}

#[test]
fn an_area_light_over_a_plane_is_its_integral() {
    let fixture = floor(4000);
    let (at_mm, size_mm) = (DVec3::new(3.0, 6.0, -2.0), [8.0, 3.0]);
    let normal = DVec3::new(0.2, -1.0, 0.3).normalize();
    let light = Light::area(at_mm, normal, size_mm, DVec3::new(5.0, 1.0, 0.0), Some(DVec3::X)).unwrap();
    let Light::Area { u, .. } = &light else { unreachable!() };
    let (u, v) = (*u, normal.cross(*u));
    let exact_at = |p: DVec3| {
        let n = 40;
        let cells = (0..n * n).map(|i| {
            let (s, t) = ((f64::from(i % n) + 0.5) / f64::from(n) - 0.5, (f64::from(i / n) + 0.5) / f64::from(n) - 0.5);
            let d = at_mm + u * (s * size_mm[0]) + v * (t * size_mm[1]) - p;
            let (mu, emitted) = (d.y / d.length(), -d.dot(normal) / d.length());
            arriving(mu) * emitted.max(0.0) / d.length_squared()
        });
        5.0 * cells.sum::<f64>() * size_mm[0] * size_mm[1] / f64::from(n * n)
    };
    let origin = fixture.scene.mesh.origin_mm;
    let exact: Vec<f64> = fixture.patches.iter().map(|p| exact_at(p.centre_mm + origin)).collect();
    for (sampling, limit) in [(LightSampling::REFERENCE, 5e-3), (LightSampling::FAST, 1e-2)] {
        let values: Vec<f64> = illuminate_with(&fixture, light.clone(), sampling).iter().map(|e| e.x).collect();
        let error = relative_rms(&values, &exact);
        let bias = values.iter().sum::<f64>() / exact.iter().sum::<f64>() - 1.0;
        println!("area light: {error:.1e}, bias {bias:.1e}");
        assert!(error < limit && bias.abs() < 5e-4, "{error} {bias}");
    }
    let turned = Light::area(at_mm, DVec3::Y, size_mm, DVec3::ONE, None).unwrap();
    assert!(illuminate(&fixture, turned).iter().all(|e| *e == DVec3::ZERO), "the back of the light is dark");
}

fn environment(pixels: impl Fn(usize, usize) -> [f32; 3], rotate_degrees: f64) -> Light {
    let (width, height) = (128, 64);
    let pixels = (0..width * height).map(|i| pixels(i % width, i / width)).collect();
    let map = Arc::new(EnvironmentMap::new(width, height, pixels).unwrap());
    Light::environment(map, rotate_degrees, DVec3::splat(2.0)).unwrap()
}

#[test]
fn an_even_environment_is_even_light() {
    let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), 3000);
    let expected = 2.0 * PI * fresnel::diffuse_transmittance(ETA);
    for (sampling, worst_limit) in [(LightSampling::REFERENCE, 0.03), (LightSampling::FAST, 0.08)] {
        let values = illuminate_with(&fixture, environment(|_, _| [1.0; 3], 20.0), sampling);
        let mean = fixture.flux(&values).x / fixture.scene.mesh.total_area_mm2() / expected - 1.0;
        let worst = values.iter().map(|e| (e.x / expected - 1.0).abs()).fold(0.0, f64::max);
        println!("even environment: mean {mean:.1e}, worst patch {worst:.1e}");
        assert!(mean.abs() < 1e-3 && worst < worst_limit, "{mean} {worst}");
    }
}

#[test]
fn one_bright_pixel_is_a_directional_light_from_where_it_should_be() {
    let fixture = Fixture::new(shapes::icosphere(10.0, 3), named("marble"), 3000);
    // Pixel beside an axis, turn, axis after the turn.
    for (x, y, degrees, axis) in [
        (64, 31, 0.0, DVec3::Z),
        (32, 31, 0.0, DVec3::X),
        (64, 31, 90.0, DVec3::X),
        (32, 32, 90.0, DVec3::NEG_Z),
        (96, 31, 180.0, DVec3::X),
        (7, 0, 33.0, DVec3::Y),
    ] {
        let light = environment(|i, j| if (i, j) == (x, y) { [9.0, 3.0, 1.0] } else { [0.0; 3] }, degrees);
        let Light::Environment { map, .. } = &light else { unreachable!() };
        let from = Rotation::from_degrees(degrees).to_world(map.pixel_direction(x, y));
        assert!(from.dot(axis) > 0.998, "{from} should be near {axis}");
        let irradiance = 2.0 * map.pixel(x, y) * map.pixel_solid_angle_sr(y);
        let sun: Vec<f64> = illuminate(&fixture, Light::Directional { from, irradiance }).iter().map(|e| e.x).collect();
        let pixel: Vec<f64> = illuminate(&fixture, light).iter().map(|e| e.x).collect();
        let error = relative_rms(&pixel, &sun);
        let bias = pixel.iter().sum::<f64>() / sun.iter().sum::<f64>() - 1.0;
        println!("pixel ({x}, {y}): {error:.1e}, bias {bias:.1e}");
        // A pixel of 2.8 degrees: single patches see one place of it.
        assert!(bias.abs() < 5e-3 && error < 0.03, "({x}, {y}): {error} {bias}");
    }
}

#[test]
fn lights_in_on_and_beside_the_surface_stay_finite() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 2), named("marble"), 700);
    let mesh = &fixture.scene.mesh;
    let centre = fixture.patches[3].centre_mm + mesh.origin_mm;
    let normal = mesh.normal(fixture.samples.patch(3)[0].triangle);
    let vertex = mesh.position_mm(17);
    let mut points = Vec::new();
    let surface = fixture.surface();
    Illumination::new(&surface, &[], &[ETA], LightSampling::REFERENCE).unwrap().points_of(3, &mut points);
    let on_sample_point = points[0].at + mesh.origin_mm;
    for at_mm in
        [DVec3::ZERO, mesh.origin_mm, vertex, centre, centre + 1e-9 * normal, centre - 1e-9 * normal, on_sample_point]
    {
        for sampling in [LightSampling::REFERENCE, LightSampling::FAST] {
            let light = Light::Point { at_mm, intensity: DVec3::ONE };
            let e = illuminate_with(&fixture, light, sampling);
            assert!(e.iter().all(|v| v.is_finite() && v.min_element() >= 0.0), "point at {at_mm}");
            let light = Light::area(at_mm, normal, [3.0, 1e-3], DVec3::ONE, None).unwrap();
            let e = illuminate_with(&fixture, light, sampling);
            let most = PI * 1.0001;
            assert!(e.iter().all(|v| v.is_finite() && v.min_element() >= 0.0 && v.x < most), "area at {at_mm}");
        }
    }
    let inside = illuminate(&fixture, Light::Point { at_mm: mesh.origin_mm, intensity: DVec3::ONE });
    assert!(inside.iter().all(|e| *e == DVec3::ZERO), "a light inside the body meets backs only");
    let blinding = Light::Point { at_mm: on_sample_point, intensity: DVec3::new(1e300, 0.0, 1.0) };
    assert!(illuminate(&fixture, blinding).iter().all(|v| v.is_finite()));
    let far = Light::Point { at_mm: DVec3::splat(1e200), intensity: DVec3::splat(1e300) };
    assert!(illuminate(&fixture, far).iter().all(|v| v.is_finite()));
}

/// The floor below a lid with a hole from (-3.3, -2.7) to (4.1, 5.2), 5 mm above.
fn floor_below_a_hole(samples: usize) -> Fixture {
    let (hole_x, hole_z) = ([-3.3, 4.1], [-2.7, 5.2]);
    let lid = [
        rectangle([-3000.0, hole_x[0]], [-3000.0, 3000.0], 5.0),
        rectangle([hole_x[1], 3000.0], [-3000.0, 3000.0], 5.0),
        rectangle(hole_x, [-3000.0, hole_z[0]], 5.0),
        rectangle(hole_x, [hole_z[1], 3000.0], 5.0),
    ];
    let floor = shapes::plane(40.0, 40.0, 8);
    let first = floor.triangles.len();
    let mut models = vec![(floor, DVec3::ZERO)];
    models.extend(lid.map(|r| (r, DVec3::ZERO)));
    Fixture::with_opaque(shapes::compose(&models), first, named("marble"), samples)
}

#[test]
fn a_hole_in_a_lid_lets_its_area_of_light_through() {
    let fixture = floor_below_a_hole(20_000);
    let hole = 7.4 * 7.9;
    for direction in [DVec3::Y, DVec3::new(0.5, 1.0, -0.3)] {
        let from = direction.normalize();
        let e = illuminate(&fixture, Light::Directional { from, irradiance: DVec3::ONE });
        let share = fixture.flux(&e).x / (hole * arriving(from.y)) - 1.0;
        println!("hole under a directional light: {share:.1e}");
        // Rays start 0.07 mm apart, along lines that the edges of the hole may follow.
        assert!(share.abs() < 6e-3, "{share}");
    }
    // Magnified by the ratio of the heights, the image of the hole under a point light.
    let at_mm = DVec3::new(0.5, 15.0, 1.0);
    let e = illuminate(&fixture, Light::Point { at_mm, intensity: DVec3::ONE });
    let n = 400;
    let exact: f64 = (0..n * n)
        .map(|i| {
            let (s, t) = ((f64::from(i % n) + 0.5) / f64::from(n), (f64::from(i / n) + 0.5) / f64::from(n));
            let through = DVec3::new(-3.3 + 7.4 * s, 5.0, -2.7 + 7.9 * t) - at_mm;
            // Flux through the hole's element: cosine over the squared distance there.
            let mu = -through.y / through.length();
            fresnel::transmittance(ETA, mu) * mu / through.length_squared()
        })
        .sum::<f64>()
        * hole
        / f64::from(n * n);
    let share = fixture.flux(&e).x / exact - 1.0;
    println!("hole under a point light: {share:.1e}");
    assert!(share.abs() < 6e-3, "{share}");
}

#[test]
fn even_light_through_a_hole_is_its_solid_angle() {
    let fixture = floor_below_a_hole(8000);
    let hole_centre = DVec3::new(0.4, 5.0, 1.25);
    let light = Light::area(hole_centre, DVec3::NEG_Y, [7.9, 7.4], DVec3::ONE, Some(DVec3::Z)).unwrap();
    let open = floor(8000);
    let through = illuminate(&fixture, Light::constant(DVec3::ONE).unwrap());
    let window = illuminate(&open, light);
    let share = fixture.flux(&through).x / open.flux(&window).x - 1.0;
    println!("hole under even light against a window of its size: {share:.1e}");
    assert!(share.abs() < 5e-3, "{share}");
}

#[test]
fn results_depend_on_neither_threads_nor_ranges() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("marble"), 1000);
    let lights = [
        Light::constant(DVec3::ONE).unwrap(),
        environment(|x, y| [(x + y) as f32, 1.0, (y % 7) as f32], 0.0),
        Light::area(DVec3::new(0.0, 20.0, 0.0), DVec3::NEG_Y, [9.0, 9.0], DVec3::ONE, None).unwrap(),
    ];
    let surface = fixture.surface();
    let illumination = Illumination::new(&surface, &lights, &[ETA], LightSampling::FAST).unwrap();
    let on = |threads| on_threads(threads, || illumination.all(&Silent));
    let all = on(1);
    assert_eq!(on(4), all);
    let mut middle = vec![DVec3::ZERO; 123];
    illumination.range(333, &mut middle);
    assert_eq!(middle, all[333..456]);
}
