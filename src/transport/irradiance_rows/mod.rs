//! Irradiance rows: for every patch, the share of each texel of a cube map in its irradiance.
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

mod blocks;
pub mod row;
pub mod texels;
pub mod vectors;

use std::ops::Range;

use translux_format::rows::IrradianceRows;

use self::row::{Keep, Work};
use self::texels::Grid;
use crate::compress::rows::Rows;
use crate::error::{Error, Result};
use crate::math::cube_map::{FACES, FRAMES, solid_angles_sr};
use crate::math::haar::Haar;
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::entrance_basis::{DEGREE, EntranceBasis, MOST_TERMS};
use crate::progress::{Progress, in_tasks};
use crate::transport::surface::Surface;
use crate::transport::visibility::{GROUP, Observer, Occluders, Resolution, Visible, visit};

/// The resolution, the terms and the number of coefficients of the rows.
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
    /// Default settings; the module has the measured errors.
    pub const DEFAULT: Self = Self { resolution: Resolution::Sub64, terms: 2, coefficients: 128 };

    /// Texels along an edge of a face.
    pub fn side(&self) -> usize {
        self.resolution.side() / 2
    }
}

/// Surface, settings and tables shared by the rows of all patches.
pub struct RowBaker<'a> {
    surface: &'a Surface<'a>,
    settings: RowSettings,
    occluders: Occluders,
    tables: Tables,
    level: InstructionSet,
}

/// Tables of a face.
struct Tables {
    grid: Grid,
    terms: usize,
    /// The square root of the solid angle of each texel.
    weights: Vec<f32>,
    polynomials: Vec<[f32; DEGREE]>,
    /// The polynomials as they are stored, one for each term.
    functions: Vec<[f64; DEGREE]>,
    haar: Haar,
}

impl Tables {
    fn new(settings: RowSettings, basis: &EntranceBasis) -> Result<Self> {
        let side = settings.side();
        let angles = solid_angles_sr(side);
        let haar = Haar::new(side, &angles).ok_or_else(|| Error::runtime("no Haar transform of this size"))?;
        let functions: Vec<[f64; DEGREE]> = basis.polynomials().iter().take(basis.terms()).copied().collect();
        Ok(Self {
            grid: Grid::new(side),
            terms: basis.terms(),
            weights: angles.iter().map(|a| a.sqrt() as f32).collect(),
            polynomials: functions.iter().map(|p| p.map(|c| c as f32)).collect(),
            functions,
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
        let occluders = Occluders::new(surface.domain.mesh);
        Ok(Self { surface, settings, occluders, tables, level: InstructionSet::detect() })
    }

    /// Rows of all patches.
    ///
    /// # Errors
    /// More than 2^32 - 2 coefficients (exit 5).
    pub fn all(&self, progress: &dyn Progress) -> Result<Rows> {
        let size = (self.surface.samples.len(), GROUP);
        let chunks = in_tasks(progress, "irradiance rows", size, |range| self.range(range));
        Rows::new(join(self.empty(), chunks)?, &self.surface.samples.part_offsets)
    }

    fn empty(&self) -> IrradianceRows {
        IrradianceRows {
            side: self.tables.grid.side,
            terms: self.settings.terms,
            offsets: vec![0],
            functions: self.tables.functions.clone(),
            ..IrradianceRows::default()
        }
    }

    /// Rows of some patches, on one thread; they do not depend on how ranges are cut.
    pub fn range(&self, patches: Range<usize>) -> IrradianceRows {
        let (mesh, samples) = (self.surface.domain.mesh, self.surface.samples);
        let observers: Vec<Observer> = patches.map(|i| Observer::of(mesh, samples.patch(i))).collect();
        let mut rows = self.empty();
        let mut work = Work::new(self.tables.grid.side, self.settings.terms);
        visit(&self.occluders, self.surface.bvh, &observers, self.settings.resolution, |i, visible| {
            self.transform(&observers[i], visible, &mut work);
            work.append(Keep::Largest(self.settings.coefficients - FACES), None, &mut rows);
        });
        rows
    }

    /// Computes the Haar coefficients of one point.
    fn transform(&self, observer: &Observer, visible: &Visible, work: &mut Work) {
        let Tables { grid, terms, weights, polynomials, haar, .. } = &self.tables;
        let face = grid.side * grid.side;
        let words = visible.seen.len() / FACES;
        for (index, frame) in FRAMES.iter().enumerate() {
            let bits = &visible.seen[index * words..(index + 1) * words];
            let out = &mut work.coefficients[index * face * terms..][..face * terms];
            work.lit[index] = bits.iter().any(|word| *word != 0);
            if !work.lit[index] {
                out.fill(0.0);
                continue;
            }
            let normal = [frame.forward, frame.right, frame.down].map(|axis| observer.normal.dot(axis) as f32);
            texels::mean_of_texels(self.level, grid, polynomials, normal, bits, out);
            transform_face(self.level, haar, weights, &mut work.scratch, out);
        }
    }
}

/// Appends the rows of all chunks to `all`.
fn join(mut all: IrradianceRows, chunks: Vec<IrradianceRows>) -> Result<IrradianceRows> {
    for mut chunk in chunks {
        let first = all.indices.len();
        if first + chunk.indices.len() >= u32::MAX as usize {
            return Err(Error::unsupported("the rows have more than 2^32 - 2 coefficients"));
        }
        all.offsets.extend(chunk.offsets.iter().skip(1).map(|end| end + first as u32));
        all.indices.append(&mut chunk.indices);
        all.values.append(&mut chunk.values);
        all.steps.append(&mut chunk.steps);
        all.scaling.append(&mut chunk.scaling);
        all.scaling_steps.append(&mut chunk.scaling_steps);
    }
    Ok(all)
}

multiversion! {
    /// Transforms means over texels to coefficients, picture after picture.
    fn transform_face(haar: &Haar, weights: &[f32], scratch: &mut [f32], out: &mut [f32]) => transform_face_body
}

#[inline(always)]
fn transform_face_body(haar: &Haar, weights: &[f32], scratch: &mut [f32], out: &mut [f32]) {
    for picture in out.chunks_exact_mut(weights.len()) {
        picture.iter_mut().zip(weights).for_each(|(value, weight)| *value *= weight);
        haar.forward(picture, scratch);
    }
}

#[cfg(test)]
mod tests;
