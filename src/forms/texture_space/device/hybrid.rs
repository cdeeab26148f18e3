//! The hybrid method on a device: the far part from shared samples by tables of any profile, the near part from an image of what the light sees.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::light::WORKGROUP;
use crate::error::{Error, Result};
use crate::evaluate::Held;
use crate::evaluate::device::Device;
use crate::evaluate::device::jobs::MOST_TURNS_OF_SOFTWARE;
use crate::evaluate::device::rays::RaysOnDevice;
use crate::evaluate::device::surface::{
    GpuTable, READ, UNIFORM, WRITE, bind, bind_group_layout, dispatch, pipeline, table_shader, uniform,
};
use crate::forms::texture_space::hybrid::STEPS;
use crate::forms::texture_space::map::medium_of;
use crate::forms::texture_space::settings::Local;
use crate::forms::texture_space::state::TextureSpaceEvaluator;
use crate::forms::texture_space::view::{Frame, From, LEAST_COSINE, plane};
use crate::light::Light;
use crate::transport::kernel::radial_table::SHIFT;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuView {
    u: [f32; 3],
    half: f32,
    v: [f32; 3],
    start: f32,
    towards: [f32; 3],
    is_point: u32,
    place: [f32; 3],
    pixels: u32,
    colour: [f32; 3],
    receivers: u32,
    middle: [f32; 2],
    rings: u32,
    of_ring: u32,
    axis: [f32; 3],
    edge: f32,
    full: f32,
    padding: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct GpuTriangle {
    plane: [f32; 4],
    part: u32,
    medium: u32,
    padding: [u32; 2],
}

/// Receivers and both parts of R_d.
pub(super) struct HybridOnDevice {
    device: Arc<Device>,
    settings: Local,
    receivers: usize,
    radiosity: wgpu::Buffer,
    /// Positions of the receivers, their parts and media, samples of each part.
    gathered: [wgpu::Buffer; 3],
    far: wgpu::ComputePipeline,
    of_far: [wgpu::BindGroupLayout; 2],
    far_tables: [wgpu::Buffer; 2],
    triangles: wgpu::Buffer,
    seen: wgpu::Buffer,
    /// Media, tables of the local part, circles.
    local: [wgpu::Buffer; 3],
    look: wgpu::ComputePipeline,
    nearby: wgpu::ComputePipeline,
    of_view: [wgpu::BindGroupLayout; 2],
}

fn single(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

impl HybridOnDevice {
    /// Uploads receivers, and triangles as the light sees them. `of_part` gives the samples of each part.
    ///
    /// # Errors
    /// More than the adapter binds (exit 5).
    pub(super) fn new(
        cpu: &TextureSpaceEvaluator,
        settings: &Local,
        (device, rays): (&Arc<Device>, &RaysOnDevice),
        of_part: impl Fn(usize) -> std::ops::Range<u32>,
    ) -> Result<Self> {
        let (scene, receivers) = (&cpu.scene, &cpu.receivers);
        let positions: Vec<[f32; 4]> = receivers.positions.iter().map(|p| p.as_vec3().extend(0.0).to_array()).collect();
        let mut owners = vec![[0u32; 2]; receivers.len()];
        for group in &receivers.groups {
            let medium = scene.parts.parts.get(group.part as usize).and_then(|part| part.medium);
            owners[group.run.range()].fill([group.part, medium.unwrap_or(0)]);
        }
        let parts: Vec<[u32; 2]> =
            (0..scene.parts.parts.len()).map(of_part).map(|range| [range.start, range.end]).collect();
        let triangle = |triangle: u32| {
            let (normal, distance) = plane(scene, triangle);
            GpuTriangle {
                plane: normal.extend(distance).as_vec4().to_array(),
                part: scene.parts.triangle_part.get(triangle as usize).copied().unwrap_or(u32::MAX),
                medium: medium_of(scene, triangle).unwrap_or(u32::MAX),
                padding: [0; 2],
            }
        };
        let triangles: Vec<GpuTriangle> = (0..scene.mesh.triangles.len() as u32).map(triangle).collect();
        let calls = &device.device;
        let of_far = [
            bind_group_layout(calls, "far part", &[READ, READ, READ, READ, READ, READ, WRITE]),
            bind_group_layout(calls, "turn", &[UNIFORM]),
        ];
        let far = pipeline(calls, &table_shader(SHIFT, include_str!("far.wgsl")), "far", of_far.each_ref());
        let of_view = [
            bind_group_layout(calls, "view", &[READ, READ, READ, READ, WRITE, READ, WRITE, READ, READ, READ]),
            bind_group_layout(calls, "light's view", &[UNIFORM]),
        ];
        let constants =
            format!("const LEAST_COSINE: f32 = {:?};\nconst TABLE: u32 = {}u;\n", LEAST_COSINE as f32, STEPS + 1);
        let text = rays.shader(&[&constants, include_str!("view.wgsl")].concat());
        let [look, nearby] = ["look", "nearby"].map(|entry| pipeline(calls, &text, entry, of_view.each_ref()));
        let seen = device.zeros("what the light sees", 16 * u64::from(settings.image).pow(2))?;
        let radiosity = device.zeros("radiosity", 16 * receivers.len() as u64)?;
        let gathered = [
            device.storage("receivers", &positions)?,
            device.storage("parts of the receivers", &owners)?,
            device.storage("samples of the parts", &parts)?,
        ];
        let none = || device.zeros("tables", 16);
        let mut result = Self {
            device: Arc::clone(device),
            settings: *settings,
            receivers: receivers.len(),
            radiosity,
            gathered,
            far,
            of_far,
            far_tables: [none()?, none()?],
            triangles: device.storage("triangles", &triangles)?,
            seen,
            local: [none()?, none()?, none()?],
            look,
            nearby,
            of_view,
        };
        device.check()?;
        result.set_media(cpu)?;
        Ok(result)
    }

    /// Takes the media in force.
    ///
    /// # Errors
    /// Tables beyond the adapter's bindings (exit 5).
    pub(super) fn set_media(&mut self, cpu: &TextureSpaceEvaluator) -> Result<()> {
        let missing = || Error::runtime("the hybrid method without its division of R_d");
        let (division, kernels) = cpu.division().ok_or_else(missing)?;
        let (mut tables, mut segments) = (Vec::new(), Vec::new());
        for (kernel, _) in kernels.media() {
            let table = kernel.by_tables(cpu.scene.mesh.diagonal_mm()).single;
            tables.push(GpuTable::append(&table, &mut segments));
        }
        let (mut media, mut local, mut circles) = (Vec::new(), Vec::new(), Vec::new());
        for (part, medium) in division.parts.iter().zip(&cpu.scene.media) {
            let eta = medium.properties.eta_inside_over_outside;
            media.push([eta as f32, ((eta - 1.0) * (eta + 1.0)) as f32, part.step_mm as f32, STEPS as f32]);
            local.extend(part.table.iter().map(|value| value.as_vec3().extend(0.0).to_array()));
            circles.extend(part.circles.iter().map(|(radius, density)| [*radius as f32, *density as f32]));
        }
        let segments: &[[f32; 4]] = segments.as_flattened();
        let device = &self.device;
        self.far_tables = [device.storage("tables", &tables)?, device.storage("segments", segments)?];
        self.local = [
            device.storage("media", &media)?,
            device.storage("local part", &local)?,
            device.storage("circles", &circles)?,
        ];
        Ok(())
    }

    /// Enqueues the radiosity of every receiver over the unit of irradiance.
    ///
    /// # Errors
    /// Lights that have no view.
    pub(super) fn run(
        &self,
        (cpu, lights): (&TextureSpaceEvaluator, &[Light]),
        (rays, samples, unit): (&RaysOnDevice, &wgpu::Buffer, f64),
    ) -> Result<()> {
        let calls = &self.device.device;
        let groups = self.receivers.div_ceil(WORKGROUP) as u32;
        let [receivers, owners, parts] = &self.gathered;
        let [tables, segments] = &self.far_tables;
        let first =
            bind(calls, &self.of_far[0], [receivers, owners, parts, samples, tables, segments, &self.radiosity]);
        let (most, of_part) = (MOST_TURNS_OF_SOFTWARE as u32, cpu.numbers.count);
        for before in (0..of_part.max(1)).step_by(most as usize) {
            let turn = [before, most.min(of_part - before), self.receivers as u32, 0];
            let turn = bind(calls, &self.of_far[1], [&uniform(calls, "turn", bytemuck::cast_slice(&turn))]);
            dispatch(&self.device, &self.far, &first, [&(turn, groups)]);
        }
        let [tree, blocks] = rays.buffers();
        let [media, local, circles] = &self.local;
        let bound =
            [tree, blocks, media, &self.triangles, &self.seen, receivers, &self.radiosity, local, circles, owners];
        let first = bind(calls, &self.of_view[0], bound);
        for light in lights {
            let view = self.view(&Frame::new(&cpu.scene, light, &self.settings)?, unit);
            let view = bind(calls, &self.of_view[1], [&uniform(calls, "view", bytemuck::bytes_of(&view))]);
            let pixels = (self.settings.image as usize).pow(2).div_ceil(WORKGROUP) as u32;
            dispatch(&self.device, &self.look, &first, [&(view.clone(), pixels)]);
            dispatch(&self.device, &self.nearby, &first, [&(view, groups)]);
        }
        self.device.check()
    }

    fn view(&self, frame: &Frame, unit: f64) -> GpuView {
        let Frame { from, colour, falloff, axes: [u, v, towards], middle, half, start, pixels } = *frame;
        let [edge, full] = falloff.versines();
        let (place, is_point) = match from {
            From::Direction(direction) => (direction, 0),
            From::Place(place) => (place, 1),
        };
        GpuView {
            u: single(u),
            half: half as f32,
            v: single(v),
            start: start as f32,
            towards: single(towards),
            is_point,
            place: single(place),
            pixels,
            colour: single(colour / unit),
            receivers: self.receivers as u32,
            middle: middle.map(|x| x as f32),
            rings: self.settings.rings,
            of_ring: self.settings.of_ring,
            axis: single(falloff.axis),
            edge,
            full,
            padding: [0; 3],
        }
    }

    /// The radiosity as that of an evaluator.
    pub(super) fn held<'a>(&'a self, cpu: &'a TextureSpaceEvaluator, unit: f64) -> Held<'a> {
        let (device, radiosity) = (&self.device, &self.radiosity);
        Held { device, radiosity, scale: unit, receiver_of_vertex: &cpu.receivers.of_vertex }
    }
}
