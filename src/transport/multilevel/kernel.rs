//! The inner loop between the points of a net: a smooth, compact kernel by a table even in the squared distance.

use crate::math::simd::{Level, multiversion};
use crate::medium::profile::Profile;
use crate::medium::softened::Softened;
use crate::transport::kernel::LANES;
use crate::transport::kernel::radial_table::{Rgb, Segment};

/// Segments of a table.
const SEGMENTS: usize = 512;

/// Sources summed before the sum is added to the total.
const FLUSH: usize = 32;

/// A part of a profile that is smaller than this share of its total over the whole reach is nothing.
const NOTHING: f64 = 1e-7;

/// A profile softened inside one radius less the same softened inside another.
#[derive(Clone, Debug)]
pub(crate) struct SmoothTable {
    /// Segments per mm^2.
    pub(crate) per_mm2: f32,
    /// The last one is zero.
    segments: Vec<Segment>,
    nothing: bool,
}

impl SmoothTable {
    /// Of three profiles softened inside `radius_mm`, less the same inside `less_mm`; all of it, up to the extent, without.
    pub(super) fn new(profiles: &[&dyn Profile; 3], radius_mm: f64, less_mm: Option<f64>, extent_mm: f64) -> Self {
        let reach = less_mm.unwrap_or(1.001 * extent_mm).max(f64::MIN_POSITIVE);
        // Without a second radius there is more than one scale.
        let count = if less_mm.is_some() {
            SEGMENTS
        } else {
            (SEGMENTS as f64 * (0.5 * reach / radius_mm).powi(2)).clamp(SEGMENTS as f64, 65536.0) as usize
        };
        let step = reach * reach / count as f64;
        let mut segments = vec![Segment::default(); count + 1];
        let mut nothing = true;
        for (c, profile) in profiles.iter().enumerate() {
            let soft = Softened::new(*profile, radius_mm);
            let less = less_mm.map(|radius| Softened::new(*profile, radius));
            let value = |k: usize| {
                let r2 = k as f64 * step;
                let less = less.map_or(0.0, |less| less.reflectance_at_square(*profile, r2));
                let value = soft.reflectance_at_square(*profile, r2) - less;
                if value.is_finite() { value } else { 0.0 }
            };
            let values: Vec<f64> = (0..=count).map(value).collect();
            let area = std::f64::consts::PI * reach * reach;
            nothing &= values[0].abs() * area <= NOTHING * profile.total();
            for (segment, pair) in segments.iter_mut().zip(values.windows(2)) {
                segment.value[c] = pair[0] as f32;
                segment.slope[c] = ((pair[1] - pair[0]) / step) as f32;
            }
        }
        // Slopes per segment, so that the fraction of the index is what they take.
        for segment in &mut segments {
            segment.slope = segment.slope.map(|s| s * step as f32);
        }
        Self { per_mm2: step.recip() as f32, segments, nothing }
    }

    /// Its segments: the value at the start of each, and what it gains up to its end.
    #[cfg(feature = "gpu")]
    pub(crate) fn segments(&self) -> Vec<[[f32; 4]; 2]> {
        self.segments.iter().map(|s| [s.value, s.slope]).collect()
    }

    /// Whether it is negligible everywhere.
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
    /// Of at most [`LANES`] points.
    pub(super) fn new(points: &[[f32; 3]]) -> Self {
        let mut at = [[0.0; LANES]; 3];
        for (lane, point) in points.iter().take(LANES).enumerate() {
            (0..3).for_each(|axis| at[axis][lane] = point[axis]);
        }
        Self { at, sums: [[0.0; 4]; LANES] }
    }

    /// Adds the sums to those of the points.
    pub(super) fn add_to(&self, out: &mut [Rgb]) {
        for (out, sum) in out.iter_mut().zip(&self.sums) {
            (0..4).for_each(|c| out[c] += sum[c]);
        }
    }
}

#[inline(always)]
fn smooth_body(block: &mut PointBlock, table: &SmoothTable, sources: &[u32], (at, charges): (&[[f32; 3]], &[Rgb])) {
    let last = table.segments.len().saturating_sub(1) as f32;
    for chunk in sources.chunks(FLUSH) {
        let mut partial = [[0.0f32; 4]; LANES];
        for &source in chunk {
            let (Some(&[sx, sy, sz]), Some(charge)) = (at.get(source as usize), charges.get(source as usize)) else {
                continue;
            };
            let [x, y, z] = &block.at;
            let (mut index, mut fraction) = ([0u32; LANES], [0.0f32; LANES]);
            for i in 0..LANES {
                let (dx, dy, dz) = (x[i] - sx, y[i] - sy, z[i] - sz);
                let place = ((dx * dx + dy * dy + dz * dz) * table.per_mm2).min(last);
                index[i] = place as u32;
                fraction[i] = place - index[i] as f32;
            }
            for (lane, partial) in partial.iter_mut().enumerate() {
                let Some(segment) = table.segments.get(index[lane] as usize) else { continue };
                for c in 0..4 {
                    partial[c] += charge[c] * (segment.value[c] + segment.slope[c] * fraction[lane]);
                }
            }
        }
        for (sum, partial) in block.sums.iter_mut().zip(&partial) {
            (0..4).for_each(|c| sum[c] += partial[c]);
        }
    }
}

multiversion! {
    /// See [`add_smooth`].
    fn smooth(block: &mut PointBlock, table: &SmoothTable, sources: &[u32], values: (&[[f32; 3]], &[Rgb])) => smooth_body
}

/// Adds what the sources, given by their indices among positions (mm) and charges, bring every point of a block.
pub(super) fn add_smooth(
    level: Level,
    block: &mut PointBlock,
    table: &SmoothTable,
    sources: &[u32],
    values: (&[[f32; 3]], &[Rgb]),
) {
    smooth(level.min(Level::Avx2), block, table, sources, values);
}
