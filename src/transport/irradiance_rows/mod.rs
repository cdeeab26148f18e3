//! Irradiance rows: for every patch, how much the light of each texel of a cube map adds to its irradiance.
//!
//! An entry is the mean over 2 x 2 sub-texels of `V f_j(mu)` times the texel's solid angle, for each function f_j of the
//! entrance basis (so that the index of refraction stays free), seen from one point of the patch. Entries are Haar
//! transformed with the solid angles as weights: the transform is orthonormal on the sphere, and constant light needs the
//! six scaling coefficients only, which are always kept, in 16 bits. Of the others the largest are kept, all terms of
//! a place together, in 8 bits each with one step for a patch.
//!
//! # Measured
//!
//! Closed bunny, 131,072 samples, faces of 32 texels, eta 1.3; relative RMS against rays at native resolution (whose own
//! noise is about 0.5 %), and in brackets of means over 64 neighbours: two terms with all coefficients 0.6 % (0.15 %) under
//! four environments, with 256 0.7 % (0.4 %), 128 1.2 % (0.8 %), 64 2.3 % (1.8 %); one term and 128 1.6 % (1.2 %);
//! three terms and 128 as two. A map with a bare sun: all 10.6 % (5.3 %), 128 16 % (9 %): texels are wider than suns. So
//! neither a third term nor more bits would show. A row of 128 takes 131 bytes in a file.

use std::ops::Range;

use rayon::prelude::*;
use translux_format::rows::IrradianceRows;

use crate::compress::rows::Rows;
use crate::error::{Error, Result};
use crate::math::cube_map::{FACES, FRAMES, centre, solid_angles_sr};
use crate::math::haar::Haar;
use crate::medium::entrance_basis::{DEGREE, EntranceBasis, MOST_TERMS};
use crate::progress::Progress;
use crate::transport::scene::Surface;
use crate::transport::simd::{Level, multiversion};
use crate::transport::visibility::{GROUP, Observer, Occluders, Resolution, Visible, visit};

/// What the rows keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowSettings {
    /// Resolution of visibility; texels are 2 x 2 sub-texels.
    pub resolution: Resolution,
    /// Terms of the entrance basis, 1 to [`MOST_TERMS`].
    pub terms: usize,
    /// Coefficients of a patch, the six scaling coefficients included.
    pub coefficients: usize,
}

impl RowSettings {
    /// See the measured errors in the tests.
    pub const DEFAULT: Self = Self { resolution: Resolution::Sub64, terms: 2, coefficients: 128 };

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.resolution.side() / 2
    }
}

/// Everything that the rows of all patches share.
pub struct RowBaker<'a> {
    surface: &'a Surface<'a>,
    settings: RowSettings,
    occluders: Occluders,
    tables: Tables,
    level: Level,
}

/// Numbers of a face.
struct Tables {
    /// Texels along an edge.
    side: usize,
    terms: usize,
    /// For even and for odd columns, `s` of the sub-texels.
    columns: [Vec<f32>; 2],
    /// One over the length of the direction: `[sub-row][parity][column / 2]`.
    inverse_length: Vec<f32>,
    /// A quarter of the square root of the solid angle of each texel.
    weights: Vec<f32>,
    polynomials: [[f32; DEGREE]; MOST_TERMS],
    /// The same as they are stored, one for each term.
    functions: Vec<[f64; DEGREE]>,
    haar: Haar,
}

impl Tables {
    fn new(settings: RowSettings, basis: &EntranceBasis) -> Result<Self> {
        let side = settings.side();
        let angles = solid_angles_sr(side);
        let haar = Haar::new(side, &angles).ok_or_else(|| Error::runtime("no Haar transform of this size"))?;
        let at = |i: usize| centre(2 * side, i);
        let inverse = |row: usize, parity: usize, x: usize| {
            let (s, t) = (at(2 * x + parity), at(row));
            1.0 / (1.0 + s * s + t * t).sqrt()
        };
        let inverse_length = (0..2 * side)
            .flat_map(|row| (0..2).flat_map(move |parity| (0..side).map(move |x| inverse(row, parity, x) as f32)))
            .collect();
        Ok(Self {
            side,
            terms: basis.terms(),
            columns: [0, 1].map(|parity| (0..side).map(|x| at(2 * x + parity) as f32).collect()),
            inverse_length,
            weights: angles.iter().map(|a| (0.25 * a.sqrt()) as f32).collect(),
            polynomials: basis.polynomials().map(|p| p.map(|c| c as f32)),
            functions: basis.polynomials().iter().take(basis.terms()).copied().collect(),
            haar,
        })
    }
}

impl<'a> RowBaker<'a> {
    /// Prepares the occluders and tables.
    ///
    /// # Errors
    /// Fewer than six coefficients or more than there are, no term or more than [`MOST_TERMS`] (exit 3).
    pub fn new(surface: &'a Surface<'a>, settings: RowSettings) -> Result<Self> {
        let most = FACES * settings.side() * settings.side();
        if !(FACES..=most).contains(&settings.coefficients) {
            return Err(Error::input(format!(
                "{} coefficients for each irradiance row: {FACES} to {most} are possible",
                settings.coefficients
            )));
        }
        if !(1..=MOST_TERMS).contains(&settings.terms) {
            return Err(Error::input(format!("{} terms for F_t: 1 to {MOST_TERMS} are possible", settings.terms)));
        }
        let tables = Tables::new(settings, &EntranceBasis::new(settings.terms))?;
        let occluders = Occluders::new(&surface.scene.mesh);
        Ok(Self { surface, settings, occluders, tables, level: Level::detect() })
    }

    /// Rows of all patches.
    ///
    /// # Errors
    /// More than 2^32 - 2 coefficients (exit 5).
    pub fn all(&self, progress: &dyn Progress) -> Result<Rows> {
        let count = self.surface.samples.len();
        progress.start("irradiance rows", count as u64);
        let chunks: Vec<IrradianceRows> = (0..count.div_ceil(GROUP))
            .into_par_iter()
            .map(|i| {
                let range = i * GROUP..((i + 1) * GROUP).min(count);
                let rows = self.range(range.clone());
                progress.advance(range.len() as u64);
                rows
            })
            .collect();
        progress.finish();
        let mut all = self.empty();
        for mut chunk in chunks {
            let first = all.indices.len();
            if first + chunk.indices.len() >= u32::MAX as usize {
                return Err(Error::unsupported("the irradiance rows have more than 2^32 - 2 coefficients"));
            }
            all.offsets.extend(chunk.offsets[1..].iter().map(|end| end + first as u32));
            all.indices.append(&mut chunk.indices);
            all.values.append(&mut chunk.values);
            all.steps.append(&mut chunk.steps);
            all.scaling.append(&mut chunk.scaling);
            all.scaling_steps.append(&mut chunk.scaling_steps);
        }
        Rows::new(all)
    }

    fn empty(&self) -> IrradianceRows {
        IrradianceRows {
            side: self.tables.side,
            terms: self.settings.terms,
            offsets: vec![0],
            functions: self.tables.functions.clone(),
            ..IrradianceRows::default()
        }
    }

    /// Rows of some patches, on one thread; they do not depend on how ranges are cut.
    pub fn range(&self, patches: Range<usize>) -> IrradianceRows {
        let (mesh, samples) = (&self.surface.scene.mesh, self.surface.samples);
        let observers: Vec<Observer> = patches.map(|i| Observer::of(mesh, samples.patch(i))).collect();
        let mut rows = self.empty();
        let mut work = Work::new(self.tables.side, self.settings.terms);
        visit(&self.occluders, self.surface.bvh, &observers, self.settings.resolution, |i, visible| {
            self.transform(&observers[i], visible, &mut work);
            work.append(self.settings.coefficients - FACES, &mut rows);
        });
        rows
    }

    /// The Haar coefficients of one point.
    fn transform(&self, observer: &Observer, visible: &Visible, work: &mut Work) {
        let face = self.tables.side * self.tables.side;
        let words = visible.seen.len() / FACES;
        for (index, frame) in FRAMES.iter().enumerate() {
            let bits = &visible.seen[index * words..(index + 1) * words];
            let out = &mut work.coefficients[index * face * self.settings.terms..][..face * self.settings.terms];
            work.lit[index] = bits.iter().any(|word| *word != 0);
            if work.lit[index] {
                let normal = [frame.forward, frame.right, frame.down].map(|axis| observer.normal.dot(axis) as f32);
                transform_face(self.level, &self.tables, normal, bits, &mut work.scratch, out);
            } else {
                out.fill(0.0);
            }
        }
    }
}

multiversion! {
    /// The coefficients of one face: `out` is `[term][row][column]`.
    fn transform_face(tables: &Tables, normal: [f32; 3], bits: &[u64], scratch: &mut [f32], out: &mut [f32])
        => transform_face_body
}

#[inline(always)]
fn transform_face_body(tables: &Tables, normal: [f32; 3], bits: &[u64], scratch: &mut [f32], out: &mut [f32]) {
    const HALF: usize = 32;
    let (side, face) = (tables.side, tables.side * tables.side);
    let words = 2 * side / 64;
    out.fill(0.0);
    for row in 0..2 * side {
        let line = &bits[row * words..(row + 1) * words];
        if line.iter().all(|word| *word == 0) {
            continue;
        }
        let t = (row as f32 + 0.5) / side as f32 - 1.0;
        let base = normal[0] + t * normal[2];
        for parity in 0..2 {
            let inverse = &tables.inverse_length[(2 * row + parity) * side..][..side];
            for (half, &word) in line.iter().enumerate() {
                let mut cosines = [0.0f32; HALF];
                let columns = &tables.columns[parity][half * HALF..(half + 1) * HALF];
                let inverse = &inverse[half * HALF..(half + 1) * HALF];
                for i in 0..HALF {
                    // Hidden sub-texels get the cosine 0, where every function is 0.
                    let bit = (word >> (2 * i + parity) & 1) as u32 as f32;
                    cosines[i] = (base + columns[i] * normal[1]) * inverse[i] * bit;
                }
                for (term, polynomial) in tables.polynomials.iter().take(tables.terms).enumerate() {
                    let target = &mut out[term * face + row / 2 * side + half * HALF..][..HALF];
                    for i in 0..HALF {
                        let mut value = 0.0;
                        for c in polynomial.iter().rev() {
                            value = value * cosines[i] + c;
                        }
                        target[i] += value * cosines[i];
                    }
                }
            }
        }
    }
    for picture in out.chunks_exact_mut(face) {
        picture.iter_mut().zip(&tables.weights).for_each(|(value, weight)| *value *= weight);
        tables.haar.forward(picture, scratch);
    }
}

/// Memory of one thread.
struct Work {
    face: usize,
    terms: usize,
    /// `[face][term][row][column]`.
    coefficients: Vec<f32>,
    lit: [bool; FACES],
    scratch: Vec<f32>,
    /// Sum of the squares over the terms, as bits, which order as the numbers do.
    energies: Vec<u32>,
    bins: Vec<u32>,
    kept: Vec<u16>,
    ties: Vec<(u32, u16)>,
}

/// Bits of an energy that its bin leaves out.
const BIN_SHIFT: u32 = 20;

impl Work {
    fn new(side: usize, terms: usize) -> Self {
        let face = side * side;
        Self {
            face,
            terms,
            coefficients: vec![0.0; FACES * terms * face],
            lit: [false; FACES],
            scratch: vec![0.0; face],
            energies: vec![0; FACES * face],
            bins: vec![0; 1 << (32 - BIN_SHIFT)],
            kept: Vec::new(),
            ties: Vec::new(),
        }
    }

    /// Appends the row with the `count` largest details.
    fn append(&mut self, count: usize, rows: &mut IrradianceRows) {
        self.choose(count);
        let (face, terms) = (self.face, self.terms);
        let value = |index: usize, term: usize| self.coefficients[(index / face * terms + term) * face + index % face];
        let largest = |values: &mut dyn Iterator<Item = f32>| values.fold(0.0f32, |m, v| m.max(v.abs()));
        let step = |largest: f32, levels: f32| {
            let step = largest / levels;
            if step >= f32::MIN_POSITIVE { step } else { 0.0 }
        };
        let quantised = |v: f32, step: f32| if step > 0.0 { (v / step).round_ties_even() } else { 0.0 };
        let all = |term: usize| self.kept.iter().map(move |&i| value(usize::from(i), term));
        let detail = step(largest(&mut (0..terms).flat_map(all)), f32::from(i8::MAX));
        let visible = |i: usize| (0..terms).any(|term| quantised(value(i, term), detail) != 0.0);
        let kept: Vec<u16> = self.kept.iter().copied().filter(|&i| visible(usize::from(i))).collect();
        for term in 0..terms {
            rows.values.extend(kept.iter().map(|&i| quantised(value(usize::from(i), term), detail) as i8));
        }
        rows.indices.extend_from_slice(&kept);
        rows.offsets.push(rows.indices.len() as u32);
        rows.steps.push(detail);
        let first = |k: usize| value(k % FACES * face, k / FACES);
        let scaling = step(largest(&mut (0..terms * FACES).map(first)), f32::from(i16::MAX));
        rows.scaling.extend((0..terms * FACES).map(|k| quantised(first(k), scaling) as i16));
        rows.scaling_steps.push(scaling);
    }

    /// Fills `kept` with the places of the largest details in ascending order; of equal ones the first.
    fn choose(&mut self, count: usize) {
        self.kept.clear();
        self.bins.fill(0);
        for (index, energies) in self.energies.chunks_exact_mut(self.face).enumerate().filter(|(i, _)| self.lit[*i]) {
            let terms = &self.coefficients[index * self.terms * self.face..][..self.terms * self.face];
            for (x, energy) in energies.iter_mut().enumerate() {
                let square = |term: &[f32]| term[x] * term[x];
                *energy = terms.chunks_exact(self.face).map(square).sum::<f32>().to_bits();
            }
            energies[0] = 0;
            energies.iter().for_each(|e| self.bins[(e >> BIN_SHIFT) as usize] += 1);
        }
        // The lowest bin that has room together with all above it; details without energy are never kept.
        let (mut above, mut bin) = (0usize, self.bins.len());
        while bin > 1 && above + (self.bins[bin - 1] as usize) <= count {
            bin -= 1;
            above += self.bins[bin] as usize;
        }
        let lowest = (bin as u32) << BIN_SHIFT;
        let partly = (bin as u32).saturating_sub(1);
        self.ties.clear();
        for index in (0..FACES).filter(|i| self.lit[*i]) {
            let from = index * self.face;
            for (x, &energy) in self.energies[from..from + self.face].iter().enumerate() {
                if bin < self.bins.len() && energy >= lowest {
                    self.kept.push((from + x) as u16);
                } else if energy >> BIN_SHIFT == partly && energy > 0 {
                    self.ties.push((u32::MAX - energy, (from + x) as u16));
                }
            }
        }
        self.ties.sort_unstable();
        self.kept.extend(self.ties.iter().take(count.saturating_sub(above)).map(|(_, i)| *i));
        self.kept.sort_unstable();
    }
}

#[cfg(test)]
mod tests;
