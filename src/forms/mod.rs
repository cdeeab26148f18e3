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
pub mod sample_count;
pub mod sampled_scene;
pub mod single_scattering;
#[cfg(test)]
mod test_scene;
pub mod texture_space;
mod truths;

use crate::evaluate::RegisteredForm;

/// Every form of this crate.
pub const ALL: [RegisteredForm; 7] = [
    RegisteredForm::of::<gathered::Gathered>(),
    RegisteredForm::of::<factored::Factored>(),
    RegisteredForm::of::<projected::lights::QuantisedLights>(),
    RegisteredForm::of::<projected::harmonics::Harmonics>(),
    RegisteredForm::of::<rows::DirectionalRows>(),
    RegisteredForm::of::<filtered_normals::FilteredNormals>(),
    RegisteredForm::of::<texture_space::TextureSpace>(),
];
