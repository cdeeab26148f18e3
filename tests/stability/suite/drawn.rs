//! Scenes at random: a body, its size, its medium and lights of one kind, each drawn from what people have.

use std::f64::consts::TAU;
use std::path::PathBuf;

use glam::{DMat3, DVec3};
use translux::geometry::mesh::Scale;
use translux::geometry::parts::PartsRule;
use translux::geometry::shapes::{bumpy_head, compose, cuboid, icosphere, plane, torus, torus_knot, uv_sphere};
use translux::geometry::source::SourceModel;
use translux::import::file::read_model;
use translux::light::LightKind;
use translux::math::random::uniform;
use translux::medium::material::{Overrides, presets};

use super::Way;
use super::cases::Case;
use super::lamps::Lamp;
use super::{WAYS, planned};

/// Random numbers of scenes.
const STAGE: u64 = 94;

/// Lights of a scene.
const LIGHTS: u64 = 3;

/// Kinds of light, the common ones more often.
const KINDS: [LightKind; 8] = [
    LightKind::Directional,
    LightKind::Directional,
    LightKind::Environment,
    LightKind::Environment,
    LightKind::Point,
    LightKind::Spot,
    LightKind::Area,
    LightKind::Constant,
];

/// Numbers of one scene, by dimension.
#[derive(Clone, Copy)]
struct Numbers(u64);

impl Numbers {
    fn next(self, dimension: u64) -> f64 {
        uniform(STAGE, self.0, dimension)
    }

    fn one_of<T: Copy>(self, dimension: u64, of: &[T]) -> Option<T> {
        of.get((self.next(dimension) * of.len() as f64) as usize).copied()
    }

    /// Between two numbers above 0, each factor as often.
    fn factor(self, dimension: u64, from: f64, to: f64) -> f64 {
        from * (to / from).powf(self.next(dimension))
    }
}

/// A scene by its index; `models` are files that take turns with bodies of our own.
pub fn drawn(index: u64, models: &[PathBuf]) -> Case {
    let numbers = Numbers(index);
    let file = models.get((numbers.next(0) * 2.0 * models.len() as f64) as usize).cloned();
    let shape = (numbers.next(1) * 8.0) as u32;
    let what = match &file {
        Some(path) => path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
        None => SHAPES[shape as usize].to_owned(),
    };
    let model = move || match &file {
        Some(path) => read_model(path).unwrap_or_default(),
        None => distorted(body(shape, numbers), numbers),
    };
    let mm = numbers.factor(2, 3.0, 300.0);
    let (material, medium) = medium(numbers);
    let kind = numbers.one_of(3, &KINDS).unwrap_or(LightKind::Directional);
    Case {
        name: format!("{index}: {what}, {mm:.0} mm, {medium}"),
        model: Box::new(model),
        scale: Scale::DiagonalMm(mm),
        materials: vec![material],
        overrides: overrides(numbers),
        parts: PartsRule::Auto,
        lamps: (0..LIGHTS).map(|light| Lamp::Drawn(kind, LIGHTS * index + light)).collect(),
        samples: None,
        set: Vec::new(),
        edited: None,
    }
}

/// The ways that a scene is baked: two methods in turn, and the planner.
pub fn ways(index: u64) -> Vec<Way> {
    let named = WAYS.iter().cycle().skip(2 * index as usize % WAYS.len()).take(2).copied();
    planned().into_iter().chain(named).collect()
}

const SHAPES: [&str; 8] = ["head", "box", "ball", "slivers", "torus", "knot", "two balls", "plane"];

fn body(shape: u32, numbers: Numbers) -> SourceModel {
    let level = 1 + (4.0 * numbers.next(10)) as u32;
    let side = |dimension: u64| numbers.factor(dimension, 0.1, 1.0);
    match shape {
        0 => bumpy_head(1.0, level),
        1 => cuboid(DVec3::new(side(11), side(12), side(13)), 1 << level),
        2 => icosphere(1.0, level),
        3 => uv_sphere(1.0, 20 << level, 3 << level),
        4 => torus(1.0, 0.6 * side(11), 16 << level, 8 << level),
        5 => torus_knot(2, 3, 1.0, 0.4, 0.5 * side(11), 24 << level, 6 << level),
        6 => compose(&[(icosphere(1.0, level), DVec3::ZERO), (icosphere(side(11), level), DVec3::new(1.5, 0.2, 0.0))]),
        _ => plane(side(11), side(12), 2 << level),
    }
}

/// A body turned and drawn out, a tenth of them with holes.
fn distorted(mut model: SourceModel, numbers: Numbers) -> SourceModel {
    let axis =
        DVec3::new(numbers.next(20) - 0.5, numbers.next(21) - 0.5, numbers.next(22) - 0.5).normalize_or(DVec3::X);
    let turn = DMat3::from_axis_angle(axis, TAU * numbers.next(23));
    let stretch = DVec3::new(1.0, numbers.factor(24, 0.4, 2.5), numbers.factor(25, 0.4, 2.5));
    model.positions.iter_mut().for_each(|p| *p = turn * (*p * stretch));
    if numbers.next(26) < 0.1 && model.triangles.len() > 32 {
        let whole = model.triangles.len();
        let hole = (numbers.next(27) * 0.8 * whole as f64) as usize;
        model.triangles.drain(hole..hole + whole / 20);
    }
    SourceModel::new(model.positions, model.triangles)
}

/// Half of the media are presets, the others have coefficients of their own.
fn medium(numbers: Numbers) -> (&'static str, String) {
    let all: Vec<&str> = presets().map(|preset| preset.name).collect();
    let name = numbers.one_of(30, &all).unwrap_or("marble");
    let changed = overrides(numbers);
    match changed.sigma_s_reduced_per_mm.zip(changed.sigma_a_per_mm) {
        Some((scattering, absorption)) => ("marble", format!("{:.2} + {:.4} /mm", scattering.y, absorption.y)),
        None => (name, name.to_owned()),
    }
}

fn overrides(numbers: Numbers) -> Overrides {
    if numbers.next(31) < 0.5 {
        return Overrides::default();
    }
    let scattering = numbers.factor(32, 0.1, 10.0);
    let channel = |dimension: u64| scattering * numbers.factor(dimension, 0.7, 1.4);
    let absorbed = |dimension: u64| scattering * numbers.factor(dimension, 1e-4, 1.0);
    Overrides {
        sigma_s_reduced_per_mm: Some(DVec3::new(channel(33), channel(34), channel(35))),
        sigma_a_per_mm: Some(DVec3::new(absorbed(36), absorbed(37), absorbed(38))),
        g: Some(0.9 * numbers.next(39)),
        eta_inside_over_outside: Some(1.1 + 0.5 * numbers.next(40)),
        ..Overrides::default()
    }
}
