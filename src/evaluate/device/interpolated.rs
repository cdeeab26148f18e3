//! Radiosity as products of stored rows with a few columns, interpolated from the rows' points to all receivers, on a
//! device.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::Device;
use super::jobs::MOST_TURNS_OF_SOFTWARE;
use super::surface::{ComputePass, READ, UNIFORM, WRITE, bind, bind_group_layout, pipeline, uniform};
use crate::error::{Error, Result};
use crate::transport::interpolation::{LANES, SharedWeights};

/// Rows of one workgroup, and runs of one workgroup.
const ROWS: usize = 16;
const RUNS: usize = 8;
const RUNS_OF_EXPANSION: usize = 4;

/// Integers that the invocations of a row take together in one turn.
const TURN: usize = 32;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct RowsOfShard {
    words: u32,
    first_row: u32,
    rows: u32,
    padding: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct RunsOfShard {
    first_run: u32,
    runs: u32,
    receivers: u32,
    /// Basis functions of the far field.
    terms: u32,
    first_receiver: u32,
    is_signed: u32,
    /// Bit k: function k of the far field is filled in.
    functions: u32,
    padding: u32,
}

/// The way in which new radiosity meets the radiosity that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sum {
    /// The new radiosity replaces it.
    New,
    /// The new radiosity is added to it.
    Added,
}

/// Rows and weights on a device.
pub struct InterpolatedOnDevice {
    device: Arc<Device>,
    columns: wgpu::Buffer,
    width: usize,
    /// Mode (1 to add to the radiosity, 0 to replace it), then a factor for each reference point.
    factors: wgpu::Buffer,
    rows: usize,
    radiosity: wgpu::Buffer,
    products: ComputePass,
    interpolation: ComputePass,
}

impl InterpolatedOnDevice {
    /// Uploads rows of coefficients `[reference point][column]`, an even number of columns, and the weights of every
    /// receiver over the reference points; reference points that have no row count as 0.
    ///
    /// # Errors
    /// Rows, points or receivers beyond the adapter's bindings (exit 5); an odd number of columns or coefficients that
    /// do not fill their rows (exit 4: a caller's mistake).
    pub fn new(device: &Arc<Device>, coefficients: &[i16], width: usize, weights: &SharedWeights) -> Result<Self> {
        check_turns(width.div_ceil(TURN))?;
        if !width.is_multiple_of(2) || !coefficients.len().is_multiple_of(width.max(1)) {
            let count = coefficients.len();
            return Err(Error::runtime(format!("{count} coefficients in rows of {width} on the device")));
        }
        let rows = coefficients.len() / width.max(1);
        let named = weights.sources().iter().max().map_or(0, |&last| last as usize + 1);
        let columns = device.zeros("columns of the lights", 16 * width as u64)?;
        let factors = device.zeros("factors of the reference points", 4 * (rows as u64 + 1))?;
        let references = device.zeros("reference points", 16 * rows.max(named) as u64)?;
        let radiosity = device.zeros("radiosity", 16 * weights.targets() as u64)?;
        let calls = &device.device;
        let first = bind_group_layout(calls, "columns", &[READ, WRITE, READ]);
        let second = bind_group_layout(calls, "rows of coefficients", &[UNIFORM, READ]);
        let products = ComputePass {
            pipeline: pipeline(calls, include_str!("products.wgsl"), "products", [&first, &second]),
            bind_group: bind(calls, &first, [&columns, &references, &factors]),
            shards: shards_of_rows(device, coefficients, width, &second)?,
        };
        let interpolation = Interpolation::new(device).stage(device, weights, [&references, &radiosity], None)?;
        device.check()?;
        Ok(Self { device: Arc::clone(device), columns, width, factors, rows, radiosity, products, interpolation })
    }

    /// Enqueues the radiosity of every reference point under a light that is a column for each channel, RGB, times a
    /// factor for each reference point (1 without factors); it replaces the previous radiosity or is added to it.
    ///
    /// # Errors
    /// Columns or factors of another length (exit 4: a caller's mistake); a lost device (exit 4).
    pub fn add(&self, columns: &[Vec<f32>; 3], factors: &[f32], sum: Sum) -> Result<()> {
        let [red, green, blue] = columns;
        if columns.iter().any(|column| column.len() != self.width) {
            let given = red.len();
            return Err(Error::runtime(format!("a light of {given} columns for rows of {}", self.width)));
        }
        if !factors.is_empty() && factors.len() != self.rows {
            let given = factors.len();
            return Err(Error::runtime(format!("{given} factors for {} reference points", self.rows)));
        }
        let packed: Vec<[f32; 4]> = red.iter().zip(green).zip(blue).map(|((&r, &g), &b)| [r, g, b, 0.0]).collect();
        let mut header = vec![f32::from(u8::from(sum == Sum::Added))];
        header.extend(factors);
        header.resize(self.rows + 1, 1.0);
        self.device.queue.write_buffer(&self.columns, 0, bytemuck::cast_slice(&packed));
        self.device.queue.write_buffer(&self.factors, 0, bytemuck::cast_slice(&header));
        self.products.run(&self.device);
        self.device.check()
    }

    /// Enqueues the interpolation from the reference points to all receivers.
    ///
    /// # Errors
    /// A lost device (exit 4).
    pub fn interpolate(&self) -> Result<()> {
        self.interpolation.run(&self.device);
        self.device.check()
    }

    /// The device.
    pub(crate) fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Radiosity of every receiver, RGB and 0, written by [`Self::interpolate`].
    pub fn radiosity(&self) -> &wgpu::Buffer {
        &self.radiosity
    }
}

/// Sums over sources that runs of neighbouring targets share, RGB and 0 each.
pub(crate) struct Interpolation {
    values: wgpu::BindGroupLayout,
    weights: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

impl Interpolation {
    pub(crate) fn new(device: &Device) -> Self {
        let calls = &device.device;
        let values = bind_group_layout(calls, "values", &[READ, WRITE]);
        let weights = bind_group_layout(calls, "weights", &[UNIFORM, READ, READ, READ]);
        let text = [include_str!("runs.wgsl"), include_str!("interpolated.wgsl")].concat();
        let pipeline = pipeline(calls, &text, "interpolate", [&values, &weights]);
        Self { values, weights, pipeline }
    }

    /// Makes the stage that interpolates values at sources to targets. With `signed_from` the targets begin there and
    /// keep their signs; without it they begin at 0 and are clamped to 0.
    ///
    /// # Errors
    /// More than the adapter binds, or sums (exit 5).
    pub(crate) fn stage(
        &self,
        device: &Device,
        weights: &SharedWeights,
        from_and_to: [&wgpu::Buffer; 2],
        signed_from: Option<u32>,
    ) -> Result<ComputePass> {
        check_turns(longest(weights.offsets()))?;
        let shard = RunsOfShard {
            first_receiver: signed_from.unwrap_or(0),
            is_signed: u32::from(signed_from.is_some()),
            ..RunsOfShard::zeroed()
        };
        Ok(ComputePass {
            pipeline: self.pipeline.clone(),
            bind_group: bind(&device.device, &self.values, from_and_to),
            shards: shards_of_runs(device, weights, &self.weights, (RUNS, shard))?,
        })
    }
}

/// Largest number of cells of a run.
pub(crate) fn longest(offsets: &[u32]) -> usize {
    offsets.array_windows().map(|[from, to]| (to - from) as usize).max().unwrap_or(0)
}

/// Refuses sums of more terms in one invocation than every adapter adds up correctly.
pub(crate) fn check_turns(turns: usize) -> Result<()> {
    if turns <= MOST_TURNS_OF_SOFTWARE {
        return Ok(());
    }
    Err(Error::unsupported(format!("sums of {turns} where shaders sum {MOST_TURNS_OF_SOFTWARE}; use --device cpu")))
}

/// Makes the stage that interpolates the RGB values `[point][function]` of a far field to the receivers, and the buffer
/// that it fills.
///
/// # Errors
/// More than the adapter binds, or sums (exit 5).
pub(crate) fn expansion(
    device: &Device,
    weights: &SharedWeights,
    (stored, terms): (&wgpu::Buffer, usize),
) -> Result<(ComputePass, wgpu::Buffer)> {
    let expanded = device.zeros("far radiosity of the receivers", 12 * (weights.targets() * terms) as u64)?;
    let shard = RunsOfShard { terms: terms as u32, ..RunsOfShard::zeroed() };
    let bound = ([READ, WRITE], [stored, &expanded]);
    let stage = over_functions(device, (include_str!("expanded.wgsl"), "expand"), bound, (weights, shard))?;
    Ok((stage, expanded))
}

/// Makes the stage that fills in those functions of a far field that some receivers take from other receivers.
///
/// # Errors
/// More than the adapter binds, or sums (exit 5).
pub(crate) fn filling(
    device: &Device,
    (functions, receivers, weights): (u16, &[u32], &SharedWeights),
    (values, terms): (&wgpu::Buffer, usize),
) -> Result<ComputePass> {
    let receivers = device.storage("receivers without functions", receivers)?;
    let shard = RunsOfShard { terms: terms as u32, functions: functions.into(), ..RunsOfShard::zeroed() };
    let bound = ([WRITE, READ], [values, &receivers]);
    over_functions(device, (include_str!("filled.wgsl"), "fill"), bound, (weights, shard))
}

/// Makes a stage that sums values of each function of a far field.
fn over_functions(
    device: &Device,
    (text, entry): (&str, &str),
    (kinds, buffers): ([wgpu::BufferBindingType; 2], [&wgpu::Buffer; 2]),
    (weights, shard): (&SharedWeights, RunsOfShard),
) -> Result<ComputePass> {
    check_turns(longest(weights.offsets()))?;
    let calls = &device.device;
    let first = bind_group_layout(calls, "far radiosity", &kinds);
    let second = bind_group_layout(calls, "weights", &[UNIFORM, READ, READ, READ]);
    Ok(ComputePass {
        pipeline: pipeline(calls, &[include_str!("runs.wgsl"), text].concat(), entry, [&first, &second]),
        bind_group: bind(calls, &first, buffers),
        shards: shards_of_runs(device, weights, &second, (RUNS_OF_EXPANSION, shard))?,
    })
}

/// Cuts rows into shards that fit the adapter's bindings.
fn shards_of_rows(
    device: &Device,
    coefficients: &[i16],
    width: usize,
    layout: &wgpu::BindGroupLayout,
) -> Result<Vec<(wgpu::BindGroup, u32)>> {
    let width = width.max(1);
    let rows = (device.largest_binding() as usize / (2 * width)).max(1);
    let of_chunk = |(chunk, values): (usize, &[i16])| {
        let count = values.len() / width;
        let shard =
            RowsOfShard { words: (width / 2) as u32, first_row: (chunk * rows) as u32, rows: count as u32, padding: 0 };
        let shard = uniform(&device.device, "shard of rows", bytemuck::bytes_of(&shard));
        let values = device.storage("coefficients", values)?;
        Ok((bind(&device.device, layout, [&shard, &values]), count.div_ceil(ROWS) as u32))
    };
    coefficients.chunks(rows.saturating_mul(width)).enumerate().map(of_chunk).collect()
}

/// Cuts runs into shards that fit the adapter's bindings.
fn shards_of_runs(
    device: &Device,
    weights: &SharedWeights,
    layout: &wgpu::BindGroupLayout,
    (of_workgroup, shard): (usize, RunsOfShard),
) -> Result<Vec<(wgpu::BindGroup, u32)>> {
    // The rows of weights are the largest; every run has some, but for those without sources.
    let binding = device.largest_binding() as usize;
    let (most_cells, most_runs) = (binding / (2 * LANES), (binding / 4).saturating_sub(1));
    let of_range = |runs: Range<usize>| {
        let offsets = weights.offsets().get(runs.start..=runs.end).unwrap_or(&[]);
        let (from, to) = (offsets.first().copied().unwrap_or(0), offsets.last().copied().unwrap_or(0));
        let cells = from as usize..to as usize;
        let shard = RunsOfShard {
            first_run: runs.start as u32,
            runs: runs.len() as u32,
            receivers: weights.targets() as u32,
            ..shard
        };
        let offsets: Vec<u32> = offsets.iter().map(|offset| offset - from).collect();
        let bound = [
            uniform(&device.device, "shard of runs", bytemuck::bytes_of(&shard)),
            device.storage("runs of receivers", &offsets)?,
            device.storage("sources of the runs", weights.sources().get(cells.clone()).unwrap_or(&[]))?,
            device.storage("weights", weights.values().get(cells).unwrap_or(&[]))?,
        ];
        Ok((bind(&device.device, layout, &bound), runs.len().div_ceil(of_workgroup) as u32))
    };
    cut(weights.offsets(), most_cells, most_runs).into_iter().map(of_range).collect()
}

/// Cuts runs into ranges of at most so many cells and runs; at least one run each.
pub(crate) fn cut(offsets: &[u32], most_cells: usize, most_runs: usize) -> Vec<Range<usize>> {
    let runs = offsets.len().saturating_sub(1);
    let (mut result, mut first) = (Vec::new(), 0);
    for run in 1..=runs {
        let is_full = |end: usize| (offsets[end] - offsets[first]) as usize > most_cells || end - first > most_runs;
        if run == runs || is_full(run + 1) {
            result.push(first..run);
            first = run;
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_cut_where_bindings_are_full() {
        assert_eq!(cut(&[], 9, 9), Vec::<Range<usize>>::new());
        assert_eq!(cut(&[0], 9, 9), Vec::<Range<usize>>::new());
        assert_eq!(cut(&[0, 4, 8, 12, 20, 21], 9, 9), [0..2, 2..3, 3..5]);
        assert_eq!(cut(&[0, 0, 0, 0, 1], 9, 2), [0..2, 2..4]);
        assert_eq!(cut(&[0, 50, 51], 9, 9), [0..1, 1..2], "too long a run alone, which the adapter then refuses");
    }
}
