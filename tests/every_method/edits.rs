//! Many edits under few lights: what is prepared for them changes next to nothing, in any order.

use super::*;

/// RMS of what preparing may cost, relative.
const COSTS: f64 = 2e-3;

#[test]
fn prepared_edits_are_those_of_a_fresh_evaluator() {
    let scene = Shared::Group.scene();
    let areas = vertex_areas(&scene);
    for method in every() {
        let lights = served(method, &every_light_but(LightKind::Spot, &scene));
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
