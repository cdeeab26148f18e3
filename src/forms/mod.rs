//! Forms: one folder, or file, for each way in which transport is kept and evaluated, with its settings, its bake, its sections, its
//! evaluator and its shaders.

pub mod baked_in;
pub mod density;
pub mod distant;
pub mod environment_rows;
pub mod factored;
pub mod filtered_normals;
pub mod gathered;
pub mod projected;
pub mod rows;
pub mod sampled_scene;
pub mod single_scattering;

use crate::evaluate::FormEntry;

/// Every form of this crate.
pub const ALL: [FormEntry; 6] = [
    FormEntry::of::<gathered::Gathered>(),
    FormEntry::of::<factored::Factored>(),
    FormEntry::of::<projected::lights::QuantisedLights>(),
    FormEntry::of::<projected::harmonics::Harmonics>(),
    FormEntry::of::<rows::DirectionalRows>(),
    FormEntry::of::<filtered_normals::FilteredNormals>(),
];
