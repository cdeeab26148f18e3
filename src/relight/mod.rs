//! Relighting in real time: a window, and the same frames without one. Evaluators are used through their traits only.

pub mod choice;
pub mod files;
pub mod headless;
pub mod lights;
pub mod orbit;
#[cfg(feature = "gpu")]
pub mod raster;
pub mod timings;
#[cfg(feature = "gui")]
pub mod window;
