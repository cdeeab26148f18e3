//! The encodings of Hao and Varshney 2004: values of every vertex under every light as they are, in one byte each, as spherical
//! harmonics, or as reference points with spherical harmonics of the differences. For comparison: `components` is smaller.

pub(super) mod bake;
mod codes;
pub(super) mod evaluate;
mod exact;
mod harmonics;
mod matrix;
mod prediction;
mod references;

use glam::Vec3;

use crate::hao::simplify::Input;
use translux::scene::Scene;
use translux::transport::receivers::Receivers;

/// Red, green, blue.
const CHANNELS: usize = 3;

/// The receivers as a mesh: what hangs together names the same ones.
struct Topology {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    triangle_part: Vec<u32>,
}

impl Topology {
    fn new(scene: &Scene, receivers: &Receivers) -> Self {
        let transfers = |part: u32| scene.parts.parts.get(part as usize).is_some_and(|p| p.transfers());
        let triangles = scene.mesh.triangles.iter().zip(&scene.parts.triangle_part);
        let some = triangles.filter(|(_, part)| transfers(**part));
        let of_vertex = |v: u32| receivers.of_vertex.get(v as usize).copied().unwrap_or(u32::MAX);
        let (triangles, triangle_part) = some.map(|(t, part)| (t.map(of_vertex), *part)).unzip();
        Self { positions: receivers.positions.iter().map(|p| p.as_vec3()).collect(), triangles, triangle_part }
    }

    fn input(&self) -> Input<'_> {
        Input { positions: &self.positions, triangles: &self.triangles, triangle_part: &self.triangle_part }
    }
}
