//! The far field of `editable`: for groups of neighbouring receivers, weighted Haar coefficients of the transport of every
//! basis function over the tree of samples.

/// Receivers side by side in a coefficient.
pub const LANES: usize = 16;

/// A run of receivers of one part with one list of coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Part whose samples it gathers from.
    pub part: u32,
    /// Its receivers end here (and begin where those of the group before end); at most [`LANES`] of them.
    pub receivers_end: u32,
    /// Its coefficients end here (and begin where those of the group before end).
    pub coefficients_end: u32,
}

/// The far field, dequantised value = `values[..] * steps[k]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FarField {
    /// Number of basis functions K.
    pub terms: usize,
    /// For each source vertex its receiver, or `u32::MAX`.
    pub receiver_of_vertex: Vec<u32>,
    /// The groups.
    pub groups: Vec<Group>,
    /// Tree node of each coefficient, strictly ascending inside a group. A node is named by the first sample of its right child.
    pub nodes: Vec<u32>,
    /// Which basis functions are kept of each coefficient: bit k; not 0.
    pub masks: Vec<u16>,
    /// Quantiser step of each basis function, positive.
    pub steps: Vec<f32>,
    /// Quantised values: for each coefficient its kept functions, ascending; lanes beyond the group's receivers are 0.
    pub values: Vec<[i16; LANES]>,
    /// Sum of each receiver's row, mm^2 times the unit of the basis: `[receiver][k]`.
    pub row_sums: Vec<f32>,
}
