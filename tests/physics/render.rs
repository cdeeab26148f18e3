//! Pictures against what is known in closed form: flux, projections, normals, orientation, determinism.

#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::in_memory;
use crate::rendering::{Fake, camera, settings, size};
use glam::{DVec2, DVec3};

use translux::error::ExitCode;
use translux::evaluate::exitance::{Exitance, MeshPoint};
use translux::geometry::mesh::Scale;
use translux::geometry::shapes::{self, compose, cuboid, icosphere, inside_out, plane};
use translux::geometry::source::CornerAttribute;
use translux::light::Light;
use translux::light::environment::EnvironmentMap;
use translux::medium::fresnel::diffuse_transmittance;
use translux::progress::Silent;
use translux::render::background::Background;
use translux::render::camera::{Camera, Resolution, View};
use translux::render::camera_text::CameraSpec;
use translux::render::exit::ExitFresnel;
use translux::render::film::{ColourType, Exposure, to_exr, to_png};
use translux::render::frame::{ExitanceAt, Frame, Ground, Pixel, RenderSettings, render};
use translux::render::single::Scattered;
use translux::render::texture::Texture;

fn fibonacci(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sin, cos) = (i as f64 * PI * (3.0 - 5f64.sqrt())).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, z, r * sin)
    })
}

/// Flux through the sphere of this radius about the origin, measured by cameras on it that look at its centre: exact for any
/// radius, since the cosine at the film is the cosine at the sphere.
fn flux(fake: &Fake, distance: f64, fov: f64, views: usize, side: usize, exit_fresnel: ExitFresnel) -> f64 {
    let radiosity = fake.uniform();
    let step = 2.0 * (0.5 * fov).to_radians().tan() / side as f64;
    let irradiance = |direction: DVec3| {
        let view =
            RenderSettings { exit_fresnel, ..settings(camera((direction * distance).into(), fov), size(side, side)) };
        let frame = fake.render(&radiosity, &view);
        let weigh = |(i, p): (usize, &Pixel)| {
            let x = ((i % side) as f64 + 0.5 - 0.5 * side as f64) * step;
            let y = ((i / side) as f64 + 0.5 - 0.5 * side as f64) * step;
            f64::from(p.diffuse[1]) * step * step / (1.0 + x * x + y * y).powi(2)
        };
        frame.pixels.iter().enumerate().map(weigh).sum::<f64>()
    };
    4.0 * PI * distance * distance * fibonacci(views).map(irradiance).sum::<f64>() / views as f64
}

#[test]
fn furnace_all_flux_that_leaves_a_convex_body_is_seen() {
    let sphere = Fake::new(icosphere(10.0, 5));
    let emitted = sphere.scene.mesh.total_area_mm2();
    let seen = flux(&sphere, 40.0, 32.0, 6, 160, ExitFresnel::Normalised) / emitted;
    assert!((seen - 1.0).abs() < 1e-3, "sphere: {seen}");
    let c = diffuse_transmittance(1.5);
    let paper = flux(&sphere, 40.0, 32.0, 6, 160, ExitFresnel::Paper) / emitted;
    assert!((paper / c - 1.0).abs() < 1e-3, "sphere, C = 1: {paper} instead of {c}");
    // A box has edges: its flux depends on the view, and on creases that smooth normals must not cross.
    let block = Fake::new(cuboid(DVec3::new(10.0, 6.0, 14.0), 1));
    let seen = flux(&block, 60.0, 20.0, 300, 40, ExitFresnel::Normalised) / block.scene.mesh.total_area_mm2();
    assert!((seen - 1.0).abs() < 2e-3, "box: {seen}");
}

#[test]
fn known_points_project_to_known_pixels() {
    let resolution = size(200, 100);
    let eye = camera([0.0, 0.0, 50.0], 2.0 * 0.2f64.atan().to_degrees());
    let pixel = |p: [f64; 3]| eye.project(DVec3::from(p), resolution).unwrap();
    // 50 mm away the picture is 20 mm high and 40 mm wide: 5 pixels for each mm.
    for (point, expected) in [
        ([0.0, 0.0, 0.0], [100.0, 50.0]),
        ([20.0, 10.0, 0.0], [200.0, 0.0]),
        ([-20.0, -10.0, 0.0], [0.0, 100.0]),
        ([5.0, 0.0, 25.0], [150.0, 50.0]),
        ([0.0, 3.0, 0.0], [100.0, 35.0]),
    ] {
        let found = pixel(point).pixel;
        assert!((found - DVec2::from(expected)).length() < 1e-9, "{point:?}: {found}");
    }
    assert!((pixel([1.0, 2.0, 10.0]).depth_mm - 40.0).abs() < 1e-12);
    assert!(eye.project(DVec3::new(0.0, 0.0, 51.0), resolution).is_none());
    // Directions are the inverse of projections.
    let tilted =
        Camera::new(DVec3::new(9.0, -4.0, 30.0), DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.3, 1.0, 0.1), 35.0).unwrap();
    for i in 0..50 {
        let place = DVec2::new(f64::from(i * 37 % 200), f64::from(i * 53 % 100));
        let direction = tilted.direction(place, resolution);
        let back = tilted.project(tilted.at_mm() + direction * 17.0, resolution).unwrap();
        assert!((back.pixel - place).length() < 1e-9, "{place}");
    }
}

#[test]
fn a_dot_is_rendered_where_its_centre_projects() {
    let at = DVec3::new(4.0, 2.5, -3.0);
    let fake = Fake::new(compose(&[(icosphere(0.5, 2), at), (icosphere(0.01, 0), -at)]));
    let resolution = size(160, 120);
    let eye = Camera::new(DVec3::new(3.0, 6.0, 40.0), DVec3::ZERO, DVec3::Y, 25.0).unwrap();
    let frame = fake.render(&fake.uniform(), &settings(eye, resolution));
    let (mut sum, mut weight) = (DVec2::ZERO, 0.0);
    for (i, p) in frame.pixels.iter().enumerate() {
        let place = DVec2::new((i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5);
        let far = (place - eye.project(-at, resolution).unwrap().pixel).length() > 3.0;
        let share = if far { f64::from(p.coverage) } else { 0.0 };
        sum += place * share;
        weight += share;
    }
    let expected = eye.project(at, resolution).unwrap().pixel;
    assert!((sum / weight - expected).length() < 0.1, "{} instead of {expected}", sum / weight);
}

#[test]
fn radiosity_is_interpolated_between_vertices() {
    // A square that faces the eye; B is linear over it, so each pixel shows it at the pixel's own place.
    let fake = Fake::new(plane(20.0, 20.0, 3));
    let b = |p: DVec3| DVec3::new(3.0 + 0.1 * p.x, 5.0 - 0.2 * p.z, 1.0 + 0.05 * (p.x + p.z));
    let resolution = size(64, 64);
    let eye = Camera::new(DVec3::new(0.0, 1000.0, 0.0), DVec3::ZERO, -DVec3::Z, 1.0).unwrap();
    let view = RenderSettings { samples_per_pixel: 64, ..settings(eye, resolution) };
    let frame = fake.render(&fake.radiosity_by(b), &view);
    let c = diffuse_transmittance(1.5);
    let facing = 0.96 / (PI * c);
    for (i, pixel) in frame.pixels.iter().enumerate() {
        assert_eq!(pixel.coverage, 1.0);
        let direction = eye.direction(DVec2::new((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5), resolution);
        let point = eye.at_mm() - direction * (1000.0 / direction.y);
        let expected = b(point) * facing;
        let found = DVec3::from(pixel.diffuse.map(f64::from));
        assert!((found / expected - 1.0).abs().max_element() < 2e-3, "{i}: {found} instead of {expected}");
    }
    // Looking down with -Z up: +X is to the right, +Z below.
    assert!(frame.pixels[63].diffuse[0] > frame.pixels[0].diffuse[0]);
    assert!(frame.pixels[0].diffuse[1] > frame.pixels[64 * 63].diffuse[1]);
}

#[test]
fn a_sphere_covers_its_projected_area_and_shows_its_normals() {
    let (radius, distance, side) = (10.0, 60.0, 256);
    let fake = Fake::new(icosphere(radius, 6));
    let eye = camera([0.0, 0.0, distance], 24.0);
    let frame = fake.render(&fake.uniform(), &settings(eye, size(side, side)));
    let covered: f64 = frame.pixels.iter().map(|p| f64::from(p.coverage)).sum();
    let outline = radius / (distance * distance - radius * radius).sqrt() / 12f64.to_radians().tan();
    let area = PI * (outline * 0.5 * side as f64).powi(2);
    assert!((covered / area - 1.0).abs() < 5e-3, "{covered} instead of {area}");
    let mut checked = 0;
    for (i, pixel) in frame.pixels.iter().enumerate().filter(|(_, p)| p.coverage == 1.0) {
        let direction = eye.direction(DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5), size(side, side));
        let along = -eye.at_mm().dot(direction);
        let beside = (eye.at_mm() + direction * along).length();
        if beside > 0.9 * radius {
            continue;
        }
        let point = eye.at_mm() + direction * (along - (radius * radius - beside * beside).sqrt());
        let normal = DVec3::from(pixel.normal.map(f64::from));
        assert!((normal - point / radius).length() < 0.01, "{normal} instead of {}", point / radius);
        assert!((normal.length() - 1.0).abs() < 1e-6);
        assert!((f64::from(pixel.depth_mm) - (distance - point.z)).abs() < 0.05 * radius / 10.0, "{}", pixel.depth_mm);
        checked += 1;
    }
    assert!(checked > 10_000, "{checked}");
    let corner = frame.pixels[0];
    assert_eq!((corner.coverage, corner.depth_mm, corner.normal), (0.0, f32::INFINITY, [0.0; 3]));
    assert_eq!(frame.back_facing_share, 0.0);
}

#[test]
fn coarse_outlines_are_not_black() {
    let fake = Fake::new(icosphere(10.0, 1));
    let resolution = size(128, 128);
    let frame = fake.render(&fake.uniform(), &settings(fake.default_camera(resolution), resolution));
    let covered: Vec<&Pixel> = frame.pixels.iter().filter(|p| p.coverage == 1.0).collect();
    let dark = covered.iter().filter(|p| p.diffuse[1] < 0.05).count();
    assert!(covered.len() > 5000 && dark < 10, "{dark} of {} are dark", covered.len());
}

#[test]
fn stored_normals_are_used_where_they_are_valid() {
    let mut model = plane(10.0, 10.0, 1);
    let tilted = DVec3::new(0.6, 0.8, 0.0).as_vec3();
    let values = vec![tilted, glam::Vec3::ZERO, -glam::Vec3::Y, glam::Vec3::NAN];
    model.normals = Some(CornerAttribute { values, corners: vec![[0; 3], [1, 2, 3]] });
    let fake = Fake::new(model);
    let resolution = size(20, 20);
    let eye = Camera::new(DVec3::new(0.0, 30.0, 0.0), DVec3::ZERO, -DVec3::Z, 10.0).unwrap();
    let frame = fake.render(&fake.uniform(), &settings(eye, resolution));
    let normal = |x: usize, y: usize| DVec3::from(frame.pixels[y * 20 + x].normal.map(f64::from));
    // The first triangle has the corners (-,-), (-,+), (+,+) in (x, z): the lower left of the picture.
    assert!((normal(3, 16) - tilted.as_dvec3()).length() < 1e-6, "{}", normal(3, 16));
    assert!((normal(16, 3) - DVec3::Y).length() < 1e-6, "{}", normal(16, 3));
}

#[test]
fn opaque_parts_are_matte_or_black_and_back_sides_black() {
    let mut model = compose(&[(icosphere(3.0, 3), DVec3::X * -5.0), (icosphere(3.0, 3), DVec3::X * 5.0)]);
    model.materials = vec!["wax".to_owned(), "wick".to_owned()];
    let half = model.triangles.len() / 2;
    model.triangle_material = (0..2 * half).map(|t| u32::from(t >= half)).collect();
    let fake = Fake::with_parts(model, |part| (part == 0).then_some(0));
    let frame = fake.render(&fake.uniform(), &settings(camera([0.0, 0.0, 60.0], 20.0), size(80, 40)));
    let left = frame.pixels[20 * 80 + 30];
    let right = frame.pixels[20 * 80 + 49];
    assert!(left.coverage == 1.0 && left.diffuse[0] > 0.3, "{left:?}");
    assert!(right.coverage == 1.0 && right.diffuse == [0.0; 3], "{right:?}");
    // With an albedo: what enters at 1.5 of the light, and no light in the shadow of the other part.
    let opaque = Some(DVec3::new(0.5, 0.25, 1.0));
    let view = RenderSettings { opaque, ..settings(camera([0.0, 0.0, 60.0], 20.0), size(80, 40)) };
    let shown = |from: DVec3, view: &RenderSettings| {
        let sun = Light::directional(from, DVec3::ONE).unwrap();
        render(&fake, &fake.uniform(), &[sun], view, &Silent).unwrap()
    };
    let frame = shown(DVec3::Z, &view);
    let [r, g, b] = frame.pixels[20 * 80 + 49].matte;
    let expected = 0.5 * diffuse_transmittance(1.5) / PI;
    assert!((f64::from(r) / expected - 1.0).abs() < 0.02 && g == 0.5 * r && b == 2.0 * r, "{r} {expected}");
    assert!(frame.has_matte && frame.pixels[20 * 80 + 30].matte == [0.0; 3]);
    assert_eq!(shown(-DVec3::X, &view).pixels[20 * 80 + 46].matte, [0.0; 3]);
    // The ground is dark below the parts, and nowhere else; where there is no background, the picture covers there.
    let ground = RenderSettings { ground: Ground::Shadow, ..settings(camera([0.0, 40.0, 60.0], 40.0), size(80, 80)) };
    let frame = shown(DVec3::Y, &ground);
    let shadow = |x: usize, y: usize| frame.pixels[y * 80 + x].shadow;
    let dark = frame.pixels.iter().filter(|p| p.shadow > 0.99).count();
    assert!(dark > 10 && frame.pixels.iter().all(|p| p.shadow + p.coverage < 1.0 + 1e-6), "{dark}");
    assert_eq!((shadow(2, 70), shadow(77, 70), shadow(2, 2)), (0.0, 0.0, 0.0));
    let hollow = Fake::new(inside_out(icosphere(3.0, 3)));
    let frame = hollow.render(&hollow.uniform(), &settings(camera([0.0, 0.0, 30.0], 20.0), size(16, 16)));
    assert_eq!(frame.back_facing_share, 1.0);
    assert!(frame.pixels.iter().all(|p| p.diffuse == [0.0; 3]));
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let fake = Fake::new(icosphere(10.0, 4));
    let radiosity = fake.radiosity_by(|p| DVec3::new(1.0 + p.x / 20.0, 0.5, 1.0 - p.y / 30.0));
    let resolution = size(150, 101);
    let lights = [Light::constant(DVec3::new(0.1, 0.2, 0.3)).unwrap()];
    let view = RenderSettings::new(fake.default_camera(resolution), resolution);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let frame = render(&fake, &radiosity, &lights, &view, &Silent).unwrap();
            let png = to_png(&frame, Exposure::Auto.factor(&frame), Background::Environment).unwrap();
            (to_exr(&frame, ColourType::Half, Vec::new()).unwrap(), png, frame)
        })
    };
    let (one, three) = (on(1), on(3));
    assert!(one == three, "pictures differ between 1 and 3 threads");
    let beside = one.2.pixels[0];
    assert_eq!((beside.coverage, beside.beauty), (0.0, [0.1, 0.2, 0.3]));
}

/// A map that is black but for one column of pixels around longitude `u`.
fn column(u: f64) -> Arc<EnvironmentMap> {
    let (width, height) = (64, 32);
    let lit = (u * width as f64) as usize;
    let pixels = (0..width * height).map(|i| if i % width == lit { [1.0, 0.5, 0.25] } else { [0.0; 3] }).collect();
    Arc::new(EnvironmentMap::new(width, height, pixels).unwrap())
}

/// Where the brightest background is, in columns of a picture 64 pixels wide, and its brightness.
fn brightest(u: f64, rotate: f64, at: [f64; 3]) -> (usize, f32) {
    let fake = Fake::new(icosphere(0.001, 0));
    let lights = [
        Light::environment(column(u), rotate, DVec3::splat(2.0)).unwrap(),
        Light::directional(DVec3::Y, DVec3::ONE).unwrap(),
    ];
    let view = RenderSettings::new(camera(at, 60.0), size(64, 48));
    let frame = render(&fake, &fake.uniform(), &lights, &view, &Silent).unwrap();
    let row = &frame.pixels[10 * 64..11 * 64];
    let (x, p) = row.iter().enumerate().max_by(|a, b| a.1.beauty[0].total_cmp(&b.1.beauty[0])).unwrap();
    (x, p.beauty[0])
}

#[test]
fn the_background_is_where_the_environment_is() {
    // From +Z the eye looks along -Z: the seam of the map, u = 0 or 1; +X (u = 1/4) is to the right.
    // Half a column of the map is 2.8 degrees, and the picture is 75 degrees wide.
    for u in [0.0, 0.999] {
        let (x, value) = brightest(u, 0.0, [0.0, 0.0, 50.0]);
        assert!((29..35).contains(&x) && value > 0.9, "u = {u}: column {x}, {value}");
    }
    let (x, _) = brightest(0.08, 0.0, [0.0, 0.0, 50.0]);
    assert!((40..64).contains(&x), "towards +X: column {x}");
    // From -Z the eye looks along +Z, the centre of the map, and +X is to the left.
    let (x, _) = brightest(0.5, 0.0, [0.0, 0.0, -50.0]);
    assert!((29..35).contains(&x), "column {x}");
    let (x, _) = brightest(0.42, 0.0, [0.0, 0.0, -50.0]);
    assert!((0..24).contains(&x), "towards +X: column {x}");
    // 90 degrees move the centre to +X, which an eye at -X looks along.
    let (x, value) = brightest(0.5, 90.0, [-50.0, 0.0, 0.0]);
    assert!((29..35).contains(&x) && value > 0.9, "column {x}");
    assert_eq!(brightest(0.5, 90.0, [0.0, 0.0, -50.0]).1, 0.0);
}

#[test]
fn backgrounds_add_up_or_are_what_is_asked_for() {
    let fake = Fake::new(icosphere(1.0, 2));
    let white = Arc::new(EnvironmentMap::new(4, 2, vec![[1.0; 3]; 8]).unwrap());
    let lights = [
        Light::constant(DVec3::new(0.25, 0.5, 0.0)).unwrap(),
        Light::environment(white.clone(), 10.0, DVec3::new(1.0, 0.0, 2.0)).unwrap(),
        Light::environment(white, 0.0, DVec3::splat(0.125)).unwrap(),
    ];
    for (background, expected) in [
        (Background::Environment, [1.375, 0.625, 2.125]),
        (Background::None, [0.0; 3]),
        (Background::Colour(DVec3::new(0.5, 0.25, 4.0)), [0.5, 0.25, 4.0]),
    ] {
        let view = RenderSettings { background, ..RenderSettings::new(camera([0.0, 0.0, 9.0], 40.0), size(32, 32)) };
        let frame = render(&fake, &fake.uniform(), &lights, &view, &Silent).unwrap();
        assert_eq!((frame.pixels[0].beauty, frame.pixels[0].diffuse), (expected, [0.0; 3]), "{background}");
        for p in frame.pixels.iter().filter(|p| p.coverage > 0.0) {
            for (c, behind) in expected.iter().enumerate() {
                let over = p.diffuse[c] + p.specular[c] + (1.0 - p.coverage) * behind;
                assert!((p.beauty[c] - over).abs() < 1e-5, "{background}: {p:?}");
            }
        }
    }
}

#[test]
fn the_default_camera_shows_the_whole_object_at_any_aspect() {
    for (model, name) in [
        (icosphere(7.0, 3), "sphere"),
        (cuboid(DVec3::new(100.0, 1.0, 3.0), 2), "rod"),
        (cuboid(DVec3::new(1e-3, 2e-2, 1e-3), 1), "needle"),
        (compose(&[(icosphere(2e5, 2), DVec3::splat(1e7))]), "far away"),
    ] {
        let fake = Fake::new(model);
        let mesh = &fake.scene.mesh;
        for resolution in [size(100, 100), size(300, 40), size(20, 400), size(1, 1000)] {
            for fov in [None, Some(1.0), Some(120.0), Some(179.0)] {
                let spec = CameraSpec { fov_degrees: fov, ..CameraSpec::default() };
                let eye = spec.resolve(mesh, resolution).unwrap();
                let (width, height) = (resolution.width as f64, resolution.height as f64);
                let mut reach = 0.0f64;
                for v in 0..mesh.local_mm.len() as u32 {
                    let pixel = eye.project(mesh.position_mm(v), resolution).unwrap().pixel;
                    let off = (pixel / DVec2::new(width, height) * 2.0 - 1.0).abs();
                    reach = reach.max(off.max_element());
                }
                let least = if fov.is_none() { 0.85 } else { 0.0 };
                assert!((least..0.98).contains(&reach), "{name}, {resolution}, {fov:?}: {reach}");
                let again: CameraSpec = eye.to_string().parse().unwrap();
                assert_eq!(again.resolve(mesh, resolution).unwrap(), eye, "{eye}");
            }
        }
    }
    let fake = Fake::new(icosphere(7.0, 3));
    let eye = fake.default_camera(size(64, 64));
    assert!(eye.at_mm().z > 20.0 && eye.at_mm().y > 0.0 && eye.at_mm().x == 0.0, "{eye}");
    for (view, signs) in
        [(View::Front, [0, 1, 1]), (View::ThreeQuarter, [1, 1, 1]), (View::Back, [0, 1, -1]), (View::Top, [0, 1, 0])]
    {
        let spec = CameraSpec { view, ..CameraSpec::default() };
        let seen = spec.resolve(&fake.scene.mesh, size(64, 64)).unwrap();
        let found = seen.at_mm().to_array().map(|c| if c.abs() < 1e-6 { 0 } else { c.signum() as i32 });
        assert_eq!(found, signs, "{view:?}");
        // A ball looks the same from everywhere, up to its facets.
        assert!((seen.at_mm().length() / eye.at_mm().length() - 1.0).abs() < 0.01, "{view:?}: {seen}");
    }
}

#[test]
fn camera_texts_say_what_to_type() {
    let fake = Fake::new(icosphere(7.0, 2));
    let resolve = |text: &str| text.parse::<CameraSpec>().and_then(|s| s.resolve(&fake.scene.mesh, size(64, 64)));
    let full = resolve(" at=0,8,75:look=0,0,0:up=0,1,0:fov=28 ").unwrap();
    assert_eq!(full.to_string(), "at=0,8,75:look=0,0,0:up=0,1,0:fov=28");
    assert_eq!(resolve("fov=28 : at= 0, 8 ,75").unwrap(), full);
    assert!(resolve("at=0,9,0").unwrap().to_string().contains("up=0,0,-1"));
    assert!(resolve("at=0,-9,0").unwrap().to_string().contains("up=0,0,1"));
    assert!(resolve("look=1,2,3").unwrap().at_mm().z > 10.0);
    for (text, part) in [
        ("", "it is empty"),
        ("at", "`at` is not key=value"),
        ("eye=1,2,3", "`eye` is not one of its keys (at, look, up, fov)"),
        ("at=1,2", "at takes X,Y,Z, not 2 numbers"),
        ("at=1,2,3,4", "at takes X,Y,Z, not 4 numbers"),
        ("at=1,2,three", "`three` is not a number in at=1,2,three"),
        ("at=1,nan,3", "at=1,nan,3"),
        ("look=1e300,0,0", "up to 1e12"),
        ("fov=inf", "finite"),
        ("fov=0", "fov=0 must be a vertical angle"),
        ("fov=-5", "fov=-5"),
        ("fov=180", "fov=180"),
        ("fov=1:fov=2", "`fov` is given twice"),
        ("at=1,2,3:look=1,2,3", "at and look are both 1,2,3"),
        ("at=0,0,0", "at and look are both 0,0,0"),
        ("at=0,0,9:up=0,0,1", "up=0,0,1 is parallel to the view"),
        ("at=0,9,0:look=0,0,0:up=0,5,0", "for example up=0,0,-1"),
        ("up=0,0,0", "up=0,0,0 has no direction"),
    ] {
        let error = resolve(text).unwrap_err();
        assert_eq!(error.code(), ExitCode::CommandLine, "{text}");
        assert!(error.message().contains(part), "{text}: {error}");
        assert!(error.message().contains("example"), "{text}: {error}");
    }
    assert_eq!("640x480".parse::<Resolution>().unwrap(), size(640, 480));
    assert_eq!("64".parse::<Resolution>().unwrap(), size(64, 64));
    for bad in ["", "x", "640x", "0x5", "640x480x3", "-1x2", "70000x1", "99999999999999999999x1"] {
        assert!(bad.parse::<Resolution>().unwrap_err().message().contains("for example 1024x768"), "{bad}");
    }
}

/// Exitance at points: its value everywhere.
struct Everywhere(DVec3);

impl Exitance for Everywhere {
    fn at_vertices(&self) -> Option<&[DVec3]> {
        None
    }

    fn at(&self, _point: &MeshPoint) -> DVec3 {
        self.0
    }
}

#[test]
fn exitance_at_points_is_seen_through_the_same_pixels() {
    // One colour looks the same from vertices and from points, with a texture and without; rays that share a point lose nothing.
    let fake = Fake::new(compose(&[(icosphere(7.0, 2), DVec3::ZERO), (cuboid(DVec3::splat(6.0), 1), DVec3::X * 9.0)]));
    let texture = Texture::new(&"marble".parse().unwrap(), &fake.scene.mesh).unwrap();
    let view = settings(camera([3.0, 4.0, 40.0], 35.0), size(50, 37));
    let colour = DVec3::new(1.0, 2.0, 0.5);
    for texture in [None, texture.as_ref()] {
        for samples_per_pixel in [1, 3, 16, 5000] {
            let resolution = if samples_per_pixel == 5000 { size(3, 2) } else { view.resolution };
            let view = RenderSettings { samples_per_pixel, resolution, ..view };
            let picture = |exitance: &dyn Exitance| {
                let scattered = Scattered { texture, ..Scattered::from(exitance) };
                render(&fake, scattered, &[], &view, &Silent).unwrap()
            };
            let expected = picture(&fake.radiosity_by(|_| colour));
            let found = picture(&Everywhere(colour));
            assert_eq!((expected.exitance, found.exitance), (ExitanceAt::Vertices, ExitanceAt::Pixels));
            for (found, expected) in found.pixels.iter().zip(&expected.pixels) {
                let close = |a: f32, b: f32| (a - b).abs() <= 1e-6 * b.abs();
                assert!((0..3).all(|c| close(found.diffuse[c], expected.diffuse[c])), "{found:?} {expected:?}");
                let rest = Pixel { beauty: expected.beauty, diffuse: expected.diffuse, ..*found };
                assert_eq!(rest, *expected);
            }
        }
    }
    let error = render(&fake, &Everywhere(DVec3::NAN) as &dyn Exitance, &[], &view, &Silent).unwrap_err();
    assert!(error.code() == ExitCode::Runtime && error.message().contains("not finite"), "{error}");
}

/// The diffuse pixels of a picture from the exitance of the vertices, and of one from exitance at points.
fn from_vertices_and_points(method: &str, divisions: u32, view: &RenderSettings) -> [Vec<DVec3>; 2] {
    let scene = in_memory::scene(cuboid(DVec3::splat(8.0), divisions), Scale::MillimetresPerUnit(1.0), "skin1");
    let mut evaluator = in_memory::open(method, scene, Some(1 << 12));
    let radiosity = in_memory::radiosity(evaluator.as_mut(), Light::directional(FROM, DVec3::ONE).unwrap());
    evaluator.prepare_points(&Silent).unwrap();
    let points = evaluator.exitance_at_points().unwrap();
    [&radiosity as &dyn Exitance, points.as_ref()].map(|exitance| {
        let frame = render(evaluator.as_ref(), exitance, &[], view, &Silent).unwrap();
        frame.pixels.iter().map(|p| DVec3::from(p.diffuse.map(f64::from))).collect()
    })
}

/// Where the light of a cube comes from: on two of the three faces that are seen.
const FROM: DVec3 = DVec3::new(0.8, -0.2, 0.6);

#[test]
fn pictures_from_points_of_twelve_triangles_are_those_from_vertices_of_thousands() {
    let view = settings(camera([12.0, 9.6, 14.4], 36.0), size(32, 32));
    let rms = |found: &[DVec3], expected: &[DVec3]| {
        let square = |pairs: &mut dyn Iterator<Item = DVec3>| pairs.map(|v| v.length_squared()).sum::<f64>();
        let difference = square(&mut found.iter().zip(expected).map(|(a, b)| *a - *b));
        (difference / square(&mut expected.iter().copied())).sqrt()
    };
    let [fine, fine_points] = from_vertices_and_points("reference", 24, &view);
    let itself = rms(&fine_points, &fine);
    assert!(itself < 0.01, "points of 6912 triangles: {itself}");
    for method in ["reference", "two_pass"] {
        let [vertices, points] = from_vertices_and_points(method, 1, &view);
        let [vertices, points] = [vertices, points].map(|picture| rms(&picture, &fine));
        let said = format!("{method}: {points:.4} from points, {vertices:.2} from 8 vertices");
        println!("{said}");
        assert!(points < 0.01 && vertices > 0.3, "{said}");
    }
}

#[test]
fn wrong_calls_are_errors() {
    let fake = Fake::new(icosphere(7.0, 1));
    let good = settings(camera([0.0, 0.0, 30.0], 30.0), size(8, 8));
    let fails = |radiosity: &[DVec3], settings: &RenderSettings| {
        render(&fake, &radiosity.to_vec(), &[], settings, &Silent).is_err()
    };
    let mut radiosity = fake.uniform();
    assert!(!fails(&radiosity, &good));
    for samples_per_pixel in [0, u32::MAX] {
        assert!(fails(&radiosity, &RenderSettings { samples_per_pixel, ..good }));
    }
    assert!(fails(&radiosity, &RenderSettings { resolution: Resolution { width: 0, height: 8 }, ..good }));
    assert!(fails(&radiosity[1..], &good));
    radiosity[3].y = f64::NAN;
    assert!(fails(&radiosity, &good));
}

#[test]
fn hard_views_give_finite_pictures() {
    let fake = Fake::new(icosphere(1.0, 2));
    let radiosity = fake.radiosity_by(|p| DVec3::new(1e300, -1e300, p.x));
    for (at, fov) in [
        ([0.0, 0.0, 0.0001], 179.0),
        ([0.0, 0.0, 1.0], 90.0),
        ([1e12, 1e12, -1e12], 0.01),
        ([0.0, 1e6, 1.0], 0.01),
        ([1e-9, 3.0, 1e-9], 60.0),
    ] {
        let frame = fake.render(&radiosity, &settings(camera(at, fov), size(33, 17)));
        for p in &frame.pixels {
            let values = [p.beauty, p.diffuse, p.normal].concat();
            assert!(values.iter().all(|v| v.is_finite()) && !p.depth_mm.is_nan(), "{at:?}: {p:?}");
        }
        assert!(to_exr(&frame, ColourType::Half, Vec::new()).is_ok() && to_png(&frame, 1.0, Background::None).is_ok());
    }
}

#[test]
fn a_far_narrow_view_is_as_sharp_as_a_near_one() {
    let fake = Fake::new(icosphere(10.0, 5));
    let distance = 1e7;
    let fov = 2.0 * (12.0_f64 / distance).atan().to_degrees();
    assert!(Camera::new(DVec3::Z * distance, DVec3::ZERO, DVec3::Y, fov).is_err(), "narrower than the narrowest");
    let distance = 1e5;
    let fov = 2.0 * (12.0_f64 / distance).atan().to_degrees();
    let side = 128;
    let frame = fake.render(&fake.uniform(), &settings(camera([0.0, 0.0, distance], fov), size(side, side)));
    let covered: f64 = frame.pixels.iter().map(|p| f64::from(p.coverage)).sum();
    let area = PI * (10.0 / 12.0 * 0.5 * side as f64).powi(2);
    assert!((covered / area - 1.0).abs() < 5e-3, "{covered} instead of {area}");
}

fn shared(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let file = root.join("data").join(path);
    if !file.exists() {
        println!("WITHOUT ../shared: {} is not there", file.display());
        return None;
    }
    Some(file)
}

/// Of the group, the elephant's ears are above, the ring to its right, the plate below; its trunk comes towards the eye.
#[test]
fn a_group_is_upright_and_not_mirrored() {
    let fake = Fake::with_parts(shapes::still_life(1.5), |_| Some(0));
    let resolution = size(256, 256);
    let colours: Vec<DVec3> = {
        let mesh = &fake.scene.mesh;
        let mut colours = vec![DVec3::ONE; mesh.local_mm.len()];
        for (t, &material) in mesh.triangles.iter().zip(&mesh.triangle_material) {
            let mut colour = DVec3::splat(1e-3);
            colour[material as usize] = 1.0;
            t.iter().for_each(|&v| colours[v as usize] = colour);
        }
        colours
    };
    let frame = fake.render(&colours, &settings(fake.default_camera(resolution), resolution));
    // Where the light of a material's own colour is: column and row.
    let middle = |material: usize| {
        let mut sum = [0.0; 3];
        for (i, p) in frame.pixels.iter().enumerate() {
            let weight = f64::from(p.beauty[material]);
            [i % 256, i / 256, 1].into_iter().zip(&mut sum).for_each(|(x, s)| *s += weight * x as f64);
        }
        [sum[0] / sum[2], sum[1] / sum[2]]
    };
    let [elephant, ring, plate] = [0, 1, 2].map(middle);
    assert!(ring[0] > elephant[0] + 40.0 && ring[0] > plate[0], "{elephant:?} {ring:?} {plate:?}");
    assert!(plate[1] > elephant[1] + 30.0 && plate[1] > ring[1], "{elephant:?} {ring:?} {plate:?}");
    let covered: f64 = frame.pixels.iter().map(|p| f64::from(p.coverage)).sum::<f64>() / frame.pixels.len() as f64;
    assert!((0.15..0.7).contains(&covered), "{covered}");
    assert!(frame.back_facing_share < 1e-3, "{}", frame.back_facing_share);
}

/// The bunny's ears are above, its head to the left of the middle, its nose to the left of its head.
#[test]
fn the_bunny_is_upright_and_not_mirrored() {
    let Some(path) = shared("meshes/bunny_closed.obj") else { return };
    let mut model = translux::io::obj::read_obj(&path).unwrap();
    model.positions.iter_mut().for_each(|p| *p *= 500.0);
    let fake = Fake::new(model);
    let mesh = &fake.scene.mesh;
    let resolution = size(512, 512);
    let eye = fake.default_camera(resolution);
    let mut normals = vec![DVec3::ZERO; mesh.local_mm.len()];
    for t in 0..mesh.triangles.len() as u32 {
        for v in mesh.triangles[t as usize] {
            normals[v as usize] += mesh.cross_mm2(t);
        }
    }
    let light = DVec3::new(0.5, 0.8, 0.6).normalize();
    let radiosity: Vec<DVec3> =
        normals.iter().map(|n| DVec3::new(1.0, 0.8, 0.6) * n.normalize_or_zero().dot(light).max(0.05)).collect();
    let start = std::time::Instant::now();
    let view = RenderSettings { background: Background::Colour(DVec3::splat(0.02)), ..settings(eye, resolution) };
    let frame = fake.render(&radiosity, &view);
    println!("{} triangles, {resolution}: {:.2} s", mesh.triangles.len(), start.elapsed().as_secs_f64());
    if let Some(folder) = std::env::var_os("TRANSLUX_PICTURES") {
        let folder = PathBuf::from(folder);
        let png = to_png(&frame, Exposure::Auto.factor(&frame), Background::Environment).unwrap();
        std::fs::write(folder.join("bunny.png"), png).unwrap();
        let normal = |p: &Pixel| Pixel { beauty: p.normal.map(|c| 0.5 + 0.5 * c), ..*p };
        let normals = Frame { pixels: frame.pixels.iter().map(normal).collect(), ..frame.clone() };
        std::fs::write(folder.join("normals.png"), to_png(&normals, 1.0, Background::Environment).unwrap()).unwrap();
    }
    // Moments of the upper third of what is covered: the ears and the head are left of the body.
    let rows: Vec<(usize, f64)> = frame.pixels.iter().enumerate().map(|(i, p)| (i, f64::from(p.coverage))).collect();
    let mean_x = |from: usize, to: usize| {
        let part = rows.iter().filter(|(i, _)| (from..to).contains(&(i / 512)));
        let (sum, weight) = part.fold((0.0, 0.0), |(s, w), (i, c)| (s + (i % 512) as f64 * c, w + c));
        sum / weight
    };
    let covered = rows.iter().map(|(_, c)| c).sum::<f64>() / rows.len() as f64;
    assert!((0.25..0.7).contains(&covered), "{covered}");
    assert!(mean_x(0, 170) < mean_x(340, 512) - 40.0, "{} {}", mean_x(0, 170), mean_x(340, 512));
    assert!(frame.back_facing_share < 1e-6);
}
