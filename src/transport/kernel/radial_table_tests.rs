use glam::DVec3;

use super::*;
use crate::math::random::uniform;
use crate::math::simd::InstructionSet;
use crate::medium::material::PRESETS;
use crate::medium::profiles::model::ProfileModel;
use crate::transport::kernel::FlatSource;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::test_scene::block_of;

fn profiles(model: &str, material: usize) -> [Arc<dyn Profile>; 3] {
    let channels = ProfileModel::parse(model).unwrap().channels(&PRESETS[material].properties()).unwrap();
    channels.map(Arc::from)
}

const MODELS: [&str; 6] = ["dipole", "better-dipole", "photon-beam", "burley", "slab:thickness=2", "gaussians:skin"];

fn receivers(count: u64) -> Vec<DVec3> {
    (0..count).map(|i| DVec3::from([0, 1, 2].map(|c| 2.0 * uniform(1, i, c) - 1.0))).collect()
}

#[test]
fn points_are_those_of_the_profile() {
    for model in MODELS {
        for material in [0, 5, 11] {
            let profiles = profiles(model, material);
            let kernel = MediumKernel::of_profiles(profiles.clone(), 40.0);
            let at = receivers(16);
            for distance in [0.05, 0.5, 3.0, 12.0] {
                let mut block = block_of(DVec3::ZERO, &at);
                let source = PointSource { at: [distance, 0.0, 0.0], flux: [1.0, 2.0, 3.0] };
                kernel.add_points(InstructionSet::detect(), &mut block, &[source]);
                for (i, receiver) in at.iter().enumerate() {
                    let r = (*receiver - DVec3::X * f64::from(distance)).length();
                    for (c, profile) in profiles.iter().enumerate() {
                        let exact = (c + 1) as f64 * profile.reflectance(r);
                        let total = profile.total() / (r * r).max(1e-6);
                        let found = block.sum(i)[c];
                        assert!((found - exact).abs() < 1.5e-3 * exact + 1e-6 * total, "{model} {r}: {found} {exact}");
                    }
                }
            }
        }
    }
}

#[test]
fn triangles_are_those_of_the_profile() {
    let corners = [DVec3::new(0.1, 0.0, -0.2), DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.3, 0.7, 0.1)];
    for model in MODELS {
        for (material, size) in [(0, 1.0), (5, 0.2), (5, 4.0), (11, 0.5)] {
            let profiles = profiles(model, material);
            let kernel = MediumKernel::of_profiles(profiles.clone(), 40.0);
            let corners = corners.map(|c| size * c);
            // On it, at a corner, above it and beside it.
            let inside = (corners[0] + corners[1] + corners[2]) / 3.0;
            let mut at = vec![inside, corners[0], inside + 0.3 * size * DVec3::Z, corners[1] * 1.5];
            at.extend(receivers(8).into_iter().map(|p| size * p));
            let mut block = block_of(DVec3::ZERO, &at);
            let source = FlatSource::new(corners, [1.0; 3], DVec3::ZERO).unwrap();
            kernel.add_triangles(InstructionSet::detect(), &mut block, &[source]);
            for (i, receiver) in at.iter().enumerate() {
                for (c, profile) in profiles.iter().enumerate() {
                    let (exact, found) = (profile.triangle(*receiver, corners), block.sum(i)[c]);
                    let tolerance = 2e-3 * exact + 1e-4 * profile.total();
                    assert!((found - exact).abs() < tolerance, "{model} {material} {size} {i} {c}: {found} {exact}");
                }
            }
        }
    }
}

#[test]
fn all_levels_give_the_same_bits() {
    let kernel = MediumKernel::of_profiles(profiles("burley", 3), 40.0);
    let corners = [DVec3::new(0.1, 0.0, -0.2), DVec3::new(0.9, 0.1, 0.0), DVec3::new(0.3, 0.7, 0.1)];
    let at = receivers(20);
    let sums = |level: InstructionSet| {
        let mut block = block_of(DVec3::ZERO, &at);
        let points: Vec<PointSource> =
            receivers(50).iter().map(|p| PointSource { at: p.as_vec3().to_array(), flux: [0.3, 0.2, 0.1] }).collect();
        kernel.add_points(level, &mut block, &points);
        kernel.add_triangles(level, &mut block, &[FlatSource::new(corners, [1.0; 3], DVec3::ZERO).unwrap()]);
        (0..at.len()).map(|i| block.sum(i)).collect::<Vec<DVec3>>()
    };
    let expected = sums(InstructionSet::Baseline);
    assert!(InstructionSet::available().into_iter().all(|level| sums(level) == expected));
}

#[test]
fn strange_profiles_and_distances_are_finite() {
    struct Odd(f64, f64);
    impl Profile for Odd {
        fn reflectance(&self, _: f64) -> f64 {
            self.0
        }
        fn tail(&self, _: f64) -> f64 {
            self.1
        }
        fn triangle(&self, _: DVec3, _: [DVec3; 3]) -> f64 {
            0.0
        }
    }
    for (value, tail) in [(0.0, 0.0), (f64::INFINITY, 1.0), (f64::NAN, f64::NAN), (1e300, 1e300), (-1.0, -1.0)] {
        for reach in [0.0, 1e-9, 1.0, 1e9, f64::INFINITY, f64::NAN] {
            let odd: [Arc<dyn Profile>; 3] = [0, 1, 2].map(|_| Arc::new(Odd(value, tail)) as Arc<dyn Profile>);
            let kernel = MediumKernel::of_profiles(odd, reach);
            let mut block = block_of(DVec3::ZERO, &receivers(16));
            let far = PointSource { at: [1e9, 0.0, 0.0], flux: [1.0; 3] };
            let near = PointSource { at: [0.0; 3], flux: [1.0; 3] };
            kernel.add_points(InstructionSet::detect(), &mut block, &[near, far]);
            assert!((0..16).all(|i| block.sum(i).is_finite() && block.sum(i).min_element() >= 0.0), "{value} {reach}");
        }
    }
}

#[test]
fn short_segments_follow_smooth_functions() {
    for (scale, reach) in [(2.0, 2.0), (1.0, 12.0)] {
        let value = |c: usize, r2: f64| (c + 1) as f64 / (r2 + scale * scale).powi(2);
        let table = SmoothTable::new(scale, reach, value);
        for i in 0..1000 {
            let r2 = reach * reach * (f64::from(i) + 0.5) / 1000.0;
            let found = table.at_square(r2 as f32);
            for (c, &found) in found.iter().enumerate().take(3) {
                let exact = value(c, r2);
                assert!((f64::from(found) - exact).abs() < 3e-5 * exact, "{r2}: {found} {exact}");
            }
        }
        assert_eq!(table.at_square(9.0 * (reach * reach) as f32), [0.0; 4]);
    }
}
