use std::sync::Arc;

use glam::DVec3;

use super::body::Body;
use super::layers::{Layers, Splines};
use super::surface::CalibratedSurface;
use super::*;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::light::Light;
use crate::math::quadrature::integrate;
use crate::math::random::uniform;
use crate::medium::material::preset;
use crate::transport::irradiance::LightSampling;
use crate::transport::kernel::double_layer::Moment;
use crate::transport::kernel::{Block, FlatSource, PointSource, Receiver};
use crate::transport::many_lights::{IrradianceRows, ManyLights};
use crate::transport::random_walk::exitance::{Effort, exitance};
use crate::transport::random_walk::model_error::compare;
use crate::transport::test_scene::{Fixture, TestScene, named, relative_rms};

const SAMPLING: LightSampling = LightSampling { points_per_patch: 4, directions: 128, area_side: 8 };

fn dipoles(name: &str) -> [crate::medium::dipole::Dipole; 3] {
    preset(name).unwrap().properties().dipoles(BoundaryFit::Published)
}

fn some_layers() -> Layers {
    let splines = Splines::new(0.2, 20.0, 1.6);
    let single = (0..splines.len()).map(|k| 0.7 + 0.05 * k as f64).collect();
    let double = (0..splines.len()).map(|k| 0.4 - 0.06 * k as f64).collect();
    Layers { splines, single, double }
}

/// A slab of 12 triangles, whose large faces would say alone how the normals of its corners stand: its vertices gather what points of the
/// surface there do.
#[test]
fn corners_of_long_triangles_gather_what_the_surface_does_there() {
    let scene = Fixture::new(shapes::cuboid(DVec3::new(20.0, 1.0, 20.0), 1), named("skin1"), 1).scene;
    let domain = scene.domain();
    let calibrated = Calibrated::by_walks(domain, &Bvh::new(&scene.mesh), Walks::default(), &Silent).unwrap();
    let receivers = calibrated.at_vertices(Receivers::new(&scene.mesh, &scene.parts, 16));
    for (triangle, corners) in scene.mesh.triangles.iter().enumerate() {
        let receiver = receivers.of_vertex[corners[0] as usize] as usize;
        let there = calibrated.normal_at(triangle as u32, [0.0, 0.0]);
        assert!(receivers.normals[receiver].distance(there) < 1e-9, "{} {there}", receivers.normals[receiver]);
        assert!(receivers.factors[receiver].distance(calibrated.at(triangle as u32, [0.0, 0.0])) < 1e-9);
    }
}

#[test]
fn splines_are_a_partition_of_one_at_any_distance() {
    let splines = Splines::new(0.3, 40.0, 1.5);
    for r in [0.0, 0.1, 0.3, 0.5, 7.7, 40.0, 1e9, f64::NAN] {
        let (first, values) = splines.at(r);
        assert!(first + values.len() <= splines.len());
        assert!((values.iter().sum::<f64>() - 1.0).abs() < 1e-14 && values.iter().all(|v| *v >= 0.0), "{r} {values:?}");
    }
    assert_eq!(Splines::new(1.0, 1.0, 1.6).intervals, 1);
}

#[test]
fn the_single_layer_is_a_profile_with_its_own_tail() {
    let layers = some_layers();
    for dipole in dipoles("skin1") {
        let profile = layers.profile(&dipole, 30.0).unwrap();
        for r in [0.05, 0.4, 2.0, 9.0] {
            let expected = dipole.reflectance(r) * layers.single(r);
            assert!((profile.reflectance(r) / expected - 1.0).abs() < 2e-3, "{r}");
            let rest = integrate(|x| dipole.reflectance(x) * layers.single(x) * x, r, 200.0, 1e-12);
            assert!((profile.tail(r) - rest).abs() < 1e-3 * profile.tail(0.0), "{r} {} {rest}", profile.tail(r));
        }
    }
}

fn scene_of(source: SourceModel, material: &str) -> TestScene {
    Fixture::new(source, named(material), 64).scene
}

/// A ball of triangles as a scene.
fn ball(radius: f64, material: &str) -> TestScene {
    scene_of(shapes::icosphere(radius, 4), material)
}

#[test]
fn moments_of_a_ball_are_those_of_the_integral() {
    // Chords of a ball are uniform in the square of their length, and heights are -r^2 / radius.
    let scene = ball(8.0, "marble");
    let body = Body::new(scene.domain(), 0, 0.4);
    let profiles = dipoles("marble");
    let splines = Splines::new(0.1, 16.0, 1.6);
    for profile in &profiles {
        let of = pairs::moments(&body, profile, &splines, 1);
        for power in 0..pairs::POWERS {
            let sum: f64 = of
                .iter()
                .flat_map(|entry| entry.iter().enumerate())
                .map(|(j, powers)| powers[power] * if j == 0 { 1.0 } else { 2.0 })
                .sum();
            let height = |r: f64| (-r * r / 8.0 * splines.fade_per_mm(r)).powi(power as i32);
            let integral =
                integrate(|r| std::f64::consts::TAU * profile.reflectance(r) * height(r) * r, 0.0, 16.0, 1e-10);
            let expected = body.area_mm2() * integral;
            assert!((sum / expected - 1.0).abs() < 0.03, "power {power}: {sum} {expected}");
        }
    }
}

#[test]
fn a_kernel_of_the_same_form_is_found_again() {
    let scene = ball(8.0, "marble");
    let body = Body::new(scene.domain(), 0, 0.4);
    let [profile, ..] = dipoles("marble");
    let splines = Splines::new(0.1, 16.0, 1.6);
    let moments = pairs::moments(&body, &profile, &splines, 1);
    let truth = |k: usize| [0.6 + 0.07 * k as f64, 0.3 - 0.05 * k as f64];
    let n = splines.len();
    let mut pairs = vec![[0.0; 2]; n];
    for (k, entry) in moments.iter().enumerate() {
        for (j, powers) in entry.iter().enumerate().take(n - k) {
            for (to, from) in [(k, k + j), (k + j, k)].into_iter().take(if j == 0 { 1 } else { 2 }) {
                let [a, b] = truth(from);
                pairs[to][0] += a * powers[0] + b * powers[1];
                pairs[to][1] += a * powers[1] + b * powers[2];
            }
        }
    }
    let found = fit::layers(splines, &moments, &pairs, 1e-9);
    // On a ball heights follow from the distance, so that only the kernel itself is determined.
    for r in [0.1, 0.3, 1.0, 3.0, 9.0] {
        let kernel = |a: f64, b: f64| a - b * r * r / 8.0 * splines.fade_per_mm(r);
        let of_truth = |which: usize| splines.sum(&(0..n).map(|k| truth(k)[which]).collect::<Vec<_>>(), r);
        let (found, expected) =
            (kernel(splines.sum(&found.single, r), splines.sum(&found.double, r)), kernel(of_truth(0), of_truth(1)));
        assert!((found / expected - 1.0).abs() < 0.02, "{r}: {found} {expected}");
    }
    // What has no solution is the dipole.
    let none = fit::layers(splines, &moments, &vec![[f64::NAN; 2]; n], 1e-9);
    assert!(none.single.iter().all(|a| *a == 1.0) && none.double.iter().all(|b| *b == 0.0));
}

/// A function of each channel.
type Channels = [Arc<dyn Profile>; 3];

/// A kernel of some layers of skin, with the single and the double ones.
fn some_kernel() -> (MediumKernel, Channels, Channels) {
    let (layers, profiles) = (some_layers(), dipoles("skin1"));
    let single = profiles.map(|p| Arc::new(layers.profile(&p, 30.0).unwrap()) as Arc<dyn Profile>);
    let double = profiles.map(|p| Arc::new(layers.double(p)) as Arc<dyn Profile>);
    (MediumKernel::of_layers(single.clone(), (double.clone(), 0.8), 30.0), single, double)
}

#[test]
fn a_block_sums_what_the_formula_says() {
    let (kernel, single, double) = some_kernel();
    let (receiver, source) = (DVec3::new(0.3, -0.2, 0.1), DVec3::new(2.0, 1.5, -0.7));
    let (n_o, n_i) = (DVec3::new(0.1, 0.9, 0.3).normalize(), DVec3::new(-0.5, 0.2, 0.8).normalize());
    let flux = DVec3::new(1.0, 2.0, 0.5);
    let mut block = Block::default();
    let centre = DVec3::splat(0.5);
    block.reset(centre, std::iter::once(Receiver { at_mm: receiver, normal: n_o }));
    let (points, moments) = ([PointSource::new(source, flux, centre)], [Moment::of_facet(flux, n_i)]);
    for level in crate::math::simd::InstructionSet::available() {
        kernel.layers().unwrap().add_points(level, &mut block, &points, &moments);
        let way = source - receiver;
        let r = way.length();
        for c in 0..3 {
            let heights = way.dot(n_o) - way.dot(n_i);
            let expected = flux[c] * (single[c].reflectance(r) + double[c].reflectance(r) * heights);
            assert!((block.sum(0)[c] / expected - 1.0).abs() < 2e-3, "{c}");
        }
        block.reset(centre, std::iter::once(Receiver { at_mm: receiver, normal: n_o }));
    }
}

/// Few receivers have the sums of many: each source by each, whatever stands side by side.
#[test]
fn blocks_of_any_number_of_receivers_have_the_same_sums() {
    let (layered, single, _) = some_kernel();
    let kernels = [MediumKernel::of_dipoles(dipoles("skin1")), MediumKernel::of_profiles(single, 30.0), layered];
    let level = crate::math::simd::InstructionSet::detect();
    let place = |i: u64| DVec3::from_array([0, 1, 2].map(|axis| 3.0 * uniform(5, axis, i) - 1.5));
    let normal = |i: u64| (place(100 + i) + DVec3::new(0.1, 0.0, 0.2)).normalize();
    let receivers: Vec<Receiver> = (0..20).map(|i| Receiver { at_mm: place(i), normal: normal(i) }).collect();
    // Numbers that no lanes divide, more than are summed in single precision at once.
    let points: Vec<PointSource> =
        (0..71).map(|i| PointSource::new(2.0 * place(200 + i), place(300 + i).abs(), DVec3::ZERO)).collect();
    let moments: Vec<Moment> = (0..71).map(|i| Moment::of_facet(place(300 + i).abs(), normal(400 + i))).collect();
    let triangles: Vec<FlatSource> = (0..37)
        .filter_map(|i| {
            let corners = [0, 1, 2].map(|k| 2.0 * place(500 + i) + 0.4 * place(600 + 3 * i + k));
            FlatSource::new(corners, place(700 + i).abs().as_vec3().to_array(), DVec3::ZERO)
        })
        .collect();
    for kernel in &kernels {
        let sums = |receivers: &[Receiver]| -> [Vec<DVec3>; 2] {
            let mut block = Block::default();
            [false, true].map(|flat| {
                block.reset(DVec3::ZERO, receivers.iter().copied());
                match (kernel.layers(), flat) {
                    (Some(layers), false) => layers.add_points(level, &mut block, &points, &moments),
                    (Some(layers), true) => layers.add_triangles(level, &mut block, &triangles),
                    (None, false) => kernel.add_points(level, &mut block, &points),
                    (None, true) => kernel.add_triangles(level, &mut block, &triangles),
                }
                let found: Vec<DVec3> = (0..receivers.len()).map(|i| block.sum(i)).collect();
                let mut taken = vec![[0.0f32; 3]; receivers.len()];
                block.take(&mut taken);
                for (taken, found) in taken.iter().zip(&found) {
                    assert_eq!(taken.map(f64::from), found.as_vec3().as_dvec3().to_array());
                }
                assert_eq!(block.sum(0), DVec3::ZERO);
                found
            })
        };
        let all = sums(&receivers);
        for count in [1, 2, 3, 4, 5, 8, 9, 16, 17] {
            // Receivers of a row share the rules along the edges of each triangle, which err by 5e-7 of the total.
            for ((some, all), limit) in sums(&receivers[..count]).iter().zip(&all).zip([1e-6, 37.0 * 5e-7]) {
                let largest = all.iter().map(|sum| sum.abs().max_element()).fold(0.0, f64::max);
                let off = some.iter().zip(all).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
                assert!(largest > 0.01 && off < limit * largest, "{count}: {off:e} of {largest}");
            }
        }
    }
}

#[test]
fn both_layers_are_integrated_over_triangles() {
    let (kernel, single, double) = some_kernel();
    let level = crate::math::simd::InstructionSet::detect();
    let centre = DVec3::new(0.2, 0.1, -0.3);
    // Receivers in the plane, at a corner whose normal leans, beside and over triangles of many and of few mean free paths.
    let receivers = [
        Receiver { at_mm: DVec3::ZERO, normal: DVec3::ONE.normalize() },
        Receiver { at_mm: DVec3::new(1.0, 0.5, 0.0), normal: DVec3::Z },
        Receiver { at_mm: DVec3::new(1.0, 1.0, -2.5), normal: DVec3::new(0.2, 0.4, -0.9).normalize() },
        Receiver { at_mm: DVec3::new(-1.5, 0.7, 0.6), normal: DVec3::new(-0.9, 0.1, 0.4).normalize() },
    ];
    let triangles = [
        [DVec3::ZERO, DVec3::new(9.0, 0.0, 0.0), DVec3::new(0.0, 7.0, 0.0)],
        [DVec3::new(0.2, 0.1, 0.0), DVec3::new(0.7, 0.2, 0.1), DVec3::new(0.3, 0.8, -0.2)],
    ];
    for corners in triangles {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize();
        let area = samples::area(corners);
        let mut block = Block::default();
        block.reset(centre, receivers.iter().copied());
        let flat = FlatSource::new(corners, [1.0, 1.0, 1.0], centre).unwrap();
        kernel.layers().unwrap().add_triangles(level, &mut block, &[flat]);
        for (index, receiver) in receivers.iter().enumerate() {
            // Polar around the corner nearest to the receiver, so that the peak is resolved.
            let value = |channel: usize| {
                let at = |u: f64, v: f64| {
                    let point = a + u * u * ((1.0 - v) * (b - a) + v * (c - a));
                    let way = point - receiver.at_mm;
                    let r = way.length();
                    let heights = way.dot(receiver.normal) - way.dot(normal);
                    let both = single[channel].reflectance(r) + double[channel].reflectance(r) * heights;
                    4.0 * area * u * u * u * both
                };
                let steps = 600;
                let middle = |k: usize| (k as f64 + 0.5) / steps as f64;
                let of_line = |k: usize| (0..steps).map(|l| at(middle(k), middle(l))).sum::<f64>();
                (0..steps).map(of_line).sum::<f64>() / (steps * steps) as f64
            };
            for channel in 0..3 {
                let (found, expected) = (block.sum(index)[channel], value(channel));
                assert!((found - expected).abs() < 3e-3 * expected.abs(), "{index} {channel}: {found} {expected}");
            }
        }
    }
}

/// Errors of the worst channel under a light from the side: of the calibrated kernel, and of the dipole.
fn errors(scene: &TestScene) -> [f64; 2] {
    let domain = scene.domain();
    let light = Light::Directional { from: DVec3::new(0.6, 0.7, 0.3).normalize(), irradiance: DVec3::ONE };
    let walked = exitance(domain, std::slice::from_ref(&light), Effort::Photons(100_000), 77, &Silent).unwrap();
    let walks = Walks { photons: 30_000, ..Walks::default() };
    let body = CalibratedSurface::new(domain, 8192, walks, &Silent).unwrap();
    let plain = CalibratedSurface::with(domain, 8192, Told::nothing(domain), &Silent).unwrap();
    [body, plain].map(|body| {
        let radiosity = body.radiosity(std::slice::from_ref(&light), SAMPLING, &Silent).unwrap();
        compare(&walked, &radiosity).unwrap().worst()[0]
    })
}

#[test]
fn the_calibrated_kernel_is_nearer_to_the_volume_than_the_dipole() {
    let head = scene_of(shapes::bumpy_head(24.0, 4), "skin1");
    let [calibrated, dipole] = errors(&head);
    assert!(dipole > 0.12 && calibrated < 0.1 && calibrated < 0.6 * dipole, "{calibrated} {dipole}");
    // A sheet of a third of a mean free path of marble.
    let sheet = scene_of(shapes::cuboid(DVec3::new(8.0, 0.4, 8.0), 24), "marble");
    let [calibrated, dipole] = errors(&sheet);
    assert!(dipole > 0.3 && calibrated < 0.5 * dipole, "{calibrated} {dipole}");
}

#[test]
fn triangles_of_many_mean_free_paths_have_the_factors_of_small_ones() {
    let light = Light::Directional { from: DVec3::new(0.6, 0.7, 0.3).normalize(), irradiance: DVec3::ONE };
    let corners = |cells: u32| {
        let scene = scene_of(shapes::cuboid(DVec3::splat(11.0), cells), "marble");
        let walks = Walks { photons: 50_000, ..Walks::default() };
        let body = CalibratedSurface::new(scene.domain(), 8192, walks, &Silent).unwrap();
        let radiosity = body.radiosity(std::slice::from_ref(&light), SAMPLING, &Silent).unwrap();
        let at = |corner: DVec3| {
            let nearest = |(_, p): &(&DVec3, &glam::Vec3)| p.as_dvec3().distance(corner);
            let all = radiosity.iter().zip(&scene.mesh.local_mm);
            *all.min_by(|a, b| nearest(a).total_cmp(&nearest(b))).unwrap().0
        };
        [-1.0, 1.0].map(|x| [-1.0, 1.0].map(|y| at(5.5 * DVec3::new(x, y, 1.0))))
    };
    let (coarse, fine) = (corners(1), corners(16));
    for (coarse, fine) in coarse.as_flattened().iter().zip(fine.as_flattened()) {
        assert!(((*coarse - *fine) / fine).abs().max_element() < 0.08, "{coarse} {fine}");
    }
}

#[test]
fn openings_keep_their_dipole() {
    let light = Light::Point { at_mm: DVec3::new(0.0, 30.0, 20.0), intensity: DVec3::splat(900.0) };
    let mut open = shapes::icosphere(10.0, 2);
    open.triangles.truncate(open.triangles.len() - 40);
    open.triangle_material.truncate(open.triangles.len());
    let scene = scene_of(open, "marble");
    let walks = Walks { photons: 4000, ..Walks::default() };
    let body = CalibratedSurface::new(scene.domain(), 2048, walks, &Silent).unwrap();
    assert!(!any_is_closed(scene.domain()) && any_is_closed(ball(10.0, "marble").domain()));
    assert!(body.calibrated.parts[0].is_none() && body.calibrated.scale.iter().all(|s| *s == DVec3::ONE));
    let radiosity = body.radiosity(&[light], SAMPLING, &Silent).unwrap();
    assert!(radiosity.iter().all(|b| b.is_finite()));
}

#[test]
fn weights_of_many_lights_hold_layers_and_the_factors_of_both_ends() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), 3000);
    let surface = fixture.surface();
    let walks = Walks { photons: 4096, ..Walks::default() };
    let calibrated = Calibrated::by_walks(surface.domain, &fixture.bvh, walks, &Silent).unwrap();
    let factors = calibrated.of_samples(&surface);
    let (least, most) = factors.iter().fold((f64::INFINITY, 0.0f64), |(a, b), f| (a.min(f.y), b.max(f.y)));
    assert!(most > 1.1 * least, "{least} {most}");
    let gather = Gather::calibrated(&surface, &fixture.tree, (&calibrated.kernels, &factors), NearField::FAST);
    let receivers = calibrated.at_vertices(fixture.receivers(16));
    let areas = vec![1.0; receivers.len()];
    let apart: Vec<u32> = (0..receivers.len() as u32).step_by(17).collect();
    let even = vec![DVec3::ONE; factors.len()];
    let exact = Gather::calibrated(&surface, &fixture.tree, (&calibrated.kernels, &factors), NearField::REFERENCE);
    let [together, alone] = [16, 1].map(|capacity| {
        let some = receivers.only(&apart, capacity);
        exact.radiosity(&some, &exact.light(&even), Scheme::AllPairs, &Silent)
    });
    assert!(relative_rms(&together, &alone) < 1e-4);
    let columns: Vec<Vec<DVec3>> = [DVec3::new(0.3, 0.8, 0.5), DVec3::new(-0.9, 0.2, 0.1), DVec3::NEG_Y]
        .map(|from| surface.patches.iter().map(|p| DVec3::splat(p.cross_mm2.dot(from).max(0.0) / p.area_mm2)).collect())
        .to_vec();
    let values = (0..factors.len()).flat_map(|i| columns.iter().map(move |column| column[i].x as f32)).collect();
    let rows = IrradianceRows { lights: columns.len(), by_channel: false, values };
    let worst = |many: &ManyLights, receivers: &Receivers| {
        let found = many.radiosity(&rows, &Silent);
        let error = |(light, column): (usize, &Vec<DVec3>)| {
            let expected = gather.radiosity(receivers, &gather.light(column), Scheme::AllPairs, &Silent);
            relative_rms(&found.under(light), &expected)
        };
        columns.iter().enumerate().map(error).fold(0.0, f64::max)
    };
    // Of one receiver each: what is near any of a group is fine for all of it in these sums, and for those that it is near to in others.
    let alone = calibrated.at_vertices(fixture.receivers(1));
    let all_pairs = worst(&ManyLights::new(&gather, &fixture.tree, &alone, &areas), &alone);
    assert!(all_pairs < 1e-5, "{all_pairs}");
    let mut many = ManyLights::new(&gather, &fixture.tree, &receivers, &areas);
    many.tune(0.005, &rows);
    let hierarchical = worst(&many, &receivers);
    assert!(matches!(many.scheme(), Scheme::Hierarchical { .. }) && hierarchical < 0.0075, "{hierarchical}");
}

#[test]
fn samples_have_the_factor_of_a_point_nearby_while_factors_are_solved_for() {
    let scene = scene_of(shapes::icosphere(10.0, 6), "marble");
    let domain = scene.domain();
    let Told { lattice, parts, .. } = Told::nothing(domain);
    assert!(lattice.len() > SOLVING);
    let calibrated = Calibrated::kept(domain, parts, vec![DVec3::ONE; lattice.len()]).unwrap();
    let bvh = Bvh::new(&scene.mesh);
    let samples = Samples::new(&scene.mesh, &scene.parts, scene.mesh.triangles.len());
    let patches = samples::patches(&scene.mesh, &samples);
    let clusters = calibrated.clusters(&Surface { domain, bvh: &bvh, samples: &samples, patches: &patches });
    assert_eq!((clusters.slots.len(), clusters.of_sample.len()), (SOLVING, samples.len()));
    let spacing = (scene.parts.parts[0].area_mm2 / SOLVING as f64).sqrt();
    for (patch, cluster) in patches.iter().zip(&clusters.of_sample) {
        let at = lattice.at_mm[clusters.slots[*cluster as usize] as usize];
        assert!(at.distance(patch.centre_mm) < 2.0 * spacing, "{at} {}", patch.centre_mm);
    }
}
