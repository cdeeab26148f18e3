//! The stability suite: bodies, lights and settings on which methods are known to fail or might, each measured against sums over all
//! pairs, and compared with the error that was promised. `tests/stability` runs a few of its rows, `examples/stability` all of them.
#![allow(missing_docs, dead_code, unreachable_pub)]

pub mod bodies;
pub mod cases;
pub mod cell;
pub mod drawn;
pub mod lamps;
pub mod truth;

use translux::evaluate::Model;
use translux::transport::calibration::Walks;

pub use cases::{Case, cases};
pub use cell::{Cell, Session, Verdict};

/// A way to bake: a method, and keys that make another way of it; or the planner, which chooses both.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    /// Name in tables.
    pub name: &'static str,
    pub by: By,
}

/// What bakes.
#[derive(Clone, Copy, Debug)]
pub enum By {
    /// A method with some of its keys, beside those of a case, and the dipole.
    Method(&'static str, &'static [(&'static str, &'static str)]),
    /// The planner, with the defaults of the command line but for the model.
    Planner(Model),
}

const fn method(name: &'static str) -> Way {
    Way { name, by: By::Method(name, &[]) }
}

/// All methods, and `editable` with stored transport.
pub const WAYS: [Way; 8] = [
    method("reference"),
    method("two_pass"),
    method("editable"),
    Way { name: "editable stored", by: By::Method("editable", &[("transport", "stored")]) },
    method("quantized_lights"),
    method("all_frequency"),
    method("texture_space"),
    method("filtered_normals"),
];

/// The planner with each model.
pub fn planned() -> [Way; 2] {
    [
        Way { name: "auto", by: By::Planner(Model::Calibrated(Walks::default())) },
        Way { name: "auto --model dipole", by: By::Planner(Model::Dipole) },
    ]
}
