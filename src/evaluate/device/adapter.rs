//! Graphics adapters: one device, its limits and its errors.

use std::sync::{Arc, Mutex, PoisonError};

use wgpu::util::DeviceExt;

use crate::error::{Error, Result};

/// Advice where there is no adapter, a part of every message about it.
const WITHOUT: &str = "the CPU does the same with --device cpu";

/// An opened adapter.
pub struct Device {
    /// The device's calls.
    pub device: wgpu::Device,
    /// Queue to which work is submitted.
    pub queue: wgpu::Queue,
    /// Name, kind and backend of the adapter.
    pub info: wgpu::AdapterInfo,
    first_error: Arc<Mutex<Option<String>>>,
}

impl Device {
    /// Opens a device without a window.
    ///
    /// # Errors
    /// No adapter, or one that refuses (exit 5).
    pub fn open() -> Result<Arc<Self>> {
        Self::open_limited(u64::MAX)
    }

    /// Like [`Self::open`], with storage bindings of at most this many bytes, as other adapters have them.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_limited(largest_binding: u64) -> Result<Arc<Self>> {
        let with = |backends| {
            let descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
            let descriptor = wgpu::InstanceDescriptor { backends, ..descriptor }.with_env();
            Self::request(&wgpu::Instance::new(descriptor), None, largest_binding)
        };
        // OpenGL only where there is nothing else: looking for it without a display writes complaints to standard error.
        with(wgpu::Backends::PRIMARY).or_else(|_| with(wgpu::Backends::all()))
    }

    /// Opens a device that can present to a surface, where one is given.
    ///
    /// # Errors
    /// No adapter, or one that refuses (exit 5).
    pub fn open_for(instance: &wgpu::Instance, surface: Option<&wgpu::Surface>) -> Result<Arc<Self>> {
        Self::request(instance, surface, u64::MAX)
    }

    fn request(instance: &wgpu::Instance, surface: Option<&wgpu::Surface>, largest_binding: u64) -> Result<Arc<Self>> {
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: surface,
            ..Default::default()
        };
        let adapter = pollster::block_on(instance.request_adapter(&options))
            .map_err(|e| Error::unsupported(format!("no graphics adapter: {e}; {WITHOUT}")))?;
        let info = adapter.get_info();
        let mut limits = adapter.limits();
        limits.max_storage_buffer_binding_size = limits.max_storage_buffer_binding_size.min(largest_binding);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("translux"),
            required_features: adapter.features() & wgpu::Features::POLYGON_MODE_LINE,
            required_limits: limits,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| Error::unsupported(format!("the graphics adapter {} refuses: {e}; {WITHOUT}", info.name)))?;
        let first_error = Arc::new(Mutex::new(None));
        let slot = Arc::clone(&first_error);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            slot.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| error.to_string());
        }));
        Ok(Arc::new(Self { device, queue, info, first_error }))
    }

    /// Name, kind and backend of the adapter.
    pub fn describe(&self) -> String {
        let kind = if self.is_software() { "software" } else { "graphics" };
        format!("{} ({kind} adapter, {})", self.info.name, self.info.backend)
    }

    /// Returns whether the adapter is software that runs on the processor.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Largest storage binding in bytes.
    pub fn largest_binding(&self) -> u64 {
        let limits = self.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// Returns the first error since the device was opened, as exit 4.
    ///
    /// # Errors
    /// The first error.
    pub fn check(&self) -> Result<()> {
        match self.first_error.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            None => Ok(()),
            Some(error) => Err(self.lost(error)),
        }
    }

    fn lost(&self, error: impl std::fmt::Display) -> Error {
        Error::runtime(format!("{}: {error}; {WITHOUT}", self.info.name))
    }

    /// A storage buffer with these contents; never empty.
    ///
    /// # Errors
    /// More bytes than the adapter binds (exit 5).
    pub fn storage<T: bytemuck::NoUninit>(&self, label: &str, values: &[T]) -> Result<wgpu::Buffer> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        self.check_size(label, bytes.len() as u64)?;
        // Room for one element of any type.
        let zero = [0u8; 64];
        Ok(self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(label),
            contents: if bytes.is_empty() { &zero } else { bytes },
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
        }))
    }

    /// A storage buffer of zeros.
    ///
    /// # Errors
    /// More bytes than the adapter binds (exit 5).
    pub fn zeros(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        self.check_size(label, bytes)?;
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(64).next_multiple_of(16),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        }))
    }

    fn check_size(&self, label: &str, bytes: u64) -> Result<()> {
        if bytes <= self.largest_binding() {
            return Ok(());
        }
        Err(Error::unsupported(format!(
            "{label}: {} KiB where {} binds {} KiB at most; {WITHOUT}",
            bytes.div_ceil(1024),
            self.info.name,
            self.largest_binding() / 1024
        )))
    }

    /// The first `bytes` of a buffer, once all that was submitted is done.
    ///
    /// # Errors
    /// A device that is lost or out of memory (exit 4).
    pub fn read(&self, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>> {
        self.read_at(buffer, 0, bytes)
    }

    /// As [`Self::read`], from an offset that is a multiple of four.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_at(&self, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> Result<Vec<u8>> {
        let size = bytes.next_multiple_of(4).max(4);
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, offset, &staging, 0, size);
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| self.lost(e))?;
        self.check()?;
        receiver.recv().map_err(|e| self.lost(e))?.map_err(|e| self.lost(e))?;
        let view = staging.get_mapped_range(..).map_err(|e| self.lost(e))?;
        let mut result = view.to_vec();
        drop(view);
        result.truncate(bytes as usize);
        Ok(result)
    }

    /// Waits until all that was submitted is done.
    ///
    /// # Errors
    /// A device that is lost or out of memory (exit 4).
    pub fn wait(&self) -> Result<()> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| self.lost(e))?;
        self.check()
    }
}
