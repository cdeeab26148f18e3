//! A method through the library, without files: bake, open, evaluate; and its distance from a separate truth.
#![allow(clippy::unwrap_used, missing_docs, dead_code, unreachable_pub)]

use std::sync::{Arc, OnceLock};

use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::Result;
use translux::evaluate::keys::{AnyKey, Audience, Keys};
use translux::evaluate::{About, AnyForm, BakeSettings, Evaluator, Method, Probes, Recipe, Registry};
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::parts::{Analysis, MaterialRoles, PartsRule};
use translux::geometry::source::SourceModel;
use translux::light::Light;
use translux::medium::material::{Medium, preset};
use translux::methods;
use translux::progress::Silent;
use translux::scene::Scene;

#[path = "../../examples/toy_form/form.rs"]
mod toy_form;
#[path = "../../examples/toy_method/method.rs"]
mod toy_method;

use crate::oracle::vector::V3;
use crate::oracle::{OracleLight, OracleMesh};

/// A model of one medium; the scale as the command line takes it.
pub fn scene(source: SourceModel, scale: Scale, material: &str) -> Scene {
    with_roles(source, scale, &[material], |materials| MaterialRoles::single(materials.len()))
}

/// A model whose materials have media of their own, `(material of the model, published material)`; the others are opaque.
pub fn scene_of(source: SourceModel, scale: Scale, media: &[(&str, &str)]) -> Scene {
    let presets: Vec<&str> = media.iter().map(|(_, preset)| *preset).collect();
    with_roles(source, scale, &presets, |materials| {
        let by_name: Vec<(String, u32)> = media.iter().map(|m| m.0.to_owned()).zip(0..).collect();
        let given = |name: &String| media.iter().any(|m| m.0 == name);
        let opaque: Vec<String> = materials.iter().filter(|name| !given(name)).cloned().collect();
        MaterialRoles::resolve(materials, &by_name, 0, &opaque).unwrap()
    })
}

fn with_roles(
    source: SourceModel,
    scale: Scale,
    presets: &[&str],
    roles: impl Fn(&[String]) -> MaterialRoles,
) -> Scene {
    let placement = resolve_scale(&source, Some(scale)).unwrap();
    let (mut mesh, mut report) = Mesh::from_source(source, &placement).unwrap();
    let roles = roles(&mesh.materials);
    let parts = Analysis::new(&mut mesh, &roles, PartsRule::Auto, &mut report).parts;
    let parts = PartTable::of(&mesh, &parts);
    Scene { mesh, parts, media: presets.iter().map(|name| medium(name)).collect() }
}

/// `editable` whose default is stored transport.
struct StoredEditable;

/// A key with another default.
struct Stored(&'static dyn AnyKey);

impl AnyKey for Stored {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn default(&self) -> &'static str {
        if self.0.name() == "transport" { "stored" } else { self.0.default() }
    }

    fn help(&self) -> &'static str {
        self.0.help()
    }

    fn audience(&self) -> Audience {
        self.0.audience()
    }

    fn values(&self) -> String {
        self.0.values()
    }

    fn words(&self) -> Vec<&'static str> {
        self.0.words()
    }

    fn check(&self, text: &str) -> Result<()> {
        self.0.check(text)
    }
}

impl Method for StoredEditable {
    fn about(&self) -> About {
        static KEYS: OnceLock<Vec<&'static dyn AnyKey>> = OnceLock::new();
        let stored = |key: &&'static dyn AnyKey| &*Box::leak(Box::new(Stored(*key))) as &'static dyn AnyKey;
        let keys = KEYS.get_or_init(|| method("editable").keys().iter().map(stored).collect());
        About { keys, ..method("editable").about() }
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        method("editable").form(keys, settings)
    }
}

/// The methods and forms of the crate, and the examples' own.
pub fn registry() -> &'static Registry {
    static REGISTRY: OnceLock<Registry> = OnceLock::new();
    REGISTRY.get_or_init(|| {
        let with_form = methods::built_in().with_form(toy_form::ENTRY);
        with_form.with_method(&toy_method::ToyMethod).with_method(&toy_form::ToyForm)
    })
}

/// The method of a name.
pub fn method(name: &str) -> &'static dyn Method {
    registry().method(name).unwrap()
}

/// Every method, and those of its forms that are methods of their own as far as results go.
pub fn every() -> Vec<&'static dyn Method> {
    registry().methods().iter().copied().chain([&StoredEditable as &dyn Method]).collect()
}

/// A published material.
pub fn medium(name: &str) -> Medium {
    Medium { name: name.to_owned(), properties: preset(name).unwrap().properties() }
}

/// Bakes with the method's defaults; `samples` replaces its choice.
pub fn bake(name: &str, scene: Scene, samples: Option<usize>) -> Arc<Asset> {
    Arc::new(try_bake(method(name), scene, samples, &[]).unwrap())
}

/// The probe lights of a bake, with one light of each kind for the figures of its ledger: a direction, a point, an environment. The
/// bakes of tests/cli have them all.
pub fn probes(scene: &Scene) -> Probes {
    let all = translux::measure::probes::for_bake(scene);
    Probes { unseen: all.unseen.into_iter().step_by(2).collect(), ..all }
}

/// Keys that shorten a bake, where tests do not look at what they set: a texture of a quarter of the texels, which costs 0.4 % RMS in
/// place of 0.2 %. Every texture of tests/cli is as large as its default.
pub fn short(method: &dyn Method) -> Vec<(String, String)> {
    let has = |name: &str| method.keys().iter().any(|key| key.name() == name);
    if has("resolution") { pairs(&[("resolution", "128")]) } else { Vec::new() }
}

/// What a bake of a scene runs with some keys set, for every kind of light.
pub fn recipe(method: &dyn Method, scene: &Scene, samples: Option<usize>, set: &[(String, String)]) -> Result<Recipe> {
    let settings = BakeSettings { samples, probes: probes(scene), ..BakeSettings::new(method.default_max_rms()) };
    method.recipe(set, settings)
}

/// Bakes with some keys set, for every kind of light.
pub fn try_bake(method: &dyn Method, scene: Scene, samples: Option<usize>, set: &[(String, String)]) -> Result<Asset> {
    recipe(method, &scene, samples, set)?.bake(scene, Provenance::default(), &Silent)
}

/// Keys and values as they are typed.
pub fn pairs(set: &[(&str, &str)]) -> Vec<(String, String)> {
    set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect()
}

/// The evaluator of an asset.
pub fn opened(asset: Arc<Asset>) -> Box<dyn Evaluator> {
    registry().open(asset).unwrap()
}

/// The method's evaluator of a scene.
pub fn open(name: &str, scene: Scene, samples: Option<usize>) -> Box<dyn Evaluator> {
    opened(bake(name, scene, samples))
}

/// Radiosity of every vertex under one light.
pub fn radiosity(evaluator: &mut dyn Evaluator, light: Light) -> Vec<DVec3> {
    let values = lit(evaluator, vec![light]);
    // What the pieces of an unevenly lit sample have more or less than the whole cancels up to rounding in f32.
    let rounding = 1e-6 * values.iter().fold(0.0, |a: f64, v| a.max(v.max_element()));
    let odd = values.iter().find(|v| !(v.is_finite() && v.min_element() >= -rounding));
    assert!(odd.is_none(), "radiosity {odd:?}");
    values
}

/// Those that a method serves.
pub fn served(method: &dyn Method, lights: &[Light]) -> Vec<Light> {
    lights.iter().filter(|l| method.kinds().contains(&l.kind())).cloned().collect()
}

/// Radiosity of every vertex under some lights, whatever its sign.
pub fn lit(evaluator: &mut dyn Evaluator, lights: Vec<Light>) -> Vec<DVec3> {
    evaluator.set_lights(lights, &Silent).unwrap();
    evaluator.radiosity(&Silent).unwrap()
}

/// A third of the area of the translucent triangles around each vertex, mm^2.
pub fn vertex_areas(scene: &Scene) -> Vec<f64> {
    let mut areas = vec![0.0; scene.mesh.local_mm.len()];
    for (index, triangle) in scene.mesh.triangles.iter().enumerate() {
        if scene.parts.parts[scene.parts.triangle_part[index] as usize].transfers() {
            triangle.iter().for_each(|&v| areas[v as usize] += scene.mesh.area_mm2(index as u32) / 3.0);
        }
    }
    areas
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
        Light::Spot { at_mm, cone, intensity } => {
            let edge = (0.5 * cone.angle_degrees).to_radians();
            let (at, to, intensity) = (at_mm.to_array(), cone.to_mm.to_array(), intensity.to_array());
            OracleLight::Spot { at, to, full: edge * (1.0 - cone.blend), edge, intensity }
        }
        Light::Area { at_mm, normal, u, size_mm, radiance, .. } => OracleLight::Area {
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
