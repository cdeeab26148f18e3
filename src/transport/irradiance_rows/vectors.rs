//! Transport vectors of receivers from the compressed irradiance rows of samples (Wang, Tran & Luebke 2005, "Diffuse Multiple
//! Scattering"): rows are summed over the nodes of a tree, each with a bounded number of coefficients, and every receiver gathers
//! rows of samples nearby and of nodes farther away.

use std::ops::Range;

use translux_format::rows::IrradianceRows;

use super::row::{Keep, Work};
use super::texels::TexelBaker;
use crate::error::{Error, Result};
use crate::light::cube_light::Transform;
use crate::math::cube_map::{FACES, solid_angles_sr};
use crate::math::haar::Haar;
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::parallel::*;
use crate::progress::{Progress, in_tasks};
use crate::transport::gather::{Gather, Lists, Lit, Scheme, Source};
use crate::transport::receivers::{Group, Receivers};
use crate::transport::tree::SampleTree;
use crate::transport::visibility::GROUP;

/// Receivers of a group at most, and lanes for their channels.
const MEMBERS: usize = 16;
const LANES: usize = 3 * MEMBERS;

/// Sparse rows of coefficients over a cube map, ascending places in each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparseRows {
    /// Bounds of the rows, one more than rows.
    pub offsets: Vec<u32>,
    /// Places of the coefficients, `(face * side + row) * side + column`.
    pub places: Vec<u16>,
    /// The coefficients.
    pub values: Vec<f32>,
}

impl SparseRows {
    fn empty() -> Self {
        Self { offsets: vec![0], ..Self::default() }
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Places and coefficients of a row.
    pub fn row(&self, index: usize) -> (&[u16], &[f32]) {
        let Some(&[from, end]) = self.offsets.get(index..).and_then(|o| o.first_chunk::<2>()) else {
            return (&[], &[]);
        };
        let range = from as usize..end as usize;
        (&self.places[range.clone()], &self.values[range])
    }

    /// Appends a row of the `most` largest of some coefficients, by place, without zeros; of equals the first stay.
    fn push(&mut self, coefficients: &mut Vec<(u16, f32)>, most: usize) {
        coefficients.retain(|(_, value)| *value != 0.0);
        if coefficients.len() > most {
            let larger_first = |a: &(u16, f32), b: &(u16, f32)| b.1.abs().total_cmp(&a.1.abs()).then(a.0.cmp(&b.0));
            coefficients.select_nth_unstable_by(most, larger_first);
            coefficients.truncate(most);
            coefficients.sort_unstable_by_key(|(place, _)| *place);
        }
        self.places.extend(coefficients.iter().map(|(place, _)| *place));
        self.values.extend(coefficients.iter().map(|(_, value)| *value));
        self.offsets.push(self.places.len() as u32);
    }

    fn extend(&mut self, other: &Self) -> Result<()> {
        let first = self.places.len();
        if first + other.places.len() >= u32::MAX as usize {
            return Err(Error::unsupported("the irradiance rows have more than 2^32 - 2 coefficients"));
        }
        self.offsets.extend(other.offsets[1..].iter().map(|end| end + first as u32));
        self.places.extend_from_slice(&other.places);
        self.values.extend_from_slice(&other.values);
        Ok(())
    }

    /// The irradiance that every row gives under a light in the same transform, in one channel of it.
    pub fn under(&self, radiance: &[[f32; 4]], channel: usize) -> Vec<f64> {
        let of_row = |index: usize| {
            let (places, values) = self.row(index);
            let light = |place: &u16| radiance.get(usize::from(*place)).map_or(0.0, |l| f64::from(l[channel]));
            places.iter().zip(values).map(|(place, value)| f64::from(*value) * light(place)).sum()
        };
        (0..self.len()).into_par_iter().map(of_row).collect()
    }
}

/// Irradiance rows of all samples, the `most` largest coefficients of each.
///
/// # Errors
/// More than 2^32 - 2 coefficients (exit 5).
pub fn irradiance_rows(
    baker: &TexelBaker,
    samples: usize,
    (transform, most): (Transform, usize),
    progress: &dyn Progress,
) -> Result<SparseRows> {
    let side = baker.side();
    let (haar, weights) = transform.of_transport(side)?;
    let of_chunk = |range: Range<usize>| {
        let mut rows = SparseRows::empty();
        let (mut picture, mut scratch) = (vec![0.0f32; side * side], vec![0.0f32; side * side]);
        let mut coefficients = Vec::new();
        baker.visit(range, |_, row| {
            coefficients.clear();
            for face in (0..FACES).filter(|f| row.lit[*f]) {
                let values = &row.values[face * side * side..(face + 1) * side * side];
                picture.iter_mut().zip(values).zip(&weights).for_each(|((out, v), w)| *out = v * w);
                haar.forward(&mut picture, &mut scratch);
                coefficients.extend(picture.iter().enumerate().map(|(i, v)| ((face * side * side + i) as u16, *v)));
            }
            rows.push(&mut coefficients, most);
        });
        rows
    };
    let chunks = in_tasks(progress, "irradiance rows", (samples, GROUP), of_chunk);
    let mut all = SparseRows::empty();
    chunks.iter().try_for_each(|chunk| all.extend(chunk))?;
    Ok(all)
}

/// Rows of three terms, the channels, without any row.
fn of_channels(side: usize) -> IrradianceRows {
    IrradianceRows {
        side,
        terms: 3,
        offsets: vec![0],
        functions: vec![Default::default(); 3],
        ..IrradianceRows::default()
    }
}

/// Rows of dense vectors, one after the other.
pub struct RowWriter {
    haar: Haar,
    /// Factors from integrals over texels to the values that are transformed.
    weights: Vec<f32>,
    work: Work,
    rows: IrradianceRows,
}

impl RowWriter {
    /// A writer of rows for faces of so many texels.
    ///
    /// # Errors
    /// A side that has no transform.
    pub fn new(side: usize, transform: Transform) -> Result<Self> {
        let (haar, weights) = transform.of_transport(side)?;
        let angles = solid_angles_sr(side);
        let weights = weights.iter().zip(angles).map(|(w, angle)| (f64::from(*w) / angle) as f32).collect();
        Ok(Self { haar, weights, work: Work::new(side, 3), rows: of_channels(side) })
    }

    /// Appends a row from integrals over texels, `[channel][face][row][column]`, each times a factor.
    pub fn push(&mut self, integrals: &[f32], factor: f32, selection: Selection) {
        let face = self.weights.len();
        for (index, out) in self.work.coefficients.chunks_exact_mut(3 * face).enumerate() {
            let mut lit = false;
            for (channel, out) in out.chunks_exact_mut(face).enumerate() {
                let from = (channel * FACES + index) * face;
                let Some(own) = integrals.get(from..from + face) else { continue };
                out.iter_mut().zip(own.iter().zip(&self.weights)).for_each(|(out, (v, w))| *out = factor * v * w);
                lit |= own.iter().any(|v| *v != 0.0);
                self.haar.forward(out, &mut self.work.scratch);
            }
            self.work.lit[index] = lit;
        }
        self.work.append(selection.keep, selection.importance, &mut self.rows);
    }

    /// Returns all rows.
    pub fn finish(self) -> IrradianceRows {
        self.rows
    }
}

/// Rows of several writers, one after the other.
///
/// # Errors
/// More than 2^32 - 2 coefficients (exit 5).
pub fn joined(side: usize, chunks: Vec<IrradianceRows>) -> Result<IrradianceRows> {
    super::join(of_channels(side), chunks)
}

/// Sums of rows times area over the samples of every node.
pub struct RowTree<'a> {
    gather: &'a Gather<'a>,
    samples: &'a SparseRows,
    /// From the last node to the first, because children follow their parent.
    nodes: SparseRows,
    side: usize,
    level: InstructionSet,
}

/// Selection of the coefficients that vectors keep.
#[derive(Clone, Copy, Debug)]
pub struct Selection<'a> {
    /// Coefficients that a row keeps.
    pub keep: Keep,
    /// Factor on the squares of each place when they are compared.
    pub importance: Option<&'a [f32]>,
}

impl<'a> RowTree<'a> {
    /// Sums rows over the nodes of a tree, `most` coefficients in each.
    ///
    /// # Errors
    /// More than 2^32 - 2 coefficients (exit 5).
    pub fn new(
        gather: &'a Gather<'a>,
        tree: &SampleTree,
        samples: &'a SparseRows,
        side: usize,
        most: usize,
    ) -> Result<Self> {
        let patches = gather.patches();
        let size = FACES * side * side;
        let mut nodes = SparseRows::empty();
        let mut sums = vec![0.0f32; size];
        let mut used: Vec<u16> = Vec::new();
        let mut coefficients = Vec::new();
        let count = tree.len();
        let add = |sums: &mut [f32], used: &mut Vec<u16>, (places, values): (&[u16], &[f32]), factor: f32| {
            for (place, value) in places.iter().zip(values) {
                let sum = &mut sums[usize::from(*place)];
                // A sum that cancels exactly is listed again, which does no harm.
                if *sum == 0.0 {
                    used.push(*place);
                }
                *sum += factor * value;
            }
        };
        for node in (0..count).rev() {
            match tree.children(node) {
                Some(children) => {
                    for child in children {
                        add(&mut sums, &mut used, nodes.row(count - 1 - child), 1.0);
                    }
                }
                None => {
                    for &sample in tree.members(node) {
                        let area = patches.get(sample as usize).map_or(0.0, |p| p.area_mm2 as f32);
                        add(&mut sums, &mut used, samples.row(sample as usize), area);
                    }
                }
            }
            used.sort_unstable();
            used.dedup();
            coefficients.clear();
            for place in used.drain(..) {
                coefficients.push((place, std::mem::take(&mut sums[usize::from(place)])));
            }
            nodes.push(&mut coefficients, most);
            if nodes.places.len() >= u32::MAX as usize {
                return Err(Error::unsupported("the sums of rows have more than 2^32 - 2 coefficients"));
            }
        }
        Ok(Self { gather, samples, nodes, side, level: InstructionSet::detect() })
    }

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Vectors of all receivers, three terms (R, G, B) of each coefficient; a receiver's depends on its own group only.
    ///
    /// # Errors
    /// More than 2^32 - 2 coefficients (exit 5).
    pub fn vectors(
        &self,
        receivers: &Receivers,
        scheme: Scheme,
        selection: Selection,
        progress: &dyn Progress,
    ) -> Result<IrradianceRows> {
        let side = self.side;
        progress.start("transfer", receivers.len() as u64);
        let mean = self.mean_irradiance();
        let lit = self.gather.light(&mean);
        let chunk = |groups: &[Group]| {
            let mut rows = of_channels(side);
            let mut work = Work::new(side, 3);
            self.dense(receivers, groups, (&lit, scheme), |vector| {
                work.take(vector);
                work.append(selection.keep, selection.importance, &mut rows);
                progress.advance(1);
            });
            rows
        };
        // A few vertices keep all threads busy as well.
        let together = (receivers.groups.len() / 64).clamp(1, 16);
        let chunks: Vec<IrradianceRows> = receivers.groups.par_chunks(together).map(chunk).collect();
        progress.finish();
        super::join(of_channels(side), chunks)
    }

    /// Calls `each` with the vectors of the receivers of some groups, one after the other: `[place][channel]`.
    fn dense(
        &self,
        receivers: &Receivers,
        groups: &[Group],
        (lit, scheme): (&Lit, Scheme),
        mut each: impl FnMut(&[[f32; 3]]),
    ) {
        let size = FACES * self.side * self.side;
        let mut lists = Lists::default();
        let mut sums = vec![[0.0f32; LANES]; size];
        let mut vector = vec![[0.0f32; 3]; size];
        for group in groups {
            sums.fill([0.0; LANES]);
            let sources = self.gather.sources_of(receivers, *group, lit, scheme);
            self.gather.weights(receivers, *group, lit, &sources, &mut lists, &mut |source, weights| {
                let mut lanes = [0.0f32; LANES];
                lanes.iter_mut().zip(weights.as_flattened()).for_each(|(lane, w)| *lane = *w);
                let (places, values) = match source {
                    Source::Cluster(node) => self.nodes.row(self.nodes.len() - 1 - node as usize),
                    Source::Patch(sample) => self.samples.row(sample as usize),
                };
                add(self.level, &mut sums, places, values, &lanes);
            });
            for member in 0..group.run.range().len().min(MEMBERS) {
                for (out, sums) in vector.iter_mut().zip(&sums) {
                    *out = [0, 1, 2].map(|channel| sums[3 * member + channel]);
                }
                each(&vector);
            }
        }
    }

    /// Irradiance of each sample under the same radiance from everywhere, up to a factor, for the tree's clusters.
    fn mean_irradiance(&self) -> Vec<glam::DVec3> {
        let face = self.side * self.side;
        let of_sample = |sample: usize| {
            let (places, values) = self.samples.row(sample);
            let first = places.iter().zip(values).filter(|(place, _)| usize::from(**place) % face == 0);
            // Whatever arrives counts as light, even where rounding or truncation took its mean.
            let least = if places.is_empty() { 0.0 } else { f64::from(f32::MIN_POSITIVE) };
            glam::DVec3::splat(first.map(|(_, v)| f64::from(*v)).sum::<f64>().max(least))
        };
        (0..self.samples.len()).into_par_iter().map(of_sample).collect()
    }
}

multiversion! {
    /// Adds one row to the sums of all receivers, with the weight of each.
    fn add(sums: &mut [[f32; LANES]], places: &[u16], values: &[f32], weights: &[f32; LANES]) => add_body
}

#[inline(always)]
fn add_body(sums: &mut [[f32; LANES]], places: &[u16], values: &[f32], weights: &[f32; LANES]) {
    for (place, value) in places.iter().zip(values) {
        let Some(sums) = sums.get_mut(usize::from(*place)) else { continue };
        add_scaled(sums, *value, weights);
    }
}

#[cfg(test)]
#[path = "vectors_tests.rs"]
mod tests;
