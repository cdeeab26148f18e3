//! Irradiance in the basis of the balanced tree, on a device.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::Device;
use super::surface::{READ, SurfaceBuffers, UNIFORM, WRITE, bind, bind_group_layout, dispatch, pipeline, uniform};
use crate::error::Result;
use crate::geometry::samples::{Patch, Samples};
use crate::transport::balanced_tree::Node;

/// Invocations of a workgroup.
const WORKGROUP: usize = 64;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuNode {
    name: u32,
    children: [u32; 2],
    /// Bit 0: the left child is a sample, bit 1: the right one is.
    leaves: u32,
    areas: [f32; 2],
    padding: [u32; 2],
}

/// The transform of [`crate::transport::balanced_tree::LightDetails`] on a device.
pub struct TreeOnDevice {
    device: Arc<Device>,
    details: wgpu::Buffer,
    means: wgpu::Buffer,
    up: wgpu::ComputePipeline,
    parts: wgpu::ComputePipeline,
    bind_group: wgpu::BindGroup,
    /// Bind group and workgroups of each level, the deepest first; and of the parts.
    levels: Vec<(wgpu::BindGroup, u32)>,
}

impl TreeOnDevice {
    /// Prepares the transform of samples in tree order; their light is in the buffers.
    ///
    /// # Errors
    /// More samples than the adapter binds (exit 5).
    pub fn new(buffers: &SurfaceBuffers, samples: &Samples, patches: &[Patch]) -> Result<Self> {
        let device = Arc::clone(buffers.device());
        let (mut by_depth, mut roots) = (Vec::new(), Vec::new());
        for part in 0..samples.part_offsets.len().saturating_sub(1) {
            let node = Node { first: samples.part_offsets[part], end: samples.part_offsets[part + 1] };
            roots.push(match node.end - node.first {
                0 => [0, 0, 1, 0],
                1 => [node.first, 1, 0, 0],
                _ => [node.name() as u32, 0, 0, 0],
            });
            collect(node, patches, 0, &mut by_depth);
        }
        let mut nodes: Vec<GpuNode> = Vec::with_capacity(patches.len());
        let mut ranges = Vec::new();
        for level in by_depth.iter().rev() {
            let first = nodes.len() as u32;
            nodes.extend_from_slice(level);
            ranges.push([first, nodes.len() as u32, 0, 0]);
        }
        let part_groups = roots.len().div_ceil(WORKGROUP) as u32;
        let bytes = 16 * patches.len() as u64;
        let (nodes, roots_buffer) = (device.storage("nodes", &nodes)?, device.storage("roots", &roots)?);
        let node_means = device.zeros("means of the nodes", bytes)?;
        let details = device.zeros("details of the light", bytes)?;
        let means = device.zeros("means of the parts", 16 * roots.len() as u64)?;
        let first = bind_group_layout(&device.device, "tree", &[READ, READ, WRITE, WRITE, READ, WRITE]);
        let second = bind_group_layout(&device.device, "level", &[UNIFORM]);
        let text = include_str!("tree.wgsl");
        let [up, parts] = ["up", "parts"].map(|entry| pipeline(&device.device, text, entry, [&first, &second]));
        let bound = [&nodes, buffers.irradiance(), &node_means, &details, &roots_buffer, &means];
        let bind_group = bind(&device.device, &first, bound);
        let level = |range: [u32; 4]| {
            let buffer = uniform(&device.device, "level", bytemuck::bytes_of(&range));
            let count = (range[1] - range[0]).div_ceil(WORKGROUP as u32);
            (bind(&device.device, &second, [&buffer]), count)
        };
        let mut levels: Vec<_> = ranges.into_iter().map(level).collect();
        // The parts need a level too, for the layout.
        levels.push((level([0; 4]).0, part_groups));
        device.check()?;
        Ok(Self { device, details, means, up, parts, bind_group, levels })
    }

    /// Transforms the light in the buffers.
    pub fn run(&self) {
        let Some((parts, levels)) = self.levels.split_last() else { return };
        dispatch(&self.device, &self.up, &self.bind_group, levels);
        dispatch(&self.device, &self.parts, &self.bind_group, [parts]);
    }

    /// Details: mean irradiance of the left child less that of the right one, indexed by the name of the node.
    pub fn details(&self) -> &wgpu::Buffer {
        &self.details
    }

    /// Mean irradiance of each part.
    pub fn means(&self) -> &wgpu::Buffer {
        &self.means
    }
}

/// Puts this node and those below it into lists by their depth; returns its area.
fn collect(node: Node, patches: &[Patch], depth: usize, by_depth: &mut Vec<Vec<GpuNode>>) -> f64 {
    if node.first >= node.end {
        return 0.0;
    }
    if node.is_leaf() {
        return patches[node.first as usize].area_mm2;
    }
    if by_depth.len() <= depth {
        by_depth.resize_with(depth + 1, Vec::new);
    }
    let children = node.children();
    let areas = children.map(|child| collect(child, patches, depth + 1, by_depth));
    let index = |child: Node| if child.is_leaf() { child.first } else { child.name() as u32 };
    by_depth[depth].push(GpuNode {
        name: node.name() as u32,
        children: children.map(index),
        leaves: u32::from(children[0].is_leaf()) | u32::from(children[1].is_leaf()) << 1,
        areas: areas.map(|area| area as f32),
        padding: [0; 2],
    });
    areas[0] + areas[1]
}
