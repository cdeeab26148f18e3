#![allow(clippy::unwrap_used)]

use glam::DVec3;
use translux_format::texture_space::Numbers;

use super::kept::Shone;
use super::light::LitMap;
use super::map::{Order, TexelMap};
use super::samples::{clusters, drawn};
use super::state::TextureSpaceEvaluator;
use super::*;
use crate::evaluate::{Evaluator, Form};
use crate::forms::density::Density;
use crate::forms::test_scene::scene;
use crate::geometry::atlas::{Atlas, Map};
use crate::geometry::bvh::Bvh;
use crate::geometry::shapes;
use crate::light::{Light, sky};
use crate::math::statistics::vertex_error;
use crate::medium::fresnel;
use crate::progress::Silent;
use crate::scene::Scene;
use crate::transport::near_rule::NearField;

const FORM: TextureSpace = TextureSpace {
    density: Density { spacing: 0.35, least: 12_000, most: 12_000 },
    map: Map::Shape,
    resolution: Some(128),
    sampling: Sampling::Product,
    count: None,
    directions: None,
    area_side: 4,
    near: NearField::FAST,
};

pub(super) const LOCAL: Local =
    Local { importance: 0.02, sharpness: 1.5, rings: 20, of_ring: 20, image: 512, far: Far::Drawn };

fn atlas(scene: &Scene) -> Atlas {
    Atlas::new(&scene.mesh, Map::Shape, 128).unwrap().0
}

fn map(scene: &Scene, resolution: u32, order: Order) -> TexelMap {
    TexelMap::new(scene, atlas(scene), resolution, order).unwrap()
}

fn lit(map: &TexelMap, scene: &Scene, light: Light) -> LitMap {
    let bvh = Bvh::new(&scene.mesh);
    let shone = Shone { map, scene, bvh: &bvh, sampling: FORM.rays(map.points.len()) };
    LitMap::new(map, shone.irradiance(&[light], &Silent).unwrap())
}

pub(super) fn sun() -> Light {
    Light::directional(DVec3::new(0.3, 0.8, 0.5), DVec3::new(1.0, 2.0, 3.0)).unwrap()
}

/// An evaluator that takes `count` samples.
pub(super) fn evaluator(scene: &Scene, sampling: Sampling, count: u32, light: Light) -> TextureSpaceEvaluator {
    let form = TextureSpace { sampling, ..FORM };
    form.validate().unwrap();
    let numbers = Numbers { resolution: 128, count, truth_samples: 12_000 };
    let mut evaluator = TextureSpaceEvaluator::new(&form, scene, atlas(scene), numbers).unwrap();
    evaluator.set_lights(vec![light], &Silent).unwrap();
    evaluator
}

/// No triangle loses light, be it smaller or larger than a texel.
#[test]
fn the_map_holds_all_that_falls_on_the_surface() {
    let scene = scene(shapes::icosphere(3.0, 4), "marble");
    let from = DVec3::new(0.3, 0.8, 0.5).normalize();
    let eta = scene.media[0].properties.eta_inside_over_outside;
    let arriving = |triangle: u32| {
        let cosine = scene.mesh.normal(triangle).dot(from).max(0.0);
        scene.mesh.area_mm2(triangle) * fresnel::transmittance(eta, cosine) * cosine
    };
    let whole: f64 = (0..scene.mesh.triangles.len() as u32).map(arriving).sum();
    for resolution in [16, 64, 256] {
        let map = map(&scene, resolution, Order::Space);
        let area: f64 = map.patches.iter().map(|p| p.area_mm2).sum();
        assert!((area / scene.mesh.total_area_mm2() - 1.0).abs() < 1e-9, "{resolution}");
        let lit = lit(&map, &scene, sun());
        let found = lit.unit * lit.of_part(&map, 0).rgb;
        let error = (found / (whole * DVec3::new(1.0, 2.0, 3.0)) - 1.0).abs().max_element();
        // Triangles at the horizon may shadow their own pieces.
        assert!(error < 1e-3, "{resolution}: {error:.1e}");
    }
}

#[test]
fn samples_carry_the_whole_flux_whatever_the_light() {
    let scene = scene(shapes::bumpy_head(3.0, 3), "skin1");
    let maps = [Order::Texture, Order::Space].map(|order| map(&scene, 128, order));
    let spot = scene.mesh.origin_mm + scene.mesh.local_mm[0].as_dvec3() * 1.0001;
    let lights = [
        sun(),
        Light::point(spot, DVec3::ONE).unwrap(),
        Light::environment(sky::sky().into(), 0.0, DVec3::ONE).unwrap(),
    ];
    for (map, light) in maps.iter().flat_map(|map| lights.iter().map(move |light| (map, light))) {
        let lit = lit(map, &scene, light.clone());
        let whole = lit.of_part(map, 0);
        assert!(whole.weight() > 0.0);
        for count in [1, 7, 400] {
            let shared = drawn(map, &lit.nodes, 0, count);
            let sum: f64 = shared.iter().map(|s| s.flux.element_sum()).sum();
            assert!(shared.len() == count && (sum / whole.weight() - 1.0).abs() < 1e-9, "{count}: {sum}");
            let clusters = clusters(map, &lit.nodes, 0, count);
            let sum: DVec3 = clusters.iter().map(|s| s.flux).sum();
            assert!(clusters.len() <= count && (sum / whole.rgb - 1.0).abs().max_element() < 1e-9, "{count}: {sum}");
            assert!(shared.iter().chain(&clusters).all(|s| s.at_mm.length() < scene.mesh.diagonal_mm()));
        }
    }
    let map = &maps[0];
    let dark = lit(map, &scene, Light::constant(DVec3::ZERO).unwrap());
    assert!(drawn(map, &dark.nodes, 0, 10).is_empty() && clusters(map, &dark.nodes, 0, 10).is_empty());
    assert!(drawn(map, &dark.nodes, 7, 10).is_empty() && clusters(map, &dark.nodes, 7, 10).is_empty());
}

/// Each choice of samples against all texels, and all texels against the exact sums.
#[test]
fn errors_fall_with_the_number_of_samples_and_better_choices_are_better() {
    let scene = scene(shapes::bumpy_head(4.0, 3), "skin1");
    let error = |sampling: Sampling, count: u32| {
        let mut evaluator = evaluator(&scene, sampling, count, sun());
        let values = evaluator.radiosity(&Silent).unwrap();
        let all = evaluator.all_pairs(&Silent).unwrap();
        vertex_error(&values, &all, &scene.vertex_areas_mm2()).rms
    };
    let few = [Sampling::Shared, Sampling::Clusters, Sampling::Product].map(|sampling| error(sampling, 100));
    let many = [Sampling::Shared, Sampling::Clusters, Sampling::Product].map(|sampling| error(sampling, 1600));
    println!("100 samples {few:.5?}, 1600 samples {many:.5?}");
    assert!(few[0] > 2.0 * few[1] && few[1] > few[2] && many[0] > 2.0 * many[1] && many[1] > many[2]);
    assert!(few.iter().zip(&many).all(|(few, many)| *few > 2.0 * many));
    assert!(many[0] < 0.03 && many[2] < 0.003);
    let mut evaluator = evaluator(&scene, Sampling::Product, 1600, sun());
    let ledger = evaluator.measured_error(&[], &Silent).unwrap();
    assert!(ledger.total_rms() < 0.01, "{:?}", ledger.entries);
}

/// The division loses nothing: with many samples the local and the global part add up to the whole.
#[test]
fn local_and_global_light_add_up() {
    let scene = scene(shapes::icosphere(4.0, 4), "skimmilk");
    let (at, to) = (scene.mesh.origin_mm + DVec3::new(9.0, 4.0, 2.0), scene.mesh.origin_mm + DVec3::Y);
    let spot = Light::spot(at, to, 30.0, 0.3, DVec3::splat(100.0)).unwrap();
    for (light, far) in [sun(), spot].iter().flat_map(|light| [Far::Drawn, Far::Clusters].map(|far| (light, far))) {
        let mut evaluator = evaluator(&scene, Sampling::Hybrid(Local { far, ..LOCAL }), 6400, light.clone());
        let values = evaluator.radiosity(&Silent).unwrap();
        let all = evaluator.all_pairs(&Silent).unwrap();
        let error = vertex_error(&values, &all, &scene.vertex_areas_mm2());
        println!("{far:?}: {error:?}");
        assert!(error.rms < 0.015 && error.bias.abs() < 0.005, "{far:?}: {error:?}");
    }
}

/// A light that turns, from frame to frame.
pub(super) fn turned(frame: u32) -> Light {
    let turn = glam::DQuat::from_rotation_y(0.05 * f64::from(frame));
    Light::directional(turn * DVec3::new(0.3, 0.3, 0.8), DVec3::new(1.0, 2.0, 3.0)).unwrap()
}

/// What is kept of a light that moves is next to what all of it anew would be, draws that are kept are as good as new ones, and all is forgotten
/// where a light is set.
#[test]
fn lights_that_move_keep_what_they_leave() {
    let scene = scene(shapes::bumpy_head(3.0, 3), "skin1");
    let areas = scene.vertex_areas_mm2();
    for sampling in [Sampling::Product, Sampling::Shared] {
        let [mut kept, mut anew] = [0, 1].map(|_| evaluator(&scene, sampling, 400, turned(0)));
        let (mut errors, mut frames) = ([0.0f64; 2], 0.0);
        let constant = Light::constant(DVec3::ONE).unwrap();
        for light in (1..6).map(turned).chain([constant]) {
            Evaluator::move_lights(&mut kept, vec![light.clone()], &Silent).unwrap();
            anew.set_lights(vec![light], &Silent).unwrap();
            let [found, expected] = [&mut kept, &mut anew].map(|e| e.radiosity(&Silent).unwrap());
            let all = anew.all_pairs(&Silent).unwrap();
            let rms = [&found, &expected].map(|values| vertex_error(values, &all, &areas).rms);
            let off = vertex_error(&found, &expected, &areas).rms;
            println!("{sampling:?}: {:.1e} kept, {:.1e} anew, {off:.1e} off", rms[0], rms[1]);
            assert!(sampling == Sampling::Shared || off < 5e-3, "{off}");
            errors = [errors[0] + rms[0].powi(2), errors[1] + rms[1].powi(2)];
            frames += 1.0;
        }
        let [kept_rms, anew_rms] = errors.map(|square| (square / frames).sqrt());
        println!("{sampling:?}: {kept_rms:.2e} kept, {anew_rms:.2e} anew");
        assert!(kept_rms < 1.5 * anew_rms, "{sampling:?}: {kept_rms:.2e} {anew_rms:.2e}");
        for all in [Evaluator::radiosity, Evaluator::all_pairs] {
            Evaluator::move_lights(&mut kept, vec![turned(2)], &Silent).unwrap();
            kept.set_lights(vec![turned(1)], &Silent).unwrap();
            anew.set_lights(vec![turned(1)], &Silent).unwrap();
            assert_eq!(all(&mut kept, &Silent).unwrap(), all(&mut anew, &Silent).unwrap());
        }
        // Exact sums are of the lights in force, whatever the samples are of.
        Evaluator::move_lights(&mut kept, vec![turned(2)], &Silent).unwrap();
        Evaluator::move_lights(&mut kept, vec![turned(1)], &Silent).unwrap();
        let [found, expected] = [&mut kept, &mut anew].map(|e| e.all_pairs(&Silent).unwrap());
        let off = vertex_error(&found, &expected, &areas).rms;
        assert!(off < 5e-3, "{off}");
    }
}

#[test]
fn the_hybrid_refuses_light_that_comes_from_everywhere_or_from_within() {
    let scene = scene(shapes::icosphere(4.0, 2), "skimmilk");
    let mut evaluator = evaluator(&scene, Sampling::Hybrid(LOCAL), 100, sun());
    let everywhere = Light::constant(DVec3::ONE).unwrap();
    let error = evaluator.set_lights(vec![everywhere], &Silent).unwrap_err();
    assert!(error.message().contains("sampling=product"), "{}", error.message());
    let within = Light::point(scene.mesh.origin_mm + 4.1 * DVec3::X, DVec3::ONE).unwrap();
    let error = evaluator.set_lights(vec![within], &Silent).unwrap_err();
    assert!(error.message().contains("outside the sphere"), "{}", error.message());
}
