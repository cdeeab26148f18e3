//! Draws a scene from the radiosity in a device's memory, without reading it back: exit radiance as in the renderer,
//! reflections of the lights, and the background.

pub mod canvas;
mod corners;
mod environment;
mod lit;
mod memory;
mod pattern;
pub mod picture;
mod pipelines;
pub(crate) mod shadows;
mod shown;
pub mod view;

use std::sync::Arc;

use glam::DVec3;

use self::canvas::{Canvas, Finish};
use self::corners::{corners, wires};
use self::lit::{ALBEDO_STEPS, Environments, Lamp, albedos, constant, lamps};
use self::memory::{filled, sampler};
use self::pattern::Pattern;
use self::pipelines::{Bound, Pipelines, layout};
use self::view::{Look, View, ViewUniform, finite, finite3};
use crate::error::Result;
use crate::evaluate::{DeviceEvaluator, device::Device};
use crate::light::Light;
use crate::medium::fresnel::transmittance;
use crate::medium::material::Medium;
use crate::render::background::Background;
use crate::render::exit::{ExitFresnel, ExitRadiance};
use crate::render::frame::Specular;
use crate::render::highlight::HighlightShape;
use crate::render::texture::Texture;

pub use self::shown::Shown;

/// A scene on a device, prepared for drawing.
pub struct Raster {
    device: Arc<Device>,
    layout: wgpu::BindGroupLayout,
    pipelines: Vec<Pipelines>,
    origin_mm: DVec3,
    bounds_mm: [DVec3; 2],
    index_count: u32,
    corners: wgpu::Buffer,
    indices: wgpu::Buffer,
    wires: wgpu::Buffer,
    bound: Bound,
    lights: Vec<Light>,
    /// The media and the reflection of the current tables.
    made_for: Option<(Vec<Medium>, Specular)>,
    bindings: wgpu::BindGroup,
}

impl Raster {
    /// Prepares the scene of an evaluator for drawing with these finishes.
    ///
    /// # Errors
    /// A mesh that the adapter has no room for (exit 5), a lost device (exit 4).
    pub fn new(evaluator: &dyn DeviceEvaluator, finishes: &[Finish]) -> Result<Self> {
        let device = Arc::clone(evaluator.held().device);
        let scene = evaluator.scene();
        let layout = layout(&device);
        let pipelines = finishes.iter().map(|finish| Pipelines::new(&device, &layout, *finish)).collect();
        let usage = |usage| wgpu::BufferUsages::COPY_DST | usage;
        let (vertices, triangles) = corners(scene, evaluator.held().receiver_of_vertex);
        let corners = filled(&device, "corners", &vertices, usage(wgpu::BufferUsages::VERTEX))?;
        let indices = filled(&device, "triangles", &triangles, usage(wgpu::BufferUsages::INDEX))?;
        let wires = filled(&device, "wires", &wires(&triangles), usage(wgpu::BufferUsages::INDEX))?;
        let bound = Bound {
            shown: Shown::new(evaluator)?,
            errors: device.zeros("errors", scene.mesh.local_mm.len() as u64 * 4)?,
            media: device.zeros("media", scene.media.len() as u64 * 16)?,
            albedo: device.zeros("reflected shares", (scene.media.len() * ALBEDO_STEPS) as u64 * 4)?,
            lamps: device.storage("lamps", &[Lamp::default()])?,
            uniform: filled(&device, "view", &[ViewUniform::default()], usage(wgpu::BufferUsages::UNIFORM))?,
            wrap: sampler(&device, "environment", wgpu::AddressMode::ClampToEdge),
            // Black, for lights without an environment.
            environments: Environments::of(&device, Vec::new(), HighlightShape::default()),
            pattern: Pattern::new(&device)?,
        };
        let bindings = bound.group(&device, &layout);
        device.check()?;
        Ok(Self {
            layout,
            pipelines,
            origin_mm: scene.mesh.origin_mm,
            bounds_mm: scene.mesh.bounds_local_mm(),
            index_count: triangles.len() as u32,
            corners,
            indices,
            wires,
            bound,
            lights: Vec::new(),
            made_for: None,
            bindings,
            device,
        })
    }

    /// The device.
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// The copy of radiosity and visibility that is drawn; evaluators publish to it.
    pub fn shown(&self) -> &Shown {
        &self.bound.shown
    }

    /// Replaces the media and the reflection; cheap where nothing changed.
    pub fn set_media(&mut self, media: &[Medium], specular: Specular) {
        let same = self.made_for.as_ref().is_some_and(|(m, g)| m == media && *g == specular);
        if same {
            return;
        }
        let mut rows: Vec<[f32; 4]> = Vec::with_capacity(media.len());
        let mut shares: Vec<f32> = Vec::with_capacity(media.len() * ALBEDO_STEPS);
        for medium in media {
            let eta = medium.properties.eta_inside_over_outside;
            let exit = ExitRadiance::new(eta, ExitFresnel::Normalised);
            let straight = transmittance(eta, 1.0);
            let scale_per_sr = if straight > 0.0 { exit.per_radiosity(1.0) / straight } else { 0.0 };
            rows.push([eta as f32, finite(scale_per_sr), shares.len() as f32, 0.0]);
            shares.extend(albedos(specular.highlight(eta)));
        }
        // The buffers are as long as the scene has media; more would have no part.
        let fits = |buffer: &wgpu::Buffer, bytes: usize| bytes as u64 <= buffer.size();
        if fits(&self.bound.media, rows.len() * 16) && fits(&self.bound.albedo, shares.len() * 4) {
            self.device.queue.write_buffer(&self.bound.media, 0, bytemuck::cast_slice(&rows));
            self.device.queue.write_buffer(&self.bound.albedo, 0, bytemuck::cast_slice(&shares));
        }
        let shape = specular.shape().unwrap_or(self.bound.environments.shape);
        if self.bound.environments.update(&self.device, &self.lights, shape) {
            self.bindings = self.bound.group(&self.device, &self.layout);
        }
        self.made_for = Some((media.to_vec(), specular));
    }

    /// Replaces the lights that are reflected and visible.
    ///
    /// # Errors
    /// More lights than the adapter binds (exit 5).
    pub fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        let lamps = lamps(lights, self.origin_mm);
        let shape = self.bound.environments.shape;
        let mut stale = self.bound.environments.update(&self.device, lights, shape);
        let bytes: &[u8] = bytemuck::cast_slice(&lamps);
        if bytes.len() as u64 > self.bound.lamps.size() {
            self.bound.lamps = self.device.storage("lamps", &lamps)?;
            stale = true;
        } else if !lamps.is_empty() {
            self.device.queue.write_buffer(&self.bound.lamps, 0, bytes);
        }
        self.lights = lights.to_vec();
        if stale {
            self.bindings = self.bound.group(&self.device, &self.layout);
        }
        Ok(())
    }

    /// Replaces the texture; each view decides whether it is shown.
    ///
    /// # Errors
    /// More materials than the adapter binds (exit 5), a lost device (exit 4).
    pub fn set_texture(&mut self, texture: Option<&Texture>) -> Result<()> {
        self.bound.pattern.set(&self.device, texture)?;
        self.bindings = self.bound.group(&self.device, &self.layout);
        self.device.check()
    }

    /// Replaces the errors of the error view, one for each source vertex.
    pub fn set_errors(&self, errors: &[f32]) {
        if !errors.is_empty() && size_of_val(errors) as u64 <= self.bound.errors.size() {
            self.device.queue.write_buffer(&self.bound.errors, 0, bytemuck::cast_slice(errors));
        }
    }

    /// Draws the state that was published last to the upper left corner of `target`, in the view's size; does nothing
    /// where the raster was not made for the finish of `canvas`.
    pub fn draw(&self, encoder: &mut wgpu::CommandEncoder, view: &View, canvas: &Canvas, target: &wgpu::TextureView) {
        let Some(pipelines) = self.pipelines.iter().find(|p| p.finish == canvas.finish) else { return };
        let uniform = self.uniform_of(view, canvas.finish.srgb);
        self.device.queue.write_buffer(&self.bound.uniform, 0, bytemuck::bytes_of(&uniform));
        let (drawn, resolved) = match &canvas.many {
            Some(many) => (many, Some(target)),
            None => (target, None),
        };
        let store = if resolved.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: drawn,
                depth_slice: None,
                resolve_target: resolved,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &canvas.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        let side = |view: usize, canvas: usize| view.min(canvas) as u32;
        let (whole, shown) = (canvas.resolution, view.resolution);
        let (width, height) = (side(shown.width, whole.width), side(shown.height, whole.height));
        pass.set_viewport(0.0, 0.0, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(0, 0, width, height);
        pass.set_bind_group(0, &self.bindings, &[]);
        pass.set_pipeline(&pipelines.surface);
        pass.set_vertex_buffer(0, self.corners.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..self.index_count, 0, 0..1);
        if view.wires {
            pass.set_pipeline(&pipelines.wire);
            pass.set_index_buffer(self.wires.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..2 * self.index_count, 0, 0..1);
        }
        // Last, so that what the object hides costs nothing; black is there already.
        let environments = view.background == Background::Environment && uniform.environment_count > 0;
        let is_black = canvas.finish.srgb && view.look != Look::Error && !environments && uniform.backdrop == [0.0; 3];
        if !is_black {
            pass.set_pipeline(&pipelines.beside);
            pass.draw(0..3, 0..1);
        }
    }

    fn uniform_of(&self, view: &View, srgb: bool) -> ViewUniform {
        let mut uniform = ViewUniform::new(view, srgb, self.origin_mm, self.bounds_mm);
        let constant = constant(&self.lights);
        (uniform.environments, uniform.environment_count) = self.bound.environments.uniforms(&self.lights);
        uniform.light_count = lamps(&self.lights, self.origin_mm).len() as u32;
        uniform.constant = finite3(constant);
        uniform.backdrop = match view.background {
            Background::Environment => finite3(constant),
            Background::None => [0.0; 3],
            Background::Colour(colour) => finite3(colour),
        };
        uniform
    }
}
