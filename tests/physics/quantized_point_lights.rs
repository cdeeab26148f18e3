//! Point lights of `quantized_lights`: the distances of the set against `two_pass`, from far away to the surface, where a set of
//! distances fails; and the paper's eight neighbours against the default.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::baked::{self, Shelf};
use crate::in_memory;
use std::collections::BTreeMap;
use std::sync::Arc;

use crate::in_memory::{lit, method, pairs, registry, scene, vertex_areas};
use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::ExitCode;
use translux::evaluate::{BakeSettings, Evaluator};
use translux::geometry::mesh::Scale;
use translux::geometry::shapes;
use translux::light::quantised::directions::DirectionSet;
use translux::light::quantised::distances::{Blend, DistanceSet};
use translux::light::{Light, LightKind};
use translux::math::cube_map::{direction, texel_of};
use translux::math::statistics::vertex_error;
use translux::progress::Silent;
use translux::scene::Scene;
use translux::transport::receivers::Sphere;

const SAMPLES: usize = 1_500;
const DIRECTIONS: &str = "100";

/// Nearest shell unless it is set, in bounding radii.
const NEAREST: f64 = 1.5;

/// What the defaults are, written out so that one bake serves those that set one of them.
const SHELLS: [(&str, &str); 2] = [("shells", "3"), ("nearest", "1.5")];

fn head() -> Scene {
    scene(shapes::bumpy_head(1.0, 3), Scale::DiagonalMm(20.0), "marble")
}

/// The evaluator of that head with some keys set, which is baked once.
fn evaluator(scene: &Scene, set: &[(&str, &str)]) -> Box<dyn Evaluator> {
    static ASSETS: Shelf<Vec<(String, String)>, Asset> = Shelf::new();
    let mut given = pairs(&[("lights", DIRECTIONS)]);
    given.extend(pairs(set));
    let bytes = ASSETS.get(given.clone(), || bake(scene, &given)).to_bytes().unwrap();
    registry().open(Arc::new(Asset::from_bytes(&bytes).unwrap())).unwrap()
}

fn bake(scene: &Scene, set: &[(String, String)]) -> Asset {
    let settings = BakeSettings {
        samples: Some(SAMPLES),
        // What is coded and interpolated between vertices must not hide the distances.
        for_lights: [LightKind::Point].into(),
        probes: in_memory::probes(scene),
        ..BakeSettings::new(0.01)
    };
    let recipe = method("quantized_lights").recipe(set, settings).unwrap();
    recipe.bake(scene.clone(), Provenance::default(), &Silent).unwrap()
}

/// Centre and radius of the scene, as the set takes them.
fn sphere(scene: &Scene) -> (DVec3, f64) {
    let points: Vec<DVec3> = scene.mesh.local_mm.iter().map(|p| p.as_dvec3() + scene.mesh.origin_mm).collect();
    let sphere = Sphere::around(&points);
    (sphere.centre_mm, sphere.radius_mm)
}

/// A direction of the set, where only the distance is interpolated.
fn of_the_set() -> DVec3 {
    let set = DirectionSet::fibonacci(DIRECTIONS.parse().unwrap()).unwrap();
    let texel = texel_of(64, set.directions()[37]);
    direction(64, texel / (64 * 64), texel % 64, texel / 64 % 64)
}

/// As far as possible from the directions of the set.
fn between() -> DVec3 {
    let set = DirectionSet::fibonacci(DIRECTIONS.parse().unwrap()).unwrap();
    let nearest = |d: &DVec3| set.directions().iter().map(|s| s.angle_between(*d)).fold(f64::INFINITY, f64::min);
    let many = DirectionSet::fibonacci(2048).unwrap();
    let farthest = *many.directions().iter().max_by(|a, b| nearest(a).total_cmp(&nearest(b))).unwrap();
    assert!(nearest(&farthest) > 0.2, "{}", nearest(&farthest));
    farthest
}

/// The scene with what errors are measured against.
struct Bench {
    scene: Scene,
    areas: Vec<f64>,
    centre_mm: DVec3,
    radius_mm: f64,
}

impl Bench {
    fn new(scene: &Scene) -> Self {
        let (centre_mm, radius_mm) = sphere(scene);
        Self { scene: scene.clone(), areas: vertex_areas(scene), centre_mm, radius_mm }
    }

    /// An irradiance of 1 at the centre from so many bounding radii.
    fn light(&self, towards: DVec3, radii: f64) -> Light {
        let distance_mm = radii * self.radius_mm;
        Light::point(self.centre_mm + distance_mm * towards, DVec3::splat(distance_mm * distance_mm)).unwrap()
    }

    /// Relative RMS error of what some lights give instead of another.
    fn error_of(&self, evaluator: &mut dyn Evaluator, lights: Vec<Light>, truth: &Light) -> f64 {
        let values = lit(evaluator, lights);
        assert!(values.iter().all(|v| v.is_finite()));
        let truth = baked::radiosity("two_pass", &self.scene, 4 * SAMPLES, &[], std::slice::from_ref(truth));
        vertex_error(&values, &truth, &self.areas).rms
    }

    fn error(&self, evaluator: &mut dyn Evaluator, towards: DVec3, radii: f64) -> f64 {
        let light = self.light(towards, radii);
        self.error_of(evaluator, vec![light.clone()], &light)
    }

    /// What the shells would say of a light nearer than all of them: the same polynomial, as lights of the set some of which are
    /// negative.
    fn extrapolated(&self, shells: &DistanceSet, towards: DVec3, radii: f64) -> Vec<Light> {
        let nodes = shells.inverse();
        let weight = |k: usize| {
            let others = nodes.iter().enumerate().filter(|(j, _)| *j != k);
            others.map(|(_, node)| (1.0 / radii - node) / (nodes[k] - node)).product::<f64>()
        };
        let light = |k: usize| match nodes[k] {
            0.0 => Light::Directional { from: towards, irradiance: DVec3::splat(weight(k)) },
            u => {
                let distance_mm = self.radius_mm / u;
                let intensity = DVec3::splat(weight(k) * distance_mm * distance_mm);
                Light::Point { at_mm: self.centre_mm + distance_mm * towards, intensity }
            }
        };
        (0..nodes.len()).map(light).collect()
    }
}

#[test]
fn distances_from_far_away_to_the_nearest_shell() {
    let scene = head();
    let bench = Bench::new(&scene);
    let mut set = evaluator(&scene, &SHELLS);
    let mut worst = [0.0f64; 2];
    for radii in [1e5, 100.0, 10.0, 4.0, 3.0, 2.5, 2.0, 1.75, NEAREST * (1.0 + 1e-9)] {
        let errors = [of_the_set(), between()].map(|towards| bench.error(set.as_mut(), towards, radii));
        println!(
            "{radii:9.2} radii: {:.2} % at a direction of the set, {:.2} % between",
            100.0 * errors[0],
            100.0 * errors[1]
        );
        worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
    }
    assert!(worst[0] < 0.02 && worst[1] < 0.06, "{worst:?}");
    // From 100 radii a point light is as good as parallel.
    let sun = lit(set.as_mut(), vec![Light::directional(between(), DVec3::ONE).unwrap()]);
    let mut difference = |radii: f64| {
        let far = lit(set.as_mut(), vec![bench.light(between(), radii)]);
        vertex_error(&far, &sun, &bench.areas).rms
    };
    let [near, far, farthest] = [100.0, 1e4, 1e6].map(&mut difference);
    println!("against parallel light: {near:.1e} from 100 radii, {far:.1e} from 1e4, {farthest:.1e} from 1e6");
    assert!(near < 0.02 && far < 2e-4 && farthest < 2e-6 && near > 30.0 * far, "{near} {far} {farthest}");
}

/// Nearer lights are refused, because neither the polynomial beyond its shells nor the nearest shell is right there.
#[test]
fn nearer_than_the_nearest_shell_is_refused_and_why() {
    let scene = head();
    let bench = Bench::new(&scene);
    let mut set = evaluator(&scene, &SHELLS);
    let shells = DistanceSet::spread(bench.centre_mm, bench.radius_mm, 4, 1.0 / NEAREST, Blend::Polynomial).unwrap();
    let towards = of_the_set();
    let mut found = Vec::new();
    for radii in [NEAREST * (1.0 + 1e-9), 1.4, 1.3, 1.2, 1.1, 1.05, 1.01] {
        let light = bench.light(towards, radii);
        let message = set.set_lights(vec![light.clone()], &Silent).err();
        assert_eq!(message.is_some(), radii < NEAREST, "{radii}");
        if let Some(error) = &message {
            assert_eq!(error.code(), ExitCode::Unsupported);
            let nearest = format!("from {:.3} mm on", NEAREST * bench.radius_mm);
            let given = format!("{:.3} mm", radii * bench.radius_mm);
            let hint = "--set nearest";
            for part in [&nearest[..], &given, hint, "two_pass"] {
                assert!(error.message().contains(part), "{} lacks {part}", error.message());
            }
        }
        let beyond = bench.extrapolated(&shells, towards, radii);
        let extrapolated = bench.error_of(set.as_mut(), beyond, &light);
        let at_nearest = bench.light(towards, NEAREST * (1.0 + 1e-9));
        let clamped = bench.error_of(set.as_mut(), vec![at_nearest], &light);
        println!(
            "{radii:5.2} radii: polynomial beyond its shells {:.1} %, nearest shell {:.1} %",
            100.0 * extrapolated,
            100.0 * clamped
        );
        found.push((extrapolated, clamped));
    }
    let (first, last) = (found[0], found[found.len() - 1]);
    assert!(first.0 < 0.02 && first.1 < 0.02, "{first:?}");
    assert!(last.0 > 0.1 && last.1 > 0.2, "{last:?}");
    assert!(found.windows(2).all(|pair| pair[0].1 < pair[1].1), "{found:?}");
}

/// Near the surface: sets that reach as near as they may, and lights inside the bounding sphere, which no set carries.
#[test]
fn close_to_the_surface_a_set_of_distances_fails() {
    let scene = head();
    let bench = Bench::new(&scene);
    // Where the surface comes nearest to the bounding sphere, the light comes nearest to the surface.
    let towards = scene.mesh.local_mm.iter().map(|p| p.as_dvec3() + scene.mesh.origin_mm - bench.centre_mm);
    let towards = towards.max_by(|a, b| a.length().total_cmp(&b.length())).unwrap().normalize();
    let mut errors = Vec::new();
    for nearest in ["1.5", "1.2", "1.05"] {
        let radii: f64 = nearest.parse().unwrap();
        let mut set = evaluator(&scene, &[SHELLS[0], ("nearest", nearest)]);
        let above_mm = (radii - 1.0) * bench.radius_mm;
        let error = bench.error(set.as_mut(), towards, radii * (1.0 + 1e-9));
        let inside = bench.light(towards, 0.99);
        let refused = set.set_lights(vec![inside], &Silent).unwrap_err();
        assert_eq!(refused.code(), ExitCode::Unsupported);
        println!("nearest {nearest} radii, {above_mm:.2} mm above the surface: {:.1} %", 100.0 * error);
        errors.push(error);
    }
    assert!(errors[0] < 0.08 && errors[2] > 0.2, "{errors:?}");
    assert!(errors.windows(2).all(|pair| pair[0] < pair[1]), "{errors:?}");
}

/// Worst error of a set under lights of several distances, at a direction of the set and between.
fn worst(bench: &Bench, set: &mut dyn Evaluator) -> [f64; 2] {
    [of_the_set(), between()].map(|towards| {
        let error = |radii: f64| bench.error(set, towards, radii);
        [20.0, 6.0, 3.5, 2.6, 2.1, 1.8, 1.6].into_iter().map(error).fold(0.0, f64::max)
    })
}

#[test]
fn more_shells_are_better_and_the_default_beats_eight_neighbours() {
    let scene = head();
    let bench = Bench::new(&scene);
    let mut table = BTreeMap::new();
    for shells in ["1", "2", "3", "4"] {
        let default = worst(&bench, evaluator(&scene, &[("shells", shells), SHELLS[1]]).as_mut());
        if shells != "3" && !in_memory::long() {
            println!("{shells} shells: {default:?}");
            table.insert(shells, default);
            continue;
        }
        let trilinear = [("shells", shells), SHELLS[1], ("blend", "linear"), ("interpolation", "nearest4")];
        let paper = worst(&bench, evaluator(&scene, &trilinear).as_mut());
        println!(
            "{shells} shells: default {:.2} % at a direction of the set, {:.2} % between; eight neighbours {:.2} %, {:.2} %",
            100.0 * default[0],
            100.0 * default[1],
            100.0 * paper[0],
            100.0 * paper[1]
        );
        // With one shell beside infinity both are linear.
        let better = |k: usize| shells == "1" || default[k] < 0.8 * paper[k];
        assert!(better(0) && better(1), "{shells}: {default:?} {paper:?}");
        table.insert(shells, default);
    }
    let at_node = |shells: &str| table[shells][0];
    assert!(at_node("1") > 0.08 && at_node("2") < 0.5 * at_node("1"), "{table:?}");
    assert!(at_node("3") < 0.8 * at_node("2") && at_node("4") < at_node("3"), "{table:?}");
}
