//! A radial kernel with a double layer: `A(r) (1 + beta(r) ((x_i - x_o).n_o + (x_o - x_i).n_i))`, A and beta by tables.
//!
//! A source is its flux and its moment, flux times normal; a receiver has a normal. Sums go over the same segments as those of
//! any tabulated profile, with one look-up more for each pair.

use std::sync::Arc;

use glam::DVec3;

use super::radial_table::{LinearTable, ProfileTable, Rgb, WIDEST};
use super::{Block, EdgePrecision, FLUSH, FlatSource, LANES, PointSource, RadialIntegral, Row, RowValues, squares};
use crate::math::simd::{InstructionSet, multiversion};
use crate::medium::profile::Profile;

/// Flux times unit normal of a source, `[axis][channel]`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment(pub(super) [Rgb; 3]);

impl Moment {
    /// The moment of a source, by channel.
    pub fn new(of_channel: [DVec3; 3]) -> Self {
        Self(
            [0, 1, 2]
                .map(|axis| [of_channel[0][axis] as f32, of_channel[1][axis] as f32, of_channel[2][axis] as f32, 0.0]),
        )
    }

    /// The moment of flux through a piece of surface with one normal.
    pub fn of_facet(flux: DVec3, normal: DVec3) -> Self {
        Self::new([0, 1, 2].map(|channel| flux[channel] * normal))
    }
}

/// The layers of a medium: the single one with its tail, and the slope of the double one in the same segments.
#[derive(Clone)]
pub struct DoubleLayer {
    single: ProfileTable,
    /// beta, 1/mm.
    slope: LinearTable,
    /// The double layer itself, A beta, as functions of the distance, 1/mm^3.
    double: [Arc<dyn Profile>; 3],
    varies_mm: f64,
}

impl std::fmt::Debug for DoubleLayer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DoubleLayer").field("single", &self.single).field("slope", &self.slope).finish_non_exhaustive()
    }
}

impl DoubleLayer {
    /// Layers from the single ones, 1/mm^2, with their table, and the double ones, 1/mm^3, which vary on the scale of a length, mm.
    pub(super) fn new(
        single: &[Arc<dyn Profile>; 3],
        table: ProfileTable,
        (double, varies_mm): ([Arc<dyn Profile>; 3], f64),
    ) -> Self {
        let slope = |c: usize, r: f64| double[c].reflectance(r) / single[c].reflectance(r);
        let slope = LinearTable::beside(&table.reflectance, |c, r2| slope(c, r2.sqrt()));
        Self { single: table, slope, double, varies_mm }
    }

    /// Length on whose scale the double layer varies, mm, the least of the channels.
    pub fn varies_mm(&self) -> f64 {
        self.varies_mm
    }

    /// The double layer of each channel as a function of the distance, 1/mm^3; of either sign, without a tail.
    pub fn double(&self) -> &[Arc<dyn Profile>; 3] {
        &self.double
    }

    /// The single layer.
    pub(super) fn single(&self) -> &ProfileTable {
        &self.single
    }

    /// beta, 1/mm, in the segments of the single layer.
    #[cfg(feature = "gpu")]
    pub(super) fn slope(&self) -> &LinearTable {
        &self.slope
    }

    pub(super) fn smooth_mm(&self) -> f64 {
        self.single.smooth_mm
    }

    /// Adds the light of every source to every receiver of the block; as many moments as sources.
    pub fn add_points(&self, level: InstructionSet, block: &mut Block, sources: &[PointSource], moments: &[Moment]) {
        points(level, block, self, sources, moments);
    }

    /// Adds the light of flat triangles of even irradiance: the single layer integrated, the heights those of the centroid,
    /// since they vanish with the distance.
    pub fn add_triangles(&self, level: InstructionSet, block: &mut Block, sources: &[FlatSource]) {
        triangles(level, block, self, sources);
    }

    /// `1 + beta heights` for each receiver, without the double layer of the flux: the factor of the single layer.
    #[inline(always)]
    fn factors(&self, r2: &Row, heights: &Row) -> [Rgb; LANES] {
        let places = self.slope.places(r2);
        let mut factors = [[1.0; 4]; LANES];
        for i in 0..LANES {
            let slope = self.slope.value(&places, i);
            for c in 0..4 {
                factors[i][c] += slope[c] * heights[i];
            }
        }
        factors
    }
}

/// Heights of a point over the tangent planes of the receivers of a row, mm.
#[inline(always)]
fn heights_over(at: &[Row; 3], normals: &[Row; 3], point: [f32; 3]) -> Row {
    let mut heights = [0.0; LANES];
    for i in 0..LANES {
        heights[i] = (point[0] - at[0][i]) * normals[0][i]
            + (point[1] - at[1][i]) * normals[1][i]
            + (point[2] - at[2][i]) * normals[2][i];
    }
    heights
}

#[inline(always)]
fn points_body(block: &mut Block, layers: &DoubleLayer, sources: &[PointSource], moments: &[Moment]) {
    for (chunk, moments) in sources.chunks(FLUSH).zip(moments.chunks(FLUSH)) {
        for (row, normals) in block.rows.iter_mut().zip(&block.normals) {
            let mut partial = [[0.0f32; 4]; LANES];
            for (source, Moment(moment)) in chunk.iter().zip(moments) {
                let r2 = squares(&row.at, source.at);
                let heights = heights_over(&row.at, normals, source.at);
                let flux = [source.flux[0], source.flux[1], source.flux[2], 0.0];
                let places = layers.slope.places(&r2);
                for i in 0..LANES {
                    let (single, slope) = (layers.single.reflectance.value(&places, i), layers.slope.value(&places, i));
                    let way = [source.at[0] - row.at[0][i], source.at[1] - row.at[1][i], source.at[2] - row.at[2][i]];
                    for c in 0..4 {
                        let under = moment[0][c] * way[0] + moment[1][c] * way[1] + moment[2][c] * way[2];
                        partial[i][c] += single[c] * (flux[c] + slope[c] * (flux[c] * heights[i] - under));
                    }
                }
            }
            partial.flush(&mut row.sums);
        }
    }
}

#[inline(always)]
fn triangles_body(block: &mut Block, layers: &DoubleLayer, sources: &[FlatSource]) {
    for chunk in sources.chunks(FLUSH) {
        for (row, normals) in block.rows.iter_mut().zip(&block.normals) {
            let mut partial = [[0.0f32; 4]; LANES];
            for source in chunk {
                let values = layers.single.triangle(&source.seen_from(&row.at), EdgePrecision::Reference);
                let r2 = squares(&row.at, source.centroid);
                let mut heights = heights_over(&row.at, normals, source.centroid);
                for axis in 0..3 {
                    let (centroid, normal) = (source.centroid[axis], source.normal[axis]);
                    for (height, at) in heights.iter_mut().zip(&row.at[axis]) {
                        *height -= (centroid - at) * normal;
                    }
                }
                let factors = layers.factors(&r2, &heights);
                for i in 0..LANES {
                    for c in 0..3 {
                        partial[i][c] += source.irradiance[c] * (values[i][c] * factors[i][c]);
                    }
                }
            }
            partial.flush(&mut row.sums);
        }
    }
}

multiversion! {
    fn points(block: &mut Block, layers: &DoubleLayer, sources: &[PointSource], moments: &[Moment]) => points_body, up to WIDEST;
    fn triangles(block: &mut Block, layers: &DoubleLayer, sources: &[FlatSource]) => triangles_body, up to WIDEST;
}
