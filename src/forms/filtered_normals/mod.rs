//! `filtered_normals`: normals low-passed over the surface take the place of the normals in local lighting (Patro 2007). No transport is
//! stored: light that travels inside is approximated by light on a smoother surface, at no cost at run time.
//!
//! `B = R F_t(mu) max(0, mu) V L` with `mu` the cosine with the filtered normal of each channel, `R` the total diffuse reflectance and
//! `V` the visibility at the vertex.

mod bake;
mod evaluate;
mod fit;
mod forecast;
mod form;
mod geometric;
mod light;
mod points;
mod response;
mod settings;

pub use settings::{Bleeding, Filter, FilteredNormals, Length, Response, Shadows, Sum, Weights};

#[cfg(test)]
mod tests;
