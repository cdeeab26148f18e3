//! Sections of components, and lights converted for them.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::RawSection;
use translux_format::quantised_lights::{QuantisedLights as File, tags};

use super::light_set::{LightSet, light_net};
use crate::error::{Error, Result};
use crate::forms::projected::components::{Coded, LightFunctions, Lit, Transport, Weighted};
use crate::light::Light;
use crate::light::quantised::vector::Emission;
use crate::scene::Scene;
use crate::transport::receivers::Receivers;

pub(super) fn write(file: &File) -> Result<Vec<RawSection>> {
    file.to_sections().map_err(|e| Error::runtime(format!("asset: {e}")))
}

pub(super) fn read(sections: &[RawSection]) -> Result<File> {
    File::from_sections(sections)
        .map_err(|e| Error::input(e.to_string()))?
        .ok_or_else(|| Error::input("an asset of `quantized_lights` without its sections qlt.*; bake it again"))
}

/// The transport of quantised lights.
pub(super) fn transport(file: &File, scene: &Scene, receivers: &Receivers, set: &LightSet) -> Result<Transport> {
    let net = light_net(&set.lights.directions, file.direction_spacing);
    let shells = [0..1, 1..file.shells.len()];
    let coded = file.sets.iter().zip(tags::SETS).zip(shells);
    let coded: Vec<Coded> = coded.map(|((set, tags), shells)| Coded { set, tags, shells, net: &net }).collect();
    let fold = |basis, functions| folded(basis, functions, set);
    Transport::new(&coded, (scene, receivers), file.spacing_mm, fold)
}

/// Converts lights to columns. The emission of an area light is that towards each reference point.
pub(super) fn light(transport: &Transport, set: &LightSet, lights: &[Light]) -> Result<Lit> {
    let emission = |light: &Light| Emission::new(light, set.lights.shells.centre_mm());
    let rest: Vec<Light> = lights.iter().filter(|light| emission(light).is_none()).cloned().collect();
    let mut parts = vec![Weighted { shells: weights_of_lights(set, &rest)?, factors: Vec::new() }];
    for light in lights {
        if let Some(emission) = emission(light) {
            let factors = transport.positions().par_iter().map(|at| emission.ratio(*at) as f32).collect();
            let shells = weights_of_lights(set, std::slice::from_ref(light))?;
            parts.push(Weighted { shells, factors });
        }
    }
    if rest.is_empty() && parts.len() > 1 {
        parts.remove(0);
    }
    transport.lit(parts)
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
