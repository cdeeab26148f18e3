//! Double layers over nets: kernels that vary slowly from the first, times the heights of points over each other's tangent
//! planes.
//!
//! `Sum K(r) ((x_i - x_o).n_o + (x_o - x_i).n_i) q_i` is `U(x_o) + n_o.V(x_o)` with `U = Sum K (x_o - x_i).m_i`,
//! `V = Sum K (x_i - x_o) q_i` and the moments `m = q n`: sums of four fields over the nets of the layer, which have no
//! compact part and a spacing of their own, that of the kernel.

use std::sync::Arc;

use glam::DVec3;

use super::{Multilevel, Net, NetKernel, Resolution};
use crate::math::simd::{InstructionSet, add_scaled, multiversion};
use crate::math::slices::cut;
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;
use crate::parallel::*;
use crate::transport::kernel::radial_table::{Rgb, SmoothTable, WIDEST};
use crate::transport::kernel::{FLUSH, LANES, squares};

/// Fields: flux and its moments as charges, U and V as potentials.
pub(crate) const FIELDS: usize = 4;

/// The fields of some points.
type Fields = [Vec<Rgb>; FIELDS];

/// Softening of double layers over that of single ones: they rise and fall inside it.
const SOFTENING: f64 = 1.2;

/// Radius that the finest net resolves, over the length on whose scale a double layer varies.
const RESOLVED: f64 = 1.2;

/// Spacing of the finest net at least, over that of single layers.
const FINEST: f64 = 0.5;

/// Spacings of the finest net at least in the length on whose scale a layer varies that it resolves.
const RESOLVING: f64 = 1.5;

/// The nets of a double layer, and its kernel on each.
pub(crate) struct Double {
    pub(crate) nets: Arc<Multilevel>,
    pub(crate) levels: Vec<NetKernel>,
}

impl Double {
    /// True if nets half as far apart as those of a resolution resolve a layer that varies on the scale of a length, mm.
    pub(super) fn is_resolved(varies_mm: f64, finest: Resolution) -> bool {
        varies_mm >= RESOLVING * FINEST * finest.spacing_mm
    }

    /// The resolution of nets for a layer that varies on the scale of a length (mm): half as far apart as those of `finest` at least,
    /// whose softening says how accurate they are.
    pub(super) fn resolution(varies_mm: f64, finest: Resolution) -> Resolution {
        let softening = SOFTENING * finest.softening;
        Resolution { spacing_mm: (RESOLVED * varies_mm / softening).max(FINEST * finest.spacing_mm), softening }
    }

    /// A layer that varies on the scale of a length (mm) on nets of its [`Self::resolution`], whose points are at most an extent apart.
    pub(super) fn new(
        nets: Arc<Multilevel>,
        (layer, varies_mm): (&[Arc<dyn Profile>; 3], f64),
        extent_mm: f64,
    ) -> Self {
        let near = nets.resolution.near_mm();
        let count = nets.levels.len();
        let kernel = |level: usize| {
            // The finest net has the layer as it is.
            let radius = if level == 0 { 0.0 } else { near * 2f64.powi(level as i32) };
            let less = (level + 1 < count).then(|| near * 2f64.powi(level as i32 + 1));
            let soft = layer.each_ref().map(|p| Softened::new(p.as_ref(), radius));
            let softer = less.map(|less| layer.each_ref().map(|p| Softened::new(p.as_ref(), less)));
            let reach = less.unwrap_or(1.001 * extent_mm).max(f64::MIN_POSITIVE);
            let value = |c: usize, r2: f64| {
                let at = |softened: &Softened| softened.reflectance_at_square(layer[c].as_ref(), r2);
                at(&soft[c]) - softer.as_ref().map_or(0.0, |softer| at(&softer[c]))
            };
            let scale = radius.max(varies_mm).min(reach);
            NetKernel { table: SmoothTable::new(scale, reach, value), nothing: false }
        };
        let levels = (0..count).into_par_iter().map(kernel).collect();
        Self { nets, levels }
    }

    /// Adds the layer to the sums at receivers with unit normals, from the flux of every sample and its normal.
    pub(super) fn add(&self, (flux, normals): (&[Rgb], &[[f32; 3]]), receivers: &[DVec3], out: &mut [Rgb]) {
        let moment = |axis: usize| {
            let of = |(flux, normal): (&Rgb, &[f32; 3])| flux.map(|value| value * normal[axis]);
            flux.iter().zip(normals).map(of).collect::<Vec<Rgb>>()
        };
        let own = [flux.to_vec(), moment(0), moment(1), moment(2)];
        let mut charges: Vec<Fields> = Vec::with_capacity(self.nets.levels.len());
        for level in 0..self.nets.levels.len() {
            charges.push(match level {
                0 => own.each_ref().map(|field| self.nets.from_samples.apply(field)),
                _ => charges[level - 1].each_ref().map(|field| self.nets.levels[level - 1].up.apply(field)),
            });
        }
        let mut potentials = Fields::default();
        for (level, (net, kernel)) in self.nets.levels.iter().zip(&self.levels).enumerate().rev() {
            let mut own = Fields::default();
            for (own, coarser) in own.iter_mut().zip(&potentials) {
                match level + 1 < self.nets.levels.len() {
                    true => net.down.apply_signed(coarser, own),
                    false => own.resize(net.points.len(), [0.0; 4]),
                }
            }
            net.add_double(&kernel.table, &charges[level], &mut own);
            potentials = own;
        }
        let mut at_receivers = Fields::default();
        for (at_receivers, field) in at_receivers.iter_mut().zip(&potentials) {
            self.nets.to_receivers.apply_signed(field, at_receivers);
        }
        let [under, over @ ..] = &at_receivers;
        for (i, (out, normal)) in out.iter_mut().zip(receivers).enumerate() {
            let normal = normal.as_vec3().to_array();
            for c in 0..3 {
                let over: f32 = over.iter().zip(normal).map(|(field, n)| n * field[i][c]).sum();
                out[c] += under[i][c] + over;
            }
        }
    }
}

impl Net {
    fn add_double(&self, table: &SmoothTable, charges: &Fields, out: &mut Fields) {
        let level = InstructionSet::detect();
        let lengths = || self.groups.iter().map(|run| run.range().len());
        let [under, x, y, z] = out;
        let jobs = self.groups.par_iter().zip(cut(under, lengths())).zip(cut(x, lengths()));
        let jobs = jobs.zip(cut(y, lengths())).zip(cut(z, lengths()));
        jobs.enumerate().with_min_len(8).for_each(|(g, ((((run, under), x), y), z))| {
            let mut block = Heights::new(&self.at[run.range()]);
            add_heights(level, &mut block, table, self.around.of(g), (&self.at, charges));
            for (field, out) in [under, x, y, z].into_iter().enumerate() {
                out.iter_mut().zip(&block.sums).for_each(|(out, sums)| add_scaled(out, 1.0, &sums[field]));
            }
        });
    }
}

/// Points that are summed side by side, with the sums of each field.
struct Heights {
    at: [[f32; LANES]; 3],
    sums: [[Rgb; FIELDS]; LANES],
}

impl Heights {
    /// A block of at most [`LANES`] points.
    fn new(points: &[[f32; 3]]) -> Self {
        let mut at = [[0.0; LANES]; 3];
        for (lane, point) in points.iter().take(LANES).enumerate() {
            (0..3).for_each(|axis| at[axis][lane] = point[axis]);
        }
        Self { at, sums: [[[0.0; 4]; FIELDS]; LANES] }
    }
}

#[inline(always)]
fn heights_body(block: &mut Heights, table: &SmoothTable, sources: &[u32], (at, charges): (&[[f32; 3]], &Fields)) {
    let [flux, x, y, z] = charges;
    for chunk in sources.chunks(FLUSH) {
        let mut partial = [[[0.0f32; 4]; FIELDS]; LANES];
        for &source in chunk {
            let source = source as usize;
            let (Some(&at), Some(flux), Some(x), Some(y), Some(z)) =
                (at.get(source), flux.get(source), x.get(source), y.get(source), z.get(source))
            else {
                continue;
            };
            let places = table.places(&squares(&block.at, at));
            for (i, sums) in partial.iter_mut().enumerate() {
                let kernel = table.value(&places, i);
                let way = [at[0] - block.at[0][i], at[1] - block.at[1][i], at[2] - block.at[2][i]];
                for c in 0..4 {
                    let own = kernel[c] * flux[c];
                    sums[0][c] -= kernel[c] * (x[c] * way[0] + y[c] * way[1] + z[c] * way[2]);
                    sums[1][c] += own * way[0];
                    sums[2][c] += own * way[1];
                    sums[3][c] += own * way[2];
                }
            }
        }
        for (sums, partial) in block.sums.iter_mut().zip(&partial) {
            sums.iter_mut().zip(partial).for_each(|(sum, partial)| add_scaled(sum, 1.0, partial));
        }
    }
}

multiversion! {
    /// Adds the fields of the sources, indices among positions (mm) and charges, to every point of a block.
    fn add_heights(
        block: &mut Heights,
        table: &SmoothTable,
        sources: &[u32],
        values: (&[[f32; 3]], &Fields),
    ) => heights_body, up to WIDEST
}
