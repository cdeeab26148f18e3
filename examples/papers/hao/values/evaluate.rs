//! What is stored, decoded: radiosity is a dot product with weights over the lights or over harmonics of the light.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::coefficients::decode;
use translux_format::quantised_values::{Encoding as Layout, QuantisedValues as File, tags};
use translux_format::{Budget, RawSection};

use super::super::settings::{Encoding, VertexValues};
use super::matrix::{Cells, Matrix};
use super::prediction::Earlier;
use super::references::References;
use super::{CHANNELS, Topology, codes, harmonics};
use crate::hao::mean::spherical_mean;
use translux::asset::Asset;
use translux::error::{Error, Result};
use translux::evaluate::Evaluator;
use translux::forms::baked_in::{BakedIn, Stored};
use translux::forms::projected::lights::LightSet;
use translux::forms::sampled_scene::GROUP;
use translux::light::Light;
use translux::light::quantised::interpolation::Scheme;
use translux::transport::receivers::Receivers;

/// Components of a vector.
const COMPONENTS: usize = 3;

pub(crate) fn open(form: &VertexValues, asset: &Asset) -> Result<Box<dyn Evaluator>> {
    let file = read(&asset.sections, form.encoding)?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let between = (interpolation(form.encoding, form.lights.scheme), form.lights.blend);
    let set = LightSet::new(&scene, file.directions as usize, file.shells.clone(), between)?;
    let values = Values::read(&file, &Topology::new(&scene, &receivers))?;
    BakedIn::boxed(scene, receivers, file.samples as usize, WithLights { set, values })
}

/// Harmonics need no interpolation between lights; this one takes no time to set up.
pub(super) fn interpolation(encoding: Encoding, scheme: Scheme) -> Scheme {
    if encoding == Encoding::Harmonics { Scheme::Nearest4 } else { scheme }
}

fn read(sections: &[RawSection], encoding: Encoding) -> Result<File> {
    let file = File::from_sections(sections)
        .map_err(|e| Error::input(e.to_string()))?
        .ok_or_else(|| Error::input("an asset without its sections qlv.*; bake it again"))?;
    let expected = match encoding {
        Encoding::Raw => Layout::Raw,
        Encoding::Uniform8 | Encoding::Lloyd8 => Layout::Codes,
        Encoding::Harmonics => Layout::Harmonics,
        Encoding::ReferencePoints => Layout::References,
    };
    if file.encoding == expected {
        return Ok(file);
    }
    let found = file.encoding;
    Err(Error::input(format!("section {}: {found:?} is stored, not what {encoding:?} stores", tags::NUMBERS)))
}

enum Content {
    /// Values of every light.
    Lights(Matrix),
    Harmonics {
        matrix: Matrix,
        order: usize,
        scales: Vec<f32>,
    },
    References {
        references: References,
        order: usize,
        scales: Vec<f32>,
    },
}

/// Stored values of all receivers.
pub(super) struct Values {
    content: Content,
}

/// A light for them.
pub(super) struct Weighted {
    /// Over the lights, `[plane][light]`.
    lights: Vec<Vec<f32>>,
    /// Over the harmonics, `[channel][shell and coefficient]`.
    harmonics: Vec<Vec<f32>>,
    /// Parallel lights whose vectors are averaged on the sphere.
    spherical: Vec<Spherical>,
}

/// A parallel light between the nearest lights of the set.
struct Spherical {
    direction: DVec3,
    irradiance: DVec3,
    near: Vec<(usize, f64)>,
}

impl Values {
    /// What the evaluator makes of a file.
    pub(super) fn read(file: &File, topology: &Topology) -> Result<Self> {
        let receivers = topology.positions.len();
        let (planes, columns) = (usize::from(file.planes), file.lights());
        let earlier = || Earlier::new(receivers, &topology.triangles);
        let order = usize::from(file.order);
        let content = match file.encoding {
            Layout::Raw => Content::Lights(Matrix { planes, columns, cells: Cells::Floats(file.raw.clone()) }),
            Layout::Codes => Content::Lights(codes::read(&file.codes, &file.tables, planes, columns, &earlier())?),
            Layout::Harmonics => {
                let earlier = earlier();
                let found = decode(tags::HARMONICS, &file.harmonics, Some(&earlier.similar(1)), Budget::default());
                let mut values = found.map_err(|e| Error::input(e.to_string()))?.values;
                earlier.restore(&mut values, file.columns());
                let columns = file.columns() / CHANNELS;
                let matrix = Matrix { planes: CHANNELS, columns, cells: Cells::Shorts(values) };
                Content::Harmonics { matrix, order, scales: file.scales.clone() }
            }
            Layout::References => {
                let references = References::read(file, topology)?;
                Content::References { references, order, scales: file.scales.clone() }
            }
        };
        if let Content::Lights(matrix) | Content::Harmonics { matrix, .. } = &content
            && matrix.rows() != receivers
        {
            return Err(Error::input(format!(
                "values of {} vertices for {receivers}: the mesh and its transport do not belong together",
                matrix.rows()
            )));
        }
        Ok(Self { content })
    }

    /// Values `[receiver][plane][light]` as they were computed.
    pub(super) fn exact(matrix: Matrix) -> Self {
        Self { content: Content::Lights(matrix) }
    }

    /// The values as they were computed, if these are what is held.
    pub(super) fn floats(&self) -> Option<(&Matrix, &[f32])> {
        match &self.content {
            Content::Lights(matrix @ Matrix { cells: Cells::Floats(cells), .. }) => Some((matrix, cells)),
            _ => None,
        }
    }

    /// Reference points, if these are what is stored.
    pub(super) fn references(&self) -> usize {
        if let Content::References { references, .. } = &self.content { references.count() } else { 0 }
    }

    /// RGB of every receiver, undershoots included.
    pub(super) fn unclamped(&self, light: &Weighted) -> Vec<[f32; 4]> {
        match &self.content {
            Content::Lights(matrix) => {
                let mut values = matrix.products(&light.lights);
                light.spherical.iter().for_each(|one| one.add(matrix, &mut values));
                values
            }
            Content::Harmonics { matrix, .. } => matrix.products(&light.harmonics),
            Content::References { references, .. } => references.radiosity(&light.lights, &light.harmonics),
        }
    }
}

impl Values {
    /// Radiosity of every receiver, RGB and nothing, none negative.
    fn clamped(&self, light: &Weighted) -> Vec<[f32; 4]> {
        let mut values = self.unclamped(light);
        // The larger of 0 and what is not a number is 0.
        values.iter_mut().flatten().for_each(|v| *v = v.max(0.0));
        values
    }

    /// The same in double precision.
    pub(super) fn at_receivers(&self, light: &Weighted) -> Vec<DVec3> {
        self.clamped(light).iter().map(|v| DVec3::new(v[0].into(), v[1].into(), v[2].into())).collect()
    }
}

/// With the set of lights that they belong to.
struct WithLights {
    set: LightSet,
    values: Values,
}

impl Stored for WithLights {
    type Light = Weighted;

    fn light(&self, lights: &[Light]) -> Result<Weighted> {
        self.values.light(&self.set, lights)
    }

    fn radiosity(&mut self, light: &Weighted, receivers: &Receivers) -> Vec<DVec3> {
        self.values.radiosity(light, receivers)
    }

    fn stage(&self) -> &'static str {
        "quantised lights"
    }

    fn bytes(&self) -> usize {
        self.values.bytes()
    }
}

impl Values {
    /// Lights made ready.
    pub(super) fn light(&self, set: &LightSet, lights: &[Light]) -> Result<Weighted> {
        let mut result = Weighted { lights: Vec::new(), harmonics: Vec::new(), spherical: Vec::new() };
        let of_channel = |vector: &[DVec3], c: usize| vector.iter().map(|v| v[c] as f32).collect::<Vec<f32>>();
        match &self.content {
            Content::Lights(matrix) if matrix.planes > CHANNELS => {
                let rest: Vec<Light> = match set.interpolator.scheme() {
                    Scheme::Nearest4 => {
                        let (parallel, rest): (Vec<Light>, Vec<Light>) =
                            lights.iter().cloned().partition(|l| matches!(l, Light::Directional { .. }));
                        for (direction, irradiance) in set.pieces(&parallel)?.into_iter().flatten() {
                            result.spherical.push(Spherical::new(set, direction, irradiance));
                        }
                        rest
                    }
                    _ => lights.to_vec(),
                };
                result.lights = vector_weights(set, &set.pieces(&rest)?);
            }
            Content::Lights(_) => {
                let vector = set.vector(lights)?;
                result.lights = (0..CHANNELS).map(|c| of_channel(&vector, c)).collect();
            }
            Content::Harmonics { order, scales, .. } => {
                result.harmonics = harmonics::weights(*order, &set.pieces(lights)?, scales);
            }
            Content::References { order, scales, .. } => {
                let vector = set.vector(lights)?;
                result.lights = (0..CHANNELS).map(|c| of_channel(&vector, c)).collect();
                result.harmonics = harmonics::weights(*order, &set.pieces(lights)?, scales);
            }
        }
        let weights = result.lights.iter().chain(&result.harmonics).flatten();
        match weights.copied().all(f32::is_finite) {
            true => Ok(result),
            false => Err(Error::runtime("the light is too bright for single precision; make it weaker")),
        }
    }

    /// Radiosity of every source vertex, RGB.
    pub(super) fn radiosity(&self, light: &Weighted, receivers: &Receivers) -> Vec<DVec3> {
        receivers.expand_rgb(&self.clamped(light), 1.0)
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        match &self.content {
            Content::Lights(matrix) => matrix.bytes(),
            Content::Harmonics { matrix, scales, .. } => matrix.bytes() + size_of_val(scales.as_slice()),
            Content::References { references, scales, .. } => references.bytes() + size_of_val(scales.as_slice()),
        }
    }
}

/// Weights of the vectors' components: for each channel x, y and z, the interpolation's times the light's direction.
fn vector_weights(set: &LightSet, pieces: &[Vec<(DVec3, DVec3)>]) -> Vec<Vec<f32>> {
    let parallel = pieces.first().map_or(&[][..], Vec::as_slice);
    let components = [0, 1, 2].map(|k| {
        let along: Vec<(DVec3, DVec3)> = parallel.iter().map(|(d, irradiance)| (*d, *irradiance * d[k])).collect();
        set.interpolator.sum(&along)
    });
    let plane = |plane: usize| components[plane % COMPONENTS].iter().map(|v| v[plane / COMPONENTS] as f32).collect();
    (0..CHANNELS * COMPONENTS).map(plane).collect()
}

impl Spherical {
    fn new(set: &LightSet, direction: DVec3, irradiance: DVec3) -> Self {
        let mut weights = Vec::new();
        set.interpolator.weights(direction, &mut weights);
        let near = weights.into_iter().enumerate().filter(|(_, weight)| *weight != 0.0).collect();
        Self { direction, irradiance, near }
    }

    /// Adds the product of the light's direction and the average of the vectors nearby (section 3.2).
    fn add(&self, matrix: &Matrix, values: &mut [[f32; 4]]) {
        values.par_iter_mut().enumerate().with_min_len(256).for_each_init(Vec::new, |vectors, (row, out)| {
            for (c, out) in out.iter_mut().enumerate().take(CHANNELS) {
                let component = |k: usize, light: usize| f64::from(matrix.value(row, COMPONENTS * c + k, light));
                vectors.clear();
                vectors.extend(self.near.iter().map(|&(light, weight)| {
                    (weight, DVec3::new(component(0, light), component(1, light), component(2, light)))
                }));
                *out += (spherical_mean(vectors).dot(self.direction) * self.irradiance[c]) as f32;
            }
        });
    }
}
