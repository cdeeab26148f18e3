//! Multilevel summation of a radial kernel over a surface (Brandt and Lubrecht 1990; Hardy, Stone and Schulten 2009), on nested
//! nets of surface points in place of grids.
//!
//! A kernel softened inside a radius is smooth enough to be interpolated, at the source as at the receiver, from points a
//! fraction of that radius apart. So a kernel is a compact part, summed sample by sample, and a sum of differences of softened
//! kernels of twice the radius each, summed from point to point of nets of twice the spacing each, until few points are
//! left. Weights and lists follow from the geometry alone: any kernel, so any medium, can be summed at once.

mod compact;
mod double;
mod near;
mod surface;

use glam::DVec3;

pub use self::surface::{Quality, SurfaceNets, SurfaceTables};
#[cfg(feature = "gpu")]
pub(crate) use self::{
    compact::Compact,
    double::{Double, FIELDS},
    surface::Part as NetsOfPart,
};
use super::close_pairs::ClosePairs;
use super::interpolation::{Adjoint, SharedWeights};
use super::kernel::radial_table::{Rgb, SmoothTable, WIDEST};
use super::kernel::{FLUSH, LANES, Radial, squares};
use crate::geometry::cluster::{self, Run};
use crate::geometry::scattered::{Kriging, OrientedPoint, Weights, choose_from};
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::math::slices::cut;
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;
use crate::parallel::*;

/// Resolution of a kernel by nets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Resolution {
    /// Spacing of the finest net, mm.
    pub spacing_mm: f64,
    /// Radius inside which a level is softened, in spacings of its net.
    pub softening: f64,
}

impl Resolution {
    /// Radius inside which the kernel is summed sample by sample, mm.
    pub(super) fn near_mm(self) -> f64 {
        self.softening * self.spacing_mm
    }
}

/// Nets are coarsened until one has no more points than this, if any does.
const FEW: usize = 600;

/// Points of a group at most.
const GROUP: usize = 16;

/// A surface's nets, finest first.
pub(crate) struct Multilevel {
    pub(super) resolution: Resolution,
    pub(crate) levels: Vec<Net>,
    pub(crate) from_samples: Adjoint,
    pub(crate) to_receivers: SharedWeights,
}

/// Points of one spacing.
pub(crate) struct Net {
    /// Points, group after group.
    points: Vec<OrientedPoint>,
    pub(crate) at: Vec<[f32; 3]>,
    pub(crate) groups: Vec<Run>,
    /// Points within reach of those of each group.
    pub(crate) around: ClosePairs,
    /// Weights from this net to the next coarser, and back.
    pub(crate) up: Adjoint,
    pub(crate) down: SharedWeights,
}

/// Tables of one medium for every level.
pub(crate) struct Tables {
    pub(crate) levels: Vec<NetKernel>,
}

impl Multilevel {
    /// Nets among the samples, given by centroid and normal, and the receivers, which are on the same surface.
    pub(super) fn new(samples: &[OrientedPoint], receivers: &[OrientedPoint], resolution: Resolution) -> Self {
        // Corners first: between them lie the samples, but not they between those.
        let points: Vec<OrientedPoint> = receivers.iter().chain(samples).copied().collect();
        let nested = choose_from(&points, receivers.len(), resolution.spacing_mm);
        // Coarsest first; every net holds those before it.
        let mut chosen: Vec<u32> = Vec::new();
        let mut nets: Vec<Vec<OrientedPoint>> = Vec::new();
        for level in &nested {
            chosen.extend(level);
            if chosen.len() > FEW || nets.is_empty() {
                nets.push(chosen.iter().map(|&i| points[i as usize]).collect());
            } else {
                nets[0] = chosen.iter().map(|&i| points[i as usize]).collect();
            }
        }
        nets.reverse();
        let mut levels: Vec<Net> = nets.into_iter().map(Net::new).collect();
        for level in 1..levels.len() {
            let spacing = resolution.spacing_mm * 2f64.powi(level as i32);
            let weights = Weights::new(&levels[level].points, &levels[level - 1].points, spacing, Kriging::SMOOTH);
            levels[level - 1].up = Adjoint::new(&weights, levels[level].points.len());
            levels[level - 1].down = SharedWeights::new(&weights);
        }
        let finest: &[OrientedPoint] = levels.first().map_or(&[], |net| &net.points);
        let spacing = resolution.spacing_mm;
        let (from, to) = rayon::join(
            || Weights::new(finest, samples, spacing, Kriging::SMOOTH),
            || Weights::new(finest, receivers, spacing, Kriging::SMOOTH),
        );
        let from_samples = Adjoint::new(&from, finest.len());
        let mut result = Self { resolution, to_receivers: SharedWeights::new(&to), from_samples, levels };
        result.soften(resolution.softening);
        result
    }

    /// Softens kernels inside so many spacings.
    pub(super) fn soften(&mut self, softening: f64) {
        self.resolution.softening = softening;
        let (near, last) = (self.resolution.near_mm(), self.levels.len().saturating_sub(1));
        for (level, net) in self.levels.iter_mut().enumerate() {
            net.reach(if level < last { 2.0 * near * 2f64.powi(level as i32) } else { f64::INFINITY });
        }
    }

    /// Bytes in memory.
    pub(super) fn bytes(&self) -> usize {
        let net = |net: &Net| {
            size_of_val(net.points.as_slice())
                + size_of_val(net.at.as_slice())
                + size_of_val(net.groups.as_slice())
                + net.around.bytes()
                + net.up.bytes()
                + net.down.bytes()
        };
        self.levels.iter().map(net).sum::<usize>() + self.from_samples.bytes() + self.to_receivers.bytes()
    }

    /// Tables of three profiles.
    pub(super) fn tables(&self, profiles: &[&dyn Profile; 3], extent_mm: f64) -> Tables {
        let count = self.levels.len();
        let level = |level: usize| {
            let radius = self.resolution.near_mm() * 2f64.powi(level as i32);
            NetKernel::new(profiles, radius, (level + 1 < count).then_some(2.0 * radius), extent_mm)
        };
        Tables { levels: (0..count).into_par_iter().map(level).collect() }
    }

    /// The softened kernel summed over all samples at every receiver, from the flux of every sample, RGB.
    pub(super) fn sum(&self, tables: &Tables, flux: &[[f32; 4]], out: &mut Vec<[f32; 4]>) {
        let mut charges: Vec<Vec<[f32; 4]>> = Vec::with_capacity(self.levels.len());
        for level in 0..self.levels.len() {
            let next = match level {
                0 => self.from_samples.apply(flux),
                _ => self.levels[level - 1].up.apply(&charges[level - 1]),
            };
            charges.push(next);
        }
        let mut potential: Vec<[f32; 4]> = Vec::new();
        for (level, net) in self.levels.iter().enumerate().rev() {
            let mut own = Vec::new();
            if level + 1 < self.levels.len() {
                net.down.apply_signed(&potential, &mut own);
            } else {
                own.resize(net.points.len(), [0.0; 4]);
            }
            if let Some(table) = tables.levels.get(level).filter(|table| !table.is_nothing()) {
                net.add(table, &charges[level], &mut own);
            }
            potential = own;
        }
        self.to_receivers.apply_signed(&potential, out);
    }
}

impl Net {
    fn new(points: Vec<OrientedPoint>) -> Self {
        let positions: Vec<DVec3> = points.iter().map(|p| p.at_mm).collect();
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let groups = cluster::groups(&mut order, &positions, GROUP);
        let points: Vec<OrientedPoint> = order.iter().map(|&i| points[i as usize]).collect();
        let at = points.iter().map(|p| p.at_mm.as_vec3().to_array()).collect();
        let (around, up, down) = (ClosePairs::default(), Adjoint::default(), SharedWeights::default());
        Self { points, at, groups, around, up, down }
    }

    /// Lists the points within a distance.
    fn reach(&mut self, reach_mm: f64) {
        let positions: Vec<DVec3> = self.points.iter().map(|p| p.at_mm).collect();
        self.around = ClosePairs::new(&positions, |_| reach_mm, &positions, &self.groups);
    }

    fn add(&self, table: &NetKernel, charges: &[[f32; 4]], out: &mut [[f32; 4]]) {
        let level = InstructionSet::detect();
        let jobs = self.groups.par_iter().zip(cut(out, self.groups.iter().map(|run| run.range().len())));
        jobs.enumerate().with_min_len(8).for_each(|(g, (run, out))| {
            let mut block = PointBlock::new(&self.at[run.range()]);
            add_smooth(level, &mut block, &table.table, self.around.of(g), (&self.at, charges));
            block.add_to(out);
        });
    }
}

/// A kernel whose integral over the whole reach is at most this share of the profile's total is negligible.
const NOTHING: f64 = 1e-7;

/// The kernel between the points of a net.
#[derive(Clone, Debug)]
pub(crate) struct NetKernel {
    pub(crate) table: SmoothTable,
    nothing: bool,
}

impl NetKernel {
    /// The kernel of three profiles softened inside `radius_mm`, less the same inside `less_mm`; without `less_mm`, all
    /// of it up to the extent.
    fn new(profiles: &[&dyn Profile; 3], radius_mm: f64, less_mm: Option<f64>, extent_mm: f64) -> Self {
        let reach = less_mm.unwrap_or(1.001 * extent_mm).max(f64::MIN_POSITIVE);
        let softened = profiles
            .map(|profile| (Softened::new(profile, radius_mm), less_mm.map(|radius| Softened::new(profile, radius))));
        let value = |c: usize, r2: f64| {
            let (soft, less) = &softened[c];
            let at = |softened: &Softened| softened.reflectance_at_square(profiles[c], r2);
            at(soft) - less.as_ref().map_or(0.0, at)
        };
        let area = std::f64::consts::PI * reach * reach;
        let is_nothing = |(c, profile): (usize, &&dyn Profile)| value(c, 0.0).abs() * area <= NOTHING * profile.total();
        let nothing = profiles.iter().enumerate().all(is_nothing);
        // Without a second radius there is more than one scale.
        let scale = if less_mm.is_some() { reach } else { radius_mm };
        Self { table: SmoothTable::new(scale, reach, value), nothing }
    }

    /// True if the kernel is negligible everywhere.
    pub(crate) fn is_nothing(&self) -> bool {
        self.nothing
    }
}

/// Points that are summed side by side.
struct PointBlock {
    at: [[f32; LANES]; 3],
    sums: [Rgb; LANES],
}

impl PointBlock {
    /// A block of at most [`LANES`] points.
    fn new(points: &[[f32; 3]]) -> Self {
        let mut at = [[0.0; LANES]; 3];
        for (lane, point) in points.iter().take(LANES).enumerate() {
            (0..3).for_each(|axis| at[axis][lane] = point[axis]);
        }
        Self { at, sums: [[0.0; 4]; LANES] }
    }

    /// Adds the block's sums to `out`.
    fn add_to(&self, out: &mut [Rgb]) {
        for (out, sum) in out.iter_mut().zip(&self.sums) {
            add_scaled(out, 1.0, sum);
        }
    }
}

#[inline(always)]
fn smooth_body(block: &mut PointBlock, table: &SmoothTable, sources: &[u32], (at, charges): (&[[f32; 3]], &[Rgb])) {
    for chunk in sources.chunks(FLUSH) {
        let mut partial = [[0.0f32; 4]; LANES];
        for &source in chunk {
            let (Some(at), Some(&[red, green, blue, _])) = (at.get(source as usize), charges.get(source as usize))
            else {
                continue;
            };
            table.add_point(&mut partial, &squares(&block.at, *at), [red, green, blue]);
        }
        for (sum, partial) in block.sums.iter_mut().zip(&partial) {
            add_scaled(sum, 1.0, partial);
        }
    }
}

multiversion! {
    /// Adds `charge K(|x - at|)` of the sources, indices among positions (mm) and charges, to every point of a block.
    fn add_smooth(
        block: &mut PointBlock,
        table: &SmoothTable,
        sources: &[u32],
        values: (&[[f32; 3]], &[Rgb]),
    ) => smooth_body, up to WIDEST
}

#[cfg(test)]
mod tests;
