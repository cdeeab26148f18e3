//! Area lights through source radiance fields: closed forms, shadow rays, environments, and who refuses them.
#![allow(clippy::unwrap_used, missing_docs)]

#[cfg(feature = "gpu")]
use crate::on_device;
use crate::{baked, in_memory};
use std::f64::consts::TAU;
use std::sync::Arc;

use crate::common::{Folder, relative_difference};
use glam::DVec3;
use translux::error::ExitCode;
use translux::evaluate::SourceFields;
use translux::forms::environment_rows::StoredRows;
use translux::geometry::bvh::Bvh;
use translux::geometry::mesh::Scale;
use translux::geometry::samples::{Samples, patches};
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::light::environment::EnvironmentMap;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::irradiance::{Illumination, LightSampling};
use translux::transport::irradiance_rows::{RowBaker, RowSettings};
use translux::transport::surface::Surface;
use translux::transport::visibility::{Observer, Resolution};

/// A scene with samples and their rows.
struct Sampled {
    scene: Scene,
    bvh: Bvh,
    samples: Samples,
    rows: StoredRows,
}

impl Sampled {
    fn new(model: SourceModel, samples: usize, settings: RowSettings, eta: f64) -> Self {
        let mut scene = in_memory::scene(model, Scale::MillimetresPerUnit(1.0), "marble");
        scene.media.iter_mut().for_each(|m| m.properties.eta_inside_over_outside = eta);
        let (bvh, samples) = (Bvh::new(&scene.mesh), Samples::new(&scene.mesh, &scene.parts, samples));
        let rows = {
            let patches = patches(&scene.mesh, &samples);
            let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
            StoredRows::new(RowBaker::new(&surface, settings).unwrap().all(&Silent).unwrap())
        };
        Self { scene, bvh, samples, rows }
    }

    fn through_rows(&self, light: &Light) -> Vec<DVec3> {
        let mut irradiance = vec![DVec3::ZERO; self.samples.len()];
        self.rows.add(std::slice::from_ref(light), self.scene.domain(), &self.samples, &mut irradiance).unwrap();
        irradiance
    }

    fn by_rays(&self, light: &Light) -> Vec<DVec3> {
        let patches = patches(&self.scene.mesh, &self.samples);
        let surface =
            Surface { domain: self.scene.domain(), bvh: &self.bvh, samples: &self.samples, patches: &patches };
        let etas: Vec<f64> = self.scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
        let lights = [light.clone()];
        Illumination::new(&surface, &lights, &etas, LightSampling::REFERENCE).unwrap().all(&Silent)
    }
}

/// RMS of the differences over that of the truth.
fn rms(values: &[DVec3], truth: &[DVec3]) -> f64 {
    let error: f64 = values.iter().zip(truth).map(|(a, b)| (*a - *b).length_squared()).sum();
    (error / truth.iter().map(|b| b.length_squared()).sum::<f64>()).sqrt()
}

fn all_coefficients(resolution: Resolution) -> RowSettings {
    let side = resolution.side() / 2;
    RowSettings { resolution, terms: 4, coefficients: 6 * side * side }
}

/// Irradiance of a plane that faces up from a rectangle above it, of radiance 1: half the sum over the edges of the angle that each
/// fills times the cosine of its plane's normal with the plane's (Lambert).
fn contour(corners: [DVec3; 4], at: DVec3) -> f64 {
    let corners = corners.map(|c| (c - at).normalize());
    let edge = |i: usize| {
        let cross = corners[i].cross(corners[(i + 1) % 4]);
        cross.length().atan2(corners[i].dot(corners[(i + 1) % 4])) * cross.normalize().y
    };
    0.5 * (0..4).map(edge).sum::<f64>().abs()
}

#[test]
fn a_rectangle_above_a_plane_is_the_closed_form() {
    let at_mm = DVec3::new(2.0, 9.0, -3.0);
    let light = Light::area(at_mm, DVec3::new(0.2, -1.0, 0.1), [6.0, 3.0], DVec3::ONE, Some(DVec3::X)).unwrap();
    let Light::Area { normal, u, size_mm, .. } = light else { unreachable!() };
    let (a, b) = (0.5 * size_mm[0] * u, 0.5 * size_mm[1] * normal.cross(u));
    let corners = [at_mm - a - b, at_mm + a - b, at_mm + a + b, at_mm - a + b];
    let mut found = Vec::new();
    for (resolution, points) in
        [(Resolution::Sub64, 4), (Resolution::Sub64, 8), (Resolution::Sub64, 32), (Resolution::Sub128, 32)]
    {
        // F_t is 1 everywhere.
        let plane = Sampled::new(shapes::plane(40.0, 40.0, 8), 512, all_coefficients(resolution), 1.0);
        let values = plane.through_rows(&light.clone().through_field(points).unwrap());
        let (mut error, mut square) = (0.0, 0.0);
        for (patch, value) in values.iter().enumerate() {
            let at = Observer::of(&plane.scene.mesh, plane.samples.patch(patch)).eye.as_dvec3();
            let exact = contour(corners, at + plane.scene.mesh.origin_mm);
            error += (value.x - exact).powi(2);
            square += exact * exact;
        }
        let rms = (error / square).sqrt();
        println!("{resolution:?}, {points} points: {rms:.2e}");
        found.push(rms);
    }
    assert!(found[1] < 0.5 * found[0] && found[2] < 0.5 * found[1], "{found:?}");
    assert!(found[2] < 6e-3 && found[3] < 6e-3, "{found:?}");
}

#[test]
fn shadows_are_those_of_rays_but_for_the_rows() {
    let knot = || shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 160, 16);
    let light = Light::area(DVec3::new(12.0, 25.0, 8.0), DVec3::new(-0.5, -1.0, -0.3), [9.0, 9.0], DVec3::ONE, None);
    let light = light.unwrap();
    let (mut errors, mut rays) = (Vec::new(), None);
    for coefficients in [128, 1024] {
        let body = Sampled::new(knot(), 8000, RowSettings { coefficients, ..RowSettings::DEFAULT }, 1.3);
        let field = body.through_rows(&light.clone().through_field(32).unwrap());
        let own = body.rows.without_interpolation(
            &light.clone().through_field(32).unwrap(),
            body.scene.domain(),
            &body.samples,
        );
        // Rays do not know the rows: once for both.
        let rays = rays.get_or_insert_with(|| body.by_rays(&light));
        errors.push([rms(&field, rays), rms(&field, &own.unwrap())]);
    }
    println!("128 and 1024 coefficients: field against rays, against maps of the samples' own: {errors:.4?}");
    // What is left with many coefficients is that a row is seen from one point of its sample.
    assert!(errors[1][0] < 0.08 && errors[1][0] < errors[0][0], "{errors:?}");
    assert!(errors.iter().all(|e| e[1] < 0.02), "{errors:?}");
}

#[test]
fn far_away_a_light_is_a_bright_patch_of_an_environment() {
    // 12 x 8 pixels in the middle, on the horizon, where the map's grid is nearly square.
    let (width, height) = (256, 128);
    let inside = |x: usize, y: usize| (122..134).contains(&x) && (60..68).contains(&y);
    let pixel = |i: usize| if inside(i % width, i / width) { [1.0, 2.0, 0.5] } else { [0.0; 3] };
    let map = EnvironmentMap::new(width, height, (0..width * height).map(pixel).collect()).unwrap();
    let environment = Light::environment(Arc::new(map), 0.0, DVec3::ONE).unwrap();
    let body = Sampled::new(shapes::bumpy_head(10.0, 4), 3000, RowSettings::DEFAULT, 1.3);
    let distance = 1e5;
    let edge = |pixels: f64| 2.0 * distance * (0.5 * pixels * TAU / width as f64).tan();
    let (at, radiance) = (body.scene.mesh.origin_mm + distance * DVec3::Z, DVec3::new(1.0, 2.0, 0.5));
    let light = Light::area(at, -DVec3::Z, [edge(12.0), edge(8.0)], radiance, Some(DVec3::X)).unwrap();
    let [near, far] = [body.through_rows(&light.through_field(64).unwrap()), body.through_rows(&environment)];
    let error = rms(&near, &far);
    println!("against the environment: {error:.2e}");
    assert!(error < 0.02, "{error}");
    assert!(far.iter().any(|e| e.y > 0.05));
}

#[test]
fn lights_move_grow_and_add_up_on_one_field() {
    let body = Sampled::new(shapes::bumpy_head(10.0, 3), 1000, RowSettings::DEFAULT, 1.3);
    let of = |at: DVec3, size: f64, radiance: DVec3| {
        Light::area(at, DVec3::NEG_Y, [size, 2.0 * size], radiance, None).unwrap().through_field(16).unwrap()
    };
    let one = of(DVec3::new(0.0, 30.0, 0.0), 4.0, DVec3::ONE);
    let lit = body.through_rows(&one);
    let bytes = body.rows.bytes();
    let brighter = body.through_rows(&of(DVec3::new(0.0, 30.0, 0.0), 4.0, DVec3::new(2.0, 3.0, 0.0)));
    assert!(lit.iter().zip(&brighter).all(|(a, b)| (*a * DVec3::new(2.0, 3.0, 0.0) - *b).length() < 1e-12));
    let moved = body.through_rows(&of(DVec3::new(0.0, 60.0, 0.0), 8.0, DVec3::ONE));
    assert!(rms(&moved, &lit) > 1e-3);
    assert_eq!(body.rows.bytes(), bytes, "another place and size is another field");
    body.through_rows(
        &Light::area(DVec3::Y * 30.0, DVec3::NEG_X, [4.0, 8.0], DVec3::ONE, None).unwrap().through_field(16).unwrap(),
    );
    assert!(body.rows.bytes() > bytes);
    // Without rows of its own, behind the light, at the surface: dark or finite.
    for at in [DVec3::new(0.0, -30.0, 0.0), DVec3::ZERO, DVec3::splat(1e200)] {
        let values = body.through_rows(&of(at, 4.0, DVec3::splat(1e300)));
        assert!(values.iter().all(|e| e.is_finite()), "{at}");
    }
    assert!(body.through_rows(&of(DVec3::new(0.0, -30.0, 0.0), 4.0, DVec3::ONE)).iter().all(|e| *e == DVec3::ZERO));
}

#[test]
fn both_forms_take_them_and_whatever_casts_rays_refuses() {
    let plain =
        Light::area(DVec3::new(5.0, 30.0, 9.0), DVec3::new(-0.1, -1.0, 0.0), [8.0, 8.0], DVec3::ONE, None).unwrap();
    let field = plain.clone().through_field(32).unwrap();
    for method in in_memory::every() {
        if !method.kinds().contains(&field.kind()) {
            continue;
        }
        let mut evaluator = in_memory::opened(baked::of_group(method));
        let set = evaluator.set_lights(vec![field.clone()], &Silent);
        if evaluator.capabilities().source_fields == SourceFields::None {
            assert_ne!(method.name(), "editable");
            assert_eq!(set.unwrap_err().code(), ExitCode::Unsupported, "{}", method.name());
            continue;
        }
        let through = evaluator.radiosity(&Silent).unwrap();
        let rays = in_memory::lit(evaluator.as_mut(), vec![plain.clone()]);
        let error = rms(&through, &rays);
        println!("{}: {error:.4}", method.name());
        assert!(error < 0.05 && error > 1e-6, "{error}");
        // Beside other lights, which go their own ways.
        let sun = Light::directional(DVec3::new(1.0, 0.5, 0.2), DVec3::ONE).unwrap();
        let [alone, both] =
            [vec![sun.clone()], vec![field.clone(), sun]].map(|l| in_memory::lit(evaluator.as_mut(), l));
        let sum: Vec<DVec3> = alone.iter().zip(&through).map(|(a, b)| *a + *b).collect();
        assert!(relative_difference(&both, &sum) < 1e-5);
        evaluator.set_lights(vec![field.clone()], &Silent).unwrap();
        let ledger = evaluator.measured_error(&[], &Silent).unwrap();
        let entry = ledger.entries.iter().find(|entry| entry.stage == "environment").unwrap();
        assert!(entry.error.rms > 1e-4 && entry.error.rms < 0.1, "{}", entry.error.rms);
        // A refractive index that no row serves.
        let mut media = evaluator.scene().media.clone();
        media.iter_mut().for_each(|m| m.properties.eta_inside_over_outside = 2.4);
        if evaluator.set_media(media).is_ok() {
            assert_eq!(evaluator.capabilities().source_fields, SourceFields::None);
            let refused = evaluator.set_lights(vec![field.clone()], &Silent).unwrap_err();
            assert_eq!(refused.code(), ExitCode::Unsupported);
        }
    }
}

#[cfg(feature = "gpu")]
#[test]
fn devices_give_the_same() {
    let Some(device) = on_device::device(u64::MAX) else { return };
    let light = Light::area(DVec3::new(28.0, 28.0, -22.0), DVec3::new(-1.0, -1.0, 0.7), [9.0, 6.0], DVec3::ONE, None);
    let sky = on_device::lights().into_iter().flatten();
    let lights: Vec<Light> = sky.chain([light.unwrap().through_field(16).unwrap()]).collect();
    for method in in_memory::every().into_iter().filter(|m| m.name() == "editable") {
        let asset = baked::of_group(method);
        let open = || in_memory::registry().open(Arc::clone(&asset)).unwrap();
        let (mut cpu, mut gpu) = (open(), open().on_device(&device).unwrap());
        let cpu = in_memory::lit(cpu.as_mut(), lights.clone());
        gpu.set_lights(lights.clone(), &Silent).unwrap();
        on_device::assert_same("fields", &gpu.radiosity(&Silent).unwrap(), &cpu);
    }
}

#[test]
fn the_command_line_tells_and_refuses() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(8.0, 2));
    let bake = "bake head.obj --unit mm --material marble --samples 500 -q";
    let editable = format!("{bake} --method editable");
    folder.run(&format!("{editable} -o rows.tlux")).ok();
    folder.run(&format!("{editable} --for-lights area -o none.tlux")).ok();
    folder.run(&format!("{bake} --method two_pass -o pass.tlux")).ok();
    let lamp = "--light area:at=0,30,9:normal=0,-1,-0.2:size=8,8:radiance=5:field=16 -q";
    for threads in [1, 3] {
        folder.run(&format!("--threads {threads} evaluate rows.tlux {lamp} -o {threads}.ply")).ok();
    }
    assert!(folder.read("1.ply") == folder.read("3.ply"));
    for asset in ["none.tlux", "pass.tlux"] {
        folder
            .run(&format!("evaluate {asset} {lamp} -o b.ply"))
            .fails(5, &["field=", "irradiance rows", "shadow rays"]);
    }
    folder.run(&format!("reference head.obj --unit mm --material marble {lamp} -o b.ply")).fails(5, &["field="]);
    folder
        .run("evaluate rows.tlux --light area:at=0,30,9:normal=0,-1,0:size=8,8:radiance=5:field=2 -o b.ply -q")
        .fails(1, &["4 to 64", "type for example"]);
    for (asset, word, json) in
        [("rows.tlux", "through source radiance fields", "any"), ("none.tlux", "no source", "none")]
    {
        assert!(folder.run(&format!("inspect {asset}")).ok().text().contains(word));
        let report = folder.run(&format!("inspect {asset} --json")).ok().json();
        assert_eq!(report["edits"]["source_fields"], json);
    }
    let json = folder.run(&format!("evaluate rows.tlux {} --measure --json -o b.ply", lamp)).ok().json();
    assert!(json.to_string().contains("fields of area lights"), "{json}");
}
