//! The inner loop between the points of a net: a kernel softened inside a radius, less that softened inside its double.

use crate::math::simd::{add_scaled, multiversion};
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;
use crate::transport::kernel::radial_table::{Rgb, SmoothTable, WIDEST};
use crate::transport::kernel::{FLUSH, LANES, Radial, squares};

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
    pub(super) fn new(profiles: &[&dyn Profile; 3], radius_mm: f64, less_mm: Option<f64>, extent_mm: f64) -> Self {
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
pub(super) struct PointBlock {
    at: [[f32; LANES]; 3],
    sums: [Rgb; LANES],
}

impl PointBlock {
    /// A block of at most [`LANES`] points.
    pub(super) fn new(points: &[[f32; 3]]) -> Self {
        let mut at = [[0.0; LANES]; 3];
        for (lane, point) in points.iter().take(LANES).enumerate() {
            (0..3).for_each(|axis| at[axis][lane] = point[axis]);
        }
        Self { at, sums: [[0.0; 4]; LANES] }
    }

    /// Adds the block's sums to `out`.
    pub(super) fn add_to(&self, out: &mut [Rgb]) {
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
    pub(super) fn add_smooth(
        block: &mut PointBlock,
        table: &SmoothTable,
        sources: &[u32],
        values: (&[[f32; 3]], &[Rgb]),
    ) => smooth_body, up to WIDEST
}
