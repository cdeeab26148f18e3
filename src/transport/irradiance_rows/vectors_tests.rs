use std::sync::Arc;

use glam::DVec3;

use super::*;
use crate::geometry::shapes;
use crate::light::Light;
use crate::light::cube_light::CubeLight;
use crate::light::sky::sky;
use crate::progress::Silent;
use crate::transport::gather::Criterion;
use crate::transport::near_rule::NearField;
use crate::transport::test_scene::{Fixture, named, relative_rms};
use crate::transport::visibility::Resolution;

const ALL: usize = FACES * 32 * 32;
const TREE: Scheme = Scheme::Hierarchical { criterion: Criterion::SolidAngle(0.1) };

fn knot() -> Fixture {
    Fixture::new(shapes::torus_knot(2, 3, 10.0, 4.0, 1.5, 60, 10), named("marble"), 1500)
}

fn lights() -> [Light; 3] {
    [
        Light::environment(Arc::new(sky()), 40.0, DVec3::new(1.0, 0.5, 2.0)).unwrap(),
        Light::Constant { radiance: DVec3::ONE },
        Light::directional(DVec3::new(0.2, 0.9, 0.3), DVec3::ONE).unwrap(),
    ]
}

/// Radiosity that stored vectors give.
fn stored(rows: &IrradianceRows, light: &CubeLight) -> Vec<DVec3> {
    let radiance = light.coefficients();
    let of_row = |row: usize| {
        let (from, end) = (rows.offsets[row] as usize, rows.offsets[row + 1] as usize);
        let sum = |c: usize| {
            let values = &rows.values[3 * from + c * (end - from)..][..end - from];
            let details = rows.indices[from..end].iter().zip(values);
            let details: f64 =
                details.map(|(&i, &v)| f64::from(v) * f64::from(radiance[usize::from(i)][c])).sum::<f64>();
            let first = |face: usize| {
                f64::from(rows.scaling[(row * 3 + c) * FACES + face]) * f64::from(radiance[face * 1024][c])
            };
            let scaling: f64 = (0..FACES).map(first).sum();
            (details * f64::from(rows.steps[row]) + scaling * f64::from(rows.scaling_steps[row])) * light.scale()
        };
        DVec3::new(sum(0), sum(1), sum(2))
    };
    (0..rows.patches()).map(of_row).collect()
}

/// The irradiance under the same light by sampling it.
fn gathered(
    gather: &Gather,
    rows: &SparseRows,
    receivers: &Receivers,
    light: &CubeLight,
    scheme: Scheme,
) -> Vec<DVec3> {
    let of_channel = [0, 1, 2].map(|c| rows.under(light.coefficients(), c));
    let irradiance: Vec<DVec3> =
        (0..rows.len()).map(|i| DVec3::from([0, 1, 2].map(|c: usize| of_channel[c][i])) * light.scale()).collect();
    gather.radiosity(receivers, &gather.light(&irradiance), scheme, &Silent)
}

fn keep(count: usize) -> Selection<'static> {
    Selection { keep: Keep::Largest(count), importance: None }
}

#[test]
fn whole_vectors_are_the_transport_of_the_samples_in_both_transforms() {
    let fixture = knot();
    let surface = fixture.surface();
    let baker = TexelBaker::new(&surface, Resolution::Sub64);
    let receivers = fixture.receivers(16);
    let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, NearField::FAST);
    let mut irradiances = Vec::new();
    for transform in [Transform::SolidAngle, Transform::Texels] {
        let rows = irradiance_rows(&baker, fixture.samples.len(), (transform, ALL), &Silent).unwrap();
        let tree = RowTree::new(&gather, &fixture.tree, &rows, 32, ALL).unwrap();
        for (scheme, most) in [(Scheme::AllPairs, 4e-3), (TREE, 1e-2)] {
            let vectors = tree.vectors(&receivers, scheme, keep(ALL), &Silent).unwrap();
            vectors.validate().unwrap();
            for (index, light) in lights().iter().enumerate() {
                // Under a sun of one texel every coefficient's rounding to 8 bits shows.
                let most = if index == 2 { 3e-2 } else { most };
                let light = CubeLight::transformed(light, 32, transform).unwrap();
                let expected = gathered(&gather, &rows, &receivers, &light, Scheme::AllPairs);
                let error = relative_rms(&stored(&vectors, &light), &expected);
                println!("{transform:?} {scheme:?}: {error:.1e}");
                assert!(error < most, "{error}");
            }
        }
        let light = CubeLight::transformed(&lights()[0], 32, transform).unwrap();
        irradiances.push(rows.under(light.coefficients(), 0).iter().map(|e| e * light.scale()).collect::<Vec<_>>());
    }
    let largest = irradiances[0].iter().fold(0.0f64, |a, e| a.max(*e));
    assert!(irradiances[0].iter().zip(&irradiances[1]).all(|(a, b)| (a - b).abs() < 1e-5 * largest));
}

#[test]
fn errors_fall_with_the_coefficients_of_each_stage() {
    let fixture = knot();
    let surface = fixture.surface();
    let baker = TexelBaker::new(&surface, Resolution::Sub64);
    let receivers = fixture.receivers(16);
    let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, NearField::FAST);
    let light = CubeLight::new(&lights()[0], 32).unwrap();
    let whole = irradiance_rows(&baker, fixture.samples.len(), (Transform::SolidAngle, ALL), &Silent).unwrap();
    let expected = gathered(&gather, &whole, &receivers, &light, Scheme::AllPairs);
    let mut errors = Vec::new();
    for (samples, nodes, kept) in [(64, 64, 64), (128, 128, 128), (256, 256, 256), (ALL, 128, ALL), (ALL, ALL, 128)] {
        let rows = irradiance_rows(&baker, fixture.samples.len(), (Transform::SolidAngle, samples), &Silent).unwrap();
        assert!((0..rows.len()).all(|i| rows.row(i).0.len() <= samples));
        let tree = RowTree::new(&gather, &fixture.tree, &rows, 32, nodes).unwrap();
        let vectors = tree.vectors(&receivers, TREE, keep(kept), &Silent).unwrap();
        assert!(vectors.offsets.windows(2).all(|w| (w[1] - w[0]) as usize <= kept));
        let error = relative_rms(&stored(&vectors, &light), &expected);
        println!("{samples} {nodes} {kept}: {error:.2e}");
        errors.push(error);
    }
    assert!(errors[0] > errors[1] && errors[1] > errors[2] && errors[2] < 0.02, "{errors:?}");
    assert!(errors[3] < errors[1] && errors[4] < errors[1], "{errors:?}");
}

#[test]
fn sums_of_whole_rows_are_exact_and_thresholds_follow_importance() {
    let fixture = knot();
    let surface = fixture.surface();
    let baker = TexelBaker::new(&surface, Resolution::Sub64);
    let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, NearField::FAST);
    let rows = irradiance_rows(&baker, fixture.samples.len(), (Transform::SolidAngle, 200), &Silent).unwrap();
    let tree = RowTree::new(&gather, &fixture.tree, &rows, 32, ALL).unwrap();
    let mut sums = vec![0.0f64; ALL];
    for sample in 0..rows.len() {
        let (places, values) = rows.row(sample);
        for (place, value) in places.iter().zip(values) {
            sums[usize::from(*place)] += f64::from(*value) * fixture.patches[sample].area_mm2;
        }
    }
    let (places, values) = tree.nodes.row(tree.nodes.len() - 1);
    let largest = sums.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    for (place, value) in places.iter().zip(values) {
        assert!((f64::from(*value) - sums[usize::from(*place)]).abs() < 1e-5 * largest);
    }
    let receivers = fixture.receivers(16);
    let mut importance = vec![1.0f32; ALL];
    importance[3 * 1024..].fill(0.0);
    let selection = Selection { keep: Keep::Above(1e-9), importance: Some(&importance) };
    let vectors = tree.vectors(&receivers, TREE, selection, &Silent).unwrap();
    assert!(!vectors.indices.is_empty() && vectors.indices.iter().all(|i| usize::from(*i) < 3 * 1024));
    // Ranges and instructions do not matter.
    let mut narrow = RowTree::new(&gather, &fixture.tree, &rows, 32, ALL).unwrap();
    narrow.level = InstructionSet::Baseline;
    assert_eq!(narrow.vectors(&receivers, TREE, selection, &Silent).unwrap(), vectors);
}
