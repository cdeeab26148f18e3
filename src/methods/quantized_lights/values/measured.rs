//! Prints what the documentation says of these encodings.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::super::encoding::{ChosenBy, Integral};
use super::bake::Work;
use super::evaluate::Values;
use super::*;
use crate::asset::{Asset, Provenance};
use crate::compress::ledger::Ledger;
use crate::compress::reference_points::{Bounds, Choice};
use crate::evaluate::BakeSettings;
use crate::geometry::mesh::{Mesh, Scale, resolve_scale};
use crate::geometry::part_table::PartTable;
use crate::geometry::parts::{MaterialRoles, Parts, PartsRule};
use crate::geometry::samples::Samples;
use crate::geometry::source::SourceModel;
use crate::light::Light;
use crate::light::quantised::directions::DirectionSet;
use crate::light::quantised::distances::Blend;
use crate::light::quantised::interpolation::Scheme;
use crate::math::sh::Window;
use crate::math::statistics::vertex_error;
use crate::medium::material::preset;
use crate::methods::quantized_lights::encoding::{Choices, Encoding};
use crate::methods::quantized_lights::lights::{LightSet, Plan};
use crate::methods::stage::Stage;
use crate::progress::Silent;
use crate::transport::gather::NearField;
use crate::transport::many_lights::ManyLights;
use crate::transport::scene::Medium;
use glam::DVec3;
use translux_format::quantised_values::QuantisedValues as File;

const MAX_RMS: f64 = 0.03;

fn scene_of(source: SourceModel, material: &str) -> Scene {
    let placement = resolve_scale(&source, Some(Scale::DiagonalMm(30.0))).unwrap();
    let (mut mesh, mut report) = Mesh::from_source(source, &placement).unwrap();
    let roles = MaterialRoles::single(mesh.materials.len());
    let parts = Parts::new(&mut mesh, &roles, PartsRule::Auto, &mut report);
    let parts = PartTable::of(&mesh, &parts);
    let properties = preset(material).unwrap().properties();
    Scene { mesh, parts, media: vec![Medium { name: material.to_owned(), properties }] }
}

/// A scene under lights, some to choose by and some that no choice sees.
struct Bench<'a> {
    name: String,
    stage: &'a Stage<'a>,
    transfer: &'a ManyLights<'a>,
    topology: Topology,
    tuning: Vec<Light>,
    unseen: Vec<Light>,
    truth: Vec<Vec<DVec3>>,
}

impl Bench<'_> {
    fn bytes_per_vertex(&self, file: &File) -> f64 {
        let mut asset = Asset {
            scene: self.stage.scene.clone(),
            samples: Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets: vec![0; 2] },
            provenance: Provenance::default(),
            ledger: Ledger::default(),
            sections: file.to_sections().unwrap(),
        };
        let whole = asset.to_bytes().unwrap().len();
        asset.sections.clear();
        (whole - asset.to_bytes().unwrap().len()) as f64 / self.topology.positions.len() as f64
    }

    /// Prints a line; `exact` are the values that were encoded.
    fn print(&self, what: &str, set: &LightSet, exact: &Values, choices: Choices) {
        let plan = Plan {
            directions: Some(set.lights.directions.count()),
            scheme: set.interpolator.scheme(),
            blend: Blend::Polynomial,
            shells: 0,
            nearest: 0.5,
            spacing_mm: None,
            choices,
        };
        let work = Work {
            stage: self.stage,
            transfer: self.transfer,
            set,
            topology: &self.topology,
            exact,
            plan: &plan,
            max_rms: MAX_RMS,
            tuning: &self.tuning,
        };
        let mut file = File {
            directions: set.lights.directions.count() as u32,
            shells: vec![0.0],
            planes: exact.floats().unwrap().0.planes as u8,
            ..File::default()
        };
        let start = Instant::now();
        let note = work.encode(&mut file).unwrap();
        let encoded = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let stored = Values::read(&file, &self.topology).unwrap();
        let read = start.elapsed().as_secs_f64();
        let (mut errors, mut added, mut fastest) = (Vec::new(), Vec::new(), f64::INFINITY);
        for (light, truth) in self.unseen.iter().zip(&self.truth) {
            let one = std::slice::from_ref(light);
            let start = Instant::now();
            let values = stored.at_receivers(&stored.light(set, one).unwrap());
            fastest = fastest.min(start.elapsed().as_secs_f64());
            errors.push(vertex_error(&values, truth, &self.stage.areas).rms);
            let plain = exact.at_receivers(&exact.light(set, one).unwrap());
            added.push(vertex_error(&values, &plain, &self.stage.areas).rms);
        }
        let summary = |errors: &mut Vec<f64>| {
            errors.sort_unstable_by(f64::total_cmp);
            format!("{:.3} / {:.3} %", 100.0 * errors[errors.len() / 2], 100.0 * errors[errors.len() - 1])
        };
        println!(
            "{} {what}: {:.2} B/v, {:.1} resident; RMS {}, against the values {}; encode {encoded:.1} s, read {read:.2} s, light \
             {:.2} ms; {note}",
            self.name,
            self.bytes_per_vertex(&file),
            stored.bytes() as f64 / self.topology.positions.len() as f64,
            summary(&mut errors),
            summary(&mut added),
            1e3 * fastest
        );
    }

    /// How far vectors and scalars between lights are apart, RMS over the vertices as a share of full scale (pictures show that).
    fn vectors(&self) {
        for scheme in [Scheme::Nearest4, Scheme::Rbf] {
            let set = LightSet::new(self.stage.scene, 200, vec![0.0], (scheme, Blend::Polynomial)).unwrap();
            let [scalar, vector] = [Integral::Scalar, Integral::Vector].map(|integral| {
                Values::exact(exact::values(self.stage, self.transfer, &set, integral, &Silent).unwrap())
            });
            let total: f64 = self.stage.areas.iter().sum();
            let of_light = |(light, truth): (&Light, &Vec<DVec3>)| {
                let one = std::slice::from_ref(light);
                let [q, v] = [&scalar, &vector].map(|values| values.at_receivers(&values.light(&set, one).unwrap()));
                let mut all: Vec<f64> = truth.iter().map(|t| t.max_element()).collect();
                all.sort_unstable_by(f64::total_cmp);
                let full = all[all.len() * 995 / 1000];
                let rms = |a: &[DVec3], b: &[DVec3]| {
                    let squares =
                        a.iter().zip(b).zip(&self.stage.areas).map(|((a, b), area)| area * a.distance_squared(*b));
                    100.0 * (squares.sum::<f64>() / (3.0 * total)).sqrt() / full
                };
                [rms(&q, &v), rms(&q, truth), rms(&v, truth)]
            };
            let mut found: Vec<[f64; 3]> = self.unseen.iter().zip(&self.truth).map(of_light).collect();
            for (k, what) in ["Q to q", "q to truth", "Q to truth"].into_iter().enumerate() {
                found.sort_unstable_by(|a, b| a[k].total_cmp(&b[k]));
                let (median, worst) = (found[found.len() / 2][k], found[found.len() - 1][k]);
                println!("{} {} {what}: {median:.3} / {worst:.3} % of full scale", self.name, scheme.name());
            }
        }
    }

    fn run(&self, full: bool) {
        let choices = Choices::new(&std::collections::BTreeMap::new()).unwrap();
        let set_of = |scheme| LightSet::new(self.stage.scene, 200, vec![0.0], (scheme, Blend::Polynomial)).unwrap();
        let sets = [Scheme::Nearest4, Scheme::Rbf].map(set_of);
        let start = Instant::now();
        let values =
            |integral| Values::exact(exact::values(self.stage, self.transfer, &sets[0], integral, &Silent).unwrap());
        let scalar = values(Integral::Scalar);
        println!("{}: scalars of 200 lights in {:.1} s", self.name, start.elapsed().as_secs_f64());
        for set in &sets {
            let scheme = set.interpolator.scheme().name();
            for (name, encoding) in
                [("raw", Encoding::Raw), ("uniform8", Encoding::Uniform8), ("lloyd8", Encoding::Lloyd8)]
            {
                self.print(&format!("{name} {scheme}"), set, &scalar, Choices { encoding, ..choices });
            }
        }
        for (order, window) in [
            (3, Window::None),
            (5, Window::None),
            (7, Window::None),
            (10, Window::None),
            (7, Window::Lanczos),
            (7, Window::Hanning),
        ] {
            let what = format!("sh {order} {window:?}");
            let choices = Choices { encoding: Encoding::Harmonics, order: Some(order), window, ..choices };
            self.print(&what, &sets[0], &scalar, choices);
        }
        let encoding = Encoding::ReferencePoints;
        self.print("reference-points auto", &sets[1], &scalar, Choices { encoding, ..choices });
        for percent in [1, 3, 6] {
            for order in if full { vec![3, 6] } else { vec![3] } {
                for chosen_by in [ChosenBy::Geometry, ChosenBy::Illumination] {
                    for weights in [
                        Choice::Barycentric,
                        Choice::Fitted(Bounds::Extrapolating),
                        Choice::BestTriangle(Bounds::Extrapolating),
                    ] {
                        let references = Some(self.topology.positions.len() * percent / 100);
                        let order = Some(order);
                        let what = format!("reference-points {percent} % {order:?} {chosen_by:?} {weights:?}");
                        let choices = Choices { encoding, references, order, chosen_by, weights, ..choices };
                        self.print(&what, &sets[1], &scalar, choices);
                    }
                }
            }
        }
        drop(scalar);
        let start = Instant::now();
        let vector = values(Integral::Vector);
        println!("{}: vectors of 200 lights in {:.1} s", self.name, start.elapsed().as_secs_f64());
        for set in &sets {
            let scheme = set.interpolator.scheme().name();
            for (name, encoding) in [("raw", Encoding::Raw), ("lloyd8", Encoding::Lloyd8)] {
                let choices = Choices { encoding, integral: Integral::Vector, ..choices };
                self.print(&format!("{name} vector {scheme}"), set, &vector, choices);
            }
        }
    }
}

fn bench(name: &str, source: SourceModel, material: &str, work: impl Fn(&Bench)) {
    let scene = scene_of(source, material);
    let settings =
        BakeSettings { max_rms: MAX_RMS, ..BakeSettings::new(&super::super::QuantizedLights, Default::default()) };
    let stage = Stage::new(&scene, super::super::bake::count(&scene, &settings));
    let all = DirectionSet::fibonacci(32).unwrap();
    let light = |d: &DVec3| Light::Directional { from: *d, irradiance: DVec3::ONE };
    let tuning: Vec<Light> = all.directions().iter().step_by(2).map(light).collect();
    let unseen: Vec<Light> = all.directions().iter().skip(1).step_by(2).map(light).collect();
    stage
        .with_transfer(NearField::for_error(MAX_RMS), |mut transfer| {
            transfer.tune(0.1 * MAX_RMS, &stage.irradiance(&tuning)?);
            let of_light = |light: &Light| Ok(transfer.under(&exact::irradiance(&stage, light, stage.sampling)?));
            let truth = unseen.iter().map(of_light).collect::<crate::error::Result<_>>()?;
            let topology = Topology::new(&scene, &stage.receivers);
            let name = format!("{name} {material}");
            work(&Bench { name, stage: &stage, transfer: &transfer, topology, tuning, unseen, truth });
            Ok(())
        })
        .unwrap();
}

fn bunny() -> Option<SourceModel> {
    let root = std::env::var_os("TRANSLUX_SHARED")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared"), PathBuf::from);
    let path = root.join("data/meshes/bunny_closed.obj");
    if !path.exists() {
        eprintln!("SKIPPED: {} is not there", path.display());
        return None;
    }
    Some(crate::io::obj::read_obj(&path).unwrap())
}

#[test]
#[ignore = "prints a table"]
fn of_a_head() {
    for material in ["marble", "skin1"] {
        bench("head", crate::geometry::shapes::bumpy_head(1.0, 5), material, |bench| bench.run(false));
    }
}

#[test]
#[ignore = "prints a table"]
fn of_a_bunny() {
    for material in ["marble", "skin1"] {
        let Some(source) = bunny() else { return };
        bench("bunny", source, material, |bench| bench.run(material == "marble"));
    }
}

#[test]
#[ignore = "prints a table"]
fn of_vectors() {
    for material in ["marble", "skin1"] {
        let Some(source) = bunny() else { return };
        bench("bunny", source, material, |bench| bench.vectors());
    }
}
