//! `gathered`: nothing is stored but surface samples. Light reaches the samples by ray casting, or through stored rows where it comes
//! from far away, and is summed at the receivers for each light: over all pairs, through a hierarchy, or over nets.

mod bake;
#[cfg(feature = "gpu")]
mod double_gpu;
mod errors;
mod evaluator;
mod forecast;
#[cfg(feature = "gpu")]
mod hierarchy_gpu;
mod lit_samples;
pub(crate) mod model;
#[cfg(feature = "gpu")]
mod near_gpu;
#[cfg(feature = "gpu")]
mod nets_gpu;
#[cfg(feature = "gpu")]
mod on_device;
mod settings;

#[cfg(feature = "gpu")]
pub use self::hierarchy_gpu::GATHER_SHADER;
pub use self::lit_samples::GatheredEvaluator;
pub use self::model::uncalibrated;
pub use self::settings::{Bound, Far, Gathered, Gathering};
