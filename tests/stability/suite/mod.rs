//! The stability suite: bodies, lights and settings on which methods are known to fail or might, each measured against sums over all
//! pairs, and compared with the error that was promised. `tests/stability` runs a few of its rows, `examples/stability` all of them.
#![allow(missing_docs, dead_code, unreachable_pub)]

pub mod bodies;
pub mod cases;
pub mod cell;
pub mod lamps;
pub mod truth;

pub use cases::{Case, cases};
pub use cell::{Cell, Session, Verdict};

/// A way to bake: a method, and keys that make another way of it.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Name in tables.
    pub name: &'static str,
    /// The method.
    pub method: &'static str,
    /// Its keys, beside those of a case.
    pub set: &'static [(&'static str, &'static str)],
}

/// All methods, and `editable` with stored transport.
pub const WAYS: [Way; 8] = [
    Way { name: "reference", method: "reference", set: &[] },
    Way { name: "two_pass", method: "two_pass", set: &[] },
    Way { name: "editable", method: "editable", set: &[] },
    Way { name: "editable stored", method: "editable", set: &[("transport", "stored")] },
    Way { name: "quantized_lights", method: "quantized_lights", set: &[] },
    Way { name: "all_frequency", method: "all_frequency", set: &[] },
    Way { name: "texture_space", method: "texture_space", set: &[] },
    Way { name: "filtered_normals", method: "filtered_normals", set: &[] },
];
