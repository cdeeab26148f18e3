//! `factored`: transport of each function of a basis of R_d, so that the material is chosen when the asset is evaluated (Wang et al.
//! 2008).

mod bake;
mod choice;
mod evaluate;
mod evaluator;
#[cfg(feature = "gpu")]
mod far_field_gpu;
mod far_sums;
mod forecast;
#[cfg(feature = "gpu")]
mod gpu;
mod interpolation;
mod ledger;
mod levels;
mod ordered_samples;
mod points;
mod settings;
mod sources;
mod subset;

pub use self::settings::{Factored, MOST_LEVELS};
