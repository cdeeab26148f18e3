//! Compute shaders against the CPU, both reading the same quantised asset: every method, every kind of light, materials
//! edited, bindings as small as adapters have them.
#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, missing_docs)]

mod in_memory;
mod oracle;

use std::sync::Arc;

use glam::DVec3;
use in_memory::{medium, scene_of, try_bake};
use translux::asset::Asset;
use translux::error::ExitCode;
use translux::evaluate::Evaluator;
use translux::evaluate::device::Device;
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::geometry::source::SourceModel;
use translux::light::{Light, sky};
use translux::methods::{self, ALL};
use translux::progress::Silent;
use translux::transport::scene::Scene;

/// Relative RMS, and the worst vertex over the RMS, that single precision may cost.
const RMS: f64 = 1e-5;
const WORST: f64 = 1e-3;

/// The adapter, or a line that says why the test is skipped.
fn device(largest_binding: u64) -> Option<Arc<Device>> {
    match Device::open_limited(largest_binding) {
        Ok(device) => Some(device),
        Err(e) => {
            assert_eq!(e.code(), ExitCode::Unsupported);
            assert!(e.message().contains("--device cpu"), "{e}");
            println!("SKIPPED: {e}");
            None
        }
    }
}

fn called(mut model: SourceModel, name: &str) -> SourceModel {
    model.materials = vec![name.to_owned()];
    model
}

/// Two bodies of unlike media, and a slab that only casts shadows.
fn group() -> Scene {
    let wax = called(shapes::bumpy_head(8.0, 3), "wax");
    let soap = called(shapes::icosphere(5.0, 1), "soap");
    let slab = called(shapes::cuboid(DVec3::new(30.0, 1.0, 20.0), 3), "slab");
    let place = [DVec3::ZERO, DVec3::new(14.0, 1.0, 3.0), DVec3::new(6.0, -11.0, 0.0)];
    let model = shapes::compose(&[(wax, place[0]), (soap, place[1]), (slab, place[2])]);
    scene_of(model, Scale::MillimetresPerUnit(1.0), &[("wax", "marble"), ("soap", "skin1")])
}

fn lights() -> Vec<Vec<Light>> {
    let directional = Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap();
    let point = Light::point(DVec3::new(-20.0, 25.0, 20.0), DVec3::new(900.0, 800.0, 1e3)).unwrap();
    let area = Light::area(DVec3::new(20.0, 20.0, -15.0), DVec3::new(-1.0, -1.0, 0.7), [9.0, 6.0], DVec3::ONE, None);
    let sky = Light::environment(Arc::new(sky::sky()), 40.0, DVec3::ONE).unwrap();
    let constant = Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap();
    vec![vec![directional.clone()], vec![point, constant], vec![area.unwrap()], vec![sky, directional]]
}

#[track_caller]
fn assert_same(what: &str, gpu: &[DVec3], cpu: &[DVec3]) {
    assert_eq!(gpu.len(), cpu.len());
    for channel in 0..3 {
        let rms = (cpu.iter().map(|b| b[channel] * b[channel]).sum::<f64>() / cpu.len() as f64).sqrt();
        let differences: Vec<f64> = gpu.iter().zip(cpu).map(|(a, b)| (a[channel] - b[channel]).abs() / rms).collect();
        let off = (differences.iter().map(|d| d * d).sum::<f64>() / cpu.len() as f64).sqrt();
        let worst = differences.iter().copied().fold(0.0, f64::max);
        assert!(off < RMS && worst < WORST, "{what}, channel {channel}: RMS {off:.2e}, worst {worst:.2e}");
    }
}

/// Both evaluators of one asset.
fn pair(asset: &Arc<Asset>, device: &Arc<Device>) -> [Box<dyn Evaluator>; 2] {
    let open = || methods::named(&asset.provenance.method).unwrap().open(Arc::clone(asset)).unwrap();
    [open(), open().on_device(device).unwrap()]
}

#[test]
fn every_method_gives_the_same_radiosity_under_every_light() {
    let Some(device) = device(u64::MAX) else { return };
    for method in ALL {
        let asset = Arc::new(try_bake(method, group(), Some(2000), &[]).unwrap());
        let [mut cpu, mut gpu] = pair(&asset, &device);
        assert_eq!(cpu.capabilities(), gpu.capabilities());
        for (index, lights) in lights().into_iter().enumerate() {
            let radiosity = |evaluator: &mut dyn Evaluator| {
                evaluator.set_lights(lights.clone(), &Silent).unwrap();
                evaluator.radiosity(&Silent).unwrap()
            };
            let (gpu, cpu) = (radiosity(gpu.as_mut()), radiosity(cpu.as_mut()));
            assert!(cpu.iter().any(|b| b.min_element() > 0.0));
            assert_same(&format!("{}, lights {index}", method.name()), &gpu, &cpu);
        }
        // A material of the same index of refraction, and one of another, under the light in force.
        for media in [["skin1", "wholemilk"], ["spectralon", "marble"]] {
            let media: Vec<_> = media.map(medium).into();
            let mut edited = media.clone();
            edited[1].properties.eta_inside_over_outside = 1.2;
            for media in [media, edited] {
                let radiosity = |evaluator: &mut dyn Evaluator| {
                    evaluator.set_media(media.clone()).unwrap();
                    evaluator.radiosity(&Silent).unwrap()
                };
                let (gpu, cpu) = (radiosity(gpu.as_mut()), radiosity(cpu.as_mut()));
                assert_same(&format!("{}, edited", method.name()), &gpu, &cpu);
            }
        }
        let (mut a, mut b) = (gpu.all_pairs(&Silent).unwrap(), cpu.all_pairs(&Silent).unwrap());
        assert_same(&format!("{}, all pairs", method.name()), &a, &b);
        gpu.set_lights(Vec::new(), &Silent).unwrap();
        (a, b) = (gpu.radiosity(&Silent).unwrap(), vec![DVec3::ZERO; b.len()]);
        assert_eq!(a, b, "{}: the dark", method.name());
    }
}

#[test]
fn small_bindings_give_the_same_radiosity_or_a_clear_refusal() {
    let (Some(whole), Some(small)) = (device(u64::MAX), device(240 << 10)) else { return };
    for method in ALL {
        let asset = Arc::new(try_bake(method, group(), Some(2000), &[]).unwrap());
        let radiosity = |device: &Arc<Device>| {
            let [_, mut gpu] = pair(&asset, device);
            gpu.set_lights(lights().remove(3), &Silent).unwrap();
            gpu.radiosity(&Silent).unwrap()
        };
        assert_same(method.name(), &radiosity(&small), &radiosity(&whole));
    }
    let Some(tiny) = device(32 << 10) else { return };
    let asset = Arc::new(try_bake(ALL[0], group(), Some(2000), &[]).unwrap());
    let evaluator = methods::named(&asset.provenance.method).unwrap().open(asset).unwrap();
    let error = evaluator.on_device(&tiny).err().unwrap();
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert!(error.message().contains("KiB") && error.message().contains("--device cpu"), "{error}");
}

#[test]
fn lights_of_any_size_keep_their_precision() {
    let Some(device) = device(u64::MAX) else { return };
    for method in ALL {
        let asset = Arc::new(try_bake(method, group(), Some(2000), &[]).unwrap());
        let [_, mut gpu] = pair(&asset, &device);
        let mut lit = |scale: f64| {
            let light = Light::directional(DVec3::ONE, DVec3::splat(scale)).unwrap();
            gpu.set_lights(vec![light], &Silent).unwrap();
            gpu.radiosity(&Silent).unwrap()
        };
        let one = lit(1.0);
        for scale in [1e-30, 1e30] {
            let scaled: Vec<DVec3> = lit(scale).into_iter().map(|b| b / scale).collect();
            assert_same(&format!("{}, {scale:e}", method.name()), &scaled, &one);
        }
    }
}
