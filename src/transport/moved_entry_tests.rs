#![allow(clippy::unwrap_used)]

use super::ways::ONE_RAY;
use super::*;
use crate::geometry::samples::Patch;
use crate::geometry::shapes;
use crate::light::harmonics::to_harmonics;
use crate::light::quantised::directions::lattice;
use crate::math::sh::real_sh;
use crate::progress::Silent;
use crate::transport::test_scene::{Fixture, named};

/// Irradiance that is even within each sample, moved.
fn even_moved(entry: &MovedEntry, surface: &Surface, light: &Light, irradiance: &[DVec3]) -> Vec<DVec3> {
    entry.moved(surface, light, (irradiance.to_vec(), Pieces::NONE)).0
}

/// The edge of a shadow on coarse samples: what is brighter within one keeps that as far as its light stays there, which is all of it where light comes
/// from above.
#[test]
fn what_is_uneven_within_a_sample_stays_as_far_as_its_light_does() {
    let plane = (shapes::plane(40.0, 40.0, 7), DVec3::ZERO);
    let roof = (shapes::plane(10.0, 10.0, 1), DVec3::new(0.0, 6.0, 0.0));
    let fixture = Fixture::new(shapes::compose(&[plane, roof]), named("skin1"), 6000);
    let surface = fixture.surface();
    let entry = MovedEntry::new(&surface, |_| true);
    let etas = [named("skin1").eta_inside_over_outside];
    let largest = |pieces: &Pieces| pieces.deviations().iter().map(|e| e.abs().max_element()).fold(0.0, f64::max);
    let of = |from: DVec3| {
        let light = Light::Directional { from: from.normalize(), irradiance: DVec3::ONE };
        let lit = Illumination::new(&surface, std::slice::from_ref(&light), &etas, LightSampling::FAST).unwrap();
        let (irradiance, pieces) = lit.all_with_pieces(&Silent);
        let before = largest(&pieces);
        assert!(before > 0.1, "{before}");
        let (_, after) = entry.moved(&surface, &light, (irradiance, pieces.clone()));
        let both = pieces.clone().beside(after.clone());
        assert_eq!(both.deviations().len(), after.deviations().len());
        assert!((largest(&both) - largest(&pieces) - largest(&after)).abs() < 1e-9 * before);
        largest(&after) / before
    };
    let [above, aside] = [DVec3::Y, DVec3::new(2.0, 1.0, 0.3)].map(of);
    assert!((above - 1.0).abs() < 1e-9 && aside > 0.05 && aside < 0.8, "{above} {aside}");
}

#[test]
fn light_on_a_plane_moves_by_the_tangential_part_of_a_free_path() {
    // Steps go to the nearest of the samples, so that those of coarser ones are shorter: by 7 % where they lie a step apart.
    let fixture = Fixture::new(shapes::plane(40.0, 40.0, 7), named("marble"), 80_000);
    let surface = fixture.surface();
    let light = Light::Directional { from: DVec3::new(0.8, 0.6, 0.0), irradiance: DVec3::ONE };
    let spot = |at: DVec3| if at.x.abs() < 2.0 && at.z.abs() < 2.0 { DVec3::ONE } else { DVec3::ZERO };
    let before: Vec<DVec3> = surface.patches.iter().map(|p| spot(p.centre_mm)).collect();
    let after = even_moved(&MovedEntry::new(&surface, |_| true), &surface, &light, &before);
    let properties = named("marble");
    let sine = 0.8 / properties.eta_inside_over_outside;
    for c in 0..3 {
        let sums = |values: &[DVec3]| {
            let of = values.iter().zip(surface.patches).map(|(e, p)| (e[c] * p.area_mm2, p.centre_mm));
            of.fold((0.0, DVec3::ZERO), |(sum, moment), (flux, at)| (sum + flux, moment + flux * at))
        };
        let ((flux, from), (there, to)) = (sums(&before), sums(&after));
        assert!((there / flux - 1.0).abs() < 1e-12);
        let shift = (to - from) / flux;
        let expected = -sine * properties.mean_free_path_mm()[c];
        assert!((shift.x / expected - 1.0).abs() < 0.05 && shift.z.abs() < 0.02, "{c}: {shift} {expected}");
    }
}

#[test]
fn even_light_stays_even_and_rows_move_as_single_lights_do() {
    let fixture = Fixture::new(shapes::plane(40.0, 40.0, 7), named("skin1"), 10_000);
    let surface = fixture.surface();
    let entry = MovedEntry::new(&surface, |_| true);
    let light = Light::Directional { from: DVec3::new(0.6, 0.4, 0.5).normalize(), irradiance: DVec3::ONE };
    let inside = |patch: &Patch| patch.centre_mm.x.abs().max(patch.centre_mm.z.abs()) < 5.0;
    let even = vec![DVec3::ONE; surface.samples.len()];
    let moved = even_moved(&entry, &surface, &light, &even);
    let far_from_edges: Vec<DVec3> =
        moved.iter().zip(surface.patches).filter(|(_, patch)| inside(patch)).map(|(e, _)| *e).collect();
    for e in &far_from_edges {
        assert!((*e - far_from_edges[0]).abs().max_element() < 1.5e-2 && (*e - 1.0).abs().max_element() < 0.01, "{e}");
    }
    let spot: Vec<DVec3> =
        surface.patches.iter().map(|p| DVec3::splat(f64::from(u8::from(p.centre_mm.length() < 3.0)))).collect();
    let values = spot.iter().flat_map(|e| [e.x as f32, 0.0]).collect();
    let rows = IrradianceRows { lights: 2, by_channel: false, values };
    let rows = entry.moved_rows(&surface, &[light.clone(), light.clone()], rows);
    assert!(rows.by_channel && rows.under(1).iter().all(|e| *e == DVec3::ZERO));
    for (row, e) in rows.under(0).iter().zip(even_moved(&entry, &surface, &light, &spot)) {
        assert!((*row - e).abs().max_element() < 1e-6, "{row} {e}");
    }
}

#[test]
fn light_that_finds_no_surface_stays_and_light_from_all_around_too() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 2), named("skin1"), 700);
    let surface = fixture.surface();
    let before: Vec<DVec3> = (0..surface.samples.len()).map(|i| DVec3::splat(f64::from(i as u32 % 5))).collect();
    let point = Light::Point { at_mm: DVec3::new(3.0, 20.0, 1.0), intensity: DVec3::ONE };
    let flux = |values: &[DVec3]| values.iter().zip(surface.patches).map(|(e, p)| *e * p.area_mm2).sum::<DVec3>();
    let entry = MovedEntry::new(&surface, |_| true);
    let after = even_moved(&entry, &surface, &point, &before);
    assert!((flux(&after) - flux(&before)).abs().max_element() < 1e-9 * flux(&before).x && after != before);
    assert_eq!(even_moved(&entry, &surface, &Light::Constant { radiance: DVec3::ONE }, &before), before);
}

#[test]
fn skies_move_as_the_sum_of_their_suns_and_light_from_everywhere_stays() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), 4000);
    let surface = fixture.surface();
    let entry = MovedEntry::new(&surface, |_| true);
    let etas = [named("skin1").eta_inside_over_outside];
    let suns = lattice(400, 0.5);
    // Of an irradiance of one: all that a sun gives is in proportion to it, channel by channel.
    let of_suns: Vec<[Vec<DVec3>; 2]> = suns
        .iter()
        .map(|from| {
            let light = Light::Directional { from: *from, irradiance: DVec3::ONE };
            let lit = Illumination::new(&surface, std::slice::from_ref(&light), &etas, ONE_RAY).unwrap().all(&Silent);
            [even_moved(&entry, &surface, &light, &lit), lit]
        })
        .collect();
    for (power, moved_by, allowed) in [(0, 0.0, 0.01), (1, 0.02, 0.012), (3, 0.04, 0.02)] {
        let radiance = |from: &DVec3| DVec3::new(1.0, 2.0, 0.5) * (1.0 + from.y).powi(power);
        let mut harmonics = vec![DVec3::ZERO; SKY_ORDER * SKY_ORDER];
        let (mut plain, mut moved) =
            (vec![DVec3::ZERO; surface.samples.len()], vec![DVec3::ZERO; surface.samples.len()]);
        for (from, [after, before]) in suns.iter().zip(&of_suns) {
            moved.iter_mut().zip(after).for_each(|(sum, e)| *sum += radiance(from) * *e);
            plain.iter_mut().zip(before).for_each(|(sum, e)| *sum += radiance(from) * *e);
            let mut y = [0.0; SKY_ORDER * SKY_ORDER];
            real_sh(SKY_ORDER, to_harmonics(*from), &mut y);
            harmonics.iter_mut().zip(y).for_each(|(sum, y)| *sum += y * radiance(from));
        }
        let error = |values: &[DVec3]| {
            let of = |(a, b): (&DVec3, &DVec3)| (*a - *b).length_squared();
            let all: f64 = moved.iter().map(|e| e.length_squared()).sum();
            (values.iter().zip(&moved).map(of).sum::<f64>() / all).sqrt()
        };
        let before = error(&plain);
        entry.move_sky(&surface, &harmonics, &mut plain);
        let after = error(&plain);
        println!("(1 + y)^{power}: {before:.4} before, {after:.4} after");
        assert!(before >= moved_by && after < allowed, "{power}: {before} {after}");
    }
}

#[test]
fn an_area_light_moves_as_the_points_that_it_is_made_of() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), 4000);
    let surface = fixture.surface();
    let entry = MovedEntry::new(&surface, |_| true);
    let etas = [named("skin1").eta_inside_over_outside];
    let of = |light: &Light| {
        let lit =
            Illumination::new(&surface, std::slice::from_ref(light), &etas, LightSampling::FAST).unwrap().all(&Silent);
        let moved = even_moved(&entry, &surface, light, &lit);
        let norm = |v: &[DVec3]| v.iter().map(|e| e.length_squared()).sum::<f64>().sqrt();
        let changes: Vec<DVec3> = lit.iter().zip(&moved).map(|(a, b)| *b - *a).collect();
        (norm(&changes) / norm(&lit), moved, norm(&lit))
    };
    let at_mm = DVec3::new(8.0, 40.0, 20.0);
    let area = Light::area(at_mm, -at_mm, [2.0, 3.0], DVec3::splat(100.0), None).unwrap();
    let (by_area, moved, size) = of(&area);
    let (by_point, of_point, size_of_point) = of(&Light::Point { at_mm, intensity: DVec3::ONE });
    let differences = moved.iter().zip(&of_point).map(|(a, b)| (*a / size - *b / size_of_point).length_squared());
    let difference = differences.sum::<f64>().sqrt();
    assert!(
        by_area > 0.03 && (by_area / by_point - 1.0).abs() < 0.1 && difference < 0.03,
        "{by_area} {by_point} {difference}"
    );
}
