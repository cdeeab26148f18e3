//! Sums over all pairs and through the hierarchy in compute shaders. The hierarchy is tuned and walked on the CPU; every pair is
//! summed on the device: dipoles in closed form, other kernels by tables.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::lit_samples::GatheredEvaluator;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::{CLUSTER, Effort, Entries, Shard, shards};
use crate::evaluate::device::surface::{
    GpuTable, READ, SurfaceBuffers, UNIFORM, bind, bind_group_layout, dispatch, pipeline, shader, table_shader, uniform,
};
use crate::transport::gather::{Scheme, Source};
use crate::transport::kernel::EdgePrecision;
use crate::transport::kernel::medium::{KernelsOfParts, MediumKernel};
use crate::transport::kernel::radial_table::{LinearTable, RULES, SHIFT, SHORT_STEP};

/// The shader that sums samples and clusters of lists through dipoles.
pub const GATHER_SHADER: &str = include_str!("gather.wgsl");

/// Kernels by tables at most: as many as the smallest uniform buffer of any adapter holds.
const MOST_KERNELS: usize = 16384 / size_of::<GpuKernel>();

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuKernel {
    single: GpuTable,
    tail: GpuTable,
    slope: GpuTable,
    double: GpuTable,
    double_tail: GpuTable,
    smooth: f32,
    is_double: u32,
    padding: [u32; 2],
}

/// Sums of samples and clusters of lists.
pub(super) struct HierarchyOnDevice {
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
    tables: Option<Tables>,
    of_part: Vec<Option<u32>>,
    effort: Effort,
    /// Shards of all pairs, which depend on the samples only.
    all_pairs: Option<Vec<Shard>>,
}

/// Kernels by tables.
struct Tables {
    kernels: wgpu::Buffer,
    segments: wgpu::Buffer,
}

impl Tables {
    fn new(device: &Device, kernels: &[MediumKernel], reach_mm: f64) -> Result<Self> {
        if kernels.len() > MOST_KERNELS {
            let count = kernels.len();
            return Err(Error::unsupported(format!(
                "{count} kernels by tables where the shaders take {MOST_KERNELS}; use --device cpu"
            )));
        }
        let mut segments = Vec::new();
        let mut heads = [GpuKernel::zeroed(); MOST_KERNELS];
        for (head, kernel) in heads.iter_mut().zip(kernels) {
            let tables = kernel.by_tables(reach_mm);
            let mut append = |table: &LinearTable| GpuTable::append(table, &mut segments);
            let (single, tail) = (append(&tables.single), append(&tables.tail));
            let double = tables.double.as_ref().map(|of| of.each_ref().map(append));
            let [slope, values, double_tail] = double.unwrap_or([single; 3]);
            *head = GpuKernel {
                single,
                tail,
                slope,
                double: values,
                double_tail,
                smooth: tables.smooth_mm as f32,
                is_double: u32::from(double.is_some()),
                padding: [0; 2],
            };
        }
        Ok(Self {
            kernels: uniform(&device.device, "kernels by tables", bytemuck::cast_slice(&heads)),
            segments: device.storage("segments of kernels", segments.as_flattened())?,
        })
    }
}

impl HierarchyOnDevice {
    /// Prepares the sums for kernels, and which of them each part has.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5).
    pub(super) fn new(
        cpu: &GatheredEvaluator,
        device: &Device,
        buffers: &mut SurfaceBuffers,
        kernels: &KernelsOfParts,
    ) -> Result<Self> {
        let by_tables = is_by_tables(&kernels.0);
        let rules = if by_tables { &RULES[..] } else { EdgePrecision::Reference.rules() };
        buffers.set_rules(rules)?;
        let (layout, text) = match by_tables {
            true => {
                let kinds = [READ, READ, READ, READ, UNIFORM];
                let numbers =
                    format!("const MOST_KERNELS: u32 = {MOST_KERNELS}u;\nconst SHORT_STEP: f32 = {SHORT_STEP:?};\n");
                let text = [&numbers, include_str!("layers.wgsl")].concat();
                (bind_group_layout(&device.device, "gather by tables", &kinds), table_shader(SHIFT, &shader(&text)))
            }
            false => (bind_group_layout(&device.device, "gather", &[READ; 3]), shader(GATHER_SHADER)),
        };
        let pipeline = pipeline(&device.device, &text, "gather", [buffers.layout(), &layout]);
        let pieces = cpu.gathering.sampling.pieces_of_uneven() as usize;
        let effort = Effort::new(&cpu.surface(), cpu.gathering.near, rules, pieces);
        let mut result = Self { layout, pipeline, tables: None, of_part: Vec::new(), effort, all_pairs: None };
        result.set_kernels(cpu, device, buffers, kernels)?;
        device.check()?;
        Ok(result)
    }

    /// True if the shader is one for such kernels.
    pub(super) fn takes(&self, kernels: &[MediumKernel]) -> bool {
        self.tables.is_some() == is_by_tables(kernels)
    }

    /// Uploads kernels that [`Self::takes`] says it takes.
    ///
    /// # Errors
    /// An adapter with too few or too small bindings (exit 5).
    pub(super) fn set_kernels(
        &mut self,
        cpu: &GatheredEvaluator,
        device: &Device,
        buffers: &mut SurfaceBuffers,
        (kernels, of_part): &KernelsOfParts,
    ) -> Result<()> {
        match is_by_tables(kernels) {
            true => self.tables = Some(Tables::new(device, kernels, cpu.scene.mesh.diagonal_mm())?),
            false => buffers.set_media(kernels, None)?,
        }
        if self.of_part != *of_part {
            self.all_pairs = None;
            self.of_part.clone_from(of_part);
        }
        Ok(())
    }

    /// Sources of every group of receivers, and the clusters of the light.
    fn interactions(
        &self,
        cpu: &GatheredEvaluator,
        device: &Device,
        scheme: Scheme,
    ) -> Result<(Vec<Shard>, Vec<[f32; 4]>)> {
        cpu.with_gather(|gather, lit| {
            let entry = |source: &Source| match source {
                Source::Cluster(index) => index | CLUSTER,
                Source::Patch(index) => *index,
            };
            let sources = gather.sources(&cpu.receivers, lit, scheme);
            let lists = sources.iter().map(|list| Entries::List(list.iter().map(entry).collect())).collect();
            let packed = |v: DVec3| v.as_vec3().extend(0.0).to_array();
            let mut clusters = Vec::new();
            for (centre, flux, moments) in gather.clusters(lit) {
                clusters.extend([packed(centre), packed(flux)]);
                if self.tables.is_some() {
                    clusters.extend([0, 1, 2].map(|axis| packed(DVec3::from_array(moments.map(|of| of[axis])))));
                }
            }
            Ok((self.shards(cpu, device, lists)?, clusters))
        })
    }

    fn shards(&self, cpu: &GatheredEvaluator, device: &Device, entries: Vec<Entries>) -> Result<Vec<Shard>> {
        let kernel = |part: u32| self.of_part.get(part as usize).copied().flatten();
        shards(device, &cpu.receivers, kernel, &entries, &self.effort)
    }

    fn sum(&self, device: &Device, buffers: &SurfaceBuffers, shards: &[Shard], clusters: &[[f32; 4]]) -> Result<()> {
        // Room for one cluster.
        let none = [[0.0; 4]; 5];
        let clusters = device.storage("clusters", if clusters.is_empty() { &none } else { clusters })?;
        let of_shard = |Shard { jobs, list, count }: &Shard| {
            let mut bound = vec![jobs, list, &clusters];
            bound.extend(self.tables.iter().flat_map(|tables| [&tables.segments, &tables.kernels]));
            (bind(&device.device, &self.layout, bound), *count)
        };
        let shards: Vec<_> = shards.iter().map(of_shard).collect();
        dispatch(device, &self.pipeline, buffers.bind_group(), &shards);
        device.check()
    }

    /// Enqueues the sums of the light in the buffers at all receivers.
    ///
    /// # Errors
    /// Lists beyond the adapter's bindings (exit 5); a lost device (exit 4).
    pub(super) fn run(
        &mut self,
        cpu: &mut GatheredEvaluator,
        device: &Arc<Device>,
        buffers: &SurfaceBuffers,
    ) -> Result<()> {
        match cpu.tuned_scheme() {
            Scheme::AllPairs => {
                let shards = match self.all_pairs.take() {
                    Some(shards) => shards,
                    None => {
                        let samples = cpu.surface().samples;
                        let range =
                            |part: u32| samples.part_offsets[part as usize]..samples.part_offsets[part as usize + 1];
                        let groups = &cpu.receivers.groups;
                        self.shards(cpu, device, groups.iter().map(|g| Entries::Samples(range(g.part))).collect())?
                    }
                };
                self.sum(device, buffers, &shards, &[])?;
                self.all_pairs = Some(shards);
                Ok(())
            }
            scheme @ Scheme::Hierarchical { .. } => {
                let (shards, clusters) = self.interactions(cpu, device, scheme)?;
                self.sum(device, buffers, &shards, &clusters)
            }
        }
    }
}

/// True if some of the kernels are not dipoles: all are taken from tables then.
fn is_by_tables(kernels: &[MediumKernel]) -> bool {
    kernels.iter().any(|kernel| kernel.poles().is_none())
}
