use glam::DVec3;

use super::*;
use crate::math::random::uniform;
use crate::math::simd::InstructionSet;
use crate::medium::dipole::Dipole;
use crate::medium::far_profile::FarProfile;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::material::PRESETS;
use crate::medium::profile::Profile;
use crate::transport::kernel::medium::MediumKernel;
use crate::transport::kernel::radial_table::QuadraticTable;
use crate::transport::kernel::{FlatSource, PointSource, near};
use crate::transport::test_scene::block_of;

/// The published materials, and media of reduced extinction 1e-3 to 1e3 per mm with and without absorption.
fn media() -> Vec<[Dipole; 3]> {
    let published = PRESETS.iter().map(|p| p.properties().dipoles(BoundaryFit::Published));
    let extremes = [1e-3, 1e-1, 10.0, 1e3].map(|s| [0.0, 1e-3, 1.0].map(|a| Dipole::new(s, a * s, 2.7)));
    published.chain(extremes).collect()
}

fn points_at(level: InstructionSet, kernel: &MediumKernel, distances: &[f64]) -> Vec<DVec3> {
    let receivers: Vec<DVec3> = distances.iter().map(|&r| DVec3::new(0.6, 0.0, 0.8) * r).collect();
    let mut block = block_of(DVec3::ZERO, &receivers);
    kernel.add_points(level, &mut block, &[PointSource { at: [0.0; 3], flux: [1.0; 3] }]);
    (0..receivers.len()).map(|i| block.sum(i)).collect()
}

fn triangles_at(level: InstructionSet, kernel: &MediumKernel, corners: [DVec3; 3], receivers: &[DVec3]) -> Vec<DVec3> {
    let centre = receivers.iter().sum::<DVec3>() / receivers.len() as f64;
    let mut block = block_of(centre, receivers);
    let sources: Vec<FlatSource> = FlatSource::new(corners, [1.0; 3], centre).into_iter().collect();
    kernel.add_triangles(level, &mut block, &sources);
    (0..receivers.len()).map(|i| block.sum(i)).collect()
}

#[test]
fn exponential_is_accurate_to_two_parts_in_ten_million() {
    let mut worst: f64 = 0.0;
    for i in 0..=200_000 {
        let x = 55.0 * f64::from(i) / 200_000.0;
        let x = x as f32;
        // The argument's own rounding costs x / 2^24.
        let exact = (-f64::from(x)).exp();
        let error = (f64::from(exp_neg(x)) / exact - 1.0).abs() / (1.0 + f64::from(x));
        worst = worst.max(error);
    }
    println!("exp: {worst:.2e} per unit of the argument");
    assert!(worst < 2e-7, "{worst:.3e}");
    assert_eq!(exp_neg(0.0), 1.0);
    for x in [87.0, 200.0, 1e6, 1e30, f32::INFINITY] {
        assert!((0.0..1e-24).contains(&exp_neg(x)), "{x}: {}", exp_neg(x));
    }
}

/// Error that the floor of exp(-x), 2^-80, leaves, over a profile's peak.
const FLOOR: f64 = 1e-24;

#[test]
fn points_follow_the_profile_at_every_distance() {
    let distances: Vec<f64> = (0..=360).map(|i| 10f64.powf(-6.0 + f64::from(i) / 40.0)).collect();
    let mut worst: f64 = 0.0;
    for dipoles in media() {
        for (value, r) in
            points_at(InstructionSet::detect(), &MediumKernel::of_dipoles(dipoles), &distances).iter().zip(&distances)
        {
            for c in 0..3 {
                let exact = dipoles[c].reflectance(*r);
                let error = (value[c] - exact).abs();
                let floor = FLOOR * dipoles[c].reflectance(0.0).max(1.0);
                if error > floor {
                    worst = worst.max(error / exact);
                }
                assert!(error <= floor + 1e-5 * exact, "r {r:e}: {} against {exact:e}, {:?}", value[c], dipoles[c]);
            }
        }
    }
    println!("points: {worst:.2e}");
}

#[test]
fn many_sources_add_up_without_drift() {
    let dipoles = PRESETS[5].properties().dipoles(BoundaryFit::Published);
    let sources: Vec<PointSource> = (0..100_000)
        .map(|i| PointSource { at: [0, 1, 2].map(|k| 4.0 * uniform(1, i, k) as f32), flux: [1.0; 3] })
        .collect();
    let receivers: Vec<DVec3> = (0..20).map(|i| DVec3::new(uniform(2, i, 0), uniform(2, i, 1), 0.3)).collect();
    let mut block = block_of(DVec3::ZERO, &receivers);
    MediumKernel::of_dipoles(dipoles).add_points(InstructionSet::detect(), &mut block, &sources);
    for (i, x) in receivers.iter().enumerate() {
        let at = |s: &PointSource| DVec3::from_array(s.at.map(f64::from));
        let exact: f64 = sources.iter().map(|s| dipoles[0].reflectance(at(s).distance(*x))).sum();
        assert!((block.sum(i).x / exact - 1.0).abs() < 1e-6, "{} {exact}", block.sum(i).x);
    }
}

/// Receivers at corners, on edges, inside, beside an edge in the plane, above and below, far away.
fn receivers_of([a, b, c]: [DVec3; 3], z: f64, seed: u64) -> Vec<DVec3> {
    let r = |k: u64| uniform(5, seed, k);
    let normal = (b - a).cross(c - a).normalize();
    let out = (b - a).normalize().cross(normal);
    let edge = a.lerp(b, r(0));
    let inside = a.lerp(b, r(1)).lerp(c, r(2));
    let mut all = vec![a, b, c, edge, a.midpoint(c), inside, (a + b + c) / 3.0];
    for power in -5..=1 {
        let step = z * 10f64.powi(power) * (0.5 + r(3));
        all.extend([edge + out * step, edge - out * step, b + (b - a).normalize() * step]);
        all.extend([edge + normal * step, inside - normal * step, inside + normal * step]);
    }
    all
}

fn shapes() -> [[DVec3; 3]; 5] {
    let p = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let o = DVec3::ZERO;
    [
        [o, p(1.0, 0.0, 0.0), p(0.4, 0.8, 0.1)],
        [o, p(1.0, 0.0, 0.0), p(0.5, 1e-2, 0.0)],
        [o, p(1.0, 0.0, 0.0), p(0.5, 1e-4, 0.0)],
        [o, p(1.0, 0.0, 0.0), p(1.0, 3e-3, 2e-3)],
        [o, p(0.1, 0.0, 0.7), p(0.98, 0.2, 0.1)],
    ]
}

/// Largest error over media, shapes and receivers, of the total reflectance, for triangles of each size in mean free paths.
fn worst_of_triangles(
    sizes: &[f64],
    values: impl Fn(&MediumKernel, [DVec3; 3], DVec3) -> [f64; 3],
    most: f64,
) -> Vec<f64> {
    let mut worst = vec![0.0f64; sizes.len()];
    for (m, dipoles) in media().iter().enumerate() {
        let (kernel, z) = (MediumKernel::of_dipoles(*dipoles), dipoles[1].z_real_mm);
        for (size, worst) in sizes.iter().zip(&mut worst) {
            for (s, shape) in shapes().iter().enumerate() {
                let corners = shape.map(|p| p * (size * z));
                for x in receivers_of(corners, z, (m * 5 + s) as u64) {
                    for (value, dipole) in values(&kernel, corners, x).iter().zip(dipoles) {
                        let exact = dipole.triangle(x, corners);
                        let error = (value - exact).abs() / dipole.total().max(1e-300);
                        *worst = worst.max(error);
                        assert!(error < most, "medium {m}, {size} mfp, shape {s}, at {x}: {value} {exact}");
                    }
                }
            }
        }
    }
    println!("edges of {sizes:?} mean free paths: {worst:?} of the total");
    worst
}

#[test]
fn triangles_follow_the_closed_form_wherever_the_receiver_is() {
    let sizes = [1e-3, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0];
    let values =
        |kernel: &MediumKernel, corners, x| triangles_at(InstructionSet::detect(), kernel, corners, &[x])[0].to_array();
    let worst = worst_of_triangles(&sizes, values, 5e-6);
    assert!(worst[..6].iter().all(|w| *w < 2e-6), "{worst:?}");
}

#[test]
fn near_rules_follow_the_closed_form() {
    let values = |kernel: &MediumKernel, corners: [DVec3; 3], x: DVec3| {
        let (mut flats, mut sums) = (near::Flats::default(), [[0.0; 3]]);
        flats.push(0, corners.map(|c| (c - x).as_vec3().to_array()), [1.0; 3]);
        kernel.add_flats(InstructionSet::detect(), &flats, &mut sums);
        sums[0]
    };
    worst_of_triangles(&[1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0], values, 1e-5);
}

#[test]
fn halves_of_a_triangle_add_up_and_orientation_does_not_matter() {
    let dipoles = PRESETS[8].properties().dipoles(BoundaryFit::Published);
    let kernel = MediumKernel::of_dipoles(dipoles);
    for shape in shapes() {
        let [a, b, c] = shape.map(|p| p * 4.0);
        let m = a.lerp(b, 0.3);
        let receivers = receivers_of([a, b, c], 1.0, 9);
        let of = |t: [DVec3; 3]| triangles_at(InstructionSet::detect(), &kernel, t, &receivers);
        let (whole, left, right, turned) = (of([a, b, c]), of([a, m, c]), of([m, b, c]), of([a, c, b]));
        for i in 0..receivers.len() {
            assert!((whole[i] - left[i] - right[i]).abs().max_element() < 2e-6, "{:?}", receivers[i]);
            assert!((whole[i] - turned[i]).abs().max_element() < 1e-6, "{:?}", receivers[i]);
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    for dipoles in media() {
        let kernel = MediumKernel::of_dipoles(dipoles);
        let z = dipoles[1].z_real_mm;
        let distances: Vec<f64> = (0..100).map(|i| z * 10f64.powf(-3.0 + f64::from(i) / 20.0)).collect();
        let corners = shapes()[0].map(|p| p * z * 5.0);
        let receivers = receivers_of(corners, z, 3);
        let of = |level| (points_at(level, &kernel, &distances), triangles_at(level, &kernel, corners, &receivers));
        let baseline = of(InstructionSet::Baseline);
        for level in InstructionSet::available() {
            assert_eq!(of(level), baseline, "{level:?}");
        }
    }
}

#[test]
fn black_media_return_nothing_and_nothing_is_ever_nan() {
    let black = [Dipole::new(0.0, 1.0, 2.0), Dipole::new(0.0, 0.0, 2.0), Dipole::new(0.0, 1e30, 2.0)];
    let corners = shapes()[0];
    let receivers = receivers_of(corners, 1.0, 1);
    assert!(
        points_at(InstructionSet::detect(), &MediumKernel::of_dipoles(black), &[0.0, 1.0])
            .iter()
            .all(|v| *v == DVec3::ZERO)
    );
    assert!(
        triangles_at(InstructionSet::detect(), &MediumKernel::of_dipoles(black), corners, &receivers)
            .iter()
            .all(|v| *v == DVec3::ZERO)
    );
    for (s, a) in [(1e-30, 1e-30), (1e30, 1e30), (1e30, 1e-30), (1e-30, 1e30), (1e12, 0.0), (1e-12, 1e12), (1.0, 1e9)] {
        let kernel =
            MediumKernel::of_dipoles([Dipole::new(s, a, 1.0), Dipole::new(s, 0.0, 1e6), Dipole::new(a, s, 2.0)]);
        for size in [1e-6, 1.0, 1e6] {
            let corners = corners.map(|p| p * size);
            let receivers = receivers_of(corners, size, 2);
            let values = points_at(InstructionSet::detect(), &kernel, &[0.0, 1e-12, 1.0, 1e12]);
            assert!(values.iter().all(|v| v.is_finite() && v.min_element() >= 0.0), "{s} {a}: {values:?}");
            let values = triangles_at(InstructionSet::detect(), &kernel, corners, &receivers);
            assert!(values.iter().all(|v| v.is_finite()), "{s} {a} {size}: {values:?}");
        }
    }
}

#[test]
fn triangles_without_area_are_no_sources() {
    let p = DVec3::new(1.0, 2.0, 3.0);
    assert!(FlatSource::new([p, p, p], [1.0; 3], DVec3::ZERO).is_none());
    assert!(FlatSource::new([p, 2.0 * p, 3.0 * p], [1.0; 3], DVec3::ZERO).is_none());
    assert!(FlatSource::new([p, DVec3::NAN, 3.0 * p], [1.0; 3], DVec3::ZERO).is_none());
}

/// Points by tables against R_d, and triangles of several receivers side by side against each alone.
#[test]
fn near_points_follow_the_profile_and_lanes_do_not_mix() {
    for dipoles in &media() {
        let z = dipoles[1].z_real_mm;
        let reach = 300.0 * z;
        let whole = dipoles.each_ref().map(|d| FarProfile::new(d, 0.0));
        let table = QuadraticTable::new(z, reach * reach, |c, r2| whole[c].reflectance_at_square(r2));
        for (count, seed) in [(1, 0), (17, 1), (700, 2)] {
            let r2: Vec<f32> = (0..count).map(|i| (reach * uniform(3, seed, i).powi(4)).powi(2) as f32).collect();
            let flux: Vec<[f32; 4]> = (0..count).map(|i| [1.0, 0.5 + i as f32, 2.0, 0.0]).collect();
            let mut expected = [0.0f64; 3];
            for (r2, flux) in r2.iter().zip(&flux) {
                for c in 0..3 {
                    expected[c] += f64::from(flux[c]) * whole[c].reflectance_at_square(f64::from(*r2));
                }
            }
            let (mut points, mut found, mut chosen) = (near::Points::default(), [0.0; 3], [0.0; 3]);
            r2.iter().zip(&flux).for_each(|(r2, &[r, g, b, _])| points.push(*r2, [r, g, b]));
            near::add_points(InstructionSet::detect(), &table, &points, &mut found);
            let indices: Vec<u32> = (0..count as u32).rev().collect();
            near::add_chosen(InstructionSet::detect(), &table, &indices, (&r2, &flux), &mut chosen);
            for c in 0..3 {
                for found in [found[c], chosen[c]] {
                    assert!((found - expected[c]).abs() <= 1e-5 * expected[c].abs(), "{found:e} {:e}", expected[c]);
                }
            }
            for level in InstructionSet::available() {
                let mut again = [0.0; 3];
                near::add_points(level, &table, &points, &mut again);
                assert_eq!(again, found);
            }
        }
    }
    let kernel = MediumKernel::of_dipoles(media()[0]);
    let triangle = |i: usize| shapes()[i % shapes().len()].map(|c| (c + i as f64 * 0.1).as_vec3().to_array());
    let mut together = [[0.0; 3]; 5];
    let mut flats = near::Flats::default();
    (0..40).for_each(|i| flats.push(i as u32 % 5, triangle(i), [1.0, 2.0, 3.0]));
    kernel.add_flats(InstructionSet::detect(), &flats, &mut together);
    for (receiver, together) in together.iter().enumerate() {
        let (mut flats, mut alone) = (near::Flats::default(), [[0.0; 3]]);
        (0..40).filter(|i| i % 5 == receiver).for_each(|i| flats.push(0, triangle(i), [1.0, 2.0, 3.0]));
        kernel.add_flats(InstructionSet::detect(), &flats, &mut alone);
        // Neighbours decide the rule of all, whose error is told of the total and not of what leaves far away; lanes that mix are off by
        // all there is.
        for c in 0..3 {
            assert!((together[c] - alone[0][c]).abs() <= 1e-3 * alone[0][c], "{together:?} {alone:?}");
        }
    }
}
