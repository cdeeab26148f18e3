//! The error ledger to the digit: what is measured is what is written, summed and read again.
#![allow(clippy::unwrap_used, missing_docs)]

use glam::DVec3;
use translux::asset::Asset;
use translux::compress::ledger::Ledger;
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::math::statistics::{VertexError, vertex_error};

use crate::baked;
use crate::in_memory::scene;

/// Three vertices of unlike areas, one channel brighter by a tenth: figures by hand.
fn by_hand() -> VertexError {
    let reference = [DVec3::new(1.0, 2.0, 0.5), DVec3::new(2.0, 1.0, 0.5), DVec3::new(3.0, 4.0, 0.5)];
    let values = reference.map(|b| b * DVec3::new(1.0, 1.1, 1.0));
    let error = vertex_error(&values, &reference, &[1.0, 2.0, 1.0]);
    // Green alone is off: mean squares of 22 / 4, of its difference a hundredth of that; mean difference 0.1 * 8 / 4.
    let unit = (22.0_f64 / 4.0).sqrt();
    for (found, expected) in
        [(error.rms, 0.1), (error.bias, 0.2 / unit), (error.p999, 0.4 / unit), (error.worst, 0.4 / unit)]
    {
        assert!((found - expected).abs() < 1e-12, "{error:?}: {found} where {expected} is right");
    }
    error
}

#[test]
fn a_ledger_says_what_it_was_told_before_and_after_its_file() {
    let told = by_hand();
    let mut ledger = Ledger::default();
    for stage in ["hierarchy", "coding", "visibility", "single scattering"] {
        ledger.add(stage, told, "by hand");
    }
    assert!(ledger.entries.iter().all(|e| e.error == told && e.note == "by hand"), "{ledger:?}");
    // Single scattering stands beside the radiosity; visibility is only for environments.
    assert!((ledger.total_rms() - 0.3).abs() < 1e-12, "{}", ledger.total_rms());
    assert!((ledger.total_rms_without_environment() - 0.2).abs() < 1e-12);
    let mut twice = ledger.clone();
    twice.worst_of(ledger.clone());
    assert_eq!(twice, ledger);

    let ball = scene(shapes::icosphere(5.0, 1), Scale::MillimetresPerUnit(1.0), "marble");
    let mut asset = (*baked::asset("two_pass", &ball, 500, &[])).clone();
    asset.ledger = ledger.clone();
    assert_eq!(Asset::from_bytes(&asset.to_bytes().unwrap()).unwrap().ledger, ledger);
}

/// Of 2000 vertices that are off by 1 to 2000 parts in a million, in no order, two are above the 99.9th percentile.
#[test]
fn the_999th_thousandth_and_factors_are_exact() {
    let reference = vec![DVec3::ONE; 2000];
    let parts = (0..2000).map(|i| f64::from(1 + i * 7 % 2000));
    let values: Vec<DVec3> = parts.map(|parts| DVec3::splat(1.0 + 1e-6 * parts)).collect();
    let error = vertex_error(&values, &reference, &vec![1.0; 2000]);
    assert!((error.p999 - 1998e-6).abs() < 1e-12 && (error.worst - 2000e-6).abs() < 1e-12, "{error:?}");
    let figures = |e: VertexError| [e.rms, e.bias, e.p999, e.worst, e.dark];
    let error = VertexError { dark: 0.25, ..error };
    for (found, before) in figures(error.scaled(2.5)).into_iter().zip(figures(error)) {
        assert!((found - 2.5 * before).abs() < 1e-15, "{found} of {before}");
    }
}
