//! The compact part of kernels in compute shaders: near samples one by one, added to what nets bring.

use bytemuck::{Pod, Zeroable};

use super::lit_samples::GatheredEvaluator;
use crate::error::Result;
use crate::evaluate::Evaluator;
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::{Effort, Entries, Shard, shards};
use crate::evaluate::device::surface::{
    GpuTable, READ, SurfaceBuffers, bind, bind_group_layout, dispatch, pipeline, shader, table_shader,
};
use crate::geometry::samples::Facet;
use crate::transport::kernel::radial_table::SHIFT;
use crate::transport::multilevel::{Compact, SurfaceNets, SurfaceTables};
use crate::transport::near_rule::{MOST_SPLITS, PIECE_IS_POINT};
use crate::transport::surface::Surface;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuCompact {
    point: GpuTable,
    disc: GpuTable,
    smooth2: f32,
    split2: f32,
    facets_below: f32,
    pieces_below: f32,
}

/// The compact part of the kernel, summed over near samples.
pub(super) struct NearOnDevice {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    shards: Vec<Shard>,
    /// Splits of triangles that the shards are cut for.
    splits: Splits,
    groups: Vec<(wgpu::BindGroup, u32)>,
}

impl NearOnDevice {
    /// Prepares the sums; [`Self::set_tables`] is still to come.
    ///
    /// # Errors
    /// Lists beyond the adapter's bindings (exit 5).
    pub(super) fn new(
        cpu: &GatheredEvaluator,
        device: &Device,
        buffers: &SurfaceBuffers,
        (nets, tables): (&SurfaceNets, &SurfaceTables),
    ) -> Result<Self> {
        let layout = bind_group_layout(&device.device, "compact", &[READ; 5]);
        let text = table_shader(SHIFT, &shader(include_str!("compact.wgsl")));
        let pipeline = pipeline(&device.device, &text, "near", [buffers.layout(), &layout]);
        // Other media may need smaller pieces: cut for those as well.
        let splits = Splits { smooth_mm: 0.5 * Splits::of(tables).smooth_mm, ..Splits::of(tables) };
        let shards = near_shards(device, (cpu, nets, tables), splits)?;
        Ok(Self { layout, pipeline, shards, splits, groups: Vec::new() })
    }

    /// Uploads the tables of the kernels in force; `flux` is that of every sample.
    ///
    /// # Errors
    /// Tables beyond the adapter's bindings (exit 5).
    pub(super) fn set_tables(
        &mut self,
        cpu: &GatheredEvaluator,
        device: &Device,
        (nets, tables): (&SurfaceNets, &SurfaceTables),
        flux: &wgpu::Buffer,
    ) -> Result<()> {
        let needed = Splits::of(tables);
        if !self.splits.covers(needed) {
            self.shards = near_shards(device, (cpu, nets, tables), needed)?;
            self.splits = needed;
        }
        let (mut heads, mut all) = (Vec::new(), Vec::new());
        for (_, compact) in &tables.parts {
            heads.push(GpuCompact {
                point: GpuTable::append(&compact.point, &mut all),
                disc: GpuTable::append(&compact.disc, &mut all),
                smooth2: (compact.smooth_mm * compact.smooth_mm) as f32,
                split2: compact.split_below * compact.split_below,
                facets_below: compact.rule.facets_below as f32,
                pieces_below: compact.rule.pieces_below as f32,
            });
        }
        let heads = device.storage("compact parts", &heads)?;
        let segments = device.storage("tables of compact parts", all.as_flattened())?;
        let of_shard = |shard: &Shard| {
            let bound = [&shard.jobs, &shard.list, flux, &heads, &segments];
            (bind(&device.device, &self.layout, bound), shard.count)
        };
        self.groups = self.shards.iter().map(of_shard).collect();
        Ok(())
    }

    /// Enqueues the sums.
    pub(super) fn run(&self, device: &Device, buffers: &SurfaceBuffers) {
        dispatch(device, &self.pipeline, buffers.bind_group(), &self.groups);
    }
}

/// Limits of splitting triangles: distance over their radius below which, and scale down to which they are split, mm.
#[derive(Clone, Copy, Debug)]
struct Splits {
    below: f64,
    smooth_mm: f64,
}

impl Splits {
    fn of(tables: &SurfaceTables) -> Self {
        let mut splits = Self { below: PIECE_IS_POINT.into(), smooth_mm: f64::INFINITY };
        for (_, compact) in &tables.parts {
            splits.below = splits.below.max(compact.split_below.into());
            splits.smooth_mm = splits.smooth_mm.min(compact.smooth_mm);
        }
        splits
    }

    fn covers(self, other: Self) -> bool {
        self.below >= other.below && self.smooth_mm <= other.smooth_mm
    }

    /// Turns of the shader's loops for a triangle; radius about its centroid in mm.
    fn turns(self, radius: f64, area: f64) -> usize {
        let levels = (self.below * radius / self.smooth_mm).log2().ceil();
        let depth = if levels.is_finite() { levels.clamp(0.0, MOST_SPLITS.into()) as u32 } else { MOST_SPLITS };
        // Of each size those around the receiver, at most.
        let around = 4.0 * std::f64::consts::PI * ((self.below + 1.0) * radius).powi(2) / area.max(f64::MIN_POSITIVE);
        let triangles: f64 = (0..=depth).map(|level| around.clamp(1.0, 4f64.powi(level as i32))).sum();
        let of_one = (2 * depth + 8) as f64;
        (triangles * of_one).min(1e12) as usize
    }

    fn effort(self, surface: &Surface, (rule_below, pieces): (f64, usize)) -> Effort {
        let mesh = surface.domain.mesh;
        let of_facet = |facet: &Facet| {
            let [a, b, c] = facet.corners_local_mm(mesh);
            let middle = (a + b + c) / 3.0;
            let radius = [a, b, c].iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
            self.turns(radius, 0.5 * (b - a).cross(c - a).length())
        };
        let turns = |index: usize| {
            let facets = surface.samples.patch(index);
            let radius = surface.patches[index].radius_mm;
            let whole = facets.iter().map(of_facet).sum::<usize>();
            // What shadow boundaries leave of a sample is not much thinner than this.
            let close = whole + pieces * self.turns(radius, 0.1 * radius * radius);
            let less_close = 9 * facets.len() + pieces;
            [(close + less_close).min(1 << 40), less_close]
        };
        // Triangles are not larger than their sample, nor farther from its centroid.
        Effort::with_turns(surface.patches, [self.below + 1.0, rule_below], turns)
    }
}

/// The work of the compact part; the "medium" of a job is its part among those that have nets.
fn near_shards(
    device: &Device,
    (cpu, nets, tables): (&GatheredEvaluator, &SurfaceNets, &SurfaceTables),
    splits: Splits,
) -> Result<Vec<Shard>> {
    let receivers = &cpu.receivers;
    let mut lists = vec![Entries::List(Vec::new()); receivers.groups.len()];
    let mut table_of_part = vec![None; cpu.scene().parts.parts.len()];
    for (index, part) in nets.parts.iter().enumerate() {
        let first = receivers.groups.partition_point(|g| (g.run.first as usize) < part.receivers.start);
        let Some(of_part) = receivers.groups.get(first).map(|g| g.part as usize) else { continue };
        table_of_part[of_part] = Some(index as u32);
        let start = part.samples.start as u32;
        let groups = receivers.groups.partition_point(|g| (g.run.first as usize) < part.receivers.end);
        for (group, list) in lists[first..groups].iter_mut().enumerate() {
            *list = Entries::List(part.near.close.of(group).iter().map(|sample| start + sample).collect());
        }
    }
    let rule = |(_, compact): &(_, Compact)| compact.rule.facets_below.max(compact.rule.pieces_below);
    let rule_below = tables.parts.iter().map(rule).fold(0.0, f64::max);
    let effort = splits.effort(&cpu.surface(), (rule_below, cpu.gathering.sampling.pieces_of_uneven() as usize));
    shards(device, receivers, |part| table_of_part.get(part as usize).copied().flatten(), &lists, &effort)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_grow_with_what_is_split_and_stay_finite() {
        let splits = |smooth_mm| Splits { below: 2.0, smooth_mm };
        let [few, some, many] = [10.0, 0.5, 0.01].map(|smooth| splits(smooth).turns(1.0, 1.3));
        assert!(few >= 8 && few < some && some < many, "{few} {some} {many}");
        assert!(splits(0.0).turns(1.0, 0.0) >= many && splits(0.0).turns(0.0, 0.0) >= 8);
        assert!(splits(0.1).covers(splits(0.2)) && !splits(0.2).covers(splits(0.1)));
        assert!(!splits(0.1).covers(Splits { below: 3.0, smooth_mm: 0.1 }));
    }
}
