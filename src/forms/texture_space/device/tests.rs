//! Each pass on the adapter against the processor.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use glam::DVec3;

use super::{Sums, TextureSpaceOnDevice};
use crate::evaluate::device::Device;
use crate::evaluate::{DeviceEvaluator, Evaluator};
use crate::forms::test_scene::scene;
use crate::forms::texture_space::light::{Flux, LitMap, Walked, nodes};
use crate::forms::texture_space::samples::drawn;
use crate::forms::texture_space::settings::{Far, Local, Sampling};
use crate::forms::texture_space::state::{Chosen, TextureSpaceEvaluator};
use crate::forms::texture_space::tests::{LOCAL, evaluator, sun, turned};
use crate::geometry::shapes;
use crate::light::{Light, sky};
use crate::math::statistics::vertex_error;
use crate::progress::Silent;
use crate::scene::Scene;

/// The adapter, or a line that says why the test is skipped.
fn device() -> Option<Arc<Device>> {
    Device::open().inspect_err(|e| println!("SKIPPED: {e}")).ok()
}

/// An object that shadows itself.
fn bumpy(material: &str) -> Scene {
    scene(shapes::bumpy_head(3.0, 3), material)
}

fn pair(
    device: &Arc<Device>,
    scene: &Scene,
    sampling: Sampling,
    light: &Light,
) -> (TextureSpaceEvaluator, TextureSpaceOnDevice) {
    let of = || evaluator(scene, sampling, 400, light.clone());
    let mut on_device = TextureSpaceOnDevice::new(of(), device).unwrap();
    on_device.set_lights(vec![light.clone()], &Silent).unwrap();
    on_device.update(&Silent).unwrap();
    let mut cpu = of();
    cpu.prepare(&Silent).unwrap();
    (cpu, on_device)
}

/// Irradiance of the patches on the device.
fn irradiance(on: &TextureSpaceOnDevice) -> Vec<DVec3> {
    let buffer = on.light.irradiance();
    let values: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&on.device.read(buffer, buffer.size()).unwrap());
    values[..on.cpu.map.patches.len()].iter().map(|[r, g, b, _]| DVec3::from([*r, *g, *b].map(f64::from))).collect()
}

fn light_of_nodes(on: &TextureSpaceOnDevice) -> Vec<Flux> {
    let buffer = on.light.nodes();
    let values: Vec<Walked> = bytemuck::pod_collect_to_vec(&on.device.read(buffer, buffer.size()).unwrap());
    let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let flux = |w: &Walked| Flux { rgb: wide(w.rgb), at_mm: wide(w.at_mm), moment: w.moment.into() };
    values[..on.cpu.map.nodes.len()].iter().map(flux).collect()
}

/// A spot light on a part of the body.
fn spot(scene: &Scene) -> Light {
    let origin = scene.mesh.origin_mm;
    Light::spot(origin + DVec3::new(9.0, 4.0, 2.0), origin + DVec3::Y, 20.0, 0.4, DVec3::splat(100.0)).unwrap()
}

fn lights(scene: &Scene) -> Vec<Light> {
    let origin = scene.mesh.origin_mm;
    let area =
        Light::area(origin + DVec3::new(8.0, 5.0, 3.0), DVec3::new(-1.0, -0.6, -0.3), [4.0, 2.0], DVec3::ONE, None);
    vec![
        sun(),
        Light::point(origin + DVec3::new(9.0, 4.0, 2.0), DVec3::new(100.0, 90.0, 80.0)).unwrap(),
        spot(scene),
        Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap(),
        area.unwrap(),
        Light::environment(sky::sky().into(), 40.0, DVec3::ONE).unwrap(),
    ]
}

/// Light of every kind, its shadows, and the mip-map over it.
#[test]
fn light_in_the_texels_and_the_mip_map_are_those_of_the_processor() {
    let Some(device) = device() else { return };
    let scene = bumpy("skin1");
    let all = lights(&scene);
    let (mut cpu, mut on) = pair(&device, &scene, Sampling::Shared, &all[0]);
    for light in all {
        on.set_lights(vec![light.clone()], &Silent).unwrap();
        on.update(&Silent).unwrap();
        cpu.set_lights(vec![light.clone()], &Silent).unwrap();
        cpu.prepare(&Silent).unwrap();
        let kind = light.kind().name();
        let LitMap { irradiance: expected, unit, .. } = cpu.lit.as_ref().unwrap();
        let found = irradiance(&on);
        let scale = on.lit.unwrap() / unit;
        let area = |i: usize| cpu.map.patches[i].area_mm2;
        let brightest = expected.iter().map(|e| e.max_element()).fold(0.0, f64::max);
        let (mut square, mut whole, mut off) = (0.0, 0.0, 0);
        for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
            let difference = (*found * scale - *expected).abs().max_element();
            square += area(i) * difference * difference;
            whole += area(i) * expected.max_element().powi(2);
            off += usize::from(difference > 1e-4 * brightest);
        }
        let rms = (square / whole).sqrt();
        println!("{kind}: RMS {rms:.1e}, {off} of {} patches off", found.len());
        // A ray that grazes an edge may meet it here and not there.
        assert!(rms < 2e-3 && off * 1000 <= found.len(), "{kind}: {rms:.1e}, {off}");
        let light = light_of_nodes(&on);
        for (index, (found, expected)) in light.iter().zip(&nodes(&cpu.map, &found)).enumerate() {
            let rgb = (found.rgb - expected.rgb).abs().max_element() / expected.rgb.max_element().max(1e-12);
            let at = found.at_mm.distance(expected.at_mm) / scene.mesh.diagonal_mm();
            // What is smaller than the last digit of its place has no moment.
            let digit = expected.weight() * (1e-6 * scene.mesh.diagonal_mm()).powi(2);
            let moment = (found.moment - expected.moment).abs() / (expected.moment + 1e4 * digit).max(1e-30);
            assert!(rgb < 1e-5 && at < 1e-6 && moment < 1e-4, "{kind} {index}: {found:?} {expected:?}");
        }
    }
}

/// The same texels are drawn, but where a step of the sum ends at the border of two.
#[test]
fn draws_are_those_of_the_processor() {
    let Some(device) = device() else { return };
    let scene = bumpy("skin1");
    let (cpu, on) = pair(&device, &scene, Sampling::Shared, &sun());
    let Sums::Shared(shared) = &on.sums else { panic!("shared samples") };
    let buffer = shared.samples.buffer();
    let found: Vec<[[f32; 4]; 2]> = bytemuck::pod_collect_to_vec(&device.read(buffer, buffer.size()).unwrap());
    let expected = drawn(&cpu.map, &light_of_nodes(&on), 0, 400);
    let mut others = 0;
    for (found, expected) in found.iter().zip(&expected) {
        let [at, flux] = found.map(|[x, y, z, _]| DVec3::new(x.into(), y.into(), z.into()));
        others += usize::from(at.distance(expected.at_mm) > 1e-5);
        assert!((flux.element_sum() / expected.flux.element_sum() - 1.0).abs() < 1e-4);
    }
    assert!(found.len() >= 400 && others <= 4, "{others}");
    let Some(Chosen::Shared(own)) = &cpu.chosen else { panic!("shared samples") };
    let moved = own[0]
        .iter()
        .zip(&found)
        .filter(|(own, [at, _])| own.at_mm.distance(DVec3::new(at[0].into(), at[1].into(), at[2].into())) > 1e-5);
    assert!(moved.count() <= 12);
}

/// Every choice of samples gives the radiosity of the processor, under media that change.
#[test]
fn every_choice_of_samples_gives_the_same_radiosity() {
    let Some(device) = device() else { return };
    let scene = bumpy("skin1");
    let areas = scene.vertex_areas_mm2();
    let point = Light::point(scene.mesh.origin_mm + DVec3::new(9.0, 4.0, 2.0), DVec3::splat(100.0)).unwrap();
    let hybrid = |far: Far| Sampling::Hybrid(Local { far, ..LOCAL });
    // Draws at the border of two texels may fall on either; pixels on an edge see either side.
    let all = [
        (Sampling::Product, 1e-5, point.clone()),
        (Sampling::Clusters, 1e-4, sun()),
        (Sampling::Shared, 2e-3, sun()),
        (hybrid(Far::Clusters), 1e-3, sun()),
        (hybrid(Far::Drawn), 2e-3, spot(&scene)),
    ];
    for (sampling, most, light) in &all {
        let (mut cpu, mut on) = pair(&device, &scene, *sampling, light);
        for material in ["skin1", "marble"] {
            let media = vec![crate::forms::test_scene::medium(material)];
            let [found, expected] = [&mut on as &mut dyn Evaluator, &mut cpu].map(|evaluator| {
                evaluator.set_media(media.clone()).unwrap();
                evaluator.radiosity(&Silent).unwrap()
            });
            let error = vertex_error(&found, &expected, &areas);
            println!("{sampling:?}, {}, {material}: {:.1e}", light.kind().name(), error.rms);
            assert!(error.rms < *most, "{sampling:?}, {material}: {error:?}");
        }
    }
}

/// Shadows that are kept are those that the processor keeps.
#[test]
fn lights_that_move_keep_the_same() {
    let Some(device) = device() else { return };
    let scene = bumpy("skin1");
    let (mut cpu, mut on) = pair(&device, &scene, Sampling::Clusters, &turned(0));
    for frame in 1..6 {
        let [found, expected] = [&mut on as &mut dyn Evaluator, &mut cpu].map(|evaluator| {
            evaluator.move_lights(vec![turned(frame)], &Silent).unwrap();
            evaluator.radiosity(&Silent).unwrap()
        });
        let error = vertex_error(&found, &expected, &scene.vertex_areas_mm2());
        println!("{frame}: {:.1e}", error.rms);
        assert!(error.rms < 1e-5, "{frame}: {error:?}");
    }
}
