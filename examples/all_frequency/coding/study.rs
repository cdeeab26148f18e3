//! Rows of a model before they are coded, and what is made of them: bytes, and errors under every light.

use glam::DVec3;
use rayon::prelude::*;
use translux::asset::Asset;
use translux::compress::prediction::Net;
use translux::error::{Error, Result};
use translux::evaluate::{BakeSettings, Probes};
use translux::forms::projected::harmonics::Harmonics as HarmonicsForm;
use translux::geometry::samples::Samples;
use translux::light::harmonics::coefficients;
use translux::light::{Light, LightKind};
use translux::math::statistics::vertex_error;
use translux::measure::probes::{self, Half};
use translux::methods;
use translux::progress::Silent;
use translux::scene::Scene;
use translux_format::coefficients::decode;
use translux_format::distant_transport::{DistantTransport, Harmonics, tags};
use translux_format::quantised_lights::Set;
use translux_format::{Budget, FormatError};

use super::curves::Measured;
use super::uncoded::Uncoded;
use crate::bench::{DEFAULT_RMS, Expected, Map, Truth, compared, half_in, sun};
use crate::common::bench::{Context, bytes_per_vertex};

/// Suns that errors are measured under.
const SUNS: usize = 12;

/// Harmonics of the rows, order 16: what coding saves is compared on the same rows, whatever order suns would ask for.
const HARMONICS: &str = "256";

/// A spacing that leaves no vertex out, mm.
pub(super) const EVERY_VERTEX: f64 = 1e-6;

/// The error of the basis that is stored over that of the basis which clusters see.
const FINER: f64 = 8.0;

pub(super) fn failed(e: FormatError) -> Error {
    Error::runtime(e.to_string())
}

/// A light as harmonics, and what it gives without any coding.
pub(super) struct Lit {
    pub(super) lights: Vec<Light>,
    pub(super) harmonics: Vec<DVec3>,
    pub(super) exact: Vec<DVec3>,
}

/// All that is measured on one model.
pub(super) struct Study<'a> {
    pub(super) scene: &'a Scene,
    pub(super) areas: Vec<f64>,
    pub(super) uncoded: Uncoded,
    /// All vertices as they are, and in the order in which they predict each other.
    pub(super) every: Net,
    pub(super) predicted: Net,
    pub(super) environments: Vec<(Lit, Expected)>,
    /// With half of the energy in each.
    pub(super) suns: Vec<Lit>,
    pub(super) truth: Truth,
}

/// Numbers of the points of a net, and what makes radiosity of them.
#[derive(Clone, Copy)]
pub(super) struct Numbers<'a> {
    pub(super) net: &'a Net,
    pub(super) spacing_mm: f64,
    /// `[row][column]`.
    pub(super) values: &'a [f32],
    pub(super) form: &'a Form,
}

/// What columns are.
pub(super) enum Form {
    /// Channels and harmonics over their units.
    Harmonics { of_column: Vec<(usize, usize)>, units: Vec<f32>, channels: [f64; 3] },
    /// Planes of functions.
    Components { set: Set, basis: Vec<f32> },
}

impl Form {
    pub(super) fn components(set: &Set) -> Result<Self> {
        let decoded =
            decode(tags::SET.basis, &set.basis, Some(&Net::unpredicted(set.units.len()).similar()), Budget::default());
        let basis = Net::unpredicted(set.units.len()).dequantise(&decoded.map_err(failed)?.values, &set.basis_steps);
        Ok(Self::Components { set: set.clone(), basis })
    }

    /// RGB of a unit of each column under a light.
    pub(super) fn weights(&self, light: &[DVec3]) -> Vec<DVec3> {
        match self {
            Self::Harmonics { of_column, units, channels } => {
                let weight = |&(c, k): &(usize, usize)| {
                    let mut rgb = DVec3::ZERO;
                    rgb[c] = light[k][c] * f64::from(units[k]) * channels[c];
                    rgb
                };
                of_column.iter().map(weight).collect()
            }
            Self::Components { set, basis } => {
                let count = set.basis_steps.len();
                let mut functions = vec![DVec3::ZERO; count];
                for ((row, unit), light) in basis.chunks_exact(count).zip(&set.units).zip(light) {
                    functions
                        .iter_mut()
                        .zip(row)
                        .for_each(|(sum, v)| *sum += f64::from(*v) * f64::from(*unit) * *light);
                }
                let weight = |&number: &u16| {
                    let (function, plane) = (usize::from(number) / 3, usize::from(number) % 3);
                    functions[function] * DVec3::from_slice(&set.channels[3 * plane..])
                };
                set.columns.iter().map(weight).collect()
            }
        }
    }
}

/// RMS of each channel in units of the directions, which a set's planes are mixed from.
pub(super) fn channel_units(set: &Set) -> [f64; 3] {
    [0, 1, 2].map(|c| (0..3).map(|plane| set.channels[3 * plane + c].powi(2)).sum::<f64>().sqrt())
}

/// The points of a net as a bake codes them.
pub(super) struct Coded {
    pub(super) set: Set,
    pub(super) form: Form,
    pub(super) digits: Vec<i16>,
    /// What a reader makes of them.
    pub(super) known: Vec<f32>,
    /// Bytes of everything but the coefficients.
    pub(super) light_bytes: usize,
}

/// Coefficients before they are quantised, `[row][function][plane]`.
pub(super) struct Exact {
    pub(super) values: Vec<f32>,
    pub(super) columns: usize,
}

impl Exact {
    /// Those of the columns of a set.
    pub(super) fn of(&self, set: &Set) -> Vec<f32> {
        let of_row = |row: &[f32]| -> Vec<f32> {
            set.columns.iter().map(|&number| row.get(usize::from(number)).copied().unwrap_or(0.0)).collect()
        };
        self.values.chunks_exact(self.columns).flat_map(of_row).collect()
    }
}

impl<'a> Study<'a> {
    pub(super) fn new(context: &Context, scene: &'a Scene) -> Result<Self> {
        let settings = BakeSettings {
            samples: compared(context, &[]).samples,
            for_lights: [LightKind::Environment].into(),
            probes: Probes { tuning: probes::directional(Half::Tuning), ..probes::for_bake(scene) },
            ..BakeSettings::new(DEFAULT_RMS)
        };
        let recipe = methods::built_in()
            .method("all_frequency")?
            .recipe(&[("coefficients".to_owned(), HARMONICS.to_owned())], settings)?;
        let form: &dyn std::any::Any = recipe.form.as_ref();
        let form = form.downcast_ref::<HarmonicsForm>().ok_or_else(|| Error::runtime("the default is harmonics"))?;
        let uncoded = Uncoded::new(scene, form, &recipe.settings, &Silent)?;
        context.say(&format!("coding: {} points, order {}", uncoded.points.len(), uncoded.order));
        let (every, predicted) = (Net::unpredicted(uncoded.points.len()), uncoded.net(EVERY_VERTEX));
        let truth = Truth::new(context, scene)?;
        let areas = scene.vertex_areas_mm2();
        let mut study =
            Self { scene, areas, uncoded, every, predicted, environments: Vec::new(), suns: Vec::new(), truth };
        for (index, map) in Map::all(context)?.iter().enumerate() {
            // Turns that no choice of a bake saw.
            let light = [map.light(101.0 * index as f64 + 20.0)];
            let expected = study.truth.under(&light)?;
            study.environments.push((study.lit(&light)?, expected));
        }
        let count = if context.quick { 2 } else { SUNS };
        study.suns = (0..count).map(|index| study.lit(&half_in(&sun(index, count)))).collect::<Result<_>>()?;
        context.say("coding: truth");
        Ok(study)
    }

    pub(super) fn lit(&self, lights: &[Light]) -> Result<Lit> {
        let mut harmonics = vec![DVec3::ZERO; self.uncoded.order.pow(2)];
        for light in lights {
            harmonics.iter_mut().zip(coefficients(light, self.uncoded.order)?).for_each(|(sum, own)| *sum += own);
        }
        let of_row = |row: &[f32]| {
            let sum = |c: usize| -> f64 {
                row[c * harmonics.len()..].iter().zip(&harmonics).map(|(v, w)| f64::from(*v) * w[c]).sum()
            };
            [sum(0) as f32, sum(1) as f32, sum(2) as f32, 0.0]
        };
        let values: Vec<[f32; 4]> = self.uncoded.values.par_chunks(3 * harmonics.len()).map(of_row).collect();
        let exact = self.uncoded.at_vertices(&self.every, EVERY_VERTEX, &values);
        Ok(Lit { lights: lights.to_vec(), harmonics, exact })
    }

    /// What some numbers lose that take so many bytes in all.
    pub(super) fn measured(&self, bytes: f64, numbers: Numbers) -> Result<Measured> {
        let coefficients = numbers.values.len() as f64;
        self.measured_under((bytes, coefficients), |lit| Ok(self.radiosity(numbers, &lit.harmonics)))
    }

    /// The same from radiosities, which so many coefficients give.
    pub(super) fn measured_under(
        &self,
        (bytes, coefficients): (f64, f64),
        mut radiosity: impl FnMut(&Lit) -> Result<Vec<DVec3>>,
    ) -> Result<Measured> {
        let mean = |squares: f64, count: usize| (squares / count.max(1) as f64).sqrt();
        let (mut coding, mut suns, mut whole) = (0.0, 0.0, 0.0);
        for (lit, expected) in &self.environments {
            let values = radiosity(lit)?;
            coding += vertex_error(&values, &lit.exact, &self.areas).rms.powi(2);
            whole += self.truth.error(&values, expected).rms.powi(2);
        }
        for lit in &self.suns {
            suns += vertex_error(&radiosity(lit)?, &lit.exact, &self.areas).rms.powi(2);
        }
        Ok(Measured {
            bytes: bytes / self.vertices(),
            coefficients: coefficients / self.vertices(),
            environments: mean(coding, self.environments.len()),
            suns: mean(suns, self.suns.len()),
            whole: mean(whole, self.environments.len()),
        })
    }

    pub(super) fn vertices(&self) -> f64 {
        self.scene.mesh.local_mm.len() as f64
    }

    /// Bytes of a set in a file.
    pub(super) fn bytes(&self, set: &Set, spacing_mm: f64) -> Result<f64> {
        let harmonics = Harmonics { order: self.uncoded.order as u32, spacing_mm, set: set.clone() };
        let file = DistantTransport { harmonics: Some(harmonics), ..Default::default() };
        let parts = self.scene.parts.parts.len();
        let samples = Samples { facets: Vec::new(), patch_offsets: vec![0], part_offsets: vec![0; parts + 1] };
        let asset = Asset::of_scene(self.scene.clone(), samples, file.to_sections().map_err(failed)?);
        bytes_per_vertex(&asset).map(|bytes| bytes * self.vertices())
    }

    /// The points of a net as a bake codes them.
    pub(super) fn coded(&self, net: &Net, spacing_mm: f64, max_rms: f64) -> Result<Coded> {
        let set = self.uncoded.coded(net, max_rms)?;
        let decoded = decode(tags::SET.coefficients, &set.coefficients, Some(&net.similar()), Budget::default());
        let digits = decoded.map_err(failed)?.values;
        let known = net.dequantise(&digits, &vec![set.step; set.columns.len()]);
        let light_bytes = self.bytes(&set, spacing_mm)? as usize - set.coefficients.len();
        Ok(Coded { form: Form::components(&set)?, set, digits, known, light_bytes })
    }

    /// The coefficients of the points of a net over all functions, exact but for the rounding of a far finer basis: that of a coded
    /// one is coarse where functions are weak, and strong ones leak into them.
    pub(super) fn exact(&self, net: &Net, max_rms: f64) -> Result<Exact> {
        let set = self.uncoded.coded(net, max_rms / FINER)?;
        let Form::Components { basis, .. } = Form::components(&set)? else {
            return Err(Error::runtime("rows that are no components"));
        };
        let uncoded = &self.uncoded;
        let (harmonics, count) = (set.units.len(), set.basis_steps.len());
        let units = channel_units(&set);
        let mut values = vec![0.0f32; net.point.len() * 3 * count];
        values.par_chunks_exact_mut(3 * count).zip(&net.point).for_each(|(out, &point)| {
            let row = uncoded.row(point);
            for (k, basis) in basis.chunks_exact(count).enumerate() {
                let rgb = [0, 1, 2].map(|c| f64::from(row[c * harmonics + k] / set.units[k]) / units[c].powi(2));
                let planes = [0, 1, 2].map(|p| (0..3).map(|c| set.channels[3 * p + c] * rgb[c]).sum::<f64>() as f32);
                for (sums, v) in out.as_chunks_mut::<3>().0.iter_mut().zip(basis) {
                    sums.iter_mut().zip(planes).for_each(|(sum, plane)| *sum += plane * v);
                }
            }
        });
        Ok(Exact { values, columns: 3 * count })
    }

    /// Harmonics of every vertex over their units, the strongest first.
    pub(super) fn plain(&self, set: &Set) -> (Vec<f32>, Form) {
        let (net, uncoded) = (&self.every, &self.uncoded);
        let (harmonics, channels) = (set.units.len(), channel_units(set));
        let unit = |c: usize, k: usize| set.units[k] * channels[c] as f32;
        let mut energy = vec![0.0f64; 3 * harmonics];
        for &point in &net.point {
            let row = self.uncoded.row(point);
            energy.iter_mut().zip(row).enumerate().for_each(|(i, (sum, v))| {
                *sum += f64::from(v / unit(i / harmonics, i % harmonics)).powi(2);
            });
        }
        let mut order: Vec<usize> = (0..3 * harmonics).collect();
        order.sort_by(|&a, &b| energy[b].total_cmp(&energy[a]).then(a.cmp(&b)));
        let of_column: Vec<(usize, usize)> = order.iter().map(|&i| (i / harmonics, i % harmonics)).collect();
        let mut values = vec![0.0f32; net.point.len() * of_column.len()];
        values.par_chunks_exact_mut(of_column.len()).zip(&net.point).for_each(|(out, &point)| {
            let row = uncoded.row(point);
            out.iter_mut().zip(&of_column).for_each(|(out, &(c, k))| *out = row[c * harmonics + k] / unit(c, k));
        });
        (values, Form::Harmonics { of_column, units: set.units.clone(), channels })
    }

    /// Radiosity of every vertex under a light.
    pub(super) fn radiosity(&self, numbers: Numbers, light: &[DVec3]) -> Vec<DVec3> {
        let weights = numbers.form.weights(light);
        let of_row = |row: &[f32]| {
            let mut sum = DVec3::ZERO;
            row.iter().zip(&weights).filter(|(v, _)| **v != 0.0).for_each(|(v, w)| sum += f64::from(*v) * *w);
            let [r, g, b] = sum.as_vec3().to_array();
            [r, g, b, 0.0]
        };
        let values: Vec<[f32; 4]> = numbers.values.par_chunks(weights.len().max(1)).map(of_row).collect();
        self.uncoded.at_vertices(numbers.net, numbers.spacing_mm, &values)
    }
}
