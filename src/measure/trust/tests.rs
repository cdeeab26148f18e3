//! The map against what is measured under lights that it never saw.
#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::blame::{Place, blame};
use super::exact::{Exact, Subject, Which};
use super::map::{Trust, measure, probe_lights, trust};
use super::thickness::thickness;
use crate::asset::{Asset, Provenance};
use crate::evaluate::exitance::MeshPoint;
use crate::evaluate::{BakeSettings, Evaluator};
use crate::forms::gathered::{Bound, Far};
use crate::geometry::bvh::Bvh;
use crate::geometry::mesh::{Mesh, Placement};
use crate::geometry::part_table::PartTable;
use crate::geometry::shapes;
use crate::geometry::source::SourceModel;
use crate::geometry::test_data::obj;
use crate::light::{Light, LightKind};
use crate::math::statistics::units;
use crate::measure::probes::{Half, directional, for_bake, points};
use crate::medium::material::{Medium, preset};
use crate::methods::built_in;
use crate::progress::Silent;
use crate::scene::Scene;

/// Samples of what assets are measured against.
const SAMPLES_OF_TRUTH: usize = 3000;

/// Samples of the assets.
const SAMPLES: usize = 1000;

fn scene(model: SourceModel) -> Scene {
    let (mesh, _) = Mesh::from_source(model, &Placement { mm_per_unit: 1.0 }).unwrap();
    let parts = PartTable::new(&mesh, vec![0; mesh.triangles.len()], vec![("body".to_owned(), Some(0))]);
    let media = vec![Medium { name: "marble".to_owned(), properties: preset("marble").unwrap().properties() }];
    Scene { mesh, parts, media }
}

/// An asset of a head of 162 vertices, 20 mm across.
fn asset(method: &str, given: &[(&str, &str)]) -> Asset {
    asset_of(scene(shapes::bumpy_head(10.0, 2)), method, given)
}

fn asset_of(scene: Scene, method: &str, given: &[(&str, &str)]) -> Asset {
    let settings = BakeSettings {
        samples: Some(SAMPLES),
        for_lights: [LightKind::Directional, LightKind::Point].into_iter().collect(),
        probes: for_bake(&scene),
        ..BakeSettings::new(0.02)
    };
    let registry = built_in();
    let method = *registry.methods().iter().find(|m| m.name() == method).unwrap();
    let given: Vec<(String, String)> = given.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let kinds = method.kinds();
    let for_lights = settings.for_lights.iter().copied().filter(|kind| kinds.contains(kind)).collect();
    let recipe = method.recipe(&given, BakeSettings { for_lights, ..settings }).unwrap();
    recipe.bake(scene, Provenance::default(), &Silent).unwrap()
}

fn opened(asset: &Asset) -> Box<dyn Evaluator> {
    built_in().open(std::sync::Arc::new(asset.clone())).unwrap()
}

fn subject<'a>(evaluator: &'a mut dyn Evaluator, asset: &'a Asset) -> Subject<'a> {
    Subject { evaluator, asset, profile: None, admit: &|_| Ok(()) }
}

/// The unseen lights and the radiosity of every vertex under them, by brute force: all pairs of 3,000 samples.
fn truths(evaluator: &mut dyn Evaluator, asset: &Asset) -> Vec<(Light, Vec<DVec3>)> {
    let mesh = &asset.scene.mesh;
    let lights = directional(Half::Figures).into_iter().chain(points(mesh, Half::Figures));
    let mut exact = Exact::new(&subject(evaluator, asset), Which::Finer(SAMPLES_OF_TRUTH), Far::AllPairs);
    let truth = |light: Light| {
        let values = exact.under(&light, &Silent).unwrap().at_vertices(&Silent).unwrap();
        (light, values)
    };
    lights.map(truth).collect()
}

/// Mean over the unseen lights of the absolute error of every vertex, worst channel.
fn measured(evaluator: &mut dyn Evaluator, asset: &Asset, truths: &[(Light, Vec<DVec3>)]) -> Vec<f64> {
    let areas = asset.scene.vertex_areas_mm2();
    let mut subject = subject(evaluator, asset);
    let (mut sums, mut count) = (vec![DVec3::ZERO; areas.len()], 0.0);
    for (light, truth) in truths {
        let Ok(served) = subject.served(light, false) else { continue };
        let unit = units(truth, &areas);
        sums.iter_mut()
            .zip(served.radiosity.iter().zip(truth))
            .for_each(|(sum, (b, t))| *sum += ((*b - *t) / unit).abs());
        count += 1.0;
    }
    sums.into_iter().map(|sum| sum.max_element() / count).collect()
}

/// Ranks of some values; values that are the same share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    for run in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let first = order.iter().position(|&i| i == run[0]).unwrap();
        run.iter().for_each(|&i| ranks[i] = first as f64 + 0.5 * (run.len() - 1) as f64);
    }
    ranks
}

/// Spearman's rank correlation.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let [a, b] = [a, b].map(ranks);
    let mean = (a.len() - 1) as f64 / 2.0;
    let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| (x - mean) * (y - mean)).sum::<f64>();
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
}

fn expected(map: &Trust) -> Vec<f64> {
    map.vertices.iter().map(|vertex| vertex.error.max_element()).collect()
}

/// One method that gathers, one that stores, and an approximation; `two_pass`, stored `editable` and `texture_space` rank alike (docs/trust.md).
const METHODS: [(&str, &[(&str, &str)]); 3] = [("editable", &[]), ("quantized_lights", &[]), ("filtered_normals", &[])];

#[test]
fn the_map_ranks_vertices_as_unseen_lights_do() {
    // A body with ears, brows and eyes: on a ball no vertex is worse than another.
    let Some(source) = obj("meshes/suzanne.obj") else { return };
    let mut head = scene(source);
    let factor = head.mesh.resize(20.0).unwrap();
    head.parts = head.parts.scaled(factor);
    let mut truths_of_head = None;
    for (method, given) in METHODS {
        let asset = asset_of(head.clone(), method, given);
        let mut evaluator = opened(&asset);
        // Light on the head is the same whoever approximates it.
        let truths = truths_of_head.get_or_insert_with(|| truths(evaluator.as_mut(), &asset));
        let truth = measured(evaluator.as_mut(), &asset, truths);
        let mut subject = subject(evaluator.as_mut(), &asset);
        let lights = probe_lights(&mut subject).unwrap();
        let map =
            measure(subject, (lights, asset.scene.clone()), (SAMPLES_OF_TRUTH, Far::AllPairs, false), &Silent).unwrap();
        let found = rank_correlation(&expected(&map), &truth);
        let mean = truth.iter().sum::<f64>() / truth.len() as f64;
        println!(
            "{method} {given:?}: rank correlation {found:.3}, mean {mean:.4}, {:?}, {}",
            map.sums,
            map.lights.len()
        );
        assert!(found >= 0.7, "{method} {given:?}: {found}");
    }
}

#[test]
fn sums_through_the_hierarchy_say_the_same() {
    let asset = asset("editable", &[]);
    let mut evaluator = opened(&asset);
    let lights: Vec<Light> = directional(Half::Tuning).into_iter().step_by(4).collect();
    let far = [Far::AllPairs, Far::Hierarchical { error: 1e-3, bound: Bound::SolidAngle }];
    let [pairs, tree] = far.map(|far| {
        let subject = subject(evaluator.as_mut(), &asset);
        measure(subject, (lights.clone(), asset.scene.clone()), (1 << 15, far, false), &Silent).unwrap()
    });
    let found = rank_correlation(&expected(&pairs), &expected(&tree));
    println!("hierarchy against all pairs: rank correlation {found:.3}, {:?} and {:?}", pairs.sums, tree.sums);
    assert!(found > 0.95 && pairs.stages.is_none() && tree.sums.hierarchy == Some(1e-3), "{found}");
}

#[test]
fn every_column_is_what_its_name_says() {
    let asset = asset("quantized_lights", &[]);
    let mut evaluator = opened(&asset);
    let map = trust(subject(evaluator.as_mut(), &asset), &Silent).unwrap();
    let stages = map.stages.as_ref().unwrap();
    assert!(!map.stores_environment && stages.len() == map.vertices.len());
    for (vertex, stage) in map.vertices.iter().zip(stages) {
        let error = vertex.error.max_element();
        // The largest of some is not below their root mean square, and stages add up at most.
        assert!(error <= 1.001 * vertex.worst && error <= 1.001 * 3f64.sqrt() * (stage.sampling + stage.transport));
        assert!(vertex.from.is_normalized() && (vertex.worst_light as usize) < map.lights.len());
        // A head of about 20 mm.
        let longest = asset.scene.media[0].properties.mean_free_path_mm().max_element();
        let thick_mm = vertex.thickness * longest;
        assert!(thick_mm > 1.0 && thick_mm < 25.0 && vertex.between < 0.6, "{vertex:?}");
    }
    assert!(map.vertices.iter().any(|vertex| vertex.between > 1e-4));
}

#[test]
fn a_body_of_one_thickness_has_it_everywhere_but_at_its_rim() {
    let slab = scene(shapes::cuboid(DVec3::new(40.0, 4.0, 40.0), 8));
    let bvh = Bvh::new(&slab.mesh);
    let depths = thickness(&slab, &bvh);
    let longest = slab.media[0].properties.mean_free_path_mm().max_element();
    let inside = (0..depths.len()).filter(|&v| slab.mesh.local_mm[v].x.abs().max(slab.mesh.local_mm[v].z.abs()) < 19.0);
    let depths: Vec<f64> = inside.map(|v| depths[v] * longest).collect();
    assert!(depths.len() > 50 && depths.iter().all(|mm| (mm - 4.0).abs() < 1e-3), "{depths:?}");
}

#[test]
fn stages_add_up_to_the_error_wherever_one_looks() {
    let light = [Light::Directional { from: DVec3::new(0.3, 0.8, 0.5).normalize(), irradiance: DVec3::splat(3.0) }];
    for (method, given) in
        [("editable", &[][..]), ("quantized_lights", &[]), ("texture_space", &[("resolution", "128")])]
    {
        let asset = asset(method, given);
        let mut evaluator = opened(&asset);
        let at_vertex = Place::vertex(&asset.scene, 17).unwrap();
        let inside = MeshPoint::new(&asset.scene.mesh, 100, [0.2, 0.3, 0.5]).unwrap();
        for place in [at_vertex, Place::point(&asset.scene, inside).unwrap()] {
            let found = blame(subject(evaluator.as_mut(), &asset), &light, place, &Silent).unwrap();
            let sum = found.stages.iter().map(|stage| DVec3::from(stage.error)).sum::<DVec3>();
            assert!((sum - DVec3::from(found.error)).abs().max_element() < 1e-9, "{found:?}");
            assert_eq!(found.stages.len(), if place.vertex.is_some() { 2 } else { 3 });
            assert_eq!(found.mend.is_some(), DVec3::from(found.error).abs().max_element() > found.asked_rms);
            evaluator.set_lights(light.to_vec(), &Silent).unwrap();
            let all = evaluator.radiosity(&Silent).unwrap();
            let there: DVec3 =
                place.point.vertices.iter().zip(place.point.barycentric).map(|(v, w)| w * all[*v as usize]).sum();
            assert!((there - DVec3::from(found.radiosity)).length() < 1e-12);
        }
    }
}

#[test]
fn places_that_are_not_there_are_refused() {
    let scene = scene(shapes::icosphere(5.0, 1));
    let error = Place::vertex(&scene, 42).unwrap_err();
    assert!(error.message().contains("the vertices 0 to 41"), "{}", error.message());
    let asset = asset("two_pass", &[]);
    let mut evaluator = opened(&asset);
    let black = [Light::Directional { from: DVec3::Y, irradiance: DVec3::ZERO }];
    let place = Place::vertex(&asset.scene, 0).unwrap();
    let error = blame(subject(evaluator.as_mut(), &asset), &black, place, &Silent).unwrap_err();
    assert!(error.message().contains("no light arrives"), "{}", error.message());
}
