//! A radial kernel with a double layer: `A(r) (1 + beta(r) ((x_i - x_o).n_o + (x_o - x_i).n_i))`, A and beta by tables.
//!
//! A source is its flux and its moment, flux times normal; a receiver has a normal. Sums go over the same segments as those of
//! any tabulated profile, with one look-up more for each pair.

use std::sync::Arc;

use glam::DVec3;

use super::radial_table::{LinearTable, ProfileTable, Rgb, SeenEdge, WIDEST, WithTail, at_least_zero};
use super::{
    Beside, Block, FLUSH, FlatSource, LANES, PointSource, Row, RowValues, SeenTriangle, irradiances, of_lanes,
};
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

/// The layers of a medium: the single one with its tail, and the double one in the same segments.
#[derive(Clone)]
pub struct DoubleLayer {
    single: ProfileTable,
    /// beta, 1/mm.
    slope: LinearTable,
    /// The double layer, 1/mm^3, and `Int_r^inf A beta s ds`, 1/mm.
    values: LinearTable,
    tail: LinearTable,
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
        let of = |c: usize, r2: f64| double[c].reflectance(r2.sqrt());
        let values = LinearTable::beside(&table.reflectance, of);
        let tail = LinearTable::tail_beside(&table.reflectance, of);
        let slope = LinearTable::beside(&table.reflectance, |c, r2| slope(c, r2.sqrt()));
        Self { single: table, slope, values, tail, double, varies_mm }
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

    /// beta, 1/mm, the double layer, 1/mm^3, and its tail, 1/mm, in the segments of the single one.
    #[cfg(feature = "gpu")]
    pub(super) fn tables(&self) -> [&LinearTable; 3] {
        [&self.slope, &self.values, &self.tail]
    }

    pub(super) fn smooth_mm(&self) -> f64 {
        self.single.smooth_mm
    }

    /// Adds the light of every source to every receiver of the block; as many moments as sources.
    pub fn add_points(&self, level: InstructionSet, block: &mut Block, sources: &[PointSource], moments: &[Moment]) {
        points(level, block, self, sources, moments);
    }

    /// Adds the light of flat triangles of even irradiance, both layers integrated.
    pub fn add_triangles(&self, level: InstructionSet, block: &mut Block, sources: &[FlatSource]) {
        triangles(level, block, self, sources);
    }

    /// Adds the light of a point in each lane, with its moment and a factor.
    #[inline(always)]
    fn add_point<'a>(
        &self,
        partial: &mut [Rgb; LANES],
        seen: &SeenPoint,
        of: impl Fn(usize) -> (&'a PointSource, &'a Moment, f32),
    ) {
        let places = self.slope.places(&seen.r2);
        for (i, partial) in partial.iter_mut().enumerate() {
            let (source, Moment(moment), factor) = of(i);
            let (single, slope) = (self.single.reflectance.value(&places, i), self.slope.value(&places, i));
            let flux = [source.flux[0], source.flux[1], source.flux[2], 0.0];
            let way = [seen.ways[0][i], seen.ways[1][i], seen.ways[2][i]];
            for c in 0..4 {
                let under = moment[0][c] * way[0] + moment[1][c] * way[1] + moment[2][c] * way[2];
                partial[c] += factor * single[c] * (flux[c] + slope[c] * (flux[c] * seen.heights[i] - under));
            }
        }
    }

    /// The double layer with its tail.
    #[inline(always)]
    fn with_tail(&self) -> WithTail<'_> {
        WithTail { value: &self.values, tail: &self.tail }
    }

    /// Both layers integrated over a triangle. With D the double one, h the height of a receiver over the plane and y the point of the
    /// plane seen from the receiver's foot, `(x_i - x_o).n_o + (x_o - x_i).n_i = h (1 - n_o.n_i) + n_o.y`, and `Int D y dA` is minus the
    /// contour integral of D's tail times the outward normal, because `D y` is minus the gradient of that tail.
    #[inline(always)]
    fn triangle(&self, seen: &SeenTriangle, facing: &Facing) -> [Rgb; LANES] {
        let (single, double) = (self.single.with_tail(), self.with_tail());
        let foot = single.value.places(&seen.height2);
        let (mut singles, mut doubles, mut around) = ([[0.0; 4]; LANES], [[0.0; 4]; LANES], [[0.0; 4]; LANES]);
        for k in 0..3 {
            let edge = SeenEdge::new(seen, k, self.single.smooth2());
            for &at in self.single.rule(seen, k) {
                let node = edge.node(at, single.value);
                for i in 0..LANES {
                    let (a, b) = (
                        single.half_mean(&foot, &node, &seen.height2, i),
                        double.half_mean(&foot, &node, &seen.height2, i),
                    );
                    let tail = double.tail.value(&node.far, i);
                    let weight = node.length[i] * seen.pedals[k][i];
                    let outwards = node.length[i] * facing.outward[k][i];
                    for c in 0..4 {
                        singles[i][c] += weight * a[c];
                        doubles[i][c] += weight * b[c];
                        around[i][c] += outwards * tail[c];
                    }
                }
            }
        }
        at_least_zero(&mut singles);
        for i in 0..LANES {
            for c in 0..4 {
                singles[i][c] += facing.height[i] * doubles[i][c] - around[i][c];
            }
        }
        singles
    }
}

/// How the receivers of a row face a triangle.
struct Facing {
    /// Height over the plane, mm, times one less the cosine between the normals.
    height: Row,
    /// Cosine between the receiver's normal and the outward normal of each edge in the plane.
    outward: [Row; 3],
}

impl Facing {
    #[inline(always)]
    fn new(beside: &Beside<FlatSource>, [x, y, z]: &[Row; 3], normals: &[Row; 3]) -> Self {
        let mut facing = Self { height: [0.0; LANES], outward: [[0.0; LANES]; 3] };
        for i in 0..LANES {
            let (source, _) = beside.of(i);
            let n = source.normal;
            let height = source.height + (n[0] * x[i] + n[1] * y[i] + n[2] * z[i]);
            let cosine = n[0] * normals[0][i] + n[1] * normals[1][i] + n[2] * normals[2][i];
            facing.height[i] = height * (1.0 - cosine);
            for (outward, edge) in facing.outward.iter_mut().zip(&source.edges) {
                let o = edge.outward;
                outward[i] = o[0] * normals[0][i] + o[1] * normals[1][i] + o[2] * normals[2][i];
            }
        }
        facing
    }
}

/// A point for each receiver of a row.
struct SeenPoint {
    /// From the receiver to the point, by axis, its square and its height over the receiver's tangent plane, mm.
    ways: [Row; 3],
    r2: Row,
    heights: Row,
}

impl SeenPoint {
    #[inline(always)]
    fn new<'a>(at: &[Row; 3], normals: &[Row; 3], source: impl Fn(usize) -> &'a PointSource) -> Self {
        let mut seen = Self { ways: [[0.0; LANES]; 3], r2: [0.0; LANES], heights: [0.0; LANES] };
        for i in 0..LANES {
            let point = source(i).at;
            for axis in 0..3 {
                let way = point[axis] - at[axis][i];
                seen.ways[axis][i] = way;
                seen.r2[i] += way * way;
                seen.heights[i] += way * normals[axis][i];
            }
        }
        seen
    }
}

#[inline(always)]
fn points_body(block: &mut Block, layers: &DoubleLayer, sources: &[PointSource], moments: &[Moment]) {
    let copies = block.copies();
    let of_lane = &of_lanes(copies);
    for (chunk, moments) in sources.chunks(FLUSH).zip(moments.chunks(FLUSH)) {
        for (row, normals) in block.rows.iter_mut().zip(&block.normals) {
            let mut partial = [[0.0f32; 4]; LANES];
            for (sources, moments) in chunk.chunks(copies).zip(moments.chunks(copies)) {
                if let ([source], [moment], 1) = (sources, moments, copies) {
                    let seen = SeenPoint::new(&row.at, normals, |_| source);
                    layers.add_point(&mut partial, &seen, |_| (source, moment, 1.0));
                    continue;
                }
                let (sources, moments) = (Beside { sources, of_lane }, Beside { sources: moments, of_lane });
                let seen = SeenPoint::new(&row.at, normals, |i| sources.of(i).0);
                layers.add_point(&mut partial, &seen, |i| (sources.of(i).0, moments.of(i).0, sources.of(i).1));
            }
            partial.flush(&mut row.sums);
        }
    }
}

#[inline(always)]
fn triangles_body(block: &mut Block, layers: &DoubleLayer, sources: &[FlatSource]) {
    let copies = block.copies();
    let of_lane = &of_lanes(copies);
    for chunk in sources.chunks(FLUSH) {
        for (row, normals) in block.rows.iter_mut().zip(&block.normals) {
            let mut partial = [[0.0f32; 4]; LANES];
            for sources in chunk.chunks(copies) {
                let beside = Beside { sources, of_lane };
                let seen = FlatSource::seen_by_each(&beside, &row.at);
                let values = layers.triangle(&seen, &Facing::new(&beside, &row.at, normals));
                partial.add_products(&irradiances(&beside), &values);
            }
            partial.flush(&mut row.sums);
        }
    }
}

multiversion! {
    fn points(block: &mut Block, layers: &DoubleLayer, sources: &[PointSource], moments: &[Moment]) => points_body, up to WIDEST;
    fn triangles(block: &mut Block, layers: &DoubleLayer, sources: &[FlatSource]) => triangles_body, up to WIDEST;
}
