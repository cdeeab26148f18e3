//! What Hao and Varshney 2004 store, to the letter, for comparison: values of every vertex in their encodings, and lists of the vertices in
//! a scattering neighbourhood. `quantised_lights` is smaller and nearer to the truth.

pub mod bleeding;
mod settings;
mod values;

pub use settings::{ChosenBy, Encoding, Integral, VertexValues};
