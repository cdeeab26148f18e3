//! From an opened asset and lights to radiosity: the traits of methods, forms and evaluators.

pub mod blocks;
pub mod capabilities;
#[cfg(feature = "gpu")]
pub mod device;
pub mod division;
pub mod evaluator;
pub mod exitance;
pub mod finer;
pub mod forecast;
pub mod form;
pub(crate) mod forward;
mod guarded;
pub mod inter_reflection;
pub mod keys;
pub mod measured;
pub mod memory;
pub mod method;
mod model_error;
pub mod sampling_error;
pub mod single_scattering;
pub mod stage_cache;
pub mod stages;
pub mod summed;

pub use capabilities::{Capabilities, Cost, MaterialEdit, ProfileEdit, SingleScattering, SourceFields};
#[cfg(feature = "gpu")]
pub use evaluator::{DeviceEvaluator, Held};
pub use evaluator::{Evaluator, Refined};
pub use forecast::Forecast;
pub use form::{AnyForm, AssetParts, BakeSettings, Form, Model, Opener, Probes, RegisteredForm};
pub use method::{About, Method, Recipe, Registry};
pub use model_error::ModelWalks;
pub use stage_cache::StageCache;
