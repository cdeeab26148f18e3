//! The far field at run time: light meets the stored coefficients once for every basis function; a change of material
//! touches the last combination only.

use glam::DVec3;
use rayon::prelude::*;
use translux_format::far_field::{FarField, LANES, over_lanes};

use crate::math::simd::{Level, multiversion};
use crate::transport::balanced_tree::LightDetails;

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
        let (mut rest, mut receiver, mut coefficient) = (values.as_mut_slice(), 0, 0);
        let (mut narrow, mut wide) = (far.narrow.as_slice(), far.wide.as_slice());
        for group in &far.groups {
            let count = group.receivers_end as usize - receiver;
            let (mine, others) = rest.split_at_mut(count * terms);
            rest = others;
            let coefficients = coefficient..group.coefficients_end as usize;
            let bits =
                |masks: &[u16]| masks[coefficients.clone()].iter().map(|m| m.count_ones() as usize).sum::<usize>();
            let wide_count = bits(&far.wide_masks);
            let (my_narrow, others) = narrow.split_at(bits(&far.masks) - wide_count);
            narrow = others;
            let (my_wide, others) = wide.split_at(wide_count);
            wide = others;
            let block = Block {
                nodes: &far.nodes[coefficients.clone()],
                masks: &far.masks[coefficients.clone()],
                wide_masks: &far.wide_masks[coefficients],
                narrow: my_narrow,
                wide: my_wide,
            };
            jobs.push((block, light.means[group.part as usize], receiver, mine));
            receiver = group.receivers_end as usize;
            coefficient = group.coefficients_end as usize;
        }
        jobs.into_par_iter().for_each(|(block, mean, receiver, out)| {
            let mut sums = [[[0.0; LANES]; 3]; TERMS];
            add_block(level, &block, &light.details, &mut sums);
            // The transform over the lanes is linear: once for the sums instead of once for each coefficient.
            for row in sums[..terms].iter_mut().flatten() {
                *row = over_lanes(*row);
            }
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
    wide_masks: &'a [u16],
    narrow: &'a [[i8; LANES]],
    wide: &'a [[i16; LANES]],
}

#[inline(always)]
fn block_body(block: &Block, details: &[[f32; 3]], sums: &mut Sums) {
    let (mut narrow, mut wide) = (block.narrow.iter(), block.wide.iter());
    for ((&node, &mask), &wide_mask) in block.nodes.iter().zip(block.masks).zip(block.wide_masks) {
        let light = details[node as usize];
        let mut mask = mask;
        while mask != 0 {
            let k = mask.trailing_zeros() as usize % TERMS;
            mask &= mask - 1;
            // Plain loops over arrays: what the compiler turns into whole registers.
            let mut sizes = [0.0f32; LANES];
            if wide_mask >> k & 1 == 1 {
                let Some(row) = wide.next() else { return };
                for i in 0..LANES {
                    sizes[i] = f32::from(row[i]);
                }
            } else {
                let Some(row) = narrow.next() else { return };
                for i in 0..LANES {
                    sizes[i] = f32::from(row[i]);
                }
            }
            for c in 0..3 {
                let (sums, light) = (&mut sums[k][c], light[c]);
                for i in 0..LANES {
                    sums[i] += sizes[i] * light;
                }
            }
        }
    }
}

multiversion! {
    /// Adds value times detail of every coefficient.
    fn add_block(block: &Block, details: &[[f32; 3]], sums: &mut Sums) => block_body
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::uniform;
    use translux_format::far_field::Group;

    const NODES: usize = 40;

    /// Two groups, 16 and 5 receivers, of a part each; random coefficients of three functions.
    fn field() -> FarField {
        let mut far = FarField { terms: 3, steps: vec![0.5, 0.25, 2.0], ..FarField::default() };
        for (part, receivers, coefficients) in [(0u32, 16u32, 1..30), (1, 5, 31..37)] {
            let receivers_end = far.groups.last().map_or(0, |g| g.receivers_end) + receivers;
            for node in coefficients {
                let mask = 1 + (uniform(1, node, 0) * 7.0) as u16;
                far.nodes.push(node as u32);
                far.masks.push(mask);
                far.wide_masks.push(mask & 0b010);
                for k in (0..3).filter(|k| mask >> k & 1 == 1) {
                    let value = |lane: usize| (uniform(2, node * 8 + k, lane as u64) * 200.0) as i16 - 100;
                    let row = std::array::from_fn(|lane| if lane < receivers as usize { value(lane) } else { 0 });
                    match k {
                        1 => far.wide.push(row.map(|x: i16| 30 * x)),
                        _ => far.narrow.push(row.map(|x| x as i8)),
                    }
                }
            }
            far.groups.push(Group { part, receivers_end, coefficients_end: far.nodes.len() as u32 });
        }
        far.row_sums = (0..21 * 3).map(|i| i as f32).collect();
        far
    }

    fn light() -> LightDetails {
        let detail = |node: u64| std::array::from_fn(|c| uniform(3, node, c as u64) as f32 - 0.5);
        LightDetails {
            details: (0..NODES as u64).map(detail).collect(),
            means: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
            scale: 8.0,
        }
    }

    #[test]
    fn sums_are_those_of_the_specification() {
        let (far, light) = (field(), light());
        let sums = FarSums::new(Level::detect(), &far, &light);
        let (mut receiver, mut coefficient, mut used) = (0, 0, [0, 0]);
        for group in &far.groups {
            let first = used;
            for r in receiver..group.receivers_end as usize {
                let mut expected = [DVec3::ZERO; 3];
                used = first;
                for c in coefficient..group.coefficients_end as usize {
                    for k in (0..3).filter(|k| far.masks[c] >> k & 1 == 1) {
                        let row = match k {
                            1 => far.wide[used[1]].map(f32::from),
                            _ => far.narrow[used[0]].map(f32::from),
                        };
                        let size = f64::from(over_lanes(row)[r - receiver]) * f64::from(far.steps[k]);
                        expected[k] += size * glam::Vec3::from_array(light.details[far.nodes[c] as usize]).as_dvec3();
                        used[usize::from(k == 1)] += 1;
                    }
                }
                for (k, expected) in expected.iter_mut().enumerate() {
                    let whole = f64::from(far.row_sums[3 * r + k]);
                    *expected += whole * glam::Vec3::from_array(light.means[group.part as usize]).as_dvec3();
                    let difference = sums.value(r, k) / light.scale - *expected;
                    assert!(difference.length() < 3e-4 * (1.0 + expected.length()), "{r} {k}: {difference}");
                }
            }
            receiver = group.receivers_end as usize;
            coefficient = group.coefficients_end as usize;
        }
        assert_eq!(used, [far.narrow.len(), far.wide.len()]);
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits_and_materials_combine_linearly() {
        let (far, light) = (field(), light());
        let sums = FarSums::new(Level::Baseline, &far, &light);
        for level in Level::available() {
            assert_eq!(FarSums::new(level, &far, &light).values, sums.values, "{level:?}");
        }
        let coefficients = [vec![1.0, 0.0, 0.0], vec![0.0, 2.0, 0.0], vec![0.5, 0.0, -1.0]];
        let mut out = vec![DVec3::ONE; 4];
        sums.combine(10, &coefficients, &mut out);
        for (i, out) in out.iter().enumerate() {
            let (a, b, c) = (sums.value(10 + i, 0), sums.value(10 + i, 1), sums.value(10 + i, 2));
            let expected = DVec3::ONE + DVec3::new(a.x, 2.0 * b.y, 0.5 * a.z - c.z);
            assert!((*out - expected).length() < 1e-9 * expected.length());
        }
    }
}
