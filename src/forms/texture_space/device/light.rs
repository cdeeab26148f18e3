//! Light in the texels and the mip-map over them, on a device: rays for shadows, then sums level by level.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::error::Result;
use crate::evaluate::device::Device;
use crate::evaluate::device::rays::RaysOnDevice;
use crate::evaluate::device::surface::{READ, UNIFORM, WRITE, bind, bind_group_layout, dispatch, pipeline, uniform};
use crate::forms::texture_space::kept::{BLOCK, SHARE};
use crate::forms::texture_space::light::{Flux, Walked};
use crate::forms::texture_space::map::medium_of;
use crate::forms::texture_space::state::TextureSpaceEvaluator;
use crate::geometry::bvh::offset_origin;
use crate::light::{Light, LightKind};
use crate::medium::material::Medium;
use crate::transport::balanced_tree::power_of_two_near;
use crate::transport::irradiance::packed::{
    ENTRANCE_STEPS, Entrance, OF_STRATUM, PackedLight, PackedRectangle, PackedStratum, packed, turns,
};

/// Invocations of a workgroup.
pub(super) const WORKGROUP: usize = 64;

/// Text of the structure of a node.
pub(super) const NODE: &str = include_str!("node.wgsl");

/// Rays of an invocation: software adapters end its loops after some 65,000 turns, and desktops long dispatches.
const RAYS_OF_SOFTWARE: u32 = 16;
const RAYS_OF_HARDWARE: u32 = 256;

/// Directional and point lights are of no larger kind.
const MOST_OF_SHARP: u32 = 1;

/// Nearest distance of a point light from a surface over the diagonal, for the unit of irradiance.
const NEAREST: f64 = 1e-3;

/// Numbers of an [`Entrance`] in the shader, in vectors of four.
const OF_ENTRANCE: usize = (4 + ENTRANCE_STEPS + 1).next_multiple_of(4);

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuPoint {
    at: [f32; 3],
    area: f32,
    normal: [f32; 3],
    spread: f32,
    origin: [f32; 3],
    triangle: u32,
    turns: [f32; 2],
    medium: u32,
    padding: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Default, Pod, Zeroable)]
struct GpuLight {
    kind: u32,
    first: u32,
    end: u32,
    count: u32,
    colour: [f32; 3],
    points: u32,
    place: [f32; 3],
    side: u32,
    u: [f32; 3],
    width: f32,
    v: [f32; 3],
    height: f32,
    normal: [f32; 3],
    key: [u32; 2],
    frame: u32,
    padding: [u32; 2],
}

/// Patches, the hierarchy over them and the triangles that cast shadows, on a device.
pub(super) struct LightOnDevice {
    device: Arc<Device>,
    points: usize,
    diagonal_mm: f64,
    bounds_mm: [DVec3; 2],
    irradiance: wgpu::Buffer,
    nodes: wgpu::Buffer,
    /// Triangles, points, entrances, irradiance.
    shone: [wgpu::Buffer; 3],
    rays: RaysOnDevice,
    shine: wgpu::ComputePipeline,
    keep: wgpu::ComputePipeline,
    /// What is known of the patches under each light that moves.
    kept: Vec<(LightKind, wgpu::Buffer)>,
    frame: u32,
    layouts: [wgpu::BindGroupLayout; 2],
    up: wgpu::ComputePipeline,
    summed: wgpu::BindGroup,
    levels: Vec<(wgpu::BindGroup, u32)>,
}

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

impl LightOnDevice {
    /// Uploads what light falls on. The irradiance of every patch, RGB and 0, is written to `irradiance`.
    ///
    /// # Errors
    /// More texels or triangles than the adapter binds (exit 5).
    pub(super) fn new(
        cpu: &TextureSpaceEvaluator,
        device: &Arc<Device>,
        rays: RaysOnDevice,
        irradiance: wgpu::Buffer,
    ) -> Result<Self> {
        let (scene, map) = (&cpu.scene, &cpu.map);
        let points: Vec<GpuPoint> = (map.patches.iter().enumerate())
            .map(|(index, patch)| GpuPoint {
                at: single(patch.centre_mm),
                area: patch.area_mm2 as f32,
                normal: single(patch.normal),
                spread: patch.spread_mm2 as f32,
                origin: offset_origin(patch.centre_mm.as_vec3(), patch.normal.as_vec3()).to_array(),
                triangle: patch.triangle,
                turns: turns(index),
                medium: medium_of(scene, patch.triangle).unwrap_or(u32::MAX),
                padding: 0,
            })
            .collect();
        let walked: Vec<Walked> = map.nodes.iter().map(|node| Walked::new(node, &Flux::default())).collect();
        let (order, levels) = map.levels();
        let [low, high] = scene.mesh.bounds_local_mm();
        let calls = &device.device;
        let points_buffer = device.storage("points of the texels", &points)?;
        let nodes = device.storage("nodes over the texels", &walked)?;
        let order = device.storage("order of the nodes", &order)?;
        let first = bind_group_layout(calls, "points", &[READ, READ, READ, READ, WRITE]);
        let second = bind_group_layout(calls, "light", &[UNIFORM, READ, WRITE]);
        let constants = format!(
            "const ENTRANCE_NUMBERS: u32 = {}u;
const STRATUM_BITS: u32 = {}u;
const BLOCK: u32 = {BLOCK}u;
const SHARE: u32 = {SHARE}u;
",
            ENTRANCE_STEPS + 1,
            OF_STRATUM.ilog2()
        );
        let text = rays.shader(&[&constants, include_str!("light.wgsl")].concat());
        let [shine, keep] = ["shine", "keep"].map(|entry| pipeline(calls, &text, entry, [&first, &second]));
        let of_nodes = bind_group_layout(calls, "mip-map", &[READ, READ, READ, WRITE]);
        let of_level = bind_group_layout(calls, "level", &[UNIFORM]);
        let up = pipeline(calls, &[NODE, include_str!("mipmap.wgsl")].concat(), "up", [&of_nodes, &of_level]);
        let summed = bind(calls, &of_nodes, [&points_buffer, &irradiance, &order, &nodes]);
        let level = |range: &std::ops::Range<u32>| {
            let buffer = uniform(calls, "level", bytemuck::cast_slice(&[range.start, range.end, 0, 0]));
            (bind(calls, &of_level, [&buffer]), (range.end - range.start).div_ceil(WORKGROUP as u32))
        };
        let levels = levels.iter().map(level).collect();
        device.check()?;
        let mut result = Self {
            device: Arc::clone(device),
            points: points.len(),
            diagonal_mm: scene.mesh.diagonal_mm(),
            bounds_mm: [low, high],
            shone: [points_buffer, device.zeros("entrances", 16)?, irradiance.clone()],
            irradiance,
            nodes,
            rays,
            shine,
            keep,
            kept: Vec::new(),
            // The first one is number 0, as on the processor.
            frame: u32::MAX,
            layouts: [first, second],
            up,
            summed,
            levels,
        };
        result.set_media(&scene.media)?;
        Ok(result)
    }

    /// Replaces the media that light enters.
    ///
    /// # Errors
    /// More media than the adapter binds (exit 5).
    pub(super) fn set_media(&mut self, media: &[Medium]) -> Result<()> {
        let mut packed: Vec<f32> = Vec::new();
        for medium in media {
            let Entrance { eta, whole, cosines } = Entrance::new(medium.properties.eta_inside_over_outside);
            packed.extend([eta as f32, ((eta - 1.0) * (eta + 1.0)) as f32, whole as f32, 0.0]);
            packed.extend(cosines);
            packed.resize(packed.len().next_multiple_of(OF_ENTRANCE), 0.0);
        }
        self.shone[1] = self.device.storage("entrances", &packed)?;
        Ok(())
    }

    /// Irradiance of every patch over the unit, RGB and 0.
    #[cfg(test)]
    pub(super) fn irradiance(&self) -> &wgpu::Buffer {
        &self.irradiance
    }

    /// The nodes and their light.
    pub(super) fn nodes(&self) -> &wgpu::Buffer {
        &self.nodes
    }

    /// Triangles for rays.
    pub(super) fn rays(&self) -> &RaysOnDevice {
        &self.rays
    }

    /// Enqueues the light in the texels and the nodes; of lights that have moved, what was seen of them before is kept. Returns the unit that
    /// irradiance is over.
    ///
    /// # Errors
    /// Lights that cannot be served.
    pub(super) fn run(&mut self, lights: &[Light], cpu: &TextureSpaceEvaluator, have_moved: bool) -> Result<f64> {
        let packed = packed(lights, cpu.scene.mesh.origin_mm, cpu.rays())?;
        let unit = power_of_two_near(packed.iter().map(|light| self.brightest(light)).sum());
        self.remember(lights, have_moved)?;
        let calls = &self.device.device;
        let mut encoder = calls.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&self.irradiance, 0, None);
        self.device.queue.submit([encoder.finish()]);
        let [tree, blocks] = self.rays.buffers();
        let [points, entrances, irradiance] = &self.shone;
        let first = bind(calls, &self.layouts[0], [tree, blocks, points, entrances, irradiance]);
        let most = if self.device.is_software() { RAYS_OF_SOFTWARE } else { RAYS_OF_HARDWARE };
        let nothing = self.device.zeros("sights", 4)?;
        let mut kept = self.kept.iter();
        for light in &packed {
            let (light, candidates) = gpu_light(light, self.points, unit);
            let candidates = self.device.storage("candidates", &candidates)?;
            let keeps = if have_moved && light.kind <= MOST_OF_SHARP { kept.next() } else { None };
            let (pipeline, of_group) = if keeps.is_some() { (&self.keep, BLOCK) } else { (&self.shine, WORKGROUP) };
            for first_ray in (0..light.count).step_by(most as usize) {
                let end = (first_ray + most).min(light.count);
                let part = GpuLight { first: first_ray, end, frame: self.frame, ..light };
                let part = uniform(calls, "light", bytemuck::bytes_of(&part));
                let sights = keeps.map_or(&nothing, |(_, sights)| sights);
                let second = bind(calls, &self.layouts[1], [&part, &candidates, sights]);
                dispatch(&self.device, pipeline, &first, [&(second, self.points.div_ceil(of_group) as u32)]);
            }
        }
        dispatch(&self.device, &self.up, &self.summed, &self.levels);
        self.device.check()?;
        Ok(unit)
    }

    /// Makes room for what is known of the patches, or forgets it.
    fn remember(&mut self, lights: &[Light], have_moved: bool) -> Result<()> {
        if !have_moved {
            self.kept.clear();
            return Ok(());
        }
        self.frame = self.frame.wrapping_add(1);
        let kinds: Vec<LightKind> = lights.iter().filter(|light| light.is_sharp()).map(Light::kind).collect();
        if !self.kept.iter().map(|(kind, _)| *kind).eq(kinds.iter().copied()) {
            let unknown = |kind| Ok((kind, self.device.zeros("sights", 4 * self.points as u64)?));
            self.kept = kinds.into_iter().map(unknown).collect::<Result<_>>()?;
        }
        Ok(())
    }

    /// About the brightest irradiance that a light may bring.
    fn brightest(&self, light: &PackedLight) -> f64 {
        let pi = std::f64::consts::PI;
        let brightest = match light {
            PackedLight::Directional(_, irradiance) => *irradiance,
            PackedLight::Point(at, intensity, _) => {
                let [low, high] = self.bounds_mm;
                let distance = at.distance(at.clamp(low, high)).max(NEAREST * self.diagonal_mm);
                *intensity / (distance * distance)
            }
            PackedLight::Constant(radiance, _) => pi * *radiance,
            PackedLight::Area(light) => pi * light.radiance,
            PackedLight::Environment(strata) => {
                strata.iter().filter_map(|stratum| stratum.candidates.first()).map(|(_, weight)| *weight).sum()
            }
        };
        brightest.max_element()
    }
}

/// A light as the shader takes it, and the candidates of an environment; over a unit of irradiance.
fn gpu_light(light: &PackedLight, points: usize, unit: f64) -> (GpuLight, Vec<[f32; 4]>) {
    let mut candidates = Vec::new();
    let of = GpuLight { points: points as u32, count: 1, ..GpuLight::default() };
    let light = match light {
        PackedLight::Directional(from, irradiance) => {
            GpuLight { kind: 0, colour: single(*irradiance / unit), place: single(*from), ..of }
        }
        PackedLight::Point(at, intensity, falloff) => {
            let [edge, full] = falloff.versines();
            let (colour, place, u) = (single(*intensity / unit), single(*at), single(falloff.axis));
            GpuLight { kind: 1, colour, place, u, width: edge, height: full, ..of }
        }
        PackedLight::Constant(radiance, count) => {
            GpuLight { kind: 2, colour: single(*radiance / unit), count: *count, ..of }
        }
        PackedLight::Area(PackedRectangle { corner, axes: [u, v, normal], size_mm, radiance, side, key }) => GpuLight {
            kind: 3,
            count: side * side,
            colour: single(*radiance / unit),
            place: single(*corner),
            side: *side,
            u: single(*u),
            width: size_mm[0] as f32,
            v: single(*v),
            height: size_mm[1] as f32,
            normal: single(*normal),
            key: [*key as u32, (*key >> 32) as u32],
            ..of
        },
        PackedLight::Environment(strata) => {
            for PackedStratum { candidates: own, shift } in strata {
                for (direction, weight) in own {
                    candidates.push(direction.as_vec3().extend(*shift as f32).to_array());
                    candidates.push((*weight / unit).as_vec3().extend(0.0).to_array());
                }
            }
            GpuLight { kind: 4, count: strata.len() as u32, ..of }
        }
    };
    (light, candidates)
}
