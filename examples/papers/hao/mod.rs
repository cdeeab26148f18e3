//! What Hao and Varshney 2004 store, to the letter, for comparison: values of every vertex in their encodings, and lists of the vertices
//! in a scattering neighbourhood. `quantized_lights` is smaller and nearer to the truth.

pub(crate) mod bleeding;
mod harmonic_fit;
mod mean;
mod method;
mod quantiser;
mod reference_points;
mod settings;
mod simplify;
mod values;

use translux::evaluate::{RegisteredForm, Registry};

pub(crate) use settings::{ChosenBy, Encoding, Integral, VertexValues};

/// Name of the method on the command line.
pub(crate) const METHOD: &str = "hao_varshney";

/// The methods and forms of the crate, and the paper's.
pub(crate) fn registry() -> Registry {
    let with_values = translux::methods::built_in().with_form(RegisteredForm::of::<VertexValues>());
    with_values.with_form(RegisteredForm::of::<bleeding::NeighbourLists>()).with_method(&method::HaoVarshney)
}
