//! The far field at run time: light meets the stored coefficients once for every basis function; a change of material
//! touches the last combination only.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::{FarField, LANES};

use crate::transport::balanced_tree::LightDetails;
use crate::transport::simd::{Level, multiversion};

/// Basis functions at most.
const TERMS: usize = 16;

/// Far radiosity of every receiver and basis function, over the scale of the light.
#[derive(Clone, Debug, Default)]
pub struct FarSums {
    /// `[receiver][k]`, RGB.
    values: Vec<[f32; 3]>,
    terms: usize,
    scale: f64,
}

/// One row of sums for each function and channel.
type Sums = [[[f32; LANES]; 3]; TERMS];

impl FarSums {
    /// Of one light.
    pub fn new(level: Level, far: &FarField, light: &LightDetails) -> Self {
        let terms = far.terms.min(TERMS);
        let mut values = vec![[0.0; 3]; far.row_sums.len()];
        let mut jobs = Vec::with_capacity(far.groups.len());
        let (mut rest, mut receiver, mut coefficient, mut value) = (values.as_mut_slice(), 0, 0, 0);
        for group in &far.groups {
            let count = group.receivers_end as usize - receiver;
            let (mine, others) = rest.split_at_mut(count * terms);
            rest = others;
            let coefficients = coefficient..group.coefficients_end as usize;
            let kept: u32 = far.masks[coefficients.clone()].iter().map(|m| m.count_ones()).sum();
            let block = Block {
                nodes: &far.nodes[coefficients.clone()],
                masks: &far.masks[coefficients],
                values: &far.values[value..value + kept as usize],
            };
            jobs.push((block, light.means[group.part as usize], receiver, mine));
            receiver = group.receivers_end as usize;
            coefficient = group.coefficients_end as usize;
            value += kept as usize;
        }
        jobs.into_par_iter().for_each(|(block, mean, receiver, out)| {
            let mut sums = [[[0.0; LANES]; 3]; TERMS];
            add_block(level, &block, &light.details, &mut sums);
            for (lane, out) in out.chunks_exact_mut(terms.max(1)).enumerate() {
                let whole = &far.row_sums[(receiver + lane) * terms..];
                for (k, out) in out.iter_mut().enumerate() {
                    *out = std::array::from_fn(|c| sums[k][c][lane] * far.steps[k] + whole[k] * mean[c]);
                }
            }
        });
        Self { values, terms, scale: light.scale }
    }

    /// Adds the far radiosity of receivers from `first` on for the coefficients of a material, `[channel][k]`.
    pub fn combine(&self, first: usize, coefficients: &[Vec<f64>; 3], out: &mut [DVec3]) {
        let rows = self.values[first * self.terms..].chunks_exact(self.terms.max(1));
        for (out, row) in out.iter_mut().zip(rows) {
            let mut sum = DVec3::ZERO;
            for (k, value) in row.iter().enumerate() {
                for c in 0..3 {
                    sum[c] += coefficients[c][k] * f64::from(value[c]);
                }
            }
            *out += sum * self.scale;
        }
    }

    /// Far radiosity of one receiver and basis function, RGB.
    pub fn value(&self, receiver: usize, k: usize) -> DVec3 {
        glam::Vec3::from_array(self.values[receiver * self.terms + k]).as_dvec3() * self.scale
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice())
    }
}

/// Coefficients of one group.
struct Block<'a> {
    nodes: &'a [u32],
    masks: &'a [u16],
    values: &'a [[i16; LANES]],
}

#[inline(always)]
fn block_body(block: &Block, details: &[[f32; 3]], sums: &mut Sums) {
    let mut values = block.values.iter();
    for (&node, &mask) in block.nodes.iter().zip(block.masks) {
        let light = details[node as usize];
        let mut mask = mask;
        while mask != 0 {
            let k = mask.trailing_zeros() as usize % TERMS;
            mask &= mask - 1;
            let Some(row) = values.next() else { return };
            for (sums, light) in sums[k].iter_mut().zip(light) {
                for i in 0..LANES {
                    sums[i] += f32::from(row[i]) * light;
                }
            }
        }
    }
}

multiversion! {
    /// Adds value times detail of every coefficient.
    fn add_block(block: &Block, details: &[[f32; 3]], sums: &mut Sums) => block_body
}
