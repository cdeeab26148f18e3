//! Stored irradiance rows on a device: environments reach the samples without a ray. First the rows are multiplied with the light, then
//! the products of samples that share rows are transformed back.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use translux_format::rows::{FACES, IrradianceRows};

use super::stored::StoredRows;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::surface::{
    READ, SurfaceBuffers, UNIFORM, WRITE, bind, bind_group_layout, dispatch, pipeline, uniform,
};
use crate::geometry::samples::Samples;
use crate::light::cube_light::CubeLight;
use crate::medium::entrance_basis::MOST_TERMS;

/// Rows of one workgroup.
const ROWS: usize = 4;

/// Samples of one workgroup.
const SAMPLES: usize = 64;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuSettings {
    terms: u32,
    face: u32,
    rows: u32,
    padding: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuRow {
    patch_index: u32,
    part: u32,
    first: u32,
    end: u32,
    step: f32,
    scaling_step: f32,
    padding: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuExpansion {
    samples: u32,
    factor: f32,
    padding: [u32; 2],
}

/// Rows that the adapter's bindings hold together: bind group and workgroups, and how many rows.
type Shard = ((wgpu::BindGroup, u32), u32);

/// The rows of an asset on a device.
pub struct RowsOnDevice {
    device: Arc<Device>,
    side: usize,
    terms: usize,
    settings: wgpu::Buffer,
    radiance: wgpu::Buffer,
    coefficients: wgpu::Buffer,
    pipeline: wgpu::ComputePipeline,
    bind_group: wgpu::BindGroup,
    shards: Vec<Shard>,
    expansion: Expansion,
}

/// From products to samples.
struct Expansion {
    samples: u32,
    settings: wgpu::Buffer,
    pipeline: wgpu::ComputePipeline,
    bind_group: wgpu::BindGroup,
    blocks: (wgpu::BindGroup, u32),
}

impl Expansion {
    fn new(buffers: &SurfaceBuffers, products: &wgpu::Buffer, (rows, samples): (&StoredRows, usize)) -> Result<Self> {
        let device = buffers.device();
        // A sample without others is a block.
        let mut of_sample: Vec<[u32; 2]> = (0..samples as u32).map(|i| [i, 1]).collect();
        for &[first, end] in rows.blocks() {
            if let Some(block) = of_sample.get_mut(first as usize..end as usize) {
                block.fill([first, end - first]);
            }
        }
        let blocks = device.storage("blocks of the rows", &of_sample)?;
        let settings = uniform(&device.device, "settings of the blocks", &[0; size_of::<GpuExpansion>()]);
        let first = bind_group_layout(&device.device, "products", &[UNIFORM, READ, WRITE]);
        let second = bind_group_layout(&device.device, "blocks of the rows", &[READ]);
        let pipeline = pipeline(&device.device, include_str!("row_blocks.wgsl"), "add_blocks", [&first, &second]);
        let bind_group = bind(&device.device, &first, [&settings, products, buffers.irradiance()]);
        let blocks = (bind(&device.device, &second, [&blocks]), samples.div_ceil(SAMPLES) as u32);
        Ok(Self { samples: samples as u32, settings, pipeline, bind_group, blocks })
    }

    /// Adds the products times a factor to the irradiance.
    fn run(&self, device: &Device, factor: f32) {
        let settings = GpuExpansion { samples: self.samples, factor, padding: [0; 2] };
        device.queue.write_buffer(&self.settings, 0, bytemuck::bytes_of(&settings));
        dispatch(device, &self.pipeline, &self.bind_group, [&self.blocks]);
    }
}

impl RowsOnDevice {
    /// Uploads valid rows of samples whose irradiance is in the buffers.
    ///
    /// # Errors
    /// A cube map beyond the adapter's bindings (exit 5).
    pub fn new(buffers: &SurfaceBuffers, stored: &StoredRows, samples: &Samples) -> Result<Self> {
        let rows = stored.data();
        let device = Arc::clone(buffers.device());
        let parts = samples.part_offsets.len().saturating_sub(1);
        let settings = uniform(&device.device, "settings of the rows", &[0; size_of::<GpuSettings>()]);
        let radiance = device.zeros("cube map", (16 * FACES * rows.side * rows.side) as u64)?;
        let coefficients = device.zeros("entrance", 16 * parts as u64)?;
        let first = bind_group_layout(&device.device, "cube map", &[UNIFORM, READ, READ, WRITE]);
        let second = bind_group_layout(&device.device, "rows", &[READ; 4]);
        let pipeline = pipeline(&device.device, include_str!("rows.wgsl"), "multiply_rows", [&first, &second]);
        let products = device.zeros("products of the rows", 16 * samples.len() as u64)?;
        let expansion = Expansion::new(buffers, &products, (stored, samples.len()))?;
        let bind_group = bind(&device.device, &first, [&settings, &radiance, &coefficients, &products]);
        let shards = shards(&device, rows, samples, &second)?;
        device.check()?;
        let (side, terms) = (rows.side, rows.terms);
        Ok(Self { device, side, terms, settings, radiance, coefficients, pipeline, bind_group, shards, expansion })
    }

    /// Texels along an edge of the cube map.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Adds a light to the irradiance, which is over `scale`; `entrance` are the coefficients of each part's medium.
    ///
    /// # Errors
    /// A light of another size (exit 4: a caller's mistake).
    pub fn add(&self, light: &CubeLight, entrance: &[[f64; MOST_TERMS]], scale: f64) -> Result<()> {
        if light.side() != self.side {
            return Err(Error::runtime(format!("a cube map of {} texels for rows of {}", light.side(), self.side)));
        }
        let entrance: Vec<[f32; 4]> = entrance.iter().map(|c| std::array::from_fn(|j| c[j] as f32)).collect();
        let queue = &self.device.queue;
        queue.write_buffer(&self.radiance, 0, bytemuck::cast_slice(light.coefficients()));
        queue.write_buffer(&self.coefficients, 0, bytemuck::cast_slice(&entrance));
        let (terms, face) = (self.terms as u32, (self.side * self.side) as u32);
        for (shard, rows) in &self.shards {
            let settings = GpuSettings { terms, face, rows: *rows, padding: 0 };
            queue.write_buffer(&self.settings, 0, bytemuck::bytes_of(&settings));
            dispatch(&self.device, &self.pipeline, &self.bind_group, [shard]);
        }
        self.expansion.run(&self.device, (light.scale() / scale) as f32);
        Ok(())
    }
}

/// Cuts the rows where the adapter's bindings are full.
fn shards(
    device: &Device,
    rows: &IrradianceRows,
    samples: &Samples,
    layout: &wgpu::BindGroupLayout,
) -> Result<Vec<Shard>> {
    let most = device.largest_binding() as usize;
    let (count, terms) = (rows.patches(), rows.terms);
    let (mut result, mut first) = (Vec::new(), 0);
    while first < count {
        let from = rows.offsets[first] as usize;
        let mut end = first;
        while end < count {
            let next = rows.offsets[end + 1] as usize - from;
            let bytes = (next * terms.max(2)).max((end + 1 - first) * size_of::<GpuRow>().max(2 * terms * FACES));
            if bytes > most && end > first {
                break;
            }
            end += 1;
        }
        let to = rows.offsets[end] as usize;
        let row = |patch: usize| GpuRow {
            patch_index: patch as u32,
            part: samples.part_offsets.partition_point(|&p| p as usize <= patch) as u32 - 1,
            first: (rows.offsets[patch] as usize - from) as u32,
            end: (rows.offsets[patch + 1] as usize - from) as u32,
            step: rows.steps[patch],
            scaling_step: rows.scaling_steps[patch],
            padding: [0; 2],
        };
        let of_rows: Vec<GpuRow> = (first..end).map(row).collect();
        let bound = [
            device.storage("rows", &of_rows)?,
            device.storage("places of the rows", &words(bytemuck::cast_slice(&rows.indices[from..to])))?,
            device
                .storage("values of the rows", &words(bytemuck::cast_slice(&rows.values[from * terms..to * terms])))?,
            device.storage(
                "scaling of the rows",
                &words(bytemuck::cast_slice(&rows.scaling[first * terms * FACES..end * terms * FACES])),
            )?,
        ];
        let workgroups = of_rows.len().div_ceil(ROWS) as u32;
        result.push(((bind(&device.device, layout, &bound), workgroups), of_rows.len() as u32));
        first = end;
    }
    Ok(result)
}

/// Bytes in whole words, padded with zeros.
fn words(bytes: &[u8]) -> Vec<u32> {
    let word = |chunk: &[u8]| {
        let mut word = [0; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        u32::from_le_bytes(word)
    };
    bytes.chunks(4).map(word).collect()
}
