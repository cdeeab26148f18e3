//! `rows`: transport of light from far away as sparse rows of Haar coefficients, one for each vertex (Wang, Tran & Luebke 2005).

mod bake;
mod evaluate;
mod settings;

pub(crate) use bake::expected_light;
pub(crate) use evaluate::Rows;
pub use settings::DirectionalRows;
