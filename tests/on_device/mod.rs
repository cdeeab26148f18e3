//! What tests of compute shaders share: the adapter, lights of every kind, and what single precision may cost.
#![allow(clippy::unwrap_used, missing_docs, dead_code, unreachable_pub)]

use std::sync::Arc;

use glam::DVec3;
use translux::error::ExitCode;
use translux::evaluate::device::Device;
use translux::light::{Light, sky};

/// Relative RMS, and the worst vertex over the RMS, that single precision may cost.
const RMS: f64 = 1e-5;
const WORST: f64 = 1e-3;

/// The adapter, or a line that says why the test is skipped.
pub fn device(largest_binding: u64) -> Option<Arc<Device>> {
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

/// All kinds of light, as far away as methods ask for that quantise their distance.
pub fn lights() -> Vec<Vec<Light>> {
    let directional = Light::directional(DVec3::new(1.0, 2.0, 3.0), DVec3::new(3.0, 2.0, 1.0)).unwrap();
    let point = Light::point(DVec3::new(-20.0, 25.0, 20.0), DVec3::new(900.0, 800.0, 1e3)).unwrap();
    let area = Light::area(DVec3::new(28.0, 28.0, -22.0), DVec3::new(-1.0, -1.0, 0.7), [9.0, 6.0], DVec3::ONE, None);
    let sky = Light::environment(Arc::new(sky::sky()), 40.0, DVec3::ONE).unwrap();
    let constant = Light::constant(DVec3::new(0.5, 0.6, 0.7)).unwrap();
    vec![vec![directional.clone()], vec![point, constant], vec![area.unwrap()], vec![sky, directional]]
}

/// Fails where two radiosities differ by more than single precision costs.
#[track_caller]
pub fn assert_same(what: &str, gpu: &[DVec3], cpu: &[DVec3]) {
    assert_eq!(gpu.len(), cpu.len());
    for channel in 0..3 {
        let rms = (cpu.iter().map(|b| b[channel] * b[channel]).sum::<f64>() / cpu.len() as f64).sqrt();
        let differences: Vec<f64> = gpu.iter().zip(cpu).map(|(a, b)| (a[channel] - b[channel]).abs() / rms).collect();
        let off = (differences.iter().map(|d| d * d).sum::<f64>() / cpu.len() as f64).sqrt();
        let worst = differences.iter().copied().fold(0.0, f64::max);
        assert!(off < RMS && worst < WORST, "{what}, channel {channel}: RMS {off:.2e}, worst {worst:.2e}");
    }
}
