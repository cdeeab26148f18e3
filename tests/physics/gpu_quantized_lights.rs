//! `quantized_lights` in compute shaders against the CPU: every kind of light and interpolation, bindings so small that rows and
//! weights are cut, lights of any size, and the stage alone with odd sizes.
#![cfg(feature = "gpu")]
#![allow(clippy::unwrap_used, missing_docs)]

use std::sync::Arc;

use crate::baked;
use crate::in_memory::{lit, medium, registry};
use crate::on_device::{assert_same, device, lights};
use glam::DVec3;
use translux::asset::Asset;
use translux::error::ExitCode;
use translux::evaluate::Evaluator;
use translux::evaluate::device::interpolated::{InterpolatedOnDevice, Sum};
use translux::evaluate::{DeviceEvaluator, device::Device};
use translux::geometry::scattered::Weights;
use translux::light::Light;
use translux::math::random::uniform;
use translux::progress::Silent;
use translux::transport::interpolation::SharedWeights;

fn bake(interpolation: &str) -> Arc<Asset> {
    baked::asset("quantized_lights", &baked::group(), 2000, &["lights=60", &format!("interpolation={interpolation}")])
}

fn on_cpu(asset: &Arc<Asset>) -> Box<dyn Evaluator> {
    registry().open(Arc::clone(asset)).unwrap()
}

fn on(asset: &Arc<Asset>, device: &Arc<Device>) -> Box<dyn DeviceEvaluator> {
    on_cpu(asset).on_device(device).unwrap()
}

#[test]
fn radiosity_is_that_of_the_cpu_under_every_light() {
    let Some(device) = device(u64::MAX) else { return };
    for interpolation in ["rbf", "nearest4"] {
        let asset = bake(interpolation);
        let (mut cpu, mut gpu) = (on_cpu(&asset), on(&asset, &device));
        assert_eq!((cpu.capabilities(), cpu.cost()), (gpu.capabilities(), gpu.cost()));
        for (index, lights) in lights().into_iter().enumerate() {
            let (gpu, cpu) = (lit(gpu.as_mut(), lights.clone()), lit(cpu.as_mut(), lights));
            assert!(cpu.iter().any(|b| b.min_element() > 0.0));
            assert_same(&format!("{interpolation}, lights {index}"), &gpu, &cpu);
        }
        let (found, expected) = (gpu.all_pairs(&Silent).unwrap(), cpu.all_pairs(&Silent).unwrap());
        assert_same("all pairs", &found, &expected);
        assert_eq!(gpu.measured_error(&[], &Silent).unwrap(), cpu.measured_error(&[], &Silent).unwrap());
        let dark = lit(gpu.as_mut(), Vec::new());
        assert_eq!(dark, vec![DVec3::ZERO; dark.len()]);
    }
}

#[test]
fn what_is_refused_changes_nothing() {
    let Some(device) = device(u64::MAX) else { return };
    let asset = bake("rbf");
    let mut gpu = on(&asset, &device);
    let before = lit(gpu.as_mut(), lights().remove(0));
    let media = gpu.scene().media.clone();
    gpu.set_media(media).unwrap();
    let error = gpu.set_media(["skin1", "wholemilk"].map(medium).into()).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported);
    let inside = Light::point(DVec3::new(9.0, 9.0, 9.0), DVec3::ONE).unwrap();
    let error = gpu.set_lights(vec![inside], &Silent).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert_eq!(gpu.radiosity(&Silent).unwrap(), before);
}

#[test]
fn small_bindings_give_the_same_radiosity_or_a_clear_refusal() {
    let (Some(whole), Some(small)) = (device(u64::MAX), device(16 << 10)) else { return };
    let asset = bake("rbf");
    let radiosity = |device: &Arc<Device>| lit(on(&asset, device).as_mut(), lights().remove(3));
    assert_eq!(radiosity(&small), radiosity(&whole), "the same sums, whatever they are bound with");
    let Some(tiny) = device(4 << 10) else { return };
    let error = on_cpu(&asset).on_device(&tiny).err().unwrap();
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert!(error.message().contains("KiB") && error.message().contains("--device cpu"), "{error}");
}

#[test]
fn lights_of_any_size_keep_their_precision() {
    let asset = bake("rbf");
    let mut evaluators = vec![on_cpu(&asset)];
    evaluators.extend(device(u64::MAX).map(|device| -> Box<dyn Evaluator> { on(&asset, &device) }));
    for evaluator in &mut evaluators {
        let mut under =
            |scale: f64| lit(evaluator.as_mut(), vec![Light::directional(DVec3::ONE, DVec3::splat(scale)).unwrap()]);
        for scale in [1e-200f64, 1e-30, 1e30, 1e36] {
            // The same digits, near 1: bits of the same sums, if the size of the light costs nothing.
            let near = scale / scale.log2().floor().exp2();
            let [scaled, same]: [Vec<DVec3>; 2] =
                [scale, near].map(|scale| under(scale).into_iter().map(|b| b / scale).collect());
            let largest = same.iter().map(|b| b.max_element()).fold(0.0, f64::max);
            let off = scaled.iter().zip(&same).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
            assert!(largest > 0.0 && off < 1e-12 * largest, "{scale:e}: {off:e} of {largest}");
        }
    }
}

/// Weights of `each` sources of so many, for some targets.
fn weights(targets: u64, each: u64, sources: u64) -> SharedWeights {
    let all = 0..targets * each;
    SharedWeights::new(&Weights {
        each: each as usize,
        sources: all.clone().map(|i| (uniform(3, i, 0) * sources as f64) as u32).collect(),
        values: all.map(|i| (uniform(3, i, 1) - 0.3) as f32).collect(),
    })
}

#[test]
fn products_of_any_size_are_interpolated() {
    // Bindings for everything at once, and for a tenth of the longest rows and weights.
    for largest_binding in [u64::MAX, 20 << 10] {
        let Some(device) = device(largest_binding) else { return };
        products_are_interpolated(&device);
    }
}

fn products_are_interpolated(device: &Arc<Device>) {
    // Columns that do not fill a turn; rows and runs that do not fill a workgroup; sources without a row; nothing at all.
    let sizes = [(48, 5, 17, 9), (2, 1, 1, 1), (32, 33, 100, 33), (94, 700, 1000, 700), (16, 0, 20, 4), (0, 0, 20, 4)];
    for (width, rows, targets, sources) in sizes.into_iter().chain([(0, 0, 0, 0)]) {
        let coefficient = |i: u64| (65_535.0 * uniform(1, i, 0) - 32_768.0) as i16;
        let coefficients: Vec<i16> = (0..width * rows).map(coefficient).collect();
        let columns = [0, 1, 2].map(|c| (0..width).map(|i| (uniform(2, i, c) - 0.5) as f32).collect::<Vec<f32>>());
        let weights = weights(targets, 4, sources);
        let on_device = InterpolatedOnDevice::new(device, &coefficients, width as usize, &weights).unwrap();
        // The same light twice, a quarter of it and the rest.
        let [some, rest] = [0.25, 0.75].map(|factor| vec![factor; rows as usize]);
        on_device.add(&columns, &[], Sum::New).unwrap();
        on_device.add(&columns, &some, Sum::New).unwrap();
        on_device.add(&columns, &rest, Sum::Added).unwrap();
        on_device.interpolate().unwrap();
        let bytes = device.read(on_device.radiosity(), 16 * targets).unwrap();
        let found: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&bytes);
        let product = |row: &[i16]| {
            let sum = |c: usize| row.iter().zip(&columns[c]).map(|(v, w)| f64::from(*v) * f64::from(*w)).sum::<f64>();
            [sum(0) as f32, sum(1) as f32, sum(2) as f32, 0.0]
        };
        let products: Vec<[f32; 4]> = coefficients.chunks_exact(width.max(1) as usize).map(product).collect();
        let mut expected = Vec::new();
        weights.apply(&products, &mut expected);
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            for (a, b) in found.iter().zip(expected) {
                assert!((a - b).abs() <= 0.05 + 1e-5 * b.abs(), "{width} x {rows}: {a} {b}");
            }
        }
        let error = on_device.add(&[0, 1, 2].map(|_| vec![0.0; width as usize + 1]), &[], Sum::New);
        assert_eq!(error.unwrap_err().code(), ExitCode::Runtime);
        let error = on_device.add(&columns, &vec![1.0; rows as usize + 1], Sum::New);
        assert_eq!(error.unwrap_err().code(), ExitCode::Runtime);
    }
    let error = InterpolatedOnDevice::new(device, &[0; 9], 3, &weights(4, 2, 3)).err().unwrap();
    assert_eq!(error.code(), ExitCode::Runtime);
}
