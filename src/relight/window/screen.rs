//! The window's surface, and the user interface on it.

use std::sync::Arc;

use winit::event_loop::ActiveEventLoop;
use winit::window::Window;

use crate::error::{Error, Result};
use crate::evaluate::device::Device;
use crate::relight::raster::Raster;
use crate::relight::raster::canvas::{Canvas, Finish};
use crate::relight::raster::view::View;
use crate::render::camera::Resolution;

/// Number of consecutive failed frames after which the window gives up.
const MAX_FAILURES: u32 = 60;

/// The surface of the window, with the textures and the user interface drawn to it.
pub(super) struct Screen {
    pub(super) window: Arc<Window>,
    pub(super) device: Arc<Device>,
    pub(super) finish: Finish,
    pub(super) context: egui::Context,
    pub(super) input: egui_winit::State,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    canvas: Canvas,
    painter: egui_wgpu::Renderer,
    failures: u32,
}

impl Screen {
    /// Opens a device for the window.
    ///
    /// # Errors
    /// No adapter that shows something in this window (exit 5).
    pub(super) fn new(event_loop: &ActiveEventLoop, window: Arc<Window>) -> Result<Self> {
        let handle = Box::new(event_loop.owned_display_handle());
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_with_display_handle_from_env(handle));
        let advice = "use --headless --frames N --out DIR, or `translux render`";
        let none =
            |e: &dyn std::fmt::Display| Error::unsupported(format!("nothing can be shown in a window ({e}); {advice}"));
        let surface = instance.create_surface(Arc::clone(&window)).map_err(|e| none(&e))?;
        let device = Device::open_for(&instance, Some(&surface))?;
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: Some(&surface),
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| none(&e))?;
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| none(&"the adapter has no format for it"))?;
        let formats = surface.get_capabilities(&adapter).formats;
        let plain = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
        config.format = plain.into_iter().find(|f| formats.contains(f)).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        surface.configure(&device.device, &config);
        // Measured: four samples cost a software adapter most of its frames.
        let samples = if device.is_software() { 1 } else { 4 };
        let finish = Finish { format: config.format, samples, srgb: !config.format.is_srgb() };
        let canvas = Canvas::new(&device, resolution(&config), finish)?;
        let context = egui::Context::default();
        context.set_visuals(egui::Visuals::dark());
        let most = device.device.limits().max_texture_dimension_2d as usize;
        let scale = Some(window.scale_factor() as f32);
        let viewport = egui::ViewportId::ROOT;
        let input = egui_winit::State::new(context.clone(), viewport, &window, scale, None, Some(most));
        let options = egui_wgpu::RendererOptions {
            msaa_samples: 1,
            depth_stencil_format: None,
            dithering: false,
            predictable_texture_filtering: false,
        };
        let painter = egui_wgpu::Renderer::new(&device.device, config.format, options);
        device.check()?;
        Ok(Self { window, device, finish, context, input, surface, config, canvas, painter, failures: 0 })
    }

    /// Size of the surface in pixels.
    pub(super) fn resolution(&self) -> Resolution {
        resolution(&self.config)
    }

    /// Resizes the surface.
    ///
    /// # Errors
    /// A size that the adapter does not support (exit 5).
    pub(super) fn resize(&mut self, width: u32, height: u32) -> Result<()> {
        let most = self.device.device.limits().max_texture_dimension_2d;
        (self.config.width, self.config.height) = (width.clamp(1, most), height.clamp(1, most));
        self.surface.configure(&self.device.device, &self.config);
        self.canvas = Canvas::new(&self.device, self.resolution(), self.finish)?;
        Ok(())
    }

    /// Draws the scene and the interface over it; returns whether there was a surface to draw to.
    ///
    /// # Errors
    /// A surface that is gone for good (exit 4).
    pub(super) fn draw(&mut self, raster: &Raster, view: &View, interface: egui::FullOutput) -> Result<bool> {
        let scale = interface.pixels_per_point;
        let shapes = self.context.tessellate(interface.shapes, scale);
        for (id, deltas) in &interface.textures_delta.set {
            for delta in deltas {
                self.painter.update_texture(&self.device.device, &self.device.queue, *id, delta);
            }
        }
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Timeout | wgpu::CurrentSurfaceTexture::Occluded => return Ok(false),
            _ => {
                self.failures += 1;
                if self.failures > MAX_FAILURES {
                    self.device.check()?;
                    return Err(Error::runtime("the window's surface is lost; start again"));
                }
                self.surface.configure(&self.device.device, &self.config);
                return Ok(false);
            }
        };
        self.failures = 0;
        let target = frame.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let device = &self.device;
        let mut encoder = device.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        raster.draw(&mut encoder, view, &self.canvas, &target);
        let size = egui_wgpu::ScreenDescriptor {
            size_in_pixels: [self.config.width, self.config.height],
            pixels_per_point: scale,
        };
        let mut commands = self.painter.update_buffers(&device.device, &device.queue, &mut encoder, &shapes, &size);
        let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("interface"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        self.painter.render(&mut pass.forget_lifetime(), &shapes, &size);
        commands.push(encoder.finish());
        device.queue.submit(commands);
        self.window.pre_present_notify();
        device.queue.present(frame);
        for id in &interface.textures_delta.free {
            self.painter.free_texture(id);
        }
        Ok(true)
    }
}

fn resolution(config: &wgpu::SurfaceConfiguration) -> Resolution {
    Resolution { width: config.width.max(1) as usize, height: config.height.max(1) as usize }
}
