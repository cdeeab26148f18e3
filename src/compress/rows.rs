//! Sparse quantised rows of Haar coefficients: the irradiance of every patch under a cube map, linear in the light.

use std::ops::Range;

use glam::DVec3;
use translux_format::RawSection;
use translux_format::rows::{self, FACES, IrradianceRows};

use super::row_blocks;
use crate::error::{Error, Result};
use crate::light::cube_light::CubeLight;
use crate::math::slices::cut;
use crate::medium::entrance_basis::{EntranceBasis, MOST_TERMS};
use crate::parallel::*;

/// Irradiance rows that can be multiplied with a light.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Validated rows, on which `fill` relies.
    data: IrradianceRows,
    entrance: EntranceBasis,
    /// Patches that share rows, or that are decoded together: first and one past the last of each run.
    runs: Vec<[u32; 2]>,
}

/// Dense coefficients of the rows of a run of patches, over the union of their indices: for products with cube maps
/// made for them.
#[derive(Clone, Debug, Default)]
pub struct WholeRows {
    /// Place among `indices` of each coefficient of the cube map, counted from 1; 0 for none.
    places: Vec<u16>,
    indices: Vec<u16>,
    /// Coefficients `[patch][index]`.
    values: Vec<f32>,
}

impl WholeRows {
    /// Writes the coefficients of a patch, counted from the first of the run, into `out`, which has room for six faces
    /// and is 0 except where other patches of the run were written.
    pub fn write(&self, patch: usize, out: &mut [f32]) {
        let count = self.indices.len();
        let values = self.values.get(patch * count..).unwrap_or(&[]);
        for (index, value) in self.indices.iter().zip(values) {
            if let Some(out) = out.get_mut(usize::from(*index)) {
                *out = *value;
            }
        }
    }

    /// Resets to 0 what [`WholeRows::write`] wrote.
    pub fn erase(&self, out: &mut [f32]) {
        for index in &self.indices {
            if let Some(out) = out.get_mut(usize::from(*index)) {
                *out = 0.0;
            }
        }
    }

    /// Clears everything and starts a run with coefficients at `indices`.
    fn begin(&mut self, coefficients: usize, indices: impl Iterator<Item = u16>) {
        for index in self.indices.drain(..) {
            self.places[usize::from(index)] = 0;
        }
        self.places.resize(coefficients, 0);
        for index in indices {
            if let Some(place @ 0) = self.places.get_mut(usize::from(index)) {
                self.indices.push(index);
                *place = self.indices.len() as u16;
            }
        }
    }
}

/// Largest number of patches that are decoded together where they share no rows.
const TOGETHER: usize = 64;

/// Number of coefficients whose values are dequantised together.
const RUN: usize = 64;

impl Rows {
    /// Wraps new rows of the patches `part_offsets[i]..part_offsets[i + 1]` of each part.
    ///
    /// # Errors
    /// Rows that are not valid (exit 3).
    pub fn new(data: IrradianceRows, part_offsets: &[u32]) -> Result<Self> {
        data.validate().map_err(|error| Error::input(error.to_string()))?;
        Self::of_valid(data, part_offsets)
    }

    /// The rows of an asset with these patches of each part, `None` if it has none. They are checked while they are
    /// decoded.
    ///
    /// # Errors
    /// Sections that are missing or not valid (exit 3).
    pub fn from_sections(sections: &[RawSection], part_offsets: &[u32]) -> Result<Option<Self>> {
        let patches = part_offsets.last().map_or(0, |end| *end as usize);
        let data = IrradianceRows::from_sections(sections, patches).map_err(|error| Error::input(error.to_string()))?;
        data.map(|data| Self::of_valid(data, part_offsets)).transpose()
    }

    fn of_valid(data: IrradianceRows, part_offsets: &[u32]) -> Result<Self> {
        let entrance = EntranceBasis::from_polynomials(&data.functions)?;
        let runs = rows::blocks(part_offsets, if data.block > 0 { data.block } else { TOGETHER });
        let covered = runs.iter().try_fold(0, |end, block| (block[0] == end).then_some(block[1]));
        if covered.map(|end| end as usize) != Some(data.patches()) {
            return Err(Error::input(format!("the parts of the rows do not fit {} patches", data.patches())));
        }
        Ok(Self { data, entrance, runs })
    }

    /// Patches that share rows, first and one past the last of each block; empty where they share none.
    pub fn blocks(&self) -> &[[u32; 2]] {
        if self.data.block > 0 { &self.runs } else { &[] }
    }

    /// Patches of one part that [`Rows::decode`] decodes together, first and one past the last of each run.
    pub fn runs(&self) -> &[[u32; 2]] {
        &self.runs
    }

    /// The functions of the angle of which the rows are made; they give the coefficients of a refractive index.
    pub fn entrance(&self) -> &EntranceBasis {
        &self.entrance
    }

    /// The rows as plain arrays.
    pub fn data(&self) -> &IrradianceRows {
        &self.data
    }

    /// The rows as plain arrays.
    pub fn into_data(self) -> IrradianceRows {
        self.data
    }

    /// Number of patches.
    pub(crate) fn len(&self) -> usize {
        self.data.patches()
    }

    /// Irradiance of every patch, RGB. `coefficients_of_patch` gives the coefficients of [`Rows::entrance`] for the
    /// patch's medium.
    ///
    /// # Errors
    /// A light with another side (exit 3).
    pub fn irradiance(
        &self,
        light: &CubeLight,
        coefficients_of_patch: impl Fn(usize) -> [f64; MOST_TERMS] + Sync,
    ) -> Result<Vec<DVec3>> {
        const CHUNK: usize = 1024;
        let mut result = vec![DVec3::ZERO; self.len()];
        self.check(light)?;
        result.par_chunks_mut(CHUNK).enumerate().for_each(|(i, out)| {
            self.fill(i * CHUNK, light, &coefficients_of_patch, out);
        });
        let of_blocks = cut(&mut result, self.blocks().iter().map(|[first, end]| (end - first) as usize));
        of_blocks.into_par_iter().with_min_len(CHUNK / 16).for_each(row_blocks::inverse);
        Ok(result)
    }

    /// Like [`Rows::irradiance`] for some patches, on one thread; patches beyond the last are left out.
    ///
    /// # Errors
    /// A light with another side (exit 3).
    pub fn irradiance_range(
        &self,
        patches: Range<usize>,
        light: &CubeLight,
        coefficients_of_patch: impl Fn(usize) -> [f64; MOST_TERMS],
    ) -> Result<Vec<DVec3>> {
        self.check(light)?;
        let end = patches.end.min(self.len());
        if patches.start >= end {
            return Ok(Vec::new());
        }
        // Whole blocks.
        let blocks = self.blocks();
        let some = blocks.partition_point(|block| block[1] as usize <= patches.start)
            ..blocks.partition_point(|block| (block[0] as usize) < end);
        let blocks = blocks.get(some).unwrap_or(&[]);
        let from = blocks.first().map_or(patches.start, |block| block[0] as usize);
        let to = blocks.last().map_or(end, |block| block[1] as usize);
        let mut result = vec![DVec3::ZERO; to - from];
        self.fill(from, light, &coefficients_of_patch, &mut result);
        for block in blocks {
            row_blocks::inverse(&mut result[block[0] as usize - from..block[1] as usize - from]);
        }
        Ok(result[patches.start - from..end - from].to_vec())
    }

    /// All coefficients of one of the [`Rows::runs`], for the coefficients of [`Rows::entrance`] of its part.
    pub fn decode(&self, [first, end]: [u32; 2], entrance: &[f64; MOST_TERMS], whole: &mut WholeRows) {
        let (rows, terms) = (&self.data, self.data.terms);
        let face = rows.side * rows.side;
        let patches = first as usize..(end as usize).min(self.len());
        let c = entrance.map(|c| c as f32);
        let detail = |patch: usize| rows.offsets[patch] as usize..rows.offsets[patch + 1] as usize;
        let scaling = (0..FACES).map(|f| (f * face) as u16);
        let details = patches.clone().flat_map(|patch| rows.indices[detail(patch)].iter().copied());
        whole.begin(FACES * face, scaling.chain(details));
        let count = whole.indices.len();
        whole.values.clear();
        whole.values.resize(patches.len() * count, 0.0);
        for (patch, out) in patches.clone().zip(whole.values.chunks_exact_mut(count)) {
            let range = detail(patch);
            let (kept, values) = (range.len(), &rows.values[range.start * terms..range.end * terms]);
            for (k, index) in rows.indices[range].iter().enumerate() {
                let sum: f32 = c[..terms].iter().enumerate().map(|(j, c)| c * f32::from(values[j * kept + k])).sum();
                out[usize::from(whole.places[usize::from(*index)]) - 1] = sum * rows.steps[patch];
            }
            // Faces come first.
            let scaling = &rows.scaling[patch * terms * FACES..(patch + 1) * terms * FACES];
            for (face, out) in out.iter_mut().enumerate().take(FACES) {
                let sum: f32 = (0..terms).map(|j| c[j] * f32::from(scaling[j * FACES + face])).sum();
                *out = sum * rows.scaling_steps[patch];
            }
        }
        if rows.block > 0 {
            row_blocks::inverse_rows(&mut whole.values, count);
        }
    }

    fn check(&self, light: &CubeLight) -> Result<()> {
        if light.side() == self.data.side {
            return Ok(());
        }
        Err(Error::input(format!(
            "the rows are for cube maps of {} texels along an edge, and the light has {}",
            self.data.side,
            light.side()
        )))
    }

    /// Products of the light with rows from `first` on, as many as there are in `out` and in the rows.
    fn fill(
        &self,
        first: usize,
        light: &CubeLight,
        coefficients_of_patch: &impl Fn(usize) -> [f64; MOST_TERMS],
        out: &mut [DVec3],
    ) {
        let (rows, terms) = (&self.data, self.data.terms);
        let face = rows.side * rows.side;
        let radiance = light.coefficients();
        for (patch, out) in (first..self.len()).zip(out) {
            let c = coefficients_of_patch(patch).map(|c| c as f32);
            let (from, end) = (rows.offsets[patch] as usize, rows.offsets[patch + 1] as usize);
            let values = &rows.values[from * terms..end * terms];
            let detail = product(&rows.indices[from..end], values, &c[..terms], radiance);
            let mut total = detail.map(|sum| f64::from(sum) * f64::from(rows.steps[patch]));
            let scaling = &rows.scaling[patch * terms * FACES..(patch + 1) * terms * FACES];
            for (k, value) in scaling.iter().enumerate() {
                let weight = f64::from(c[k / FACES]) * f64::from(*value) * f64::from(rows.scaling_steps[patch]);
                let coefficient = radiance[k % FACES * face];
                total.iter_mut().zip(coefficient).for_each(|(sum, l)| *sum += weight * f64::from(l));
            }
            *out = DVec3::new(total[0], total[1], total[2]) * light.scale();
        }
    }
}

/// `Sum_k (Sum_j c_j value_jk) radiance[index_k]`.
fn product(indices: &[u16], values: &[i8], c: &[f32], radiance: &[[f32; 4]]) -> [f32; 4] {
    let count = indices.len();
    let mut sums = [[0.0f32; 4]; 2];
    let mut weights = [0.0f32; RUN];
    for start in (0..count).step_by(RUN) {
        let run = RUN.min(count - start);
        weights[..run].fill(0.0);
        for (c, values) in c.iter().zip(values.chunks_exact(count)) {
            for (weight, value) in weights.iter_mut().zip(&values[start..start + run]) {
                *weight += c * f32::from(*value);
            }
        }
        // Two chains of sums in a fixed order.
        for (k, (weight, index)) in weights.iter().zip(&indices[start..start + run]).enumerate() {
            let Some(light) = radiance.get(usize::from(*index)) else { continue };
            for (sum, light) in sums[k % 2].iter_mut().zip(light) {
                *sum += weight * light;
            }
        }
    }
    std::array::from_fn(|i| sums[0][i] + sums[1][i])
}
