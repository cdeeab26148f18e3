//! Light that is scattered once, stored for light from far away or followed by rays: a companion of the forms of such light.

mod bake;
mod evaluate;
mod phase;

pub(crate) use bake::{Folded, stored};
pub(crate) use evaluate::opened;
