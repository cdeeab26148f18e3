//! Single scattering, stored for light from far away or by rays: a companion of the forms of such light.

mod bake;
mod evaluate;

pub(crate) use bake::{Folded, stored};
pub(crate) use evaluate::{Opened, opened};
