//! Single scattering, stored for light from far away or by rays: a companion of the forms of such light.

mod bake;
mod evaluate;
mod first_order;

pub(crate) use bake::{Folded, stored};
pub(crate) use evaluate::{Opened, opened};
pub use first_order::FirstOrder;
