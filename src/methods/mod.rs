//! Methods: one file each, a name for a choice of a form and its settings. A method is one file and one line in
//! [`built_in`].

pub mod all_frequency;
pub mod editable;
pub mod filtered_normals;
mod keys;
pub mod quantized_lights;
pub mod reference;
pub mod texture_space;
pub mod two_pass;

use crate::evaluate::{Method, Registry};
use crate::forms;

/// Every method of this crate, in the order of listings.
const ALL: [&dyn Method; 7] = [
    &reference::Reference,
    &two_pass::TwoPass,
    &editable::Editable,
    &quantized_lights::QuantizedLights,
    &all_frequency::AllFrequency,
    &texture_space::TextureSpace,
    &filtered_normals::FilteredNormals,
];

/// The methods and the forms of this crate.
pub fn built_in() -> Registry {
    let with_forms = forms::ALL.into_iter().fold(Registry::default(), Registry::with_form);
    ALL.into_iter().fold(with_forms, Registry::with_method)
}
