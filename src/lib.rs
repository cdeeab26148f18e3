//! Precomputes, compresses and relights subsurface light transport on translucent meshes.
//!
//! # Units and conventions
//!
//! Lengths are millimetres, scattering and absorption coefficients 1/mm, colours linear sRGB (Rec. 709).
//! Directions point away from the surface: `w_i` towards the light, `w_o` towards the eye.
//! Irradiance is the power per area that enters the medium (entrance Fresnel included); radiosity is the exitance
//! `B(x_o) = Int_A R_d(|x_i - x_o|) E(x_i) dA` outside the medium, per vertex and RGB.
//!
//! # Example
//!
//! A model is baked, its asset written and opened again, and its radiosity read:
//!
//! ```
//! use translux::{ImportOptions, MaterialChoice, Scale, bake, evaluate, light, load, measure, open, write};
//!
//! # fn main() -> translux::error::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let (model, path) = (folder.path().join("tetrahedron.obj"), folder.path().join("tetrahedron.tlux"));
//! # std::fs::write(&model, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n").unwrap();
//! let options = ImportOptions {
//!     scale: Some(Scale::DiagonalMm(20.0)),
//!     materials: MaterialChoice::plain("marble"),
//!     ..ImportOptions::default()
//! };
//! let asset = bake(load(&model, &options)?, "two_pass", &[("points", "1")])?;
//! write(&asset, &path)?;
//! let mut evaluator = open(&path)?;
//! let radiosity = evaluate(evaluator.as_mut(), vec![light("directional:from=1,1,1:irradiance=3")?])?;
//! println!("{:?} at the first vertex, off by {:.1e}", radiosity[0], measure(evaluator.as_mut())?.total_rms());
//! # assert_eq!(radiosity.len(), 4);
//! # Ok(())
//! # }
//! ```
//!
//! # Layers
//!
//! Modules import downwards only, in this order:
//! `error` < `parallel` < `progress` < `math` < `medium` < `geometry` < `light` < `io` < `compress` < `transport` < `scene`
//! < `import` < `asset` < `evaluate` < `forms` < `methods` < `render` < `relight` < `export` < `measure` < `report` < `plan`
//! < `commands`. `tests/layers.rs` checks it. This file alone re-exports across them.

#![warn(clippy::exit, clippy::panic, clippy::print_stderr, clippy::print_stdout)]

pub mod error;
pub mod parallel;
pub mod progress;

pub mod math;

pub mod medium;

pub mod geometry;

pub mod light;

pub mod io;

pub mod compress;

pub mod transport;

pub mod scene;

pub mod import;

pub mod asset;

pub mod evaluate;

pub mod forms;

pub mod methods;

pub mod render;

pub mod relight;

pub mod export;

pub mod measure;

pub mod report;

pub mod plan;

pub mod commands;

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

pub use asset::Asset;
pub use compress::ledger::Ledger;
pub use evaluate::Evaluator;
pub use geometry::mesh::Scale;
pub use import::materials::MaterialChoice;
pub use import::{ImportOptions, Imported};
pub use light::Light;
pub use medium::material::Material;

use error::Result;
use medium::inversion::Reflector;
use medium::material_file::Chosen;
use progress::Silent;

/// Reads a model (OBJ, glTF) and makes a scene of it.
///
/// # Errors
/// Files that cannot be read, no unit or material, names that the model does not have.
pub fn load(model: &Path, options: &ImportOptions) -> Result<Imported> {
    import::load(model, options, &Silent)
}

/// Bakes a scene with a method and some of its keys, for every kind of light.
///
/// # Errors
/// Unknown methods, keys and values; failures of the work.
pub fn bake(imported: Imported, method: &str, set: &[(&str, &str)]) -> Result<Asset> {
    let registry = methods::built_in();
    let method = registry.method(method)?;
    let given: Vec<(String, String)> = set.iter().map(|(key, value)| ((*key).into(), (*value).into())).collect();
    let probes = measure::probes::for_bake(&imported.scene);
    let settings = evaluate::BakeSettings { probes, ..evaluate::BakeSettings::new(method.default_max_rms()) };
    method.recipe(&given, settings)?.bake(imported.scene, imported.origin.into(), &Silent)
}

/// Writes an asset atomically; returns its bytes.
///
/// # Errors
/// I/O.
pub fn write(asset: &Asset, path: &Path) -> Result<u64> {
    asset.write(path)
}

/// Opens an asset for evaluation.
///
/// # Errors
/// I/O, anything that is not a valid asset, a form that this build does not have.
pub fn open(path: &Path) -> Result<Box<dyn Evaluator>> {
    methods::built_in().open(Arc::new(Asset::read(path)?)).map_err(|e| e.in_file(path))
}

/// A light from its text, such as `directional:from=0,1,0:irradiance=3`.
///
/// # Errors
/// Command line: a fault of the text; environments that cannot be read.
pub fn light(text: &str) -> Result<Light> {
    Ok(io::environment::load_light(&light::parse::parse(text)?)?.value)
}

/// A material by the name of a preset or the path of a file.
///
/// # Errors
/// Command line: no such preset; a file that cannot be read.
pub fn material(name: &str) -> Result<Material> {
    Chosen::from_argument(name, &Reflector::default()).map(|chosen| chosen.material)
}

/// Radiosity of every source vertex under some lights, RGB, in the unit of their irradiance.
///
/// # Errors
/// Lights that the asset does not carry; failures of the work.
pub fn evaluate(evaluator: &mut dyn Evaluator, lights: Vec<Light>) -> Result<Vec<DVec3>> {
    evaluator.set_lights(lights, &Silent)?;
    evaluator.radiosity(&Silent)
}

/// The error of the evaluator under the lights in force, by stage.
///
/// # Errors
/// Failures of the work.
pub fn measure(evaluator: &mut dyn Evaluator) -> Result<Ledger> {
    measure::probes::by_stage(evaluator, &Silent)
}
