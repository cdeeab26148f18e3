//! The basis of radial profiles: an edited material is projected on it with one dot product a function.

/// Functions b_k(r) on shared nodes. The coefficients of a far profile f are `s_k = Sum_g weight_g f(r_g) b_k(r_g)`, and
/// `f(r) ~ Sum_k s_k b_k(r)`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ProfileBasis {
    /// Split radius in mm: inside it a far profile is the even polynomial that continues R_d.
    pub split_mm: f64,
    /// Nodes r_g in mm, ascending; the last one is the largest distance that the basis serves.
    pub nodes_mm: Vec<f64>,
    /// Quadrature weights of the nodes, mm^2.
    pub weights_mm2: Vec<f64>,
    /// b_k(r_g), function after function, 1/mm^2.
    pub functions: Vec<f32>,
}
