use super::*;
use crate::geometry::shapes;
use crate::light::Light;
use crate::medium::far_profile::FarProfile;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::profile::Profile;
use crate::progress::Silent;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::near_field::{Near, around};
use crate::transport::test_scene::{Fixture, named, on_threads};

/// RMS difference of the near field by rings and by itself, over the RMS of the whole radiosity, under a light whose shadow
/// boundaries cross samples.
fn difference(name: &str, samples: usize, spacings: f64, colours: usize) -> f64 {
    let fixture = Fixture::new(shapes::torus(8.0, 3.0, 96, 48), named(name), samples).in_tree_order();
    let surface = fixture.surface();
    let media = &fixture.scene.media;
    let receivers = fixture.receivers(LANES);
    let area: f64 = fixture.patches.iter().map(|p| p.area_mm2).sum();
    let split_mm = spacings * (area / fixture.patches.len() as f64).sqrt();
    let corners = Corners::new(&fixture.scene.mesh, &fixture.samples, &fixture.patches);
    let rule = NearField::FAST;
    let around = around(&surface, &receivers, rule, split_mm);
    let light = [
        Light::point(DVec3::new(30.0, 6.0, 4.0), DVec3::new(300.0, 200.0, 100.0)).unwrap(),
        Light::point(DVec3::new(-8.0, 30.0, 9.0), DVec3::new(50.0, 200.0, 300.0)).unwrap(),
    ];
    let light = &light[..colours];
    let illumination = Illumination::new(&surface, light, &[fixture.eta()], LightSampling::FAST).unwrap();
    let (irradiance, pieces) = illumination.all_with_pieces(&Silent);
    let zero = vec![DVec3::ZERO; receivers.len()];
    let (mut exact, mut by_rings) = (zero.clone(), zero);
    Near::new(surface, (&around, &corners), &MediumKernel::of_media(media), NearField::REFERENCE, split_mm).add(
        &receivers,
        (&irradiance, &pieces),
        &mut exact,
        &Silent,
    );
    let rings = NearRings::new(&surface, (&around, &corners), &receivers, (rule, split_mm), &Silent);
    let range = LightRange::new(&irradiance, pieces.deviations());
    assert_eq!(range.colour.is_some(), colours == 1);
    let moments = rings.moments(&surface, &around, &receivers, (&irradiance, &pieces), range);
    let coefficients = rings.coefficients(&MediumKernel::new(&media[0]));
    rings.add(&moments, &receivers, |_| Some(&coefficients), &mut by_rings);
    let totals = DVec3::from_array(media[0].properties.dipoles(BoundaryFit::Published).map(|d| d.total()));
    let square = |v: DVec3| (v / totals).length_squared();
    let off: f64 = exact.iter().zip(&by_rings).map(|(a, b)| square(*a - *b)).sum();
    // The radiosity would be the irradiance times the total, more or less.
    let whole: f64 = irradiance.iter().map(|e| e.length_squared()).sum::<f64>() / irradiance.len() as f64;
    (off / exact.len() as f64 / whole).sqrt()
}

#[test]
fn rings_give_the_near_field_of_thin_and_dense_media() {
    for name in ["marble", "skin1", "ketchup", "cream", "spectralon"] {
        for colours in [1, 2] {
            let error = difference(name, 20_000, 6.0, colours);
            println!("{name}, {colours}: {error:.1e}");
            assert!(error < 1e-3, "{name}, {colours}: {error:.1e}");
        }
    }
}

#[test]
fn hats_of_a_triangle_hold_its_area_and_moment() {
    let rings = Rings::new(3.0);
    let [a, b, c] = [DVec3::ZERO, DVec3::new(0.6, 0.1, 0.0), DVec3::new(0.2, 0.7, 0.1)];
    let mut areas = [0.0; RINGS + 1];
    rings.triangle([a, b, c], &mut areas);
    let areas = areas.map(f64::from);
    let area = 0.5 * (b - a).cross(c - a).length();
    let moment = area / 3.0 * [a + b, b + c, c + a].map(|s| 0.25 * s.length_squared()).iter().sum::<f64>();
    let (sum, first) = areas.iter().zip(&rings.0).fold((0.0, 0.0), |(s, m), (a, r2)| (s + a, m + a * r2));
    assert!((sum / area - 1.0).abs() < 1e-6 && (first / moment - 1.0).abs() < 1e-6, "{sum} {area} {first} {moment}");
}

#[test]
fn even_light_on_a_plane_costs_nothing() {
    // What the near part and its hats return of even light: the same, by Galerkin, but for the hat at the end.
    for name in ["marble", "cream", "spectralon", "chicken1"] {
        let properties = named(name);
        for (channel, dipole) in properties.dipoles(BoundaryFit::Published).iter().enumerate() {
            let rings = Rings::new(2.0);
            let coefficients = rings.coefficients(dipole, dipole.z_real_mm);
            let hats: f64 = (0..RINGS)
                .map(|k| {
                    let before = if k > 0 { rings.0[k] - rings.0[k - 1] } else { 0.0 };
                    let half = 0.5 * std::f64::consts::PI * (rings.0[k + 1] - rings.0[k] + before);
                    half * f64::from(coefficients[k])
                })
                .sum();
            let far = FarProfile::new(dipole, 2.0);
            let exact = FarProfile::new(dipole, 0.0).total() - far.total();
            assert!((hats - exact).abs() < 1e-4 * dipole.total(), "{name} {channel}: {hats} {exact}");
        }
    }
}

#[test]
fn more_samples_around_a_group_than_are_numbered_together() {
    // Receivers all over the torus have all samples around them in one group; alone each has few. The sums are the same.
    let fixture = Fixture::new(shapes::torus(8.0, 3.0, 24, 12), named("marble"), NUMBERED + 20_000).in_tree_order();
    let surface = fixture.surface();
    let all = fixture.receivers(LANES);
    let corners = Corners::new(&fixture.scene.mesh, &fixture.samples, &fixture.patches);
    let (rule, split_mm) = (NearField::FAST, 5.0);
    let irradiance: Vec<DVec3> =
        fixture.patches.iter().map(|p| DVec3::new(1.0, 1.5 + p.centre_mm.x.sin(), 0.5)).collect();
    let spread: Vec<u32> = (0..LANES as u32).map(|i| i * all.len() as u32 / LANES as u32).collect();
    let near_of = |capacity: usize| {
        let receivers = all.only(&spread, capacity);
        let around = around(&surface, &receivers, rule, split_mm);
        let rings = NearRings::new(&surface, (&around, &corners), &receivers, (rule, split_mm), &Silent);
        let range = LightRange::new(&irradiance, &[]);
        let moments = rings.moments(&surface, &around, &receivers, (&irradiance, &Pieces::default()), range);
        let mut values = vec![DVec3::ZERO; receivers.len()];
        let coefficients = rings.coefficients(&MediumKernel::new(&fixture.scene.media[0]));
        rings.add(&moments, &receivers, |_| Some(&coefficients), &mut values);
        (values, around.of(0).len())
    };
    let ((together, many), (alone, few)) = (near_of(LANES), near_of(1));
    assert!(many > NUMBERED && few < NUMBERED, "{many} {few}");
    for (a, b) in together.iter().zip(&alone) {
        assert!(a.max_element() > 0.0 && (*a - *b).abs().max_element() < 1e-5 * a.max_element(), "{a} {b}");
    }
}

#[test]
fn threads_do_not_change_the_moments() {
    let run = |threads: usize| on_threads(threads, || difference("marble", 5_000, 5.0, 2)).to_bits();
    assert_eq!(run(1), run(3));
}
