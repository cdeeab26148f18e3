//! Many edits under few lights: what is prepared for them changes next to nothing, in any order.

use translux::evaluate::Model;
use translux::transport::calibration::Walks;

use super::*;

/// RMS of what preparing may cost, relative.
const COSTS: f64 = 2e-3;

#[test]
fn prepared_edits_are_those_of_a_fresh_evaluator() {
    let scene = Shared::Group.scene();
    let areas = vertex_areas(&scene);
    // From everywhere, sharp, and unlike from every side.
    let lights = every_light_but(&[LightKind::Area, LightKind::Spot], &scene);
    for method in every() {
        let lights = served(method, &lights);
        let mut plain = Shared::Group.baked(method);
        let [mut before, mut after] = [Shared::Group.baked(method), Shared::Group.baked(method)];
        before.prepare_for_edits(&Silent);
        for evaluator in [&mut plain, &mut before, &mut after] {
            evaluator.set_lights(vec![lights[0].clone()], &Silent).unwrap();
        }
        after.prepare_for_edits(&Silent);
        after.prepare_for_edits(&Silent);
        let check = |what: &str, [plain, before, after]: [&mut Box<dyn Evaluator>; 3]| {
            let [plain, before, after] = [plain, before, after].map(|e| e.radiosity(&Silent).unwrap());
            assert!(before == after, "{}, {what}: the order matters", method.name());
            let error = vertex_error(&before, &plain, &areas);
            assert!(error.rms < COSTS, "{}, {what}: {error:?}", method.name());
        };
        check("as it was", [&mut plain, &mut before, &mut after]);
        for light in &lights {
            for evaluator in [&mut plain, &mut before, &mut after] {
                evaluator.set_lights(vec![light.clone()], &Silent).unwrap();
            }
            check(light.kind().name(), [&mut plain, &mut before, &mut after]);
        }
        if plain.capabilities().material != MaterialEdit::Any {
            continue;
        }
        for pair in [["skin2", "cream"], ["ketchup", "wholemilk"]] {
            for evaluator in [&mut plain, &mut before, &mut after] {
                evaluator.set_media(pair.map(medium).to_vec()).unwrap();
            }
            check(pair[0], [&mut plain, &mut before, &mut after]);
        }
    }
}

/// What evaluators keep of lights through edits, one by themselves and as many as they are told, leaves no trace.
#[test]
fn lights_that_are_remembered_leave_no_trace() {
    // Coarse, since what is compared is equal to the last bit, and so small that walks of photons end soon.
    let scene = group_at(1, Scale::MillimetresPerUnit(0.2));
    let lights = every_light(&scene);
    let sky = lights.iter().position(|light| light.kind() == LightKind::Environment).unwrap();
    // Two at once, and more than are remembered.
    let turns: [Vec<Light>; 3] =
        [vec![lights[sky].clone()], vec![lights[1].clone(), lights[sky].clone()], vec![lights[0].clone()]];
    // The last has another index of refraction.
    let media = [["marble", "skin1"], ["skin1", "ketchup"], ["cream", "marble"]];
    for model in [Model::Dipole, Model::Calibrated(Walks { photons: 1024, ..Walks::default() })] {
        let probes = in_memory::probes(&scene);
        let settings =
            BakeSettings { model, probes, samples: Some(400), tells_model: false, ..BakeSettings::new(0.05) };
        let recipe = in_memory::method("editable").recipe(&[], settings).unwrap();
        let asset = Arc::new(recipe.bake(scene.clone(), Provenance::default(), &Silent).unwrap());
        let fresh: Vec<Vec<Vec<DVec3>>> = media
            .iter()
            .map(|media| {
                let mut evaluator = in_memory::opened(Arc::clone(&asset));
                evaluator.set_media(media.map(medium).to_vec()).unwrap();
                turns.iter().map(|lights| lit(evaluator.as_mut(), lights.clone())).collect()
            })
            .collect();
        let mut evaluator = in_memory::opened(asset);
        // The media in turn under each light; dipoles keep all of that.
        for (turn, lights) in turns.iter().enumerate().filter(|_| model != Model::Dipole) {
            evaluator.set_lights(lights.clone(), &Silent).unwrap();
            for (edit, media) in media.iter().enumerate() {
                evaluator.set_media(media.map(medium).to_vec()).unwrap();
                let found = evaluator.radiosity(&Silent).unwrap();
                assert!(found == fresh[edit][turn], "{model:?}: light {turn}, media {edit}");
            }
        }
        // The lights in turn in all media.
        evaluator.remember_lights(2);
        for edit in [0, 1, 2] {
            evaluator.set_media(media[edit].map(medium).to_vec()).unwrap();
            for (turn, lights) in turns.iter().enumerate() {
                let found = lit(evaluator.as_mut(), lights.clone());
                assert!(found == fresh[edit][turn], "{model:?}: remembered, media {edit}, light {turn}");
            }
        }
    }
}
