//! A method through the library, without files: bake, open, evaluate; and its distance from a separate truth.
#![allow(clippy::unwrap_used, missing_docs, dead_code, unreachable_pub)]

use std::sync::Arc;

use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::evaluate::{BakeSettings, Evaluator};
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::parts::{MaterialRoles, Parts, PartsRule};
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::medium::material::preset;
use translux::methods;
use translux::progress::Silent;
use translux::transport::scene::{Medium, Scene};

use crate::oracle::vector::V3;
use crate::oracle::{OracleLight, OracleMesh};

/// A model of one medium; the scale as the command line takes it.
pub fn scene(source: SourceModel, scale: Scale, material: &str) -> Scene {
    let placement = resolve_scale(&source, Some(scale)).unwrap();
    let (mut mesh, mut report) = Mesh::from_source(source, &placement).unwrap();
    let roles = MaterialRoles::single(mesh.materials.len());
    let parts = Parts::new(&mut mesh, &roles, PartsRule::Auto, &mut report);
    let parts = PartTable::of(&mesh, &parts);
    let media = vec![Medium { name: material.to_owned(), properties: preset(material).unwrap().properties() }];
    Scene { mesh, parts, media }
}

/// Bakes with the method's defaults; `samples` replaces its choice.
pub fn bake(method: &str, scene: Scene, samples: Option<usize>) -> Arc<Asset> {
    let method = methods::named(method).unwrap();
    let values = methods::settings::resolve(method, &[]).unwrap();
    let probes = translux::measure::probes::for_bake(&scene.mesh);
    let settings = BakeSettings { samples, probes, ..BakeSettings::new(method, values) };
    Arc::new(methods::bake(method, scene, &settings, Provenance::default(), &Silent).unwrap())
}

/// The method's evaluator of a scene.
pub fn open(method: &str, scene: Scene, samples: Option<usize>) -> Box<dyn Evaluator> {
    methods::named(method).unwrap().open(bake(method, scene, samples)).unwrap()
}

/// Radiosity of every vertex under one light.
pub fn radiosity(evaluator: &mut dyn Evaluator, light: Light) -> Vec<DVec3> {
    evaluator.set_lights(vec![light], &Silent).unwrap();
    let values = evaluator.radiosity(&Silent).unwrap();
    let odd = values.iter().find(|v| !(v.is_finite() && v.min_element() >= 0.0));
    assert!(odd.is_none(), "radiosity {odd:?}");
    values
}

/// The same triangles for the separate truth.
pub fn oracle_mesh(mesh: &Mesh) -> OracleMesh {
    OracleMesh {
        positions: (0..mesh.local_mm.len() as u32).map(|v| mesh.position_mm(v).to_array()).collect(),
        triangles: mesh.triangles.clone(),
    }
}

/// The same light for the separate truth.
pub fn oracle_light(light: &Light) -> OracleLight {
    match light {
        Light::Constant { radiance } => OracleLight::Constant { radiance: radiance.to_array() },
        Light::Directional { from, irradiance } => {
            OracleLight::Directional { from: from.to_array(), irradiance: irradiance.to_array() }
        }
        Light::Point { at_mm, intensity } => {
            OracleLight::Point { at: at_mm.to_array(), intensity: intensity.to_array() }
        }
        Light::Area { at_mm, normal, u, size_mm, radiance } => OracleLight::Area {
            at: at_mm.to_array(),
            normal: normal.to_array(),
            first_edge: Some(u.to_array()),
            size: *size_mm,
            radiance: radiance.to_array(),
        },
        Light::Environment { map, rotate_degrees, scale } => OracleLight::Environment {
            width: map.width(),
            height: map.height(),
            pixels: map.pixels().to_vec(),
            rotate_degrees: *rotate_degrees,
            scale: scale.to_array(),
        },
    }
}

/// Root-mean-square difference over the rows relative to the truth's, worst channel, and the mean difference in the
/// same unit; a channel counts from a thousandth of the brightest.
pub fn error(values: &[DVec3], truth: &[(usize, V3)]) -> (f64, f64) {
    let sum = |f: &dyn Fn(usize, V3) -> DVec3| truth.iter().map(|&(v, b)| f(v, b)).sum::<DVec3>() / truth.len() as f64;
    let squares = sum(&|_, b| DVec3::from(b) * DVec3::from(b));
    let unit = squares.max(DVec3::splat(1e-6 * squares.max_element())).powf(0.5);
    let errors = sum(&|v, b| (values[v] - DVec3::from(b)).powf(2.0)).powf(0.5) / unit;
    let bias = sum(&|v, b| values[v] - DVec3::from(b)) / unit;
    let worst_bias = bias.to_array().into_iter().fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
    (errors.max_element(), worst_bias)
}

pub fn long() -> bool {
    let long = std::env::var("TRANSLUX_LONG").is_ok_and(|v| v == "1");
    if !long {
        eprintln!("SKIPPED: set TRANSLUX_LONG=1");
    }
    long
}
