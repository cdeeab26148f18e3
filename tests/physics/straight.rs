//! Light straight through a body, against closed forms.
#![allow(clippy::unwrap_used, missing_docs)]

use glam::DVec3;

use crate::rendering::{Fake, camera, settings, size};
use translux::geometry::part_table::PartTable;
use translux::geometry::shapes::{compose, cuboid, icosphere};
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::medium::fresnel::{refracted_cosine, transmittance};
use translux::progress::Silent;
use translux::render::frame::{Pixel, RenderSettings, render};

const SIGMA_T: DVec3 = DVec3::new(0.05, 0.2, 0.7);

/// A body of a medium with that extinction, half of it absorption.
fn body(source: SourceModel, eta: f64) -> Fake {
    let mut fake = Fake::new(source);
    let properties = &mut fake.scene.media[0].properties;
    (properties.sigma_s_reduced_per_mm, properties.sigma_a_per_mm) = (0.5 * SIGMA_T, 0.5 * SIGMA_T);
    properties.eta_inside_over_outside = eta;
    fake
}

/// What one eye ray through the middle of the picture sees.
fn seen(fake: &Fake, lights: &[Light], from: DVec3) -> Pixel {
    let view =
        RenderSettings { straight: true, samples_per_pixel: 1024, ..settings(camera(from.into(), 0.01), size(1, 1)) };
    let frame = render(fake, &fake.uniform(), lights, &view, &Silent).unwrap();
    assert!(frame.has_straight);
    frame.pixels[0]
}

fn white() -> Light {
    Light::Constant { radiance: DVec3::ONE }
}

/// Parts of the light from behind and from the front of a slab, between whose sides it goes to and fro.
fn slab(eta: f64, thickness_mm: f64, cosine: f64) -> [DVec3; 2] {
    let way = thickness_mm / refracted_cosine(eta, cosine).unwrap();
    let (a, enters) = ((-SIGMA_T * way).exp(), transmittance(eta, cosine));
    let reflected = 1.0 - enters;
    let through = a * enters * enters / (1.0 - reflected * reflected * a * a);
    [through, through * reflected * a]
}

fn assert_near(pixel: &Pixel, expected: DVec3, what: &str) {
    let found = DVec3::from(pixel.straight.map(f64::from));
    assert!((found - expected).abs().cmple(expected * 1e-3 + 1e-4).all(), "{what}: {found} {expected}");
}

#[test]
fn a_slab_shows_the_sky_behind_it_and_that_before_it() {
    for eta in [1.0, 1.3, 1.5] {
        let fake = body(cuboid(DVec3::new(4000.0, 4000.0, 2.0), 1), eta);
        for from in [DVec3::new(0.0, 0.0, 500.0), DVec3::new(300.0, 100.0, 400.0)] {
            let [behind, before] = slab(eta, 2.0, from.normalize().z);
            let what = format!("eta {eta} from {from}");
            assert_near(&seen(&fake, &[white()], from), behind + before, &what);
            // A wide lamp behind it, and one before it.
            for (z, expected) in [(-50.0, behind), (450.0, before)] {
                let at = DVec3::new(0.0, 0.0, z);
                let lamp = Light::area(at, -at.normalize(), [4000.0; 2], DVec3::ONE, None).unwrap();
                assert_near(&seen(&fake, &[lamp], from), expected, &what);
                let away = Light::area(at, at.normalize(), [4000.0; 2], DVec3::ONE, None).unwrap();
                assert_near(&seen(&fake, &[away], from), DVec3::ZERO, &what);
            }
        }
    }
}

#[test]
fn without_refraction_a_ball_takes_its_chord() {
    let fake = body(icosphere(3.0, 6), 1.0);
    let view = RenderSettings {
        straight: true,
        samples_per_pixel: 16,
        ..settings(camera([0.0, 0.0, 4000.0], 0.1), size(48, 48))
    };
    let frame = render(&fake, &fake.uniform(), &[white()], &view, &Silent).unwrap();
    let half = 4000.0 * 0.05f64.to_radians().tan();
    let mut inside = 0;
    for (i, pixel) in frame.pixels.iter().enumerate() {
        let [x, y] = [i % 48, i / 48].map(|k| (k as f64 + 0.5) / 24.0 - 1.0);
        let beside = half * x.hypot(y);
        if beside > 2.4 {
            continue;
        }
        let expected = (-SIGMA_T * 2.0 * (9.0 - beside * beside).sqrt()).exp();
        let found = DVec3::from(pixel.straight.map(f64::from));
        assert!((found - expected).abs().max_element() < 0.02, "{beside}: {found} {expected}");
        inside += 1;
    }
    assert!(inside > 500, "{inside}");
}

#[test]
fn bodies_behind_bodies_and_cores_are_dark_and_nothing_is_added_unasked() {
    let from = DVec3::new(0.0, 0.0, 500.0);
    let pane = || cuboid(DVec3::new(4000.0, 4000.0, 2.0), 1);
    let wall = |z: f64| compose(&[(pane(), DVec3::ZERO), (pane(), DVec3::new(0.0, 0.0, z))]);
    let lamp = Light::area(DVec3::new(0.0, 0.0, -50.0), DVec3::Z, [4000.0; 2], DVec3::ONE, None).unwrap();
    let [behind, _] = slab(1.3, 2.0, 1.0);
    // One part of two panes, with the lamp between them and behind both.
    assert_near(&seen(&body(wall(-100.0), 1.3), std::slice::from_ref(&lamp), from), behind, "lamp between");
    assert_near(&seen(&body(wall(-20.0), 1.3), std::slice::from_ref(&lamp), from), DVec3::ZERO, "lamp behind");
    // An opaque core in the pane.
    let mut cored =
        body(compose(&[(pane(), DVec3::ZERO), (cuboid(DVec3::new(3000.0, 3000.0, 0.5), 1), DVec3::ZERO)]), 1.3);
    let part: Vec<u32> = (0..cored.scene.mesh.triangles.len() as u32).map(|t| u32::from(t >= 12)).collect();
    cored.scene.parts = PartTable::new(&cored.scene.mesh, part, vec![("pane".into(), Some(0)), ("core".into(), None)]);
    assert_near(&seen(&cored, &[white()], from), DVec3::ZERO, "core");
    let view = settings(camera(from.into(), 0.01), size(1, 1));
    let frame = render(&body(pane(), 1.3), &Fake::new(pane()).uniform(), &[white()], &view, &Silent).unwrap();
    assert!(!frame.has_straight && frame.pixels[0].straight == [0.0; 3]);
}

#[test]
fn the_sum_has_it() {
    let fake = body(cuboid(DVec3::new(40.0, 40.0, 1.0), 1), 1.3);
    let pixel = seen(&fake, &[white()], DVec3::new(10.0, 20.0, 100.0));
    for c in 0..3 {
        let sum = pixel.diffuse[c] + pixel.single[c] + pixel.specular[c] + pixel.straight[c];
        assert!(pixel.straight[c] > 0.01 && (pixel.beauty[c] - sum).abs() < 1e-5 * sum, "{pixel:?}");
    }
}
