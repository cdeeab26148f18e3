use super::*;
use crate::geometry::shapes;
use crate::light::harmonics::to_harmonics;
use crate::math::cube_map::{direction, solid_angles_sr};
use crate::math::sh::real_sh;
use crate::medium::fresnel;
use crate::progress::Silent;
use crate::transport::test_scene::{Fixture, named};

#[test]
fn texels_are_the_visible_share_of_the_irradiance() {
    let fixture = Fixture::knot(70);
    let surface = fixture.surface();
    let baker = TexelBaker::new(&surface, Resolution::Sub64);
    let eta = fixture.eta();
    let mut visited = Vec::new();
    baker.visit(3..70, |sample, row| {
        visited.push(sample);
        let observer = Observer::of(&fixture.scene.mesh, fixture.samples.patch(sample));
        for (texel, value) in row.values.iter().enumerate().step_by(37) {
            let (face, y, x) = (texel / 1024, texel / 32 % 32, texel % 32);
            let mut expected = 0.0;
            for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let w = direction(64, face, 2 * x + dx, 2 * y + dy);
                let mu = observer.normal.dot(w);
                if mu > 0.0 && !fixture.bvh.occluded(&observer.ray(w), observer.triangle) {
                    expected += 0.25 * mu * fresnel::transmittance(eta, mu);
                }
            }
            // A sub-texel at an edge may be decided otherwise.
            assert!((f64::from(*value) - expected).abs() < 0.26, "{sample} {texel}: {value} {expected}");
            if !row.lit[face] {
                assert_eq!(*value, 0.0);
            }
        }
    });
    assert_eq!(visited, (3..70).collect::<Vec<_>>());
}

#[test]
fn harmonics_are_sums_over_texels_whatever_the_batch() {
    let fixture = Fixture::knot(131);
    let surface = fixture.surface();
    for (resolution, order) in [(Resolution::Sub64, 6), (Resolution::Sub128, 3)] {
        let baker = TexelBaker::new(&surface, resolution);
        let found = baker.harmonics(order, &Silent);
        assert_eq!((found.lights, found.values.len()), (order * order, 131 * order * order));
        let side = baker.side();
        let angles = solid_angles_sr(side);
        baker.visit(0..131, |sample, row| {
            for k in [0, 1, order * order - 1] {
                let mut expected = 0.0;
                for (texel, value) in row.values.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                    let (within, face) = (texel % (side * side), texel / (side * side));
                    let mut y = vec![0.0; order * order];
                    real_sh(order, to_harmonics(direction(side, face, within % side, within / side)), &mut y);
                    expected += f64::from(*value) * angles[within] * y[k];
                }
                let found = f64::from(found.values[sample * order * order + k]);
                assert!((found - expected).abs() < 2e-6, "{sample} {k}: {found} {expected}");
            }
        });
        for level in InstructionSet::available() {
            let other = TexelBaker { level, ..TexelBaker::new(&surface, resolution) };
            assert_eq!(other.harmonics(order, &Silent), found);
        }
    }
}

#[test]
fn the_first_harmonic_is_constant_light() {
    for name in ["marble", "skin1"] {
        let fixture = Fixture::new(shapes::icosphere(10.0, 3), named(name), 500);
        let surface = fixture.surface();
        let found = TexelBaker::new(&surface, Resolution::Sub64).harmonics(1, &Silent);
        let eta = fixture.eta();
        // Radiance 1 / sqrt(4 pi).
        let expected = 0.5 * std::f64::consts::PI.sqrt() * fresnel::diffuse_transmittance(eta);
        let worst = found.values.iter().map(|v| (f64::from(*v) / expected - 1.0).abs()).fold(0.0, f64::max);
        println!("{name}: {worst:.2e}");
        assert!(worst < 2e-3, "{worst}");
    }
}

#[test]
fn one_polynomial_holds_the_transmittance_of_an_eta() {
    for (eta, most) in [(0.7, 0.2), (1.0, 1e-6), (1.05, 3e-3), (1.3, 1e-3), (2.0, 1e-3)] {
        let p = polynomial(eta);
        let at = |mu: f64| p.iter().rev().fold(0.0, |sum, c| sum * mu + c) * mu;
        let exact = |mu: f64| fresnel::transmittance(eta, mu) * mu;
        let middles = || (0..1000).map(|i| (f64::from(i) + 0.5) / 1000.0);
        let error: f64 = middles().map(|mu| (at(mu) - exact(mu)).powi(2)).sum();
        let total: f64 = middles().map(|mu| exact(mu).powi(2)).sum();
        let relative = (error / total).sqrt();
        println!("eta {eta}: {relative:.1e}");
        assert!(relative < most, "{eta}: {relative}");
        let (sum, wanted): (f64, f64) = (middles().map(at).sum(), middles().map(exact).sum());
        assert!((sum / wanted - 1.0).abs() < 3e-3, "{eta}: {sum} {wanted}");
    }
}
