//! Evaluation of `quantized_lights`: lights become weights over the set, these a vector over the columns of components;
//! radiosity is a dot product with it at a reference point, and at a vertex a weighted sum over these.

use glam::DVec3;
use translux_format::quantised_lights::{QuantisedLights as File, tags};

use super::light_set::{LightSet, light_net};
use super::settings::QuantisedLights;
use crate::asset::Asset;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::form::read_error;
use crate::forms::baked_in::{BakedIn, Beside};
use crate::forms::gathered::model::sections_of;
use crate::forms::projected::components::{
    Coded, Components, LightBasis, LightFunctions, Lit, Rows, Transport, Weighted,
};
use crate::forms::sampled_scene::GROUP;
use crate::light::Light;
use crate::light::quantised::vector::Emission;
use crate::parallel::*;
use crate::scene::Scene;
use crate::transport::receivers::Receivers;

/// Opens an asset of components.
pub(super) fn open(form: &QuantisedLights, asset: &Asset) -> Result<Box<dyn Evaluator>> {
    let file = File::from_sections(&asset.sections)
        .map_err(read_error)?
        .ok_or_else(|| Error::input("an asset of `quantized_lights` without its sections qlt.*; bake it again"))?;
    let scene = asset.scene.clone();
    let receivers = Receivers::new(&scene.mesh, &scene.parts, GROUP);
    let between = (form.lights.scheme, form.lights.blend);
    let mut set = LightSet::new(&scene, file.directions as usize, file.shells.clone(), between)?;
    let transport = transport(&file, &scene, &receivers, &set)?;
    // The basis has taken them in.
    set.interpolator.forget_weights();
    let components = Components { basis: set, transport };
    let beside = Beside { single: form.single.opened(), outside: None, calibration: sections_of(asset) };
    BakedIn::with(scene, receivers, file.samples as usize, components, beside)
}

impl LightBasis for LightSet {
    const STAGE: &'static str = "quantised lights";

    /// Lights as columns. The emission of an area light is that towards each reference point.
    fn lit(&self, transport: &Transport, lights: &[Light]) -> Result<Lit> {
        let emission = |light: &Light| Emission::new(light, self.lights.shells.centre_mm());
        let rest: Vec<Light> = lights.iter().filter(|light| emission(light).is_none()).cloned().collect();
        let mut parts = vec![Weighted { shells: weights_of_lights(self, &rest)?, factors: Vec::new() }];
        for light in lights {
            if let Some(emission) = emission(light) {
                let factors = transport.positions.par_iter().map(|at| emission.ratio(*at) as f32).collect();
                let shells = weights_of_lights(self, std::slice::from_ref(light))?;
                parts.push(Weighted { shells, factors });
            }
        }
        if rest.is_empty() && parts.len() > 1 {
            parts.remove(0);
        }
        transport.lit(parts)
    }
}

/// The transport of quantised lights.
pub(super) fn transport(file: &File, scene: &Scene, receivers: &Receivers, set: &LightSet) -> Result<Transport> {
    let net = light_net(&set.lights.directions, file.direction_spacing);
    let shells = [0..1, 1..file.shells.len()];
    let coded = file.sets.iter().zip(tags::SETS).zip(shells);
    let coded = coded.map(|((set, tags), shells)| {
        // The nearest light of a shell is its distance from the sphere around the scene away; one inside of that may touch the surface.
        let nearest = file.shells.get(shells.end - 1).map_or(1.0, |shell| (1.0 - shell).max(0.0));
        Coded { set, tags, shells, net: &net, rows: Rows::Lights(1.0 / (nearest * nearest)) }
    });
    let coded: Vec<Coded> = coded.collect();
    let fold = |basis, functions| folded(basis, functions, set);
    Transport::new(&coded, (scene, receivers), file.spacing_mm, fold)
}

/// RGB weights over the rows of the folded basis, for each shell.
fn weights_of_lights(set: &LightSet, lights: &[Light]) -> Result<Vec<Vec<[f64; 3]>>> {
    if set.interpolator.functions() == 0 {
        let weights: Vec<[f64; 3]> = set.vector(lights)?.iter().map(DVec3::to_array).collect();
        let of_shell = (weights.len() / set.lights.shells.inverse().len().max(1)).max(1);
        return Ok(weights.chunks(of_shell).map(<[_]>::to_vec).collect());
    }
    let of_shell = |[r, g, b]: [Vec<f64>; 3]| r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect();
    Ok(set.function_sums(lights)?.into_iter().map(of_shell).collect())
}

/// The basis combined with the interpolator's matrix, `[function of the direction][function]`; unchanged,
/// `[direction][function]`, where the interpolator has no functions.
fn folded(basis: Vec<f32>, functions: usize, set: &LightSet) -> LightFunctions {
    let width = set.interpolator.functions();
    if width == 0 {
        return LightFunctions::stored(&basis, functions);
    }
    let matrix = set.interpolator.matrix();
    let mut result = vec![0.0f64; width * functions];
    result.par_chunks_mut(functions.max(1)).enumerate().for_each(|(k, out)| {
        for (row, values) in matrix.chunks_exact(width).zip(basis.chunks_exact(functions.max(1))) {
            out.iter_mut().zip(values).for_each(|(sum, v)| *sum += row[k] * f64::from(*v));
        }
    });
    LightFunctions::Combined(result)
}
