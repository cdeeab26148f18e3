//! The radial kernel R_d, in single precision: the share of the irradiance at one point of the surface that leaves at
//! another, per area, which every stage sums.
//!
//! A medium's kernel is one type, [`medium::MediumKernel`]: three radial profiles in double precision, and a fast form
//! of them, in [`closed_form`] or by a [`radial_table`]. There are two kinds of sources, points and flat triangles, and
//! two ways of summing them: a block of receivers that lie close together against all sources of a list ([`Block`]), or
//! each receiver against sources of its own ([`near`]). Coordinates are relative to the centre of the receivers, so
//! that single precision loses little; sums run in f32 over at most `FLUSH` sources and are then added to f64.
//!
//! A radial kernel knows no more of the two ends of a pair than their places. One with a [`double_layer`] knows the
//! normal of the receiver and flux times normal of the source. One factor a point lies outside of the sums: it is applied
//! to the light before, and to the sums after.

pub mod closed_form;
pub mod double_layer;
pub mod medium;
pub mod near;
pub mod radial_table;

use glam::DVec3;

use crate::math::quadrature::gauss_legendre_const;

/// Sources summed in f32 before the sum is added to its f64 total.
pub(super) const FLUSH: usize = 32;

/// A point where light leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Position relative to the mesh's origin, mm.
    pub at_mm: DVec3,
    /// Unit normal, outward; only a double layer asks for it.
    pub normal: DVec3,
}

/// A point source of flux: one surface sample, or a cluster of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct PointSource {
    /// Position relative to the block's centre, mm.
    pub at: [f32; 3],
    /// Irradiance times area, mm^2 times the unit of irradiance, RGB.
    pub flux: [f32; 3],
}

impl PointSource {
    /// A source at a position relative to the mesh's origin (mm), seen from a block around `centre_mm`.
    pub fn new(at_mm: DVec3, flux: DVec3, centre_mm: DVec3) -> Self {
        Self { at: (at_mm - centre_mm).as_vec3().to_array(), flux: flux.as_vec3().to_array() }
    }
}

/// A flat triangle of uniform irradiance, as a block sees it. Quantities of the triangle alone are computed in double
/// precision, so that single precision loses only a part in 2^24 of the block's own size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlatSource {
    /// Unit normal.
    normal: [f32; 3],
    /// Height of the block's centre over the plane, mm.
    height: f32,
    edges: [Edge; 3],
    /// Irradiance, RGB.
    irradiance: [f32; 3],
}

/// An edge of a triangle, seen from the foot of the block's centre in the triangle's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    /// Unit vector along the edge.
    along: [f32; 3],
    /// Unit vector in the plane, perpendicular to the edge, away from the triangle.
    outward: [f32; 3],
    /// Distance to the edge's line along `outward`, mm.
    pedal: f32,
    /// Coordinate of its first end along `along`, mm.
    start: f32,
    /// Length, mm.
    length: f32,
}

impl FlatSource {
    /// The triangle seen from a block centred at `centre`; `None` if it has no area.
    pub fn new(corners: [DVec3; 3], irradiance: [f32; 3], centre: DVec3) -> Option<Self> {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()?;
        let edge = |index: usize| {
            let (from, to) = (corners[index], corners[(index + 1) % 3]);
            let along = (to - from).try_normalize()?;
            let outward = along.cross(normal);
            Some(Edge {
                along: along.as_vec3().to_array(),
                outward: outward.as_vec3().to_array(),
                pedal: (from - centre).dot(outward) as f32,
                start: (from - centre).dot(along) as f32,
                length: from.distance(to) as f32,
            })
        };
        Some(Self {
            normal: normal.as_vec3().to_array(),
            height: normal.dot(centre - corners[0]) as f32,
            edges: [edge(0)?, edge(1)?, edge(2)?],
            irradiance,
        })
    }

    /// Triangles as the receivers of a row see them, each lane that of its own.
    #[inline(always)]
    fn seen_by_each(beside: &Beside<Self>, [x, y, z]: &[Row; 3]) -> SeenTriangle {
        let mut seen = SeenTriangle::NONE;
        for i in 0..LANES {
            let (source, _) = beside.of(i);
            let n = source.normal;
            let h = source.height + (n[0] * x[i] + n[1] * y[i] + n[2] * z[i]);
            seen.height2[i] = h * h;
            for k in 0..3 {
                let Edge { along: u, outward: o, pedal, start, length } = source.edges[k];
                seen.pedals[k][i] = pedal - (o[0] * x[i] + o[1] * y[i] + o[2] * z[i]);
                seen.starts[k][i] = start - (u[0] * x[i] + u[1] * y[i] + u[2] * z[i]);
                seen.lengths[k][i] = length;
            }
        }
        seen
    }

    /// The triangle as the receivers of a row see it.
    #[inline(always)]
    fn seen_from(&self, [x, y, z]: &[Row; 3]) -> SeenTriangle {
        let n = self.normal;
        let mut seen = SeenTriangle::NONE;
        for i in 0..LANES {
            let h = self.height + (n[0] * x[i] + n[1] * y[i] + n[2] * z[i]);
            seen.height2[i] = h * h;
        }
        for (k, e) in self.edges.iter().enumerate() {
            let (o, u) = (e.outward, e.along);
            for i in 0..LANES {
                seen.pedals[k][i] = e.pedal - (o[0] * x[i] + o[1] * y[i] + o[2] * z[i]);
                seen.starts[k][i] = e.start - (u[0] * x[i] + u[1] * y[i] + u[2] * z[i]);
            }
            seen.lengths[k] = [e.length; LANES];
        }
        seen
    }
}

/// Receivers of a row: one AVX-512 register, two of AVX2, four of SSE or NEON.
pub const LANES: usize = 16;

/// One value for each receiver of a row.
pub(super) type Row = [f32; LANES];

/// A triangle for each receiver of a row, the same or different ones, as the input of its integral.
struct SeenTriangle {
    /// Squared heights of the receivers over the planes, mm^2.
    height2: Row,
    /// For each edge: signed distance of its line from the receiver's foot, coordinate of its start, length, mm.
    pedals: [Row; 3],
    starts: [Row; 3],
    lengths: [Row; 3],
}

impl SeenTriangle {
    const NONE: Self = Self {
        height2: [0.0; LANES],
        pedals: [[0.0; LANES]; 3],
        starts: [[0.0; LANES]; 3],
        lengths: [[0.0; LANES]; 3],
    };

    /// Which of some rules an edge takes: its length is seen against the distance of its nearest point, which is no less than a depth
    /// inside which the kernel is smooth, mm^2. The worst of all receivers decides.
    #[inline(always)]
    fn rule_of_edge(&self, k: usize, smooth2: f32, rules: &'static [EdgeRule]) -> &'static [(f32, f32)] {
        let mut ratios2 = [0.0; LANES];
        for (i, ratio2) in ratios2.iter_mut().enumerate() {
            let (pedal, start, length) = (self.pedals[k][i], self.starts[k][i], self.lengths[k][i]);
            let beside = start.max(-(start + length)).max(0.0);
            *ratio2 = length * length / (self.height2[i] + smooth2 + pedal * pedal + beside * beside);
        }
        edge_rule(rules, ratios2.into_iter().fold(0.0, f32::max).sqrt())
    }
}

/// Accuracy of the integration of triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgePrecision {
    /// Accuracy of sums over everything.
    Reference,
    /// Accuracy of the near field beside a far field that is interpolated.
    Near,
}

/// RGB values of every receiver of a row, in the order that suits a kernel. Inlined into the loops below, once for
/// every instruction set.
pub(super) trait RowValues: Copy {
    /// Zero for every receiver.
    const ZERO: Self;

    /// Adds values times one factor for each channel.
    fn add_scaled(&mut self, factor: [f32; 3], values: &Self);

    /// Adds values times factors of each lane, by channel.
    fn add_products(&mut self, factors: &[Row; 3], values: &Self);

    /// Values of one receiver.
    fn of_lane(&self, lane: usize) -> [f32; 3];

    /// Adds the values to sums in double precision.
    fn flush(&self, sums: &mut [[f64; LANES]; 3]);
}

/// A radial kernel, evaluated for a row of receivers.
pub(super) trait Radial {
    type Values: RowValues;

    /// Adds flux times the kernel at squared distances, mm^2.
    fn add_point(&self, sums: &mut Self::Values, r2: &Row, flux: [f32; 3]);

    /// The same with another flux in each lane, by channel.
    fn add_each(&self, sums: &mut Self::Values, r2: &Row, flux: &[Row; 3]);
}

/// A radial kernel that is integrated over triangles.
trait RadialIntegral {
    type Values: RowValues;

    /// The kernel integrated over each receiver's triangle, at least 0.
    fn triangle(&self, seen: &SeenTriangle, precision: EdgePrecision) -> Self::Values;
}

/// Receivers that are computed side by side, and their sums.
#[derive(Clone, Copy, Debug)]
struct Receivers {
    /// Coordinates relative to the block's centre, mm.
    at: [Row; 3],
    /// Radiosity so far, RGB.
    sums: [[f64; LANES]; 3],
}

/// Receivers of one block and their sums.
#[derive(Clone, Debug, Default)]
pub struct Block {
    rows: Vec<Receivers>,
    /// Normals of the receivers of each row.
    normals: Vec<[Row; 3]>,
    /// How often the receivers stand in their row where they are few, and so how many sources are summed side by side.
    copies: usize,
}

/// Sources that are summed side by side where the receivers of a row are few: each lane has one of its own.
struct Beside<'a, T> {
    sources: &'a [T],
    of_lane: &'a [usize; LANES],
}

impl<'a, T> Beside<'a, T> {
    /// The source of a lane and 1; for lanes without one any other and 0.
    #[inline(always)]
    fn of(&self, lane: usize) -> (&'a T, f32) {
        let index = self.of_lane[lane];
        if index < self.sources.len() { (&self.sources[index], 1.0) } else { (&self.sources[0], 0.0) }
    }
}

/// Which of so many sources beside one another each lane has.
fn of_lanes(copies: usize) -> [usize; LANES] {
    std::array::from_fn(|lane| lane * copies / LANES)
}

impl Block {
    /// A block of `receivers` around `centre`, its sums zero.
    pub fn reset(&mut self, centre: DVec3, receivers: impl Iterator<Item = Receiver>) {
        self.rows.clear();
        self.normals.clear();
        let mut count = 0;
        for (index, receiver) in receivers.enumerate() {
            let lane = index % LANES;
            if lane == 0 {
                self.rows.push(Receivers { at: [[0.0; LANES]; 3], sums: [[0.0; LANES]; 3] });
                self.normals.push([[0.0; LANES]; 3]);
            }
            if let (Some(row), Some(normals)) = (self.rows.last_mut(), self.normals.last_mut()) {
                for axis in 0..3 {
                    row.at[axis][lane] = (receiver.at_mm[axis] - centre[axis]) as f32;
                    normals[axis][lane] = receiver.normal[axis] as f32;
                }
            }
            count = index + 1;
        }
        self.copies = (LANES / count.next_power_of_two()).max(1);
        let width = LANES / self.copies;
        for row in self.rows.iter_mut().map(|row| &mut row.at).chain(&mut self.normals) {
            row.iter_mut().for_each(|values| (width..LANES).for_each(|lane| values[lane] = values[lane % width]));
        }
    }

    /// How many sources stand side by side in a row.
    #[inline(always)]
    fn copies(&self) -> usize {
        self.copies.max(1)
    }

    /// Moves the sums of all receivers, RGB, to `out` and sets them to zero.
    pub fn take(&mut self, out: &mut [[f32; 3]]) {
        let width = LANES / self.copies();
        for (row, out) in self.rows.iter_mut().zip(out.chunks_mut(LANES)) {
            for (lane, out) in out.iter_mut().enumerate() {
                *out = row.sum(lane, width).map(|sum| sum as f32);
            }
            row.sums = [[0.0; LANES]; 3];
        }
    }

    /// RGB sum of one receiver.
    pub fn sum(&self, receiver: usize) -> DVec3 {
        DVec3::from_array(self.rows[receiver / LANES].sum(receiver % LANES, LANES / self.copies()))
    }
}

impl Receivers {
    /// RGB sum of a receiver that stands in every so many lanes.
    fn sum(&self, lane: usize, width: usize) -> [f64; 3] {
        self.sums.map(|channel| channel.iter().skip(lane).step_by(width).sum())
    }
}

/// Squared distances of some points, by axis, from another.
#[inline(always)]
pub(super) fn squares<const N: usize>([x, y, z]: &[[f32; N]; 3], from: [f32; 3]) -> [f32; N] {
    let mut r2 = [0.0; N];
    for i in 0..N {
        let (dx, dy, dz) = (x[i] - from[0], y[i] - from[1], z[i] - from[2]);
        r2[i] = dx * dx + dy * dy + dz * dz;
    }
    r2
}

/// Adds `flux K(|x - at|)` of every source to every receiver of the block.
#[inline(always)]
fn points_body<K: Radial>(block: &mut Block, kernel: &K, sources: &[PointSource]) {
    let copies = block.copies();
    let of_lane = &of_lanes(copies);
    for chunk in sources.chunks(FLUSH) {
        for row in &mut block.rows {
            let mut partial = K::Values::ZERO;
            if copies == 1 {
                for source in chunk {
                    kernel.add_point(&mut partial, &squares(&row.at, source.at), source.flux);
                }
            } else {
                for sources in chunk.chunks(copies) {
                    let beside = Beside { sources, of_lane };
                    let (mut r2, mut flux) = ([0.0; LANES], [[0.0; LANES]; 3]);
                    for i in 0..LANES {
                        let (source, is_one) = beside.of(i);
                        for (axis, flux) in flux.iter_mut().enumerate() {
                            let step = row.at[axis][i] - source.at[axis];
                            r2[i] += step * step;
                            flux[i] = is_one * source.flux[axis];
                        }
                    }
                    kernel.add_each(&mut partial, &r2, &flux);
                }
            }
            partial.flush(&mut row.sums);
        }
    }
}

/// Adds `irradiance Int K(|x - y|) dA(y)` over every flat triangle to every receiver of the block.
#[inline(always)]
fn triangles_body<K: RadialIntegral>(block: &mut Block, kernel: &K, sources: &[FlatSource]) {
    let copies = block.copies();
    let of_lane = &of_lanes(copies);
    for chunk in sources.chunks(FLUSH) {
        for row in &mut block.rows {
            let mut partial = K::Values::ZERO;
            for sources in chunk.chunks(copies) {
                if let ([source], 1) = (sources, copies) {
                    let values = kernel.triangle(&source.seen_from(&row.at), EdgePrecision::Reference);
                    partial.add_scaled(source.irradiance, &values);
                    continue;
                }
                let beside = Beside { sources, of_lane };
                let values = kernel.triangle(&FlatSource::seen_by_each(&beside, &row.at), EdgePrecision::Reference);
                partial.add_products(&irradiances(&beside), &values);
            }
            partial.flush(&mut row.sums);
        }
    }
}

/// Irradiance of the source of each lane, by channel; none in lanes without a source.
#[inline(always)]
fn irradiances(beside: &Beside<FlatSource>) -> [Row; 3] {
    let mut values = [[0.0; LANES]; 3];
    for (c, values) in values.iter_mut().enumerate() {
        for (i, value) in values.iter_mut().enumerate() {
            let (source, is_one) = beside.of(i);
            *value = is_one * source.irradiance[c];
        }
    }
    values
}

/// Nodes and weights of a Gauss-Legendre rule on [-1, 1] in single precision.
const fn rule<const N: usize>() -> [(f32, f32); N] {
    let nodes = gauss_legendre_const::<N>();
    let mut result = [(0.0, 0.0); N];
    let mut i = 0;
    while i < N {
        result[i] = (nodes[i].position as f32, nodes[i].weight as f32);
        i += 1;
    }
    result
}

static GAUSS_3: [(f32, f32); 3] = rule();
static GAUSS_4: [(f32, f32); 4] = rule();
static GAUSS_6: [(f32, f32); 6] = rule();
static GAUSS_8: [(f32, f32); 8] = rule();
static GAUSS_12: [(f32, f32); 12] = rule();
static GAUSS_24: [(f32, f32); 24] = rule();

/// A Gauss-Legendre rule, nodes on [-1, 1] and weights, for edges up to a length over the distance of their nearest point.
pub type EdgeRule = (f32, &'static [(f32, f32)]);

/// The first rule that is long enough, or the last.
#[inline(always)]
fn edge_rule(rules: &'static [EdgeRule], ratio: f32) -> &'static [(f32, f32)] {
    let longest = rules.iter().find(|(limit, _)| ratio <= *limit).or(rules.last());
    longest.map_or(&[], |(_, nodes)| nodes)
}
