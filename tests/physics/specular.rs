//! Specular reflection in pictures against what is known apart from the renderer: quadrature, formulas, symmetries.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::{baked, in_memory};
use std::f64::consts::PI;
use std::sync::Arc;

use crate::rendering::{Fake, camera, settings, size};
use glam::{DVec2, DVec3};
use translux::evaluate::Evaluator;
use translux::geometry::shapes::{bumpy_head, compose, cuboid, icosphere};
use translux::light::environment::EnvironmentMap;
use translux::light::{Light, LightKind, sky};
use translux::medium::fresnel::transmittance;
use translux::methods;
use translux::progress::Silent;
use translux::render::blinn_phong::Exponent;
use translux::render::camera::Camera;
use translux::render::film::Exposure;
use translux::render::frame::{Frame, Pixel, RenderSettings, Specular, render};
use translux::render::specular::Roughness;

const RADIUS: f64 = 10.0;

fn rough(roughness: f64) -> Specular {
    Specular::Rough(Roughness::new(roughness).unwrap())
}

fn power(exponent: f64) -> Specular {
    Specular::BlinnPhong(Exponent::new(exponent).unwrap())
}

fn ball(eta: f64) -> Fake {
    let mut fake = Fake::new(icosphere(RADIUS, 6));
    fake.scene.media[0].properties.eta_inside_over_outside = eta;
    fake
}

/// The eye far in front of the ball; the picture is a little larger than it.
fn front(side: usize) -> RenderSettings {
    let distance = 400.0;
    settings(camera([0.0, 0.0, distance], 2.0 * (1.05 * RADIUS / distance).atan().to_degrees()), size(side, side))
}

fn lit(fake: &Fake, lights: &[Light], view: &RenderSettings) -> Frame {
    let frame = render(fake, &fake.uniform(), lights, view, &Silent).unwrap();
    for p in &frame.pixels {
        let values = [p.beauty, p.diffuse, p.specular, p.normal].concat();
        assert!(values.iter().all(|v| v.is_finite()) && p.specular.iter().all(|v| *v >= 0.0), "{p:?}");
    }
    frame
}

fn specular(p: &Pixel) -> DVec3 {
    DVec3::from(p.specular.map(f64::from))
}

fn total(frame: &Frame) -> DVec3 {
    frame.pixels.iter().map(specular).sum()
}

/// The formula of the model, written down again: F, half vector, and the power of Blinn-Phong, or D and G2 of GGX by the
/// auxiliary function Lambda.
fn model(specular: Specular, eta: f64, n: DVec3, i: DVec3, o: DVec3) -> f64 {
    let h = (i + o).normalize();
    let alpha = match specular {
        Specular::BlinnPhong(exponent) => {
            let power = exponent.value();
            return (1.0 - transmittance(eta, h.dot(o))) * (power + 2.0) / (8.0 * PI) * n.dot(h).powf(power);
        }
        rough => rough.roughness().unwrap().value().powi(2),
    };
    let tan2 = |c: f64| 1.0 / (c * c) - 1.0;
    let lambda = |c: f64| 0.5 * ((1.0 + alpha * alpha * tan2(c)).sqrt() - 1.0);
    let (ci, co, ch) = (n.dot(i), n.dot(o), n.dot(h));
    let d = alpha * alpha / (PI * ch.powi(4) * (alpha * alpha + tan2(ch)).powi(2));
    (1.0 - transmittance(eta, h.dot(o))) * d / (1.0 + lambda(ci) + lambda(co)) / (4.0 * ci * co)
}

/// `Int f_r cos_i dw_i` by a dense grid over the hemisphere, finer towards the mirror direction's polar angle.
fn albedo(specular: Specular, eta: f64, cos_o: f64) -> f64 {
    let o = DVec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
    let (polar, turns) = (500, 250);
    let mut sum = 0.0;
    for a in 0..polar {
        let theta = (f64::from(a) + 0.5) / f64::from(polar) * 0.5 * PI;
        for b in 0..turns {
            let phi = (f64::from(b) + 0.5) / f64::from(turns) * PI;
            let i = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            sum += model(specular, eta, DVec3::Z, i, o) * theta.cos() * theta.sin();
        }
    }
    2.0 * sum * (0.5 * PI / f64::from(polar)) * (PI / f64::from(turns))
}

/// Pixels all on the ball, with the cosine that their middle is seen at and the direction to the eye.
fn on_ball<'a>(frame: &'a Frame, view: &'a RenderSettings) -> impl Iterator<Item = (&'a Pixel, DVec3, DVec3)> {
    let width = view.resolution.width;
    frame.pixels.iter().enumerate().filter(|(_, p)| p.coverage == 1.0).map(move |(i, p)| {
        let place = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let direction = view.camera.direction(place, view.resolution);
        let along = -view.camera.at_mm().dot(direction);
        let beside = (view.camera.at_mm() + direction * along).length();
        let hit = view.camera.at_mm() + direction * (along - (RADIUS * RADIUS - beside * beside).max(0.0).sqrt());
        (p, hit / RADIUS, -direction)
    })
}

#[test]
fn white_furnace_shows_the_albedo_of_the_lobe() {
    let light = [Light::constant(DVec3::new(1.0, 0.5, 2.0)).unwrap()];
    for (highlights, eta) in [
        (rough(0.3), 1.5),
        (rough(0.6), 1.3),
        (rough(1.0), 1.5),
        (rough(0.5), 0.8),
        (power(20.0), 1.3),
        (power(200.0), 1.5),
    ] {
        let view = RenderSettings { specular: highlights, samples_per_pixel: 64, ..front(48) };
        let frame = lit(&ball(eta), &light, &view);
        for (low, high) in [(0.95, 1.0), (0.7, 0.75), (0.45, 0.5)] {
            let (mut sum, mut count, mut cosine) = (0.0, 0.0, 0.0);
            for (p, n, eye) in on_ball(&frame, &view).filter(|(_, n, eye)| (low..high).contains(&n.dot(*eye))) {
                sum += f64::from(p.specular[0]);
                assert!((specular(p) / DVec3::new(1.0, 0.5, 2.0) - f64::from(p.specular[0])).length() < 1e-6);
                cosine += n.dot(eye);
                count += 1.0;
            }
            let (found, expected) = (sum / count, albedo(highlights, eta, cosine / count));
            assert!((found / expected - 1.0).abs() < 0.02, "{highlights:?} {eta} {low}: {found} instead of {expected}");
        }
    }
}

#[test]
fn directional_and_point_lights_follow_the_formula() {
    let fake = ball(1.5);
    let from = DVec3::new(0.5, 0.7, 1.0).normalize();
    let at = DVec3::new(-14.0, 6.0, 25.0);
    for highlights in [rough(0.4), rough(0.7), power(20.0), power(80.0)] {
        let view = RenderSettings { specular: highlights, ..front(64) };
        for light in [
            Light::directional(from, DVec3::new(3.0, 2.0, 1.0)).unwrap(),
            Light::point(at, DVec3::new(900.0, 600.0, 300.0)).unwrap(),
        ] {
            let frame = lit(&fake, std::slice::from_ref(&light), &view);
            let brightest = frame.pixels.iter().fold(0.0f32, |m, p| m.max(p.specular[0]));
            let mut checked = 0;
            for (p, n, eye) in on_ball(&frame, &view) {
                let (to_light, irradiance) = match light {
                    Light::Point { at_mm, intensity } => {
                        let offset = at_mm - n * RADIUS;
                        (offset.normalize(), intensity / offset.length_squared())
                    }
                    _ => (from, DVec3::new(3.0, 2.0, 1.0)),
                };
                let (cos_i, cos_o) = (n.dot(to_light), n.dot(eye));
                if cos_i > 0.1 && cos_o > 0.3 {
                    let expected = irradiance * cos_i * model(highlights, 1.5, n, to_light, eye);
                    // A pixel is a mean over its square.
                    let difference = (specular(p) - expected).abs().max_element();
                    assert!(difference < 0.03 * expected.x + 0.01 * f64::from(brightest), "{n}: {p:?} {expected}");
                    checked += 1;
                }
                if cos_i < -0.05 {
                    assert_eq!(p.specular, [0.0; 3], "{n} faces away");
                }
            }
            assert!(checked > 800, "{checked}");
        }
    }
}

#[test]
fn an_area_light_is_the_sum_of_its_points() {
    let fake = ball(1.5);
    for (highlights, at, extent) in [
        (rough(0.3), [8.0, 9.0, 30.0], [20.0, 12.0]),
        (rough(0.8), [-20.0, 5.0, 5.0], [9.0, 30.0]),
        (rough(0.4), [0.0, 0.0, 14.0], [1.0; 2]),
        (power(200.0), [8.0, 9.0, 30.0], [20.0, 12.0]),
        (power(5.0), [-20.0, 5.0, 5.0], [9.0, 30.0]),
    ] {
        let (at, normal) = (DVec3::from(at), -DVec3::from(at).normalize());
        let view = RenderSettings { specular: highlights, ..front(100) };
        let area = Light::area(at, normal, extent, DVec3::new(2.0, 1.0, 0.5), None).unwrap();
        let Light::Area { u, .. } = area else { unreachable!() };
        let v = normal.cross(u);
        let frame = lit(&fake, &[area], &view);
        let steps = 20;
        let expected: f64 = on_ball(&frame, &view)
            .map(|(_, n, eye)| {
                let mut sum = 0.0;
                for i in 0..steps * steps {
                    let cell = |k: usize| (k as f64 + 0.5) / steps as f64 - 0.5;
                    let q = at + u * (cell(i % steps) * extent[0]) + v * (cell(i / steps) * extent[1]);
                    let offset = q - n * RADIUS;
                    let to_light = offset.normalize();
                    let (cos_i, cos_light) = (n.dot(to_light), -normal.dot(to_light));
                    if cos_i > 0.0 && cos_light > 0.0 {
                        let f = model(highlights, 1.5, n, to_light, eye);
                        sum += f * cos_i * cos_light / offset.length_squared();
                    }
                }
                2.0 * sum * extent[0] * extent[1] / (steps * steps) as f64
            })
            .sum();
        let found: f64 = on_ball(&frame, &view).map(|(p, _, _)| f64::from(p.specular[0])).sum();
        assert!((found / expected - 1.0).abs() < 0.02, "{highlights:?}: {found} instead of {expected}");
        // One-sided.
        let away = Light::area(at, -normal, extent, DVec3::ONE, None).unwrap();
        assert_eq!(total(&lit(&fake, &[away], &view)), DVec3::ZERO);
    }
}

/// A map that is black but for a patch, and the direction and irradiance of that patch.
fn patch() -> (Arc<EnvironmentMap>, DVec3, f64) {
    let (width, height) = (256, 128);
    let lit = |i: usize| (118..122).contains(&(i % width)) && (40..44).contains(&(i / width));
    let pixels = (0..width * height).map(|i| if lit(i) { [100.0; 3] } else { [0.0; 3] }).collect();
    let map = EnvironmentMap::new(width, height, pixels).unwrap();
    let irradiance = map.energy().x;
    let direction = (map.pixel_direction(119, 41) + map.pixel_direction(120, 42)).normalize();
    (Arc::new(map), direction, irradiance)
}

#[test]
fn a_small_bright_patch_of_an_environment_is_a_directional_light() {
    let fake = ball(1.5);
    let (map, from, irradiance) = patch();
    for (highlights, turns) in [(rough(0.3), &[0.0, 30.0][..]), (rough(0.6), &[30.0]), (power(200.0), &[30.0])] {
        let view = RenderSettings { specular: highlights, samples_per_pixel: 64, ..front(96) };
        for &rotate in turns {
            let (sin, cos) = f64::to_radians(rotate).sin_cos();
            let turned = DVec3::new(cos * from.x + sin * from.z, from.y, cos * from.z - sin * from.x);
            let environment = lit(&fake, &[Light::environment(map.clone(), rotate, DVec3::ONE).unwrap()], &view);
            let sun = lit(&fake, &[Light::directional(turned, DVec3::splat(irradiance)).unwrap()], &view);
            let (a, b) = (total(&environment).x, total(&sun).x);
            assert!((a / b - 1.0).abs() < 0.05, "{highlights:?}: {a} instead of {b}");
            // The patch is as small as a texel of the blurred map, whose middle takes its place.
            let middle = |frame: &Frame| {
                let weigh = |(i, p): (usize, &Pixel)| {
                    DVec3::new((i % 96) as f64, (i / 96) as f64, 1.0) * f64::from(p.specular[0])
                };
                let sum: DVec3 = frame.pixels.iter().enumerate().map(weigh).sum();
                DVec2::new(sum.x, sum.y) / sum.z
            };
            let (a, b) = (middle(&environment), middle(&sun));
            assert!(
                (a - b).length() < 1.5,
                "{highlights:?}, turned by {rotate}: the highlight is at {a} instead of {b}"
            );
        }
    }
}

#[test]
fn a_constant_environment_is_a_constant_light() {
    let map = Arc::new(EnvironmentMap::new(8, 4, vec![[0.5, 1.0, 0.25]; 32]).unwrap());
    let (fake, view) = (ball(1.5), front(32));
    let a = lit(&fake, &[Light::environment(map, 77.0, DVec3::splat(2.0)).unwrap()], &view);
    let b = lit(&fake, &[Light::constant(DVec3::new(1.0, 2.0, 0.5)).unwrap()], &view);
    for (a, b) in a.pixels.iter().zip(&b.pixels) {
        assert!((specular(a) - specular(b)).length() < 1e-5 * (1e-3 + specular(b).length()), "{a:?} {b:?}");
    }
}

/// The ball with a plate in front of it on the side of +X.
fn sheltered() -> Fake {
    let plate = cuboid(DVec3::new(1.0, 60.0, 60.0), 1);
    Fake::new(compose(&[(icosphere(RADIUS, 4), DVec3::ZERO), (plate, DVec3::new(20.0, 0.0, 0.0))]))
}

#[test]
fn what_stands_before_a_light_takes_its_highlight_away() {
    let lights = |x: f64| {
        [
            Light::directional(DVec3::new(x, 0.0, 0.8), DVec3::ONE).unwrap(),
            Light::point(DVec3::new(30.0 * x, 0.0, 5.0), DVec3::splat(900.0)).unwrap(),
            Light::area(DVec3::new(30.0 * x, 0.0, 5.0), DVec3::new(-x, 0.0, 0.0), [9.0; 2], DVec3::ONE, None).unwrap(),
        ]
    };
    let view = front(48);
    for (open, shut) in lights(-1.0).into_iter().zip(lights(1.0)) {
        let (open, shut) = (lit(&sheltered(), &[open], &view), lit(&sheltered(), &[shut], &view));
        let of_ball = |frame: &Frame| on_ball(frame, &view).map(|(p, _, _)| f64::from(p.specular[0])).sum::<f64>();
        assert!(of_ball(&open) > 0.01 && of_ball(&shut) == 0.0, "{} {}", of_ball(&open), of_ball(&shut));
    }
}

fn every_light() -> Vec<Light> {
    let lights = vec![
        Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap(),
        Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap(),
        Light::point(DVec3::new(-8.0, 9.0, 20.0), DVec3::splat(300.0)).unwrap(),
        Light::area(DVec3::new(9.0, 12.0, 20.0), DVec3::new(-0.5, -0.6, -1.0), [6.0, 9.0], DVec3::ONE, None).unwrap(),
        Light::environment(Arc::new(sky::sky()), 40.0, DVec3::ONE).unwrap(),
        Light::spot(DVec3::new(8.0, 9.0, 20.0), DVec3::ZERO, 20.0, 0.5, DVec3::splat(300.0)).unwrap(),
    ];
    assert!(LightKind::ALL.iter().all(|kind| lights.iter().any(|light| light.kind() == *kind)));
    lights
}

#[test]
fn lights_add_up_and_stay_proportional() {
    let (fake, view) = (Fake::new(bumpy_head(RADIUS, 4)), front(24));
    let lights = every_light();
    let together = lit(&fake, &lights, &view);
    let single: Vec<Frame> = lights.iter().map(|light| lit(&fake, std::slice::from_ref(light), &view)).collect();
    for (i, p) in together.pixels.iter().enumerate() {
        let sum: DVec3 = single.iter().map(|frame| specular(&frame.pixels[i])).sum();
        assert!((specular(p) - sum).length() <= 1e-5 * sum.length(), "{p:?} {sum}");
    }
    let (area, bright) = match &lights[3] {
        Light::Area { at_mm, normal, u, size_mm, radiance, .. } => {
            (&lights[3], Light::area(*at_mm, *normal, *size_mm, *radiance * 8.0, Some(*u)).unwrap())
        }
        _ => unreachable!(),
    };
    let (dim, bright) = (lit(&fake, std::slice::from_ref(area), &view), lit(&fake, &[bright], &view));
    assert!(dim.pixels.iter().zip(&bright.pixels).all(|(a, b)| a.specular.map(|c| 8.0 * c) == b.specular));
}

#[test]
fn beauty_is_diffuse_and_specular_and_switching_off_leaves_the_rest() {
    let (fake, view) = (ball(1.5), RenderSettings { background: Default::default(), ..front(24) });
    let on = lit(&fake, &every_light(), &view);
    let off = lit(&fake, &every_light(), &RenderSettings { specular: Specular::Off, ..view });
    let matched = lit(&ball(1.0), &every_light(), &view);
    assert!(matched.pixels.iter().all(|p| p.specular == [0.0; 3]), "matched indices reflect nothing");
    for (on, off) in on.pixels.iter().zip(&off.pixels) {
        assert_eq!((off.specular, off.diffuse, off.coverage, off.part), ([0.0; 3], on.diffuse, on.coverage, on.part));
        let sum = DVec3::from(off.beauty.map(f64::from)) + specular(on);
        assert!((sum - DVec3::from(on.beauty.map(f64::from))).length() < 1e-5 * sum.length());
        assert!(on.coverage < 1.0 || on.specular[1] > 0.0, "{on:?}");
    }
}

#[test]
fn glare_is_what_single_rays_have_above_white_and_changes_nothing_else() {
    let (fake, view) = (ball(1.5), RenderSettings { background: Default::default(), ..front(32) });
    let plain = lit(&fake, &every_light(), &view);
    assert!(plain.pixels.iter().all(|p| p.glare == [0.0; 3]));
    let white = Exposure::Auto.white(&fake, &fake.uniform(), &view).unwrap();
    assert!((white * Exposure::Auto.factor(&plain) - 1.0).abs() < 0.05, "{white}");
    assert_eq!(Exposure::Stops(3.0).white(&fake, &fake.uniform(), &view).unwrap(), 0.125);
    let white = 0.2 * white;
    let shown = lit(&fake, &every_light(), &RenderSettings { white, ..view });
    let mut bright = 0;
    for (a, b) in plain.pixels.iter().zip(&shown.pixels) {
        assert_eq!(*a, Pixel { glare: [0.0; 3], ..*b });
        bright += u32::from(b.glare[0] > 0.0);
        for c in 0..3 {
            let (left, diffuse) = (f64::from(b.beauty[c] - b.glare[c]), f64::from(b.diffuse[c]));
            assert!(b.glare[c] >= 0.0 && left <= diffuse + white * 1.0001, "{b:?}");
            // What is cut is no more than what the mean has above white, where all rays are alike.
            let above = f64::from(b.beauty[c]) - diffuse - white;
            assert!(f64::from(b.glare[c]) >= above * 0.999 - 1e-6, "{b:?}");
        }
    }
    assert!(bright > 20, "{bright}");
}

#[test]
fn opaque_parts_are_black_and_parts_are_numbered() {
    let mut model = compose(&[(icosphere(3.0, 3), DVec3::X * -5.0), (icosphere(3.0, 3), DVec3::X * 5.0)]);
    model.materials = vec!["wax".to_owned(), "wick".to_owned()];
    let half = model.triangles.len() / 2;
    model.triangle_material = (0..2 * half).map(|t| u32::from(t >= half)).collect();
    let fake = Fake::with_parts(model, |part| (part == 0).then_some(0));
    let view = settings(camera([0.0, 0.0, 60.0], 20.0), size(80, 40));
    let frame = lit(&fake, &every_light(), &view);
    let (left, right, beside) = (frame.pixels[20 * 80 + 30], frame.pixels[20 * 80 + 49], frame.pixels[0]);
    assert!(left.specular[0] > 0.0 && right.specular == [0.0; 3] && beside.specular == [0.0; 3]);
    assert_eq!((left.part, right.part, beside.part), (1, 2, 0));
}

#[test]
fn odd_lights_and_views_stay_finite() {
    let fake = Fake::new(icosphere(1.0, 2));
    let vertex = fake.scene.mesh.position_mm(0);
    let lights = [
        Light::point(vertex, DVec3::ONE).unwrap(),
        Light::point(DVec3::ZERO, DVec3::splat(1e300)).unwrap(),
        Light::point(DVec3::new(1e9, 1e9, 1e9), DVec3::splat(1e20)).unwrap(),
        Light::directional(DVec3::Z, DVec3::splat(1e300)).unwrap(),
        Light::area(vertex, DVec3::Z, [1e-6, 1e6], DVec3::splat(1e30), None).unwrap(),
        Light::area(DVec3::Z * 1e8, -DVec3::Z, [1e-6; 2], DVec3::splat(1e30), None).unwrap(),
    ];
    for highlights in [rough(0.0), rough(0.3), rough(1.0), power(1.0), power(1e4)] {
        for (at, fov) in [([0.0, 0.0, 1.0001], 150.0), ([0.0, 0.0, 1.0], 90.0), ([3.0, 0.0, 1e-9], 40.0)] {
            let view = RenderSettings { specular: highlights, ..settings(camera(at, fov), size(33, 17)) };
            lit(&fake, &lights, &view);
        }
    }
}

#[test]
fn pictures_do_not_depend_on_threads_or_on_how_rays_are_bundled() {
    let fake = Fake::new(bumpy_head(RADIUS, 4));
    let lights = every_light();
    for samples_per_pixel in [1, 5, 16, 33] {
        let view = RenderSettings { samples_per_pixel, ..front(37) };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| lit(&fake, &lights, &view))
        };
        assert!(on(1) == on(3), "{samples_per_pixel} samples");
    }
}

/// A picture with 16 samples a pixel is near the one with many.
#[test]
fn default_samples_are_free_of_visible_noise() {
    let fake = ball(1.5);
    let both = |light: Light| [Specular::default(), power(200.0)].map(|highlights| (light.clone(), highlights));
    for (light, highlights) in every_light().into_iter().flat_map(both) {
        let view = RenderSettings { specular: highlights, ..front(32) };
        // Of environments by more: each sample of many is blurred less.
        let many = if light.kind() == LightKind::Environment { 1024 } else { 256 };
        let few = lit(&fake, std::slice::from_ref(&light), &view);
        let many = lit(&fake, std::slice::from_ref(&light), &RenderSettings { samples_per_pixel: many, ..view });
        let (mut error, mut scale) = (0.0, 0.0);
        for (few, many) in few.pixels.iter().zip(&many.pixels).filter(|(few, _)| few.coverage == 1.0) {
            error += (specular(few) - specular(many)).length_squared();
            scale += specular(many).length_squared();
        }
        let relative = (error / scale).sqrt();
        println!("{}, {highlights:?}: {:.1} %", light.kind().name(), 100.0 * relative);
        // Of highlights, which are added to a much brighter and smooth diffuse part. Environments are blurred by the
        // distance between samples: few of them make the reflected sun wider.
        let most = match light.kind() {
            LightKind::Area => 0.2,
            // Without the tails of GGX, the highlight of the sun is more of all that is reflected.
            LightKind::Environment if highlights.roughness().is_none() => 0.35,
            LightKind::Environment => 0.3,
            _ => 0.1,
        };
        assert!(relative < most, "{}, {highlights:?}: {relative}", light.kind().name());
    }
}

#[test]
fn every_method_renders_under_every_light() {
    for (index, &method) in methods::built_in().methods().iter().enumerate() {
        let mut evaluator = in_memory::opened(baked::of_group(method));
        let evaluator: &mut dyn Evaluator = evaluator.as_mut();
        let view = RenderSettings::new(Camera::framing(&evaluator.scene().mesh, size(24, 24)).unwrap(), size(24, 24));
        // The method is asked for radiosity alone: each meets two kinds of light, and each kind some method.
        let lights = in_memory::served(method, &every_light());
        for light in [0, 2].map(|i| lights[(index + i) % lights.len()].clone()) {
            let what = format!("{}, {}", method.name(), light.kind().name());
            let radiosity = in_memory::lit(evaluator, vec![light.clone()]);
            let frame = render(evaluator, &radiosity, &[light], &view, &Silent).unwrap();
            let mut wax = (DVec3::ZERO, 0.0);
            for p in &frame.pixels {
                let values = [p.beauty, p.diffuse, p.specular, p.normal].concat();
                assert!(values.iter().all(|v| v.is_finite()) && (0.0..=1.0).contains(&p.coverage), "{what}: {p:?}");
                assert_eq!(p.depth_mm.is_finite(), p.coverage > 0.0, "{what}: {p:?}");
                assert_eq!(p.part > 0, p.coverage > 0.0, "{what}: {p:?}");
                if p.part == 1 {
                    wax = (wax.0 + specular(p), wax.1 + f64::from(p.diffuse[0]));
                }
            }
            assert!(wax.0.min_element() > 0.0 && wax.1 > 0.0, "{what}: {wax:?}");
        }
    }
}
