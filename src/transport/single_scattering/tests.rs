//! Against closed forms and against each other.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;

use super::plane::PlaneMedium;
use super::radiance::{DepthSampling, Path, Settings, SingleScattering};
use super::vectors::{Sharing, VectorBaker, VectorSettings};
use super::*;
use crate::geometry::part_table::PartTable;
use crate::geometry::shapes;
use crate::light::Light;
use crate::math::cube_map::{FACES, solid_angles_sr};
use crate::medium::material::OpticalProperties;
use crate::medium::phase::{HenyeyGreenstein, LightTerms};
use crate::progress::Silent;
use crate::transport::test_scene::{self, Fixture, named};

fn medium(sigma_s: [f64; 3], sigma_a: [f64; 3], eta: f64) -> OpticalProperties {
    test_scene::medium(DVec3::from_array(sigma_s), DVec3::from_array(sigma_a), eta)
}

/// A patch that is flat as far as light goes, and its middle.
fn patch(properties: OpticalProperties) -> (Fixture, ExitPoint) {
    let fixture = Fixture::new(shapes::plane(4000.0, 4000.0, 2), properties, 10);
    let point = ExitPoint { at_mm: DVec3::new(1.0, 0.0, 2.0), normal: DVec3::Y, geometric: DVec3::Y, part: 0 };
    (fixture, point)
}

fn closed(properties: &OpticalProperties, channel: usize) -> PlaneMedium {
    PlaneMedium {
        sigma_s_per_mm: properties.sigma_s_per_mm()[channel],
        sigma_t_per_mm: properties.sigma_t_per_mm()[channel],
        eta_inside_over_outside: properties.eta_inside_over_outside,
        thickness_mm: f64::INFINITY,
    }
}

fn at_angle(degrees: f64, azimuth: f64) -> DVec3 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    DVec3::new(sin * azimuth.cos(), cos, sin * azimuth.sin())
}

fn flat_vector(baker: &VectorBaker, point: ExitPoint) -> Vec<f32> {
    let mut result = Vec::new();
    baker.range(&[point], 0..1, |_, vector| result = vector.to_vec());
    result
}

#[test]
fn albedo_of_a_patch_is_that_of_the_half_space() {
    for (eta, albedo) in [(1.3, 0.078), (1.5, 0.052)] {
        for (form, albedo) in [(Form::Physical, albedo), (Form::Printed, if eta == 1.3 { 0.190 } else { 0.178 })] {
            let (fixture, point) = patch(medium([1.0, 2.0, 0.5], [0.0; 3], eta));
            let lights = [Light::constant(DVec3::ONE).unwrap()];
            let settings = Settings { form, directions: 1 << 10, ..Settings::REFERENCE };
            let single = SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, settings).unwrap();
            // Radiosity: Int L1 mu dw over the eye's hemisphere, by the midpoint rule in mu^2.
            let (count, mut sum) = (100, DVec3::ZERO);
            for i in 0..count {
                let mu = ((f64::from(i) + 0.5) / f64::from(count)).sqrt();
                sum += single.radiance(&point, at_angle(mu.acos().to_degrees(), 0.3), Path::Refracted, i as u64);
            }
            let found = sum / f64::from(count);
            println!("eta {eta} {form:?}: {found:.5}");
            assert!(
                (found - DVec3::splat(albedo)).abs().max_element() < 0.011 * albedo + 6e-4,
                "{eta} {form:?} {found}"
            );
        }
    }
}

#[test]
fn hanrahan_and_krueger_on_a_plane() {
    let properties = OpticalProperties { g: 0.4, ..medium([1.0, 2.0, 0.5], [0.1, 0.0, 1.0], 1.3) };
    let (fixture, point) = patch(properties);
    for form in [Form::Physical, Form::Printed] {
        let settings = Settings { form, coefficients: Coefficients::Unreduced, ..Settings::REFERENCE };
        for (eye, light) in [(0.0, 0.0), (0.0, 60.0), (45.0, 10.0), (45.0, 80.0), (80.0, 30.0), (89.0, 89.0)] {
            let (to_eye, from) = (at_angle(eye, 0.4), at_angle(light, 2.0));
            let lights = [Light::directional(from, DVec3::ONE).unwrap()];
            let single = SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, settings).unwrap();
            let found = single.radiance(&point, to_eye, Path::Refracted, 5);
            let inside = |w| interface::refracted(1.3, w, DVec3::Y).unwrap();
            let phase = HenyeyGreenstein::new(0.4).density(-inside(to_eye).dot(inside(from)));
            for c in 0..3 {
                let (mu_eye, mu_light) = (to_eye.y, from.y);
                let expected = closed(&properties, c).radiance(form, mu_eye, mu_light, phase);
                assert!((found[c] / expected - 1.0).abs() < 2e-3, "{form:?} {eye} {light} {c}: {found} {expected}");
            }
        }
    }
}

#[test]
fn vectors_of_a_patch_are_the_closed_form_texel_by_texel() {
    for eta in [1.0, 1.3, 1.5] {
        let properties = medium([1.0, 2.0, 0.5], [0.1, 0.0, 1.0], eta);
        let (fixture, point) = patch(properties);
        for sharing in [Sharing::DEFAULT, Sharing::PAPER] {
            let settings = VectorSettings { side: 16, sharing, ..VectorSettings::DEFAULT };
            let baker = VectorBaker::new(fixture.scene.domain(), &fixture.bvh, settings).unwrap();
            let vector = flat_vector(&baker, point);
            let angles = solid_angles_sr(16);
            for c in 0..3 {
                let (mut total, mut expected, mut error, mut square) = (0.0, 0.0, 0.0, 0.0);
                for texel in 0..FACES * 256 {
                    let mean: f64 = (0..4)
                        .map(|sub| {
                            let (x, y) = (2 * (texel % 16) + sub % 2, 2 * (texel / 16 % 16) + sub / 2);
                            let w = crate::math::cube_map::direction(32, texel / 256, x, y);
                            let exit = crate::medium::fresnel::transmittance(eta, 1.0);
                            closed(&properties, c).radiance(Form::Physical, 1.0, w.y, 0.25 * FRAC_1_PI) / exit * 0.25
                        })
                        .sum::<f64>()
                        * angles[texel % 256];
                    let found = f64::from(vector[c * FACES * 256 + texel]);
                    total += found;
                    expected += mean;
                    error += (found - mean) * (found - mean);
                    square += mean * mean;
                }
                let [bias, rms] = [total / expected - 1.0, (error / square).sqrt()];
                println!("eta {eta} {sharing:?} channel {c}: bias {bias:.5} rms {rms:.5}");
                assert!(bias.abs() < 1e-2 && rms < 0.05, "{eta} {sharing:?} {c}: {bias} {rms}");
            }
        }
    }
}

/// Under constant light all points of a ball are alike: quadrature over depth and angle, with a sphere in closed form.
fn ball(radius: f64, properties: &OpticalProperties, channel: usize, form: Form) -> f64 {
    use crate::math::quadrature::{gauss_legendre, integrate_with};
    let rule = gauss_legendre(64);
    let (sigma_s, sigma_t) = (properties.sigma_s_per_mm()[channel], properties.sigma_t_per_mm()[channel]);
    let eta = properties.eta_inside_over_outside;
    let of_depth = |s: f64| {
        let height = radius - s;
        let of_angle = |mu: f64| {
            let (along, b2) = (height * mu, height * height * (1.0 - mu * mu));
            let straight = -along + (radius * radius - b2).max(0.0).sqrt();
            let cosine = (along + straight) / radius;
            let Some(refraction) = interface::Refraction::new(form, eta, cosine) else { return 0.0 };
            refraction.gain * (-sigma_t * straight * refraction.stretch).exp() * 0.5
        };
        sigma_s
            * (-sigma_t * s).exp()
            * (integrate_with(&rule, -1.0, 0.0, of_angle) + integrate_with(&rule, 0.0, 1.0, of_angle))
    };
    let piece = 2.0 * radius / 16.0;
    let sum: f64 =
        (0..16).map(|i| integrate_with(&rule, f64::from(i) * piece, f64::from(i + 1) * piece, of_depth)).sum();
    radiosity_factor(eta) * sum
}

#[test]
fn a_ball_agrees_with_quadrature() {
    let properties = medium([0.6, 1.2, 0.3], [0.05, 0.0, 0.4], 1.3);
    let radius = 2.0;
    let fixture = Fixture::new(shapes::icosphere(radius, 5), properties, 10);
    let lights = [Light::constant(DVec3::ONE).unwrap()];
    let points = vertex_points(fixture.scene.domain());
    let points: Vec<ExitPoint> = points.iter().copied().step_by(points.len() / 24).collect();
    let single = SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, Settings::REFERENCE).unwrap();
    let traced = single.per_points(&points, &Silent).into_iter().sum::<DVec3>() / points.len() as f64;
    let baker = VectorBaker::new(fixture.scene.domain(), &fixture.bvh, VectorSettings::DEFAULT).unwrap();
    let mut baked = DVec3::ZERO;
    baker.range(&points, 0..points.len(), |_, v| {
        let of = |c: usize| v[c * baker.texels()..(c + 1) * baker.texels()].iter().map(|x| f64::from(*x)).sum::<f64>();
        baked += DVec3::new(of(0), of(1), of(2)) * radiosity_factor(1.3) / points.len() as f64;
    });
    for c in 0..3 {
        let expected = ball(radius, &properties, c, Form::Physical);
        println!("channel {c}: traced {:.5} baked {:.5} expected {expected:.5}", traced[c], baked[c]);
        assert!((traced[c] / expected - 1.0).abs() < 0.01, "{c}");
        assert!((baked[c] / expected - 1.0).abs() < 0.01, "{c}");
    }
}

#[test]
fn terms_of_a_phase_function_add_up_to_it() {
    let g = 0.3;
    let properties = OpticalProperties { g, ..medium([0.6, 1.2, 0.3], [0.05, 0.0, 0.4], 1.3) };
    let fixture = Fixture::new(shapes::bumpy_head(3.0, 4), properties, 10);
    let points = vertex_points(fixture.scene.domain());
    let lights = [Light::constant(DVec3::new(1.0, 2.0, 3.0)).unwrap()];
    let settings = Settings { coefficients: Coefficients::Unreduced, directions: 1 << 13, ..Settings::REFERENCE };
    let single = SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, settings).unwrap();
    let phase = crate::medium::phase::LegendrePhase::henyey_greenstein(g, 16);
    let sharings = [(Sharing::DEFAULT, 0.035), (Sharing::Adaptive { depths: 6, tolerance: 0.05 }, 0.02)];
    for (sharing, limit) in sharings {
        let settings = VectorSettings {
            side: 16,
            coefficients: Coefficients::Unreduced,
            phase: LightTerms::Harmonics(16),
            sharing,
            ..VectorSettings::DEFAULT
        };
        let baker = VectorBaker::new(fixture.scene.domain(), &fixture.bvh, settings).unwrap();
        let (mut error, mut square) = (0.0, 0.0);
        for (i, point) in points.iter().enumerate().step_by(points.len() / 12) {
            let to_eye = (point.normal + 0.8 * point.normal.any_orthonormal_vector()).normalize();
            let mut h = [0.0; 16];
            phase.view(interface::refracted(1.3, to_eye, point.normal).unwrap(), &mut h);
            let vector = flat_vector(&baker, *point);
            let texels = baker.texels();
            let exit = crate::medium::fresnel::transmittance(1.3, to_eye.dot(point.normal));
            let mut baked = DVec3::ZERO;
            for (k, h) in h.iter().enumerate() {
                for c in 0..3 {
                    let part = &vector[(k * 3 + c) * texels..(k * 3 + c + 1) * texels];
                    baked[c] += exit * h * (c + 1) as f64 * part.iter().map(|x| f64::from(*x)).sum::<f64>();
                }
            }
            let traced = single.radiance(point, to_eye, Path::InverseNormal, i as u64);
            error += (baked - traced).length_squared();
            square += traced.length_squared();
        }
        let error = (error / square).sqrt();
        println!("K = 16, g {g}, {sharing:?}: {error:.4}");
        assert!(error < limit, "{sharing:?} {error}");
    }
}

#[test]
fn thin_and_open_and_strange_scenes_give_finite_numbers() {
    let thin = shapes::cuboid(DVec3::new(4.0, 1e-4, 4.0), 3);
    let shapes = [
        thin,
        shapes::plane(3.0, 3.0, 3),
        shapes::inside_out(shapes::icosphere(1.0, 2)),
        shapes::compose(&[(shapes::icosphere(1.0, 2), DVec3::ZERO), (shapes::icosphere(0.5, 2), DVec3::X * 0.2)]),
    ];
    let media = [
        medium([0.0; 3], [0.0; 3], 1.3),
        medium([0.0, 1.0, 2.0], [1.0, 0.0, 0.0], 1.0),
        medium([1.0, 1e6, 1e-9], [0.0; 3], 0.6),
        OpticalProperties { g: 0.95, ..medium([1.0; 3], [0.1; 3], 1.5) },
    ];
    let lights = [
        Light::constant(DVec3::ONE).unwrap(),
        Light::directional(DVec3::new(1.0, 1e-7, 0.0), DVec3::ONE).unwrap(),
        Light::point(DVec3::new(0.0, 0.3, 0.0), DVec3::ONE).unwrap(),
        Light::area(DVec3::new(0.0, 2.0, 0.0), -DVec3::Y, [1.0, 1.0], DVec3::ONE, None).unwrap(),
    ];
    for shape in &shapes {
        for properties in &media {
            let fixture = Fixture::new(shape.clone(), *properties, 10);
            let mut points: Vec<ExitPoint> = vertex_points(fixture.scene.domain()).into_iter().step_by(17).collect();
            points.push(ExitPoint::default());
            points.push(ExitPoint { part: 9, normal: DVec3::Y, ..ExitPoint::default() });
            points.push(ExitPoint { at_mm: DVec3::NAN, normal: DVec3::Y, ..ExitPoint::default() });
            for crossings in [Crossings::Occluded, Crossings::Attenuated] {
                for coefficients in [Coefficients::Reduced, Coefficients::Unreduced] {
                    let settings = Settings { crossings, coefficients, directions: 16, ..Settings::PAPER };
                    let single =
                        SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, settings).unwrap();
                    for (i, point) in points.iter().enumerate() {
                        let value = single.per_point(point, i as u64);
                        assert!(value.is_finite() && value.min_element() >= 0.0, "{value}");
                        for eye in [point.normal, DVec3::new(1.0, 1e-9, 0.0), DVec3::ZERO] {
                            assert!(single.radiance(point, eye, Path::Refracted, 3).is_finite());
                        }
                    }
                    let phase = LightTerms::Harmonics(4);
                    let settings =
                        VectorSettings { side: 8, crossings, coefficients, phase, ..VectorSettings::DEFAULT };
                    let baker = VectorBaker::new(fixture.scene.domain(), &fixture.bvh, settings).unwrap();
                    baker.range(&points, 0..points.len() + 2, |i, v| {
                        assert!(v.iter().all(|x| x.is_finite()), "{i}");
                    });
                }
            }
        }
    }
}

#[test]
fn ranges_and_neighbours_change_nothing() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), 10);
    let points = vertex_points(fixture.scene.domain());
    let baker = VectorBaker::new(fixture.scene.domain(), &fixture.bvh, VectorSettings::DEFAULT).unwrap();
    let mut whole = Vec::new();
    baker.range(&points, 0..12, |i, v| whole.push((i, v.to_vec())));
    let mut cut = Vec::new();
    for range in [0..1, 1..7, 7..12] {
        baker.range(&points, range, |i, v| cut.push((i, v.to_vec())));
    }
    assert_eq!(whole, cut);
}

#[test]
fn a_second_crossing_occludes_or_attenuates() {
    let properties = medium([1.0; 3], [0.0; 3], 1.3);
    let slab = shapes::cuboid(DVec3::new(40.0, 1.0, 40.0), 2);
    let two = shapes::compose(&[(slab.clone(), DVec3::ZERO), (slab.clone(), DVec3::Y * 3.0)]);
    let (alone, fixture) = (Fixture::new(slab.clone(), properties, 10), Fixture::new(two, properties, 10));
    let lights = [Light::directional(DVec3::Y, DVec3::ONE).unwrap()];
    let top = |fixture: &Fixture| {
        let at_mm = DVec3::new(0.3, 0.5, 0.7) - fixture.scene.mesh.origin_mm;
        ExitPoint { at_mm, normal: DVec3::Y, geometric: DVec3::Y, part: 0 }
    };
    let of = |fixture: &Fixture, crossings| {
        let settings = Settings { crossings, depths: DepthSampling::Deterministic(16), ..Settings::REFERENCE };
        let single = SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, settings).unwrap();
        single.per_point(&top(fixture), 0).x
    };
    let free = of(&alone, Crossings::Attenuated);
    assert_eq!(of(&alone, Crossings::Occluded), free);
    assert_eq!(of(&fixture, Crossings::Occluded), 0.0);
    let once = crate::medium::fresnel::transmittance(1.3, 1.0);
    let expected = free * once * once * (-1.0f64).exp();
    assert!((of(&fixture, Crossings::Attenuated) / expected - 1.0).abs() < 1e-5);
    // So does one that touches, as long as it is another part.
    let touching = shapes::compose(&[(slab.clone(), DVec3::ZERO), (slab.clone(), DVec3::Y)]);
    let mut touching = Fixture::new(touching, properties, 10);
    let mesh = &touching.scene.mesh;
    let upper = |t: usize| {
        let y: f64 = mesh.corners_local_mm(t as u32).iter().map(|p| p.y / 3.0).sum();
        u32::from(if y.abs() < 0.1 { mesh.normal(t as u32).y < 0.0 } else { y > 0.0 })
    };
    let of_triangle = (0..mesh.triangles.len()).map(upper).collect();
    let names = ["lower", "upper"].map(|name| (name.to_owned(), Some(0))).to_vec();
    touching.scene.parts = PartTable::new(mesh, of_triangle, names);
    assert!((of(&touching, Crossings::Attenuated) / expected - 1.0).abs() < 1e-4);
    assert_eq!(of(&touching, Crossings::Occluded), 0.0);
    // An opaque body lets nothing through.
    let triangles = slab.triangles.len();
    let two = shapes::compose(&[(slab.clone(), DVec3::ZERO), (slab, DVec3::Y * 3.0)]);
    let opaque = Fixture::with_opaque(two, triangles, properties, 10);
    assert_eq!(of(&opaque, Crossings::Attenuated), 0.0);
}

#[test]
fn a_far_point_light_is_a_directional_one_and_an_area_light_many_of_them() {
    let fixture = Fixture::new(shapes::icosphere(2.0, 4), named("skin1"), 10);
    let point = vertex_points(fixture.scene.domain())[100];
    let from = (point.normal + 0.3 * point.normal.any_orthonormal_vector()).normalize();
    let of = |light: Light| {
        let lights = [light];
        let single = SingleScattering::new(fixture.scene.domain(), &fixture.bvh, &lights, Settings::REFERENCE).unwrap();
        single.per_point(&point, 0)
    };
    let distance = 1e4;
    let at = fixture.scene.mesh.origin_mm + point.at_mm + distance * from;
    let sun = of(Light::directional(from, DVec3::ONE).unwrap());
    let lamp = of(Light::point(at, DVec3::splat(distance * distance)).unwrap());
    assert!((lamp / sun - 1.0).abs().max_element() < 2e-3, "{sun} {lamp}");
    let panel = of(Light::area(at, -from, [10.0, 10.0], DVec3::splat(distance * distance / 100.0), None).unwrap());
    assert!((panel / sun - 1.0).abs().max_element() < 0.02, "{sun} {panel}");
    assert!(sun.min_element() > 0.0);
}
