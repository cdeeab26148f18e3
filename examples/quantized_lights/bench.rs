//! What the parts share: models, bakes in memory, lights, numbers as text.

use std::any::Any;
use std::sync::Arc;

use glam::DVec3;
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::{Evaluator, Form, Method};
use translux::forms::hao::VertexValues;
use translux::forms::projected::lights::LightSetSettings;
use translux::light::LightKind;
use translux::light::quantised::directions::DirectionSet;
use translux::light::quantised::interpolation::Scheme;
use translux::math::cube_map::{direction, texel_of};
use translux::math::random::uniform;
use translux::math::sphere::unit;
use translux::methods;
use translux::progress::Silent;
use translux::scene::Scene;

use crate::common::bench::bake_for;
pub(crate) use crate::common::bench::{
    Context, Recipe, SIZE_MM, bytes_per_vertex, copy_bandwidth, met, noted, parallel, table,
};
pub(crate) use crate::common::runner::summary;

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

impl Context {
    /// The lights that errors are measured under: random directions, the same for all.
    pub(crate) fn lights(&self) -> Vec<DVec3> {
        (0..if self.quick { 2 } else { 8 }).map(|i| random_direction(STAGE, i)).collect()
    }

    /// Random views of each picture.
    pub(crate) fn views(&self) -> usize {
        if self.quick { 10 } else { 100 }
    }
}

/// Uniform on the sphere.
pub(crate) fn random_direction(stage: u64, index: u64) -> DVec3 {
    let z = 2.0 * uniform(stage, index, 0) - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * uniform(stage, index, 1)).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    unit(DVec3::new(radius * cos, radius * sin, z))
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

/// Bakes for parallel light; no figures for a ledger.
pub(crate) fn bake(method: &dyn Method, scene: &Scene, recipe: &Recipe) -> Result<Asset> {
    bake_for(LightKind::Directional, method, scene, recipe, &Silent)
}

/// An encoding with the samples that all comparisons share.
pub(crate) fn encoded(scene: &Scene, set: &[(&str, &str)]) -> Result<Asset> {
    let lights = LIGHTS.to_string();
    let mut all = vec![("lights", lights.as_str())];
    all.extend(set);
    bake(
        methods::built_in().method("quantized_lights")?,
        scene,
        &Recipe { samples: Some(SAMPLES), max_rms: 0.02, set: &all },
    )
}

/// What the asset gives; values of the paper's encodings optionally with another interpolation between the lights.
pub(crate) fn open(asset: &Asset, interpolation: Option<Scheme>) -> Result<Box<dyn Evaluator>> {
    let registry = methods::built_in();
    let asset = Arc::new(asset.clone());
    let Some(scheme) = interpolation else { return registry.open(asset) };
    let form: Box<dyn Any> = registry.form(&asset)?;
    let form = form.downcast::<VertexValues>().map_err(|_| Error::runtime("only the paper's encodings"))?;
    let lights = LightSetSettings { scheme, ..form.lights };
    VertexValues { lights, ..*form }.open(asset)
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
    let method = methods::built_in().method(name)?;
    methods::built_in().open(Arc::new(bake(method, scene, recipe)?))
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

/// An error in thousandths.
pub(crate) fn thousandths(value: f64) -> String {
    let value = 1e3 * value;
    match value {
        v if v >= 9.95 => format!("{v:.0}"),
        v if v >= 0.095 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}
