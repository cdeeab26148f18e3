//! `harmonics`: transport of light from far away under spherical harmonics, at reference points (after Wang, Tran & Luebke 2005).

mod bake;
mod evaluate;
mod moved;
mod returned;
mod settings;

pub use bake::{coded, coding_error, everywhere};
pub(crate) use evaluate::{HarmonicBasis, components};
pub use settings::Harmonics;
