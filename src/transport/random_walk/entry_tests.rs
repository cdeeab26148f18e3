//! The light that enters against the irradiance that every other method uses, kind by kind.

use std::sync::Arc;

use super::*;
use crate::geometry::part_table::PartTable;
use crate::geometry::samples::{Samples, patches};
use crate::geometry::shapes;
use crate::light::environment::EnvironmentMap;
use crate::light::sky::sky;
use crate::math::random::uniform;
use crate::medium::material::{Medium, OpticalProperties};
use crate::parallel::*;
use crate::progress::Silent;
use crate::transport::irradiance::{Illumination, LightSampling};
use crate::transport::surface::Surface;
use crate::transport::test_scene::TestScene;
use crate::transport::test_scene::{mesh_of, named};

/// A head, a knot beside it that shadows itself and it, of different indices, and an opaque board, far from the origin.
fn scene() -> TestScene {
    let (head, knot) = (shapes::bumpy_head(5.0, 3), shapes::torus_knot(2, 3, 3.0, 1.5, 0.8, 48, 8));
    let board = shapes::cuboid(DVec3::new(4.0, 0.5, 4.0), 1);
    let counts = [&head, &knot].map(|m| mesh_of((*m).clone()).triangles.len());
    let offset = DVec3::new(70.0, -20.0, 9.0);
    let mesh = mesh_of(shapes::compose(&[
        (head, offset),
        (knot, offset + DVec3::new(7.5, 1.0, 1.0)),
        (board, offset + DVec3::new(0.0, 9.0, 0.0)),
    ]));
    let part_of = |t| u32::from(t >= counts[0]) + u32::from(t >= counts[0] + counts[1]);
    let triangle_part = (0..mesh.triangles.len()).map(part_of).collect();
    let entries = [("head", Some(0)), ("knot", Some(1)), ("board", None)].map(|(name, m)| (name.into(), m));
    let parts = PartTable::new(&mesh, triangle_part, entries.into());
    let medium = |name: &str, eta| {
        let properties = OpticalProperties { eta_inside_over_outside: eta, ..named(name) };
        Medium { name: name.into(), properties }
    };
    TestScene { mesh, parts, media: vec![medium("marble", 1.5), medium("skin1", 1.3)] }
}

/// Octants of normals of the two parts that transfer.
const REGIONS: usize = 16;

fn region(scene: &TestScene, triangle: u32) -> usize {
    let part = scene.parts.triangle_part[triangle as usize] as usize;
    let normal = scene.mesh.normal(triangle);
    8 * part + (0..3).fold(0, |octant, axis| octant | usize::from(normal[axis] > 0.0) << axis)
}

/// Factor by which candidates are fewer unless there is time: 3 % in place of 0.5 %.
const SAVES: u64 = 9;

/// Lights around the scene, all coloured, with as many candidates as bring four standard errors of the whole below 0.5 %.
fn lights() -> Vec<(&'static str, Vec<Light>, u64)> {
    let colour = DVec3::new(1.0, 2.0, 0.4);
    let centre = DVec3::new(73.0, -20.0, 9.0);
    let patchy =
        (0..64 * 32).map(|i| std::array::from_fn(|c| uniform(3, (i / 4 % 16 + i / 256 * 16) as u64, c as u64) as f32));
    let patchy = EnvironmentMap::new(64, 32, patchy.collect()).unwrap();
    let sun = (0..256 * 128).map(|i| if i == 30 * 256 + 90 { [3e4, 2.5e4, 2e4] } else { [0.02, 0.05, 0.1] });
    let sun = EnvironmentMap::new(256, 128, sun.collect()).unwrap();
    let environment = |map, degrees| Light::environment(Arc::new(map), degrees, colour).unwrap();
    let constant = Light::constant(colour).unwrap();
    let (at, normal) = (centre + DVec3::new(9.0, 3.0, 8.0), DVec3::new(-0.8, -0.1, -0.6));
    let area = Light::area(at, normal, [8.0, 3.0], colour, None).unwrap();
    vec![
        ("constant", vec![constant.clone()], 1 << 19),
        ("directional", vec![Light::directional(DVec3::new(0.7, 0.5, 0.4), colour).unwrap()], 1 << 19),
        ("point", vec![Light::point(centre + DVec3::new(2.0, 6.0, 9.0), 100.0 * colour).unwrap()], 1 << 19),
        ("area", vec![area.clone()], 1 << 21),
        ("sky", vec![environment(sky(), 0.0)], 1 << 21),
        ("turned environment", vec![environment(patchy, 117.0)], 3 << 20),
        ("small sun", vec![environment(sun, -40.0)], 1 << 20),
        ("three lights", vec![constant, Light::directional(DVec3::NEG_X, 3.0 * DVec3::Z).unwrap(), area], 1 << 22),
    ]
}

/// Flux into each region by the walk, RGB, and the standard errors of it.
fn entering(scene: &TestScene, lights: &[Light], candidates: u64) -> [Vec<DVec3>; 2] {
    const BATCHES: u64 = 64;
    let bvh = Bvh::new(&scene.mesh);
    let entries = Entries::new(scene.domain(), &bvh, lights).unwrap();
    let each = candidates / BATCHES;
    let batch = |batch: u64| {
        let mut flux = vec![DVec3::ZERO; REGIONS];
        for i in 0..each {
            let mut stream = Stream::new(batch, i);
            let along = (i as f64 + stream.uniform()) / each as f64;
            if let Some(c) = entries.candidate(along, &mut stream).filter(|c| entries.is_lit(c)) {
                flux[region(scene, c.triangle)] += c.irradiance * (entries.area_mm2() / each as f64);
            }
        }
        flux
    };
    let batches: Vec<Vec<DVec3>> = (0..BATCHES).into_par_iter().map(batch).collect();
    let n = BATCHES as f64;
    let mean = |r: usize| batches.iter().map(|b| b[r]).sum::<DVec3>() / n;
    let error = |r: usize| {
        let variance = batches.iter().map(|b| (b[r] - mean(r)) * (b[r] - mean(r))).sum::<DVec3>() / (n - 1.0);
        (variance / n).map(f64::sqrt)
    };
    [(0..REGIONS).map(mean).collect(), (0..REGIONS).map(error).collect()]
}

/// Flux into each region by the irradiance that the other methods use, RGB.
fn arriving(scene: &TestScene, lights: &[Light], sampling: LightSampling) -> Vec<DVec3> {
    let bvh = Bvh::new(&scene.mesh);
    let samples = Samples::new(&scene.mesh, &scene.parts, scene.mesh.triangles.len());
    let patches = patches(&scene.mesh, &samples);
    let surface = Surface { domain: scene.domain(), bvh: &bvh, samples: &samples, patches: &patches };
    let etas: Vec<f64> = scene.media.iter().map(|m| m.properties.eta_inside_over_outside).collect();
    let irradiance = Illumination::new(&surface, lights, &etas, sampling).unwrap().all(&Silent);
    let mut flux = vec![DVec3::ZERO; REGIONS];
    for (patch, e) in irradiance.iter().enumerate() {
        flux[region(scene, samples.patch(patch)[0].triangle)] += patches[patch].area_mm2 * *e;
    }
    flux
}

#[test]
fn every_light_brings_the_irradiance_that_all_methods_use() {
    let scene = scene();
    let (saves, most) = if std::env::var_os("TRANSLUX_LONG").is_some() { (1, 5e-3) } else { (SAVES, 3e-2) };
    for (name, lights, candidates) in lights() {
        let coarse = arriving(&scene, &lights, LightSampling::FAST);
        let fine = arriving(&scene, &lights, LightSampling { directions: 1024, ..LightSampling::REFERENCE });
        let [flux, error] = entering(&scene, &lights, candidates / saves);
        let whole: DVec3 = fine.iter().sum();
        // Four standard errors, and what is left of the error of the other side, which is less than what refining it changed.
        let tolerance = |r: usize| 4.0 * error[r] + (coarse[r] - fine[r]).abs() + 1e-4 * whole;
        for r in 0..REGIONS {
            let off = (flux[r] - fine[r]).abs();
            assert!(off.cmple(tolerance(r)).all(), "{name}, {r}: {} {} {}", flux[r], fine[r], tolerance(r));
        }
        let squares: DVec3 = error.iter().map(|e| *e * *e).sum();
        let (off, tolerance) = (flux.iter().sum::<DVec3>() / whole - 1.0, 4.0 * squares.map(f64::sqrt) / whole);
        println!("{name}: off by {off:.5}, tolerance {tolerance:.5}");
        assert!(tolerance.max_element() <= most, "{name}: {tolerance}");
        assert!(off.abs().cmple(tolerance).all(), "{name}: {off} {tolerance}");
    }
}
