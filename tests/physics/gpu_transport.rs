//! Compute shaders against the CPU, both reading the same quantised asset: every method, every kind of light, materials
//! edited, bindings as small as adapters have them.
#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, missing_docs)]

use crate::in_memory;
use std::sync::Arc;

use crate::baked::{group, of_group};
use crate::in_memory::{every, medium, registry, served, try_bake};
use crate::on_device::{assert_same, device, lights};
use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::ExitCode;
use translux::evaluate::device::Device;
use translux::evaluate::{BakeSettings, Evaluator, MaterialEdit, Method, Model};
use translux::light::Light;
use translux::medium::profiles::model::ProfileModel;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::calibration::Walks;

/// Methods whose forms have no shaders.
const WITHOUT_SHADERS: [&str; 2] = ["filtered_normals", "toy_form"];

/// Methods whose textures have more texels than small bindings take, however small the object.
const WITH_TEXTURES: [&str; 1] = ["texture_space"];

/// Every other method.
fn with_shaders() -> Vec<&'static dyn Method> {
    every().into_iter().filter(|method| !WITHOUT_SHADERS.contains(&method.name())).collect()
}

#[test]
fn a_form_without_shaders_says_so() {
    let Some(device) = device(u64::MAX) else { return };
    for name in WITHOUT_SHADERS {
        let evaluator = registry().open(of_group(in_memory::method(name))).unwrap();
        assert_eq!(evaluator.on_device(&device).err().unwrap().code(), ExitCode::Unsupported, "{name}");
    }
}

/// Both evaluators of one asset.
fn pair(asset: &Arc<Asset>, device: &Arc<Device>) -> [Box<dyn Evaluator>; 2] {
    let open = || registry().open(Arc::clone(asset)).unwrap();
    [open(), open().on_device(device).unwrap()]
}

#[test]
fn every_method_gives_the_same_radiosity_under_every_light() {
    let Some(device) = device(u64::MAX) else { return };
    for method in with_shaders() {
        let asset = of_group(method);
        let [mut cpu, mut gpu] = pair(&asset, &device);
        assert_eq!(cpu.capabilities(), gpu.capabilities());
        for (index, lights) in lights().into_iter().enumerate() {
            let lights = served(method, &lights);
            if lights.is_empty() {
                continue;
            }
            let radiosity = |evaluator: &mut dyn Evaluator| {
                evaluator.set_lights(lights.clone(), &Silent).unwrap();
                evaluator.radiosity(&Silent).unwrap()
            };
            let (gpu, cpu) = (radiosity(gpu.as_mut()), radiosity(cpu.as_mut()));
            assert!(cpu.iter().any(|b| b.min_element() > 0.0));
            assert_same(&format!("{}, lights {index}", method.name()), &gpu, &cpu);
        }
        // Materials of the same index of refraction, and others of which one has another, under the light in force.
        let same: Vec<_> = ["skin1", "wholemilk"].map(medium).into();
        let mut other: Vec<_> = ["spectralon", "marble"].map(medium).into();
        other[1].properties.eta_inside_over_outside = 1.2;
        for media in [same, other] {
            if cpu.capabilities().material == MaterialEdit::None {
                let refused = |evaluator: &mut dyn Evaluator| evaluator.set_media(media.clone()).unwrap_err();
                let (gpu, cpu) = (refused(gpu.as_mut()), refused(cpu.as_mut()));
                assert_eq!((gpu.code(), gpu.message()), (ExitCode::Unsupported, cpu.message()));
                continue;
            }
            let radiosity = |evaluator: &mut dyn Evaluator| {
                evaluator.set_media(media.clone()).unwrap();
                evaluator.radiosity(&Silent).unwrap()
            };
            let (gpu, cpu) = (radiosity(gpu.as_mut()), radiosity(cpu.as_mut()));
            assert_same(&format!("{}, edited", method.name()), &gpu, &cpu);
        }
        let (mut a, mut b) = (gpu.all_pairs(&Silent).unwrap(), cpu.all_pairs(&Silent).unwrap());
        assert_same(&format!("{}, all pairs", method.name()), &a, &b);
        gpu.set_lights(Vec::new(), &Silent).unwrap();
        (a, b) = (gpu.radiosity(&Silent).unwrap(), vec![DVec3::ZERO; b.len()]);
        assert_eq!(a, b, "{}: the dark", method.name());
        lights_of_any_size_keep_their_precision(method.name(), gpu.as_mut());
    }
}

fn lights_of_any_size_keep_their_precision(name: &str, gpu: &mut dyn Evaluator) {
    let mut lit = |scale: f64| {
        let light = Light::directional(DVec3::ONE, DVec3::splat(scale)).unwrap();
        gpu.set_lights(vec![light], &Silent).unwrap();
        gpu.radiosity(&Silent).unwrap()
    };
    let one = lit(1.0);
    for scale in [1e-30, 1e30] {
        let scaled: Vec<DVec3> = lit(scale).into_iter().map(|b| b / scale).collect();
        assert_same(&format!("{name}, {scale:e}"), &scaled, &one);
    }
}

/// Sums over nets and through the hierarchy take any radial profile, on a device as on the CPU.
#[test]
fn profiles_have_the_same_sums() {
    let Some(device) = device(u64::MAX) else { return };
    let profiles = ["better-dipole", "gaussians:skin"].map(|text| {
        let model: ProfileModel = text.parse().unwrap();
        model.load().unwrap()
    });
    let tree = Arc::new(try_bake(in_memory::method("two_pass"), group(), Some(500), &[]).unwrap());
    for asset in [of_group(in_memory::method("editable")), tree] {
        let [mut cpu, mut gpu] = pair(&asset, &device);
        for profile in &profiles {
            let radiosity = |evaluator: &mut dyn Evaluator| {
                evaluator.set_profile(profile.clone()).unwrap();
                evaluator.set_lights(lights().remove(1), &Silent).unwrap();
                evaluator.radiosity(&Silent).unwrap()
            };
            assert_same("a profile", &radiosity(gpu.as_mut()), &radiosity(cpu.as_mut()));
        }
    }
}

/// Calibrated kernels have double layers and factors at both ends: over nets where these resolve them, as those of chicken, else
/// through the hierarchy.
#[test]
fn calibrated_kernels_have_the_same_sums() {
    let Some(device) = device(u64::MAX) else { return };
    for (name, media) in [("two_pass", ["skin1", "marble"]), ("editable", ["chicken1", "skin1"])] {
        let method = in_memory::method(name);
        let scene = Scene { media: media.map(medium).into(), ..group() };
        let model = Model::Calibrated(Walks { photons: 2048, ..Walks::default() });
        let probes = in_memory::probes(&scene);
        let settings = BakeSettings { model, probes, samples: Some(500), ..BakeSettings::new(0.05) };
        let asset = method.recipe(&[], settings).unwrap().bake(scene, Provenance::default(), &Silent).unwrap();
        let [mut cpu, mut gpu] = pair(&Arc::new(asset), &device);
        // Kernels do not know the lights: two sets of them, before and after an edit, are enough.
        for (index, lights) in lights().into_iter().enumerate().skip(1).step_by(2) {
            let radiosity = |evaluator: &mut dyn Evaluator| {
                evaluator.set_lights(lights.clone(), &Silent).unwrap();
                if name == "editable" && index == 3 {
                    evaluator.set_media(["marble", "skin1"].map(medium).into()).unwrap();
                }
                evaluator.radiosity(&Silent).unwrap()
            };
            let (gpu, cpu) = (radiosity(gpu.as_mut()), radiosity(cpu.as_mut()));
            assert!(cpu.iter().any(|b| b.min_element() > 0.0));
            assert_same(&format!("{name}, lights {index}"), &gpu, &cpu);
        }
    }
}

#[test]
fn small_bindings_give_the_same_radiosity_or_a_clear_refusal() {
    let (Some(whole), Some(small)) = (device(u64::MAX), device(300 << 10)) else { return };
    for method in with_shaders() {
        let asset = of_group(method);
        if WITH_TEXTURES.contains(&method.name()) {
            assert_refused(&asset, &small);
            continue;
        }
        let radiosity = |device: &Arc<Device>| {
            let [_, mut gpu] = pair(&asset, device);
            gpu.set_lights(lights().remove(3), &Silent).unwrap();
            gpu.radiosity(&Silent).unwrap()
        };
        assert_same(method.name(), &radiosity(&small), &radiosity(&whole));
    }
    let Some(tiny) = device(32 << 10) else { return };
    assert_refused(&of_group(in_memory::method("reference")), &tiny);
}

/// Fails unless the device is said to be too small.
fn assert_refused(asset: &Arc<Asset>, device: &Arc<Device>) {
    let error = registry().open(Arc::clone(asset)).unwrap().on_device(device).err().unwrap();
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert!(error.message().contains("KiB") && error.message().contains("--device cpu"), "{error}");
}
