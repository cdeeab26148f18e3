use super::*;
use crate::geometry::shapes;
use crate::math::random::uniform;
use crate::medium::fresnel::BoundaryFit;
use crate::medium::profile::Profile;
use crate::progress::Silent;
use crate::transport::gather::{Gather, Scheme};
use crate::transport::test_scene::{Fixture, named};
use crate::transport::tree::SampleTree;

/// Worst difference between near plus far and the gather of everything, over the total reflectance, worst channel.
fn difference(fixture: Fixture, split_mm: f64, rule: NearField, irradiance: &dyn Fn(u64) -> DVec3) -> f64 {
    differences(fixture, split_mm, rule, irradiance)[0]
}

/// [`difference`], and that of a gather of everything by the same rule.
fn differences(fixture: Fixture, split_mm: f64, rule: NearField, irradiance: &dyn Fn(u64) -> DVec3) -> [f64; 2] {
    let fixture = fixture.in_tree_order();
    let surface = fixture.surface();
    let media = &fixture.scene.media;
    let receivers = fixture.receivers(16);
    let irradiance: Vec<DVec3> = (0..fixture.patches.len() as u64).map(irradiance).collect();
    let corners = Corners::new(&fixture.scene.mesh, &fixture.samples, &fixture.patches);
    let dipoles = media[0].properties.dipoles(BoundaryFit::Published);
    let mut sums = far_all_pairs(
        (&fixture.patches, &fixture.samples.part_offsets),
        &dipoles,
        (split_mm, fixture.scene.mesh.diagonal_mm()),
        &receivers,
        &irradiance,
    );
    let around = around(&surface, &receivers, rule, split_mm);
    let near = Near::new(surface, (&around, &corners), &MediumKernel::of_media(media), rule, split_mm);
    near.add(&receivers, (&irradiance, &Pieces::default()), &mut sums, &Silent);
    let no_tree = SampleTree::default();
    let all = |rule| {
        let gather = Gather::new(&surface, &no_tree, media, rule);
        gather.radiosity(&receivers, &gather.light(&irradiance), Scheme::AllPairs, &Silent)
    };
    let (exact, by_rule) = (all(NearField::REFERENCE), all(rule));
    let totals = DVec3::from_array(dipoles.map(|d| d.total()));
    let relative = |(a, b): (&DVec3, &DVec3)| ((*a - *b) / totals).abs().max_element();
    [sums, by_rule].map(|values| values.iter().zip(&exact).map(relative).fold(0.0, f64::max))
}

#[test]
fn near_and_far_are_the_whole_for_every_material_and_split() {
    let noise = |i: u64| DVec3::new(uniform(7, i, 0), uniform(7, i, 1), uniform(7, i, 2));
    for name in ["marble", "spectralon", "cream", "ketchup", "chicken1"] {
        for (samples, split) in [(3000, 3.9), (3000, 1.0), (12_000, 2.0)] {
            let fixture = Fixture::new(shapes::icosphere(10.0, 3), named(name), samples);
            let error = difference(fixture, split, NearField::REFERENCE, &noise);
            assert!(error < 2e-4, "{name} {samples} {split}: {error:.1e}");
        }
    }
}

#[test]
fn a_coarse_rule_costs_what_it_costs_without_a_split() {
    for name in ["marble", "spectralon", "skin1"] {
        let fixture = Fixture::new(shapes::icosphere(10.0, 4), named(name), 20_000);
        let [split, whole] = differences(fixture, 1.5, NearField::FAST, &|_| DVec3::ONE);
        // The gather is stricter than its rule by the radius of a group of receivers, the near field is not.
        assert!(whole < 4e-3 && split < 2.5 * whole + 2e-4, "{name}: {split:.1e} {whole:.1e}");
    }
}

#[test]
fn a_split_far_above_the_free_path_leaves_all_to_the_near_field() {
    // 1 mm of spectralon is twenty free paths, the samples are far apart, and the far part is nearly nothing.
    let fixture = Fixture::new(shapes::plane(40.0, 40.0, 8), named("spectralon"), 128);
    let error = difference(fixture, 12.0, NearField::REFERENCE, &|i| DVec3::splat(uniform(8, i, 0)));
    assert!(error < 3e-4, "{error:.1e}");
}

#[test]
fn the_result_does_not_depend_on_the_light_s_unit() {
    let dim = difference(Fixture::new(shapes::icosphere(10.0, 2), named("skin1"), 500), 2.0, NearField::FAST, &|_| {
        DVec3::splat(1e-250)
    });
    assert!(dim < 1e-250, "{dim:e}");
}
