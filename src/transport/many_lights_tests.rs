use glam::DVec3;

use super::*;
use crate::geometry::shapes;
use crate::light::Light;
use crate::math::statistics::vertex_error;
use crate::progress::Silent;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::near_rule::NearField;
use crate::transport::test_scene::{Fixture, named};

fn lights(count: usize) -> Vec<Light> {
    let from = |i: usize| crate::math::random::uniform(7, i as u64, 0) * 2.0 - 1.0;
    (0..count)
        .map(|i| Light::Directional {
            from: DVec3::new(from(3 * i), from(3 * i + 1), from(3 * i + 2)).normalize(),
            irradiance: DVec3::ONE,
        })
        .collect()
}

fn rows(fixture: &Fixture, lights: &[Light]) -> (IrradianceRows, Vec<Vec<DVec3>>) {
    let surface = fixture.surface();
    let eta = fixture.eta();
    let of_light = |light: &Light| {
        let one = std::slice::from_ref(light);
        Illumination::new(&surface, one, &[eta], LightSampling::FAST).unwrap().all(&Silent)
    };
    let columns: Vec<Vec<DVec3>> = lights.iter().map(of_light).collect();
    let of_sample = |s: usize| columns.iter().map(move |c| c[s].x as f32);
    let values = (0..fixture.samples.len()).flat_map(of_sample).collect();
    (IrradianceRows { lights: lights.len(), by_channel: false, values }, columns)
}

fn with_many<T>(fixture: &Fixture, work: impl FnOnce(&mut ManyLights, &Gather, &Receivers) -> T) -> T {
    with_many_near(fixture, NearField::FAST, work)
}

fn with_many_near<T>(
    fixture: &Fixture,
    near: NearField,
    work: impl FnOnce(&mut ManyLights, &Gather, &Receivers) -> T,
) -> T {
    let surface = fixture.surface();
    let gather = Gather::new(&surface, &fixture.tree, &fixture.scene.media, near);
    let receivers = fixture.receivers(16);
    let areas = vec![1.0; receivers.len()];
    work(&mut ManyLights::new(&gather, &fixture.tree, &receivers, &areas), &gather, &receivers)
}

/// Errors under each light against all pairs.
fn errors(found: &RadiosityRows, columns: &[Vec<DVec3>], gather: &Gather, receivers: &Receivers) -> Vec<VertexError> {
    let of_light = |(light, column): (usize, &Vec<DVec3>)| {
        let expected = gather.radiosity(receivers, &gather.light(column), Scheme::AllPairs, &Silent);
        vertex_error(&found.under(light), &expected, &vec![1.0; expected.len()])
    };
    columns.iter().enumerate().map(of_light).collect()
}

/// So few that no group of receivers is wide beside them: what is near a wide one is summed for each receiver alone under one light, and for
/// all of them under many.
const FEW_SAMPLES: usize = 600;

#[test]
fn all_pairs_are_those_of_the_gather() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("marble"), FEW_SAMPLES);
    let lights = lights(5);
    let (rows, columns) = rows(&fixture, &lights);
    with_many_near(&fixture, NearField::REFERENCE, |many, gather, receivers| {
        let found = many.radiosity(&rows, &Silent);
        for error in errors(&found, &columns, gather, receivers) {
            assert!(error.worst < 3e-6, "{error:?}");
        }
        assert_eq!(found.of(3).len(), 15);
        assert!(found.of(receivers.len()).is_empty());
    });
}

#[test]
fn channels_may_have_light_of_their_own() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("skin1"), FEW_SAMPLES);
    // More than a block of columns.
    for count in [5, 19] {
        let (one, columns) = rows(&fixture, &lights(count));
        let other = |light: usize, c: usize| &columns[(light + 2 * c) % count];
        let mixed: Vec<Vec<DVec3>> = (0..count)
            .map(|light| {
                let of = |s: usize| DVec3::from([0, 1, 2].map(|c| (c + 1) as f64 * other(light, c)[s].x));
                (0..fixture.samples.len()).map(of).collect()
            })
            .collect();
        let row = |s: usize| (0..3).flat_map(move |c| (0..count).map(move |light| (light, c, s)));
        let values = (0..fixture.samples.len()).flat_map(row).map(|(light, c, s)| mixed[light][s][c] as f32).collect();
        let own = IrradianceRows { by_channel: true, values, ..one };
        for (light, column) in mixed.iter().enumerate() {
            assert!(own.under(light).iter().zip(column).all(|(a, b)| (*a - *b).abs().max_element() < 1e-6));
        }
        with_many_near(&fixture, NearField::REFERENCE, |many, gather, receivers| {
            for error in errors(&many.radiosity(&own, &Silent), &mixed, gather, receivers) {
                assert!(error.worst < 3e-6, "{error:?}");
            }
            many.tune(0.005, &own);
            for error in errors(&many.radiosity(&own, &Silent), &mixed, gather, receivers) {
                assert!(error.rms < 0.0075, "{error:?}");
            }
        });
    }
}

#[test]
fn the_hierarchy_keeps_the_asked_error_under_lights_that_no_tuning_saw() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 4), named("skin1"), 12_000);
    let lights = lights(8);
    let (tuning, _) = rows(&fixture, &lights[..4]);
    let (others, columns) = rows(&fixture, &lights[4..]);
    with_many(&fixture, |many, gather, receivers| {
        for asked in [0.01, 0.002] {
            let own = many.tune(asked, &tuning);
            assert!(own.rms > 0.05 * asked && own.rms < 1.5 * asked, "{own:?}");
            let found = many.radiosity(&others, &Silent);
            for error in errors(&found, &columns, gather, receivers) {
                assert!(error.rms < 1.5 * asked, "{asked}: {error:?}");
            }
        }
    });
}

#[test]
fn every_level_gives_the_same_bits() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 2), named("marble"), 1500);
    let (all, _) = rows(&fixture, &lights(37));
    let of_level = |level| {
        with_many(&fixture, |_, gather, receivers| {
            let areas = vec![1.0; receivers.len()];
            let many = ManyLights::new(gather, &fixture.tree, receivers, &areas);
            ManyLights { level, ..many }.radiosity(&all, &Silent)
        })
    };
    let levels = InstructionSet::available();
    for level in &levels[1..] {
        assert_eq!(of_level(*level), of_level(levels[0]));
    }
}

#[test]
fn nothing_gives_nothing() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 1), named("marble"), 300);
    with_many(&fixture, |many, _, receivers| {
        let dark = IrradianceRows { lights: 2, by_channel: false, values: vec![0.0; 2 * fixture.samples.len()] };
        assert!(many.radiosity(&dark, &Silent).values.iter().all(|v| *v == 0.0));
        let none = IrradianceRows { lights: 0, by_channel: false, values: Vec::new() };
        assert_eq!((many.radiosity(&none, &Silent).values.len(), receivers.is_empty()), (0, false));
    });
}

/// A shard has few receivers and a bake many: threads share the sources of a group there, and the groups here.
#[test]
fn a_few_receivers_have_the_same_bits_as_among_all() {
    let fixture = Fixture::new(shapes::bumpy_head(10.0, 3), named("marble"), 3 * SOURCES_OF_A_JOB);
    let (rows, _) = rows(&fixture, &lights(5));
    with_many(&fixture, |many, _, receivers| {
        let all = many.radiosity(&rows, &Silent);
        // Groups one after the other, as they are among all.
        let groups = FEW_GROUPS / 2;
        let count = receivers.groups[..groups].iter().map(|group| group.run.range().len()).sum::<usize>();
        let mut few = receivers.clone();
        few.groups.truncate(groups);
        assert!(receivers.groups.len() > FEW_GROUPS && count > 1);
        let areas = vec![1.0; few.len()];
        let found = many.towards(&few, &areas).radiosity(&rows, &Silent);
        let size = 3 * rows.lights;
        assert!(found.values[..count * size] == all.values[..count * size]);
        assert!(all.values[..count * size].iter().any(|v| *v > 0.0));
    });
}
