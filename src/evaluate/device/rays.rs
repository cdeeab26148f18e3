//! The triangles of a scene in the memory of a device, for rays.

use super::Device;
use crate::error::Result;
use crate::geometry::bvh::Bvh;

/// Largest finite distance in shaders.
const FAR: f32 = 3e38;

/// The tree of a [`Bvh`] on a device.
pub struct RaysOnDevice {
    nodes: wgpu::Buffer,
    blocks: wgpu::Buffer,
    constants: String,
}

impl RaysOnDevice {
    /// Uploads the tree.
    ///
    /// # Errors
    /// More triangles than the adapter binds (exit 5).
    pub fn new(device: &Device, bvh: &Bvh) -> Result<Self> {
        let words = bvh.words();
        let [low, high] = words.bounds.map(|corner| {
            let [x, y, z] = corner.to_array();
            format!("vec3<f32>({x:?}, {y:?}, {z:?})")
        });
        let constants = format!(
            "const TREE_STACK: u32 = {}u;
const TREE_LOW: vec3<f32> = {low};
const TREE_HIGH: vec3<f32> = {high};
const TREE_EXTENT: f32 = {:?};
const TREE_MAGNITUDE: f32 = {:?};
",
            words.stack, words.extent, words.magnitude
        );
        let nodes = device.storage("nodes of the triangles", &words.nodes)?;
        Ok(Self { nodes, blocks: device.storage("triangles", &words.blocks)?, constants })
    }

    /// Completes the text of a shader that casts rays, whose first two bindings are [`Self::buffers`].
    pub fn shader(&self, text: &str) -> String {
        [self.constants.as_str(), include_str!("rays.wgsl"), text].concat()
    }

    /// Nodes and triangles, bound at 0 and 1.
    pub fn buffers(&self) -> [&wgpu::Buffer; 2] {
        [&self.nodes, &self.blocks]
    }

    /// A distance in single precision, no more than shaders take.
    pub fn distance(mm: f64) -> f32 {
        mm.min(f64::from(FAR)) as f32
    }
}
