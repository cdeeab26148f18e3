//! The open window with the evaluator, the raster and the threads that work for it.

use std::sync::Arc;

use crate::relight::raster::Raster;
use crate::relight::window::colours::Colours;
use crate::relight::window::desk::Desk;
use crate::relight::window::jobs::Jobs;
use crate::relight::window::screen::Screen;
use crate::relight::window::worker::Worker;
use crate::render::texture::Texture;

/// The open window: the screen, its worker threads, and the state that the user changes.
pub(super) struct Shown {
    pub(super) screen: Screen,
    pub(super) staged: Staged,
    /// Workers of evaluators that were replaced, until their last state is computed.
    pub(super) retired: Vec<Worker>,
    pub(super) colours: Colours,
    pub(super) jobs: Jobs,
    pub(super) desk: Desk,
    pub(super) texture: Option<Arc<Texture>>,
    pub(super) follows_eye: bool,
    /// Whether better kernels are on their way.
    pub(super) is_rough: bool,
}

/// An evaluator with its worker and its raster.
pub(super) struct Staged {
    pub(super) raster: Raster,
    pub(super) worker: Worker,
    pub(super) transport: String,
    pub(super) vertices: usize,
    pub(super) samples: usize,
}

impl Shown {
    /// Replaces the working evaluator.
    pub(super) fn put(&mut self, staged: Staged) {
        // To wait for what it does now would hold up the picture.
        let mut before = std::mem::replace(&mut self.staged, staged);
        before.worker.retire();
        self.retired.push(before.worker);
    }
}
