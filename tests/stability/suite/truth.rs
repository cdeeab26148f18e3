//! The truth: sums over all pairs of many samples with many rays, at some vertices, and how far it is off itself.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::DVec3;
use translux::asset::{Asset, Provenance};
use translux::error::{Error, Result};
use translux::evaluate::exitance::MeshPoint;
use translux::evaluate::{BakeSettings, Evaluator, Model};
use translux::light::Light;
use translux::math::statistics::{VertexError, vertex_error};
use translux::methods;
use translux::progress::Silent;
use translux::scene::Scene;
use translux_format::RawSection;
use translux_format::calibration::tags;

/// Vertices that are looked at, at most.
const MOST: usize = 1000;

/// Samples under lights whose shadows are sharp, and under soft ones.
const SHARP: usize = 1 << 16;
const SOFT: usize = 1 << 14;

/// The same where methods have their own, more than in other rows.
const SHARP_OF_MANY: usize = 3 << 16;
const SOFT_OF_MANY: usize = 1 << 16;

/// Some vertices with the area around each.
pub struct Places {
    pub vertices: Vec<u32>,
    points: Vec<MeshPoint>,
    pub areas_mm2: Vec<f64>,
}

impl Places {
    /// Every vertex with area around it, or so many spread over all.
    pub fn new(scene: &Scene) -> Self {
        let areas = scene.vertex_areas_mm2();
        let all: Vec<u32> = (0..areas.len() as u32).filter(|&v| areas[v as usize] > 0.0).collect();
        let step = all.len().div_ceil(MOST).max(1);
        let mut wanted: BTreeMap<u32, ()> = all.into_iter().step_by(step).map(|v| (v, ())).collect();
        let mut places = Self { vertices: Vec::new(), points: Vec::new(), areas_mm2: Vec::new() };
        for (index, corners) in scene.mesh.triangles.iter().enumerate() {
            let part = &scene.parts.parts[scene.parts.triangle_part[index] as usize];
            if !part.transfers() {
                continue;
            }
            for (corner, &vertex) in corners.iter().enumerate() {
                if wanted.remove(&vertex).is_none() {
                    continue;
                }
                let barycentric = [0, 1, 2].map(|k| f64::from(u8::from(k == corner)));
                if let Some(point) = MeshPoint::new(&scene.mesh, index as u32, barycentric) {
                    places.vertices.push(vertex);
                    places.points.push(point);
                    places.areas_mm2.push(areas[vertex as usize]);
                }
            }
        }
        places
    }

    /// Values of the places, out of those of every vertex.
    pub fn of(&self, all: &[DVec3]) -> Vec<DVec3> {
        self.vertices.iter().map(|&v| all[v as usize]).collect()
    }

    pub fn error(&self, values: &[DVec3], truth: &[DVec3]) -> VertexError {
        vertex_error(values, truth, &self.areas_mm2)
    }
}

/// True radiosity of a scene at its places.
pub struct Truth {
    pub places: Places,
    sums: BTreeMap<(bool, usize), Box<dyn Evaluator>>,
    sharp: usize,
    soft: usize,
    model: Model,
    /// Sections of the kernels of a calibrated model.
    kernels: Vec<RawSection>,
}

impl Truth {
    /// A truth for methods with the numbers of samples that they choose, or with the few of the suite.
    pub fn new(scene: &Scene, many: bool) -> Self {
        let [sharp, soft] = if many { [SHARP_OF_MANY, SOFT_OF_MANY] } else { [SHARP, SOFT] };
        Self {
            places: Places::new(scene),
            sums: BTreeMap::new(),
            sharp,
            soft,
            model: Model::Dipole,
            kernels: Vec::new(),
        }
    }

    /// The truth of the model of an asset, with its kernels where they are calibrated.
    pub fn of_asset(scene: &Scene, model: Model, asset: &Asset) -> Self {
        let sections = asset.sections.iter().filter(|section| tags::ALL.contains(&section.tag));
        Self { model, kernels: sections.cloned().collect(), ..Self::new(scene, true) }
    }

    /// Radiosity under a light, and the error of that: the difference from half as many samples.
    pub fn under(&mut self, scene: &Scene, light: &Light) -> Result<(Vec<DVec3>, f64)> {
        let soft = !light.is_sharp();
        let count = if soft { self.soft.max((2 * scene.mesh.triangles.len()).min(self.sharp)) } else { self.sharp };
        let values = self.at(scene, (soft, count), light)?;
        let coarser = self.at(scene, (soft, count / 2), light)?;
        let own = self.places.error(&coarser, &values).or_none().rms;
        Ok((values, own))
    }

    fn at(&mut self, scene: &Scene, (soft, count): (bool, usize), light: &Light) -> Result<Vec<DVec3>> {
        let Self { places, sums, model, kernels, .. } = self;
        let evaluator = match sums.entry((soft, count)) {
            std::collections::btree_map::Entry::Occupied(found) => found.into_mut(),
            std::collections::btree_map::Entry::Vacant(free) => free.insert(made(scene, count, (*model, kernels))?),
        };
        evaluator.set_lights(vec![light.clone()], &Silent)?;
        evaluator.prepare_points(&Silent)?;
        let exitance = evaluator.exitance_at_points().ok_or_else(|| Error::runtime("a truth without points"))?;
        Ok(exitance.at_each(&places.points, &Silent))
    }
}

/// `reference` with so many samples.
fn made(scene: &Scene, samples: usize, (model, kernels): (Model, &[RawSection])) -> Result<Box<dyn Evaluator>> {
    let registry = methods::built_in();
    let method = registry.method("reference")?;
    let settings = BakeSettings {
        samples: Some(samples),
        model,
        kernels: kernels.to_vec(),
        tells_model: false,
        ..BakeSettings::new(method.default_max_rms())
    };
    let asset = method.recipe(&[], settings)?.bake(scene.clone(), Provenance::default(), &Silent)?;
    registry.open(Arc::new(asset))
}
