//! The choice alone, on small bodies: what is asked decides what is chosen. tests/cli bakes what is chosen here.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use super::candidates::{Candidate, Candidates};
use super::choice::Choice;
use super::lights::{Purpose, lights};
use super::record::{Attempt, Considered, Left};
use super::request::{DEFAULT_MAX_RMS, Edits, Request};
use super::truth::{Places, Sampling, TrueSums, Truth, between_few_vertices, samples_of_a_choice, telling};
use super::{PLACES, mesh_bytes};
use crate::evaluate::Model;
use crate::geometry::mesh::{Mesh, Placement};
use crate::geometry::part_table::PartTable;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::light::{Light, LightKind};
use crate::math::statistics::VertexError;
use crate::medium::material::{Medium, preset};
use crate::methods::built_in;
use crate::progress::Silent;
use crate::scene::Scene;
use crate::transport::calibration::Walks;

fn scene(model: SourceModel, material: &str) -> Scene {
    let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
    let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".to_owned(), Some(0))]);
    let media = vec![Medium { name: material.to_owned(), properties: preset(material).unwrap().properties() }];
    Scene { mesh, parts, media }
}

fn request(max_rms: f64, kinds: &[LightKind]) -> Request {
    Request::new(max_rms, kinds.iter().copied().collect())
}

/// Everything that a choice needs, and what comes of it.
fn choosing<R>(
    scene: &Scene,
    request: &Request,
    with: impl FnOnce(&mut Choice, &[Candidate], &mut [Considered], &mut Sampling) -> R,
) -> R {
    let memory = u64::MAX;
    let Candidates { all, mut considered, families } =
        Candidates::new(&built_in(), request, (scene, None), (mesh_bytes(scene).unwrap(), memory));
    let seen = telling(lights(scene, &request.for_lights, Purpose::Choice).unwrap(), scene, request.model);
    let samples = samples_of_a_choice(scene, request.max_rms, request.model);
    let mut sums = TrueSums::new(scene, (samples, request.max_rms), (Vec::new(), None));
    let truth = Truth::new(&mut sums, (seen, Places::new(scene, PLACES, 0)), &Silent).unwrap();
    let mut sampling = Sampling::new(scene, &[], (truth, samples), request);
    with(&mut Choice::new(&all, request, families.len()), &all, &mut considered, &mut sampling)
}

/// The first candidate that would be baked, all that were considered, and what would meet the request.
fn chosen(scene: &Scene, request: &Request) -> (Option<Considered>, Vec<Considered>, String) {
    choosing(scene, request, |choice, all, considered, sampling| {
        let next = choice.next(considered, sampling).unwrap();
        let would_meet = choice.would_meet(considered, sampling).unwrap();
        (next.map(|index| considered[all[index].entry].clone()), considered.to_vec(), would_meet)
    })
}

#[test]
fn what_is_asked_decides_what_is_chosen() {
    let head = scene(shapes::bumpy_head(15.0, 4), "skin1");
    let sun = request(0.01, &[LightKind::Directional]);
    let plain = chosen(&head, &sun).0.unwrap();
    println!("a sun: {plain:?}");
    // Nothing stored but samples, and no more of them than needed.
    assert!(["editable", "two_pass"].contains(&plain.family.as_str()) && plain.samples.unwrap() < 1 << 15);

    // A light as fast as a lookup: transport must be stored, and the material may be baked in or not.
    let fast = Request { max_rms: 0.1, max_relight_ms: Some(1.2), ..sun.clone() };
    let looked_up = chosen(&head, &fast).0.unwrap();
    println!("fast: {looked_up:?}");
    assert!(looked_up.expected.as_ref().unwrap().relight_ms <= 1.2);
    assert!(["quantized_lights", "all_frequency"].contains(&looked_up.method.as_str()), "{looked_up:?}");
    let (none, considered, _) = chosen(&head, &Request { edit: Edits::Any, ..fast.clone() });
    assert!(none.is_none(), "{none:?}");
    let baked_in = considered.iter().filter(|c| c.why.contains("its material is baked in"));
    assert_eq!(baked_in.map(|c| c.method.as_str()).collect::<Vec<_>>(), ["quantized_lights", "all_frequency"]);

    // A few milliseconds, and the material free: stored transport of a basis.
    let edited = Request { max_relight_ms: Some(3.2), edit: Edits::Absorption, ..sun.clone() };
    let edited = chosen(&head, &edited).0.unwrap();
    println!("edited: {edited:?}");
    assert!(edited.family.starts_with("editable transport=stored"), "{edited:?}");

    // Point light is no light from far away.
    let (_, considered, _) = chosen(&head, &Request { for_lights: BTreeSet::from([LightKind::Point]), ..fast });
    assert!(considered.iter().any(|c| c.method == "all_frequency" && c.why.contains("far away")));
}

#[test]
fn smaller_errors_take_more_samples_and_what_cannot_be_says_what_can() {
    let head = scene(shapes::bumpy_head(15.0, 4), "marble");
    let samples = |max_rms: f64| chosen(&head, &request(max_rms, &[LightKind::Directional])).0.unwrap().samples;
    let [coarse, fine] = [0.05, 0.002].map(samples);
    println!("{coarse:?} samples for 5 %, {fine:?} for 0.2 %");
    assert!(coarse.unwrap() < fine.unwrap());
    let tiny = Request { max_bytes_per_vertex: Some(0.1), ..request(0.01, &[LightKind::Directional]) };
    let (none, considered, would_meet) = chosen(&head, &tiny);
    assert!(none.is_none() && considered.iter().all(|c| c.left.is_some()));
    assert!(considered.iter().any(|c| c.left == Some(Left::Size) && c.why.contains("bytes/vertex")));
    println!("{would_meet}");
    assert!(would_meet.contains("bytes/vertex") && would_meet.contains("ms for a new light"));
}

#[test]
fn what_has_no_more_samples_than_what_missed_is_left_unless_it_is_expected_to_do() {
    let ball = scene(shapes::icosphere(8.0, 3), "marble");
    let model = Model::Calibrated(Walks::default());
    let wanted = Request { model, ..request(0.005, &[LightKind::Directional]) };
    choosing(&ball, &wanted, |choice, all, considered, sampling| {
        let index = choice.next(considered, sampling).unwrap().unwrap();
        let (first, only) = (&all[index], &all[index..=index]);
        let samples = first.forecast.erring_samples().unwrap();
        let expected = considered[first.entry].expected.as_ref().unwrap().rms.unwrap();
        let alike = || all.iter().filter(|c| c.family == first.family);
        let with_samples =
            |found: &dyn Fn(usize) -> bool| alike().find(|c| c.forecast.erring_samples().is_some_and(found)).unwrap();
        let fewer = with_samples(&|number| number < samples);
        let more = with_samples(&|number| number > samples);
        // What was expected may be unlucky, so that a bake is worth trying a tenth beyond the request, but not one with no more samples than
        // what missed.
        for (beyond, missed, baked) in [(1.1, fewer, true), (1.1, first, false), (1.1, more, false), (0.9, first, true)]
        {
            let slightly = Request { max_rms: expected / beyond, ..wanted.clone() };
            let mut choice = Choice::new(only, &slightly, all.iter().map(|c| c.family).max().unwrap() + 1);
            // As large as what was expected, so that nothing is learnt but that it missed.
            let (rms, _) = choice.expected(missed, sampling).unwrap();
            let attempt = Attempt {
                considered: missed.entry,
                bytes: missed.file_bytes as u64,
                bytes_per_vertex: missed.forecast.bytes / missed.vertices as f64,
                error: VertexError { rms, ..VertexError::default() },
                worst_light: String::new(),
                lights: 1,
                vertices: PLACES,
                between: 0,
                misses: vec!["slightly".to_owned()],
            };
            choice.learn(missed, &attempt, considered, sampling).unwrap();
            let next = choice.next(considered, sampling).unwrap();
            assert_eq!(next, baked.then_some(0), "{beyond} {:?} of {samples}", missed.forecast.erring_samples());
        }
    });
}

#[test]
fn the_model_decides_what_can_be_stored() {
    let ball = scene(shapes::icosphere(8.0, 3), "marble");
    let calibrated = Request { model: Model::Calibrated(Walks::default()), ..request(0.02, &[LightKind::Directional]) };
    let (chosen, considered, _) = chosen(&ball, &calibrated);
    let chosen = chosen.unwrap();
    assert!(["editable", "two_pass"].contains(&chosen.family.as_str()), "{chosen:?}");
    assert!(considered.iter().any(|c| c.family.contains("stored") && c.why.contains("holds the dipole")));
    // Stored transport of calibrated kernels errs by the samples that it is baked from too.
    let erring = |request: &Request| -> Vec<bool> {
        let all = Candidates::new(&built_in(), request, (&ball, None), (0, u64::MAX)).all;
        let stored = all.iter().filter(|c| c.forecast.samples.is_none() && c.recipe.form.serves(request.model));
        stored.map(|c| c.forecast.erring_samples().is_some()).collect()
    };
    let [calibrated, dipole] = [&calibrated, &request(0.02, &[LightKind::Directional])].map(erring);
    assert!(!calibrated.is_empty() && calibrated.iter().all(|errs| *errs));
    assert!(!dipole.is_empty() && !dipole.contains(&true));
}

#[test]
fn lights_are_of_the_kinds_asked_for_and_some_graze_the_largest_flat_area() {
    let slab = scene(shapes::cuboid(glam::DVec3::new(40.0, 3.0, 40.0), 4), "marble");
    for purpose in [Purpose::Choice, Purpose::Verdict { directions: 6 }] {
        let suns = lights(&slab, &BTreeSet::from([LightKind::Directional]), purpose).unwrap();
        let from = suns.iter().map(|light| match light {
            Light::Directional { from, .. } => *from,
            _ => panic!("{light:?}"),
        });
        let from: Vec<glam::DVec3> = from.collect();
        assert!(
            from.iter().any(|d| d.y.abs() < 0.06) && from.iter().any(|d| d.y < -0.8) && from.iter().any(|d| d.z < -0.8)
        );
    }
    let all: BTreeSet<LightKind> = LightKind::ALL.into_iter().collect();
    let [choice, verdict] =
        [Purpose::Choice, Purpose::Verdict { directions: 6 }].map(|purpose| lights(&slab, &all, purpose).unwrap());
    let kinds: BTreeSet<LightKind> = choice.iter().map(Light::kind).collect();
    assert_eq!(kinds, all);
    // Only the light that has no direction is the same.
    assert_eq!(choice.iter().filter(|light| verdict.contains(light)).count(), 1);
    let [first, second] = [0, 1].map(|phase| Places::new(&slab, 40, phase).vertices);
    assert!(!first.is_empty() && first.iter().all(|vertex| !second.contains(vertex)));
}

#[test]
fn places_lie_one_here_and_one_there() {
    let ball = scene(shapes::icosphere(8.0, 4), "marble");
    let places = Places::new(&ball, 128, 1);
    let at = |vertex: &u32| ball.mesh.local_mm[*vertex as usize].as_dvec3();
    let to_nearest = |vertex: &u32| {
        let others = places.vertices.iter().filter(|other| *other != vertex);
        others.map(|other| at(other).distance(at(vertex))).fold(f64::INFINITY, f64::min)
    };
    let mean = places.vertices.iter().map(to_nearest).sum::<f64>() / places.vertices.len() as f64;
    let spacing = (ball.parts.parts[0].area_mm2 / places.vertices.len() as f64).sqrt();
    assert!(places.vertices.len().abs_diff(128) < 10 && mean > 0.5 * spacing, "{mean} {spacing}");
}

#[test]
fn coarse_surfaces_are_judged_between_their_vertices_too() {
    let cube = scene(shapes::cuboid(glam::DVec3::splat(20.0), 1), "skin1");
    let between = between_few_vertices(&cube, PLACES, &Silent).unwrap();
    assert!(between.unwrap().rms > 0.3, "{between:?}");
    // Many vertices, or few that will do.
    let ball = scene(shapes::icosphere(8.0, 2), "skin1");
    for few in [PLACES, usize::MAX] {
        assert_eq!(between_few_vertices(&ball, few, &Silent).unwrap(), None);
    }
    let [first, second] = [0, 1].map(|phase| Places::between(&cube, 128, phase));
    for places in [&first, &second] {
        assert!(places.len() == 128 && places.vertices.len() == 8);
        // Every facet has as many as its area says, and all stand for the surface.
        let (points, areas) = places.parts();
        let on_top = points.iter().skip(8).filter(|p| p.at_mm.y > 9.99).count();
        assert!((18..=22).contains(&on_top), "{on_top}");
        assert!((areas.iter().sum::<f64>() - 2400.0).abs() < 1e-6);
        assert!(points.iter().all(|p| p.barycentric.iter().all(|w| (0.0..=1.0).contains(w))));
    }
    let (seen, unseen) = (first.parts().0, second.parts().0);
    assert!(seen[8..].iter().all(|p| !unseen.contains(p)));
    let sun = request(0.05, &[LightKind::Directional]);
    let found = Candidates::new(&built_in(), &sun, (&cube, between), (0, u64::MAX));
    assert!(!found.all.is_empty() && found.all.iter().all(|c| c.recipe.form.serves_points()));
    let ends = found.considered.iter().filter(|c| c.why.contains("ends at the vertices"));
    assert!(ends.map(|c| c.method.as_str()).collect::<Vec<_>>().contains(&"all_frequency"));
}

#[test]
fn nobody_pays_for_less_than_a_third_of_the_error_of_the_model() {
    let model = |rms: f64| Some(VertexError { rms, ..VertexError::default() });
    let named = request(DEFAULT_MAX_RMS, &[LightKind::Directional]);
    assert_eq!(named.beside(model(0.12)), named);
    let free = Request { max_rms_may_grow: true, ..named };
    assert_eq!(free.beside(None), free);
    for (rms, expected) in [(0.01, DEFAULT_MAX_RMS), (0.12, 0.04), (0.6, 0.05)] {
        assert!((free.beside(model(rms)).max_rms - expected).abs() < 1e-12, "{rms}");
    }
}
