//! What the parts share: models, bakes in memory, lights, numbers as text.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::{Error, Result};
use translux::evaluate::{BakeSettings, Evaluator, Method};
use translux::geometry::mesh::{Mesh, Scale, resolve_scale};
use translux::geometry::part_table::PartTable;
use translux::geometry::parts::{MaterialRoles, Parts, PartsRule};
use translux::io::obj::read_obj;
use translux::light::quantised::directions::DirectionSet;
use translux::light::{Light, LightKind};
use translux::math::cube_map::{direction, texel_of};
use translux::math::random::uniform;
use translux::math::sphere::unit;
use translux::measure::probes::{self, Half};
use translux::medium::material::preset;
use translux::methods::{self, quantized_lights::QuantizedLights};
use translux::progress::Silent;
use translux::transport::scene::{Medium, Scene};

/// The diagonal of every model, mm.
pub(crate) const SIZE_MM: f64 = 30.0;

/// The paper's number of lights.
pub(crate) const LIGHTS: usize = 200;

/// Samples where every bake and its truth have the same, so that only what is compared differs.
pub(crate) const SAMPLES: usize = 16_384;

/// Samples and asked error of `two_pass` where it stands for the truth.
pub(crate) const TRUTH: (usize, f64) = (262_144, 0.002);

/// Sides of the faces of the cube map that directions of a set are centres of.
const SIDE: usize = 64;

/// Random numbers of the lights.
const STAGE: u64 = 0x6c69_6768_7473;

/// Where to read and write, and how much to do.
pub(crate) struct Context {
    pub(crate) data: PathBuf,
    pub(crate) pictures: PathBuf,
    /// One small mesh, few lights and views.
    pub(crate) quick: bool,
    pub(crate) start: Instant,
}

impl Context {
    /// A line of progress.
    pub(crate) fn say(&self, text: &str) {
        eprintln!("{:7.1} s  {text}", self.start.elapsed().as_secs_f64());
    }

    /// A model of one medium.
    pub(crate) fn scene(&self, model: &str, material: &str) -> Result<Scene> {
        let source = read_obj(&self.data.join(format!("meshes/{model}.obj")))?;
        let placement = resolve_scale(&source, Some(Scale::DiagonalMm(SIZE_MM)))?;
        let (mut mesh, mut report) = Mesh::from_source(source, &placement)?;
        let roles = MaterialRoles::single(mesh.materials.len());
        let parts = Parts::new(&mut mesh, &roles, PartsRule::Auto, &mut report);
        let parts = PartTable::of(&mesh, &parts);
        let unknown = || Error::command_line(format!("no material `{material}`"));
        let properties = preset(material).ok_or_else(unknown)?.properties();
        Ok(Scene { mesh, parts, media: vec![Medium { name: material.to_owned(), properties }] })
    }

    /// Some of a list where little is to be done.
    pub(crate) fn some<T: Copy>(&self, all: &[T], few: usize) -> Vec<T> {
        all.iter().copied().take(if self.quick { few } else { all.len() }).collect()
    }

    /// The lights that errors are measured under: random directions, the same for all.
    pub(crate) fn lights(&self) -> Vec<DVec3> {
        (0..if self.quick { 2 } else { 8 }).map(|i| random_direction(STAGE, i)).collect()
    }

    /// Random views of each picture.
    pub(crate) fn views(&self) -> usize {
        if self.quick { 10 } else { 100 }
    }

    /// The model of the parts that take one.
    pub(crate) fn model(&self) -> &'static str {
        if self.quick { "bunny_3k" } else { "bunny_closed" }
    }
}

/// Uniform on the sphere.
pub(crate) fn random_direction(stage: u64, index: u64) -> DVec3 {
    let z = 2.0 * uniform(stage, index, 0) - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * uniform(stage, index, 1)).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    unit(DVec3::new(radius * cos, radius * sin, z))
}

/// Parallel light of irradiance 1.
pub(crate) fn parallel(from: DVec3) -> Light {
    Light::Directional { from, irradiance: DVec3::ONE }
}

/// The directions of a set of the method: the Fibonacci lattice, each moved to the centre of its texel.
pub(crate) fn directions_of(count: usize) -> Result<DirectionSet> {
    let lattice = DirectionSet::fibonacci(count)?;
    let centre = |d: &DVec3| {
        let texel = texel_of(SIDE, *d);
        direction(SIDE, texel / (SIDE * SIDE), texel % SIDE, texel / SIDE % SIDE)
    };
    DirectionSet::new(lattice.directions().iter().map(centre).collect())
}

/// How an asset is baked.
pub(crate) struct Recipe<'a> {
    pub(crate) samples: Option<usize>,
    pub(crate) max_rms: f64,
    pub(crate) set: &'a [(&'a str, &'a str)],
}

/// Bakes for parallel light; no figures for a ledger.
pub(crate) fn bake(method: &dyn Method, scene: &Scene, recipe: &Recipe) -> Result<Asset> {
    let given: Vec<(String, String)> = recipe.set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let mut probes = probes::for_bake(&scene.mesh);
    probes.tuning = probes::directional(Half::Tuning);
    probes.unseen.clear();
    let settings = BakeSettings {
        samples: recipe.samples,
        max_rms: recipe.max_rms,
        for_lights: [LightKind::Directional].into(),
        probes,
        ..BakeSettings::new(method, methods::settings::resolve(method, &given)?)
    };
    methods::bake(method, scene.clone(), &settings, Provenance::default(), &Silent)
}

/// An encoding with the samples that all comparisons share.
pub(crate) fn encoded(scene: &Scene, set: &[(&str, &str)]) -> Result<Asset> {
    let lights = LIGHTS.to_string();
    let mut all = vec![("lights", lights.as_str())];
    all.extend(set);
    bake(&QuantizedLights, scene, &Recipe { samples: Some(SAMPLES), max_rms: 0.02, set: &all })
}

/// What the asset gives, optionally with another interpolation between the lights.
pub(crate) fn open(asset: &Asset, interpolation: Option<&str>) -> Result<Box<dyn Evaluator>> {
    let mut asset = asset.clone();
    if let Some(name) = interpolation {
        asset.provenance.settings.insert("interpolation".to_owned(), name.to_owned());
    }
    QuantizedLights.open(Arc::new(asset))
}

/// `two_pass` with rays for every light and samples enough to be the truth.
pub(crate) fn truth(scene: &Scene) -> Result<Box<dyn Evaluator>> {
    method("two_pass", scene, &Recipe { samples: Some(TRUTH.0), max_rms: TRUTH.1, set: &[] })
}

/// `two_pass` with the samples and the one ray each that [`encoded`] has.
pub(crate) fn same_samples(scene: &Scene) -> Result<Box<dyn Evaluator>> {
    method("two_pass", scene, &Recipe { samples: Some(SAMPLES), max_rms: TRUTH.1, set: &[("points", "1")] })
}

/// A method by its name, baked and opened.
pub(crate) fn method(name: &str, scene: &Scene, recipe: &Recipe) -> Result<Box<dyn Evaluator>> {
    let method = methods::named(name)?;
    method.open(Arc::new(bake(method, scene, recipe)?))
}

/// Radiosity of every vertex under parallel light.
pub(crate) fn lit(evaluator: &mut dyn Evaluator, from: DVec3) -> Result<Vec<DVec3>> {
    evaluator.set_lights(vec![parallel(from)], &Silent)?;
    evaluator.radiosity(&Silent)
}

/// The same under each of some lights.
pub(crate) fn all_lit(evaluator: &mut dyn Evaluator, lights: &[DVec3]) -> Result<Vec<Vec<DVec3>>> {
    lights.iter().map(|from| lit(evaluator, *from)).collect()
}

/// Bytes of the method's sections in a file, for each vertex.
pub(crate) fn bytes_per_vertex(asset: &Asset) -> Result<f64> {
    let mut without = asset.clone();
    without.sections.clear();
    let bytes = asset.to_bytes()?.len() - without.to_bytes()?.len();
    Ok(bytes as f64 / asset.scene.mesh.local_mm.len() as f64)
}

/// The number before some words in the notes of an asset's ledger.
pub(crate) fn noted(asset: &Asset, words: &str) -> Option<f64> {
    let before = |note: &str| note.split(words).next().filter(|before| before.len() < note.len()).map(str::to_owned);
    let text = asset.ledger.entries.iter().find_map(|e| before(&e.note))?;
    text.split_whitespace().last()?.parse().ok()
}

/// An error in thousandths.
pub(crate) fn thousandths(value: f64) -> String {
    let value = 1e3 * value;
    match value {
        v if v >= 9.95 => format!("{v:.0}"),
        v if v >= 0.095 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

/// Rows of a table in Markdown, below its head.
pub(crate) fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = format!("| {} |\n|{}\n", head.join(" | "), " --- |".repeat(head.len()));
    for row in rows {
        text.push_str(&format!("| {} |\n", row.join(" | ")));
    }
    text
}

/// Marks a row of the page's first table in a part's text.
pub(crate) const SUMMARY: &str = "@summary ";

/// A row of the page's first table: a figure, what the paper says, what is wanted here, what was measured.
pub(crate) fn summary(figure: &str, paper: &str, wanted: &str, measured: &str) -> String {
    format!("{SUMMARY}| {figure} | {paper} | {wanted} | {measured} |\n")
}

/// Whether a figure is as wanted.
pub(crate) fn met(as_wanted: bool) -> &'static str {
    if as_wanted { "**met**" } else { "**not met**" }
}
