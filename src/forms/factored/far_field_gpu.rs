//! The stored far field under one light, summed by a device for every basis function.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use translux_format::far_field::{FarField, LANES};

use super::far_sums::Fill;
use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::evaluate::device::interpolated::{expansion, filling};
use crate::evaluate::device::jobs::MOST_TURNS_OF_SOFTWARE;
use crate::evaluate::device::surface::{ComputePass, READ, UNIFORM, WRITE, bind, bind_group_layout, pipeline, uniform};
use crate::evaluate::device::tree::TreeOnDevice;
use crate::transport::interpolation::SharedWeights;

/// Basis functions at most.
const TERMS: usize = 16;

/// Groups of one dispatch, on every adapter.
const MOST_GROUPS: usize = 65_535;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuSteps {
    values: [f32; TERMS],
    terms: u32,
    padding: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuGroup {
    part: u32,
    first_receiver: u32,
    end_receiver: u32,
    first: u32,
    end: u32,
    padding: [u32; 3],
}

/// Groups that the adapter's bindings hold together.
#[derive(Default)]
struct Pending {
    groups: Vec<GpuGroup>,
    coefficients: Vec<[u32; 4]>,
    narrow: Vec<[i8; LANES]>,
    wide: Vec<[i16; LANES]>,
}

/// The far field on a device.
pub(super) struct FarOnDevice {
    device: Arc<Device>,
    values: wgpu::Buffer,
    stored: ComputePass,
    /// Functions that receivers take from other rows because their own lack them.
    fills: Vec<ComputePass>,
    /// Interpolation from the points of the far field to the receivers, and its result.
    expansion: Option<(ComputePass, wgpu::Buffer)>,
}

impl FarOnDevice {
    /// Uploads a far field; the light comes from a tree. With weights, every receiver interpolates from the points of
    /// the far field.
    ///
    /// # Errors
    /// Buffers beyond the adapter's bindings that cannot be cut (exit 5).
    pub(super) fn new(
        device: &Arc<Device>,
        (far, fills, weights): (&FarField, &[Fill], Option<&SharedWeights>),
        tree: &TreeOnDevice,
    ) -> Result<Self> {
        let terms = far.terms.min(TERMS);
        let mut steps = GpuSteps { values: [0.0; TERMS], terms: terms as u32, padding: [0; 3] };
        steps.values.iter_mut().zip(&far.steps).for_each(|(value, step)| *value = *step);
        let steps = uniform(&device.device, "steps", bytemuck::bytes_of(&steps));
        let row_sums = device.storage("row sums", &far.row_sums)?;
        let values = device.zeros("far radiosity", 12 * far.row_sums.len() as u64)?;
        let first = bind_group_layout(&device.device, "far light", &[UNIFORM, READ, READ, READ, WRITE]);
        let second = bind_group_layout(&device.device, "far field", &[READ; 4]);
        let bound = [&steps, tree.details(), tree.means(), &row_sums, &values];
        let stored = ComputePass {
            pipeline: pipeline(&device.device, include_str!("far.wgsl"), "far", [&first, &second]),
            bind_group: bind(&device.device, &first, bound),
            shards: shards(device, far, &second)?,
        };
        let fills = fills
            .iter()
            .map(|fill| filling(device, (fill.functions, &fill.receivers, &fill.weights), (&values, terms)))
            .collect::<Result<_>>()?;
        let expansion = weights.map(|weights| expansion(device, weights, (&values, terms))).transpose()?;
        device.check()?;
        Ok(Self { device: Arc::clone(device), values, stored, fills, expansion })
    }

    /// Computes the far radiosity of every receiver and function under the light of the tree, over its scale:
    /// `[receiver][k]`, RGB.
    pub(super) fn run(&self) {
        self.stored.run(&self.device);
        self.fills.iter().for_each(|stage| stage.run(&self.device));
        if let Some((stage, _)) = &self.expansion {
            stage.run(&self.device);
        }
    }

    /// Values that [`Self::run`] writes.
    pub(super) fn values(&self) -> &wgpu::Buffer {
        self.expansion.as_ref().map_or(&self.values, |(_, expanded)| expanded)
    }
}

/// Cuts the groups where the adapter's bindings are full.
fn shards(device: &Device, far: &FarField, layout: &wgpu::BindGroupLayout) -> Result<Vec<(wgpu::BindGroup, u32)>> {
    let most = device.largest_binding() as usize;
    let (mut result, mut pending) = (Vec::new(), Pending::default());
    let (mut receiver, mut first, mut narrow, mut wide) = (0, 0, 0, 0);
    for group in &far.groups {
        let range = first..group.coefficients_end as usize;
        if range.len() > MOST_TURNS_OF_SOFTWARE {
            let count = range.len();
            return Err(Error::unsupported(format!(
                "a group of receivers has {count} coefficients where shaders sum {MOST_TURNS_OF_SOFTWARE}; use --device cpu"
            )));
        }
        let count = |masks: &[u16]| masks[range.clone()].iter().map(|m| m.count_ones() as usize).sum::<usize>();
        let wides = count(&far.wide_masks);
        let narrows = count(&far.masks) - wides;
        let full = (pending.narrow.len() + narrows) * LANES > most
            || (pending.wide.len() + wides) * 2 * LANES > most
            || (pending.coefficients.len() + range.len()) * 16 > most
            || pending.groups.len() == MOST_GROUPS;
        if full {
            result.extend(upload(device, layout, &std::mem::take(&mut pending))?);
        }
        let (mut next_narrow, mut next_wide) = (pending.narrow.len() as u32, pending.wide.len() as u32);
        let first_coefficient = pending.coefficients.len() as u32;
        for c in range {
            let (mask, wide_mask) = (far.masks[c], far.wide_masks[c]);
            let masks = u32::from(mask) | u32::from(wide_mask) << 16;
            pending.coefficients.push([far.nodes[c], masks, next_narrow, next_wide]);
            next_narrow += (mask & !wide_mask).count_ones();
            next_wide += wide_mask.count_ones();
        }
        pending.narrow.extend_from_slice(&far.narrow[narrow..narrow + narrows]);
        pending.wide.extend_from_slice(&far.wide[wide..wide + wides]);
        pending.groups.push(GpuGroup {
            part: group.part,
            first_receiver: receiver,
            end_receiver: group.rows_end,
            first: first_coefficient,
            end: pending.coefficients.len() as u32,
            padding: [0; 3],
        });
        (narrow, wide) = (narrow + narrows, wide + wides);
        (receiver, first) = (group.rows_end, group.coefficients_end as usize);
    }
    result.extend(upload(device, layout, &pending)?);
    Ok(result)
}

fn upload(
    device: &Device,
    layout: &wgpu::BindGroupLayout,
    pending: &Pending,
) -> Result<Option<(wgpu::BindGroup, u32)>> {
    if pending.groups.is_empty() {
        return Ok(None);
    }
    let groups = device.storage("groups of the far field", &pending.groups)?;
    let coefficients = device.storage("coefficients of the far field", &pending.coefficients)?;
    let narrow = device.storage("8-bit values of the far field", &pending.narrow)?;
    let wide = device.storage("16-bit values of the far field", &pending.wide)?;
    let bound = [&groups, &coefficients, &narrow, &wide];
    Ok(Some((bind(&device.device, layout, bound), pending.groups.len() as u32)))
}
