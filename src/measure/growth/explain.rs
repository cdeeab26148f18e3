//! Known reasons why costs grow faster than size.

use super::axis::{Axis, Quantity};

/// The reason of a finding, if one is known; `fixed_samples` is the number of samples of every bake, where it does not
/// follow the surface.
pub fn why(axis: Axis, method: &str, quantity: Quantity, fixed_samples: Option<usize>) -> Option<&'static str> {
    match (axis, method, quantity) {
        (Axis::Vertices, "reference" | "two_pass", Quantity::RelightMs) if fixed_samples.is_some() => Some(
            "the number of samples is fixed: a sample becomes a cluster of ever more triangles, and the near field of every \
             vertex is integrated over each of them",
        ),
        (Axis::Vertices, "reference", Quantity::RelightMs) => Some(
            "all pairs by construction: vertices times samples, and beyond 65,536 vertices the samples grow with the \
             triangles, one each at least, so that the exponent goes from 1 to 2",
        ),
        (Axis::Ratio, "reference", Quantity::RelightMs) => Some(
            "all pairs by construction: vertices times samples, and the samples follow the square of the ratio between \
             their least and largest number",
        ),
        (Axis::Vertices, "two_pass", Quantity::RelightMs) => Some(
            "beyond 65,536 vertices the samples grow with the triangles, and the opening that keeps the asked error narrows: 0.024, \
             0.017 and 0.012 sr at 100k, 300k and 1M vertices of the knot, where a group of vertices sums over 1240, 1860 and 2570 \
             clusters and samples",
        ),
        _ => None,
    }
}

/// Number of pairs that a new light sums over, for a method that sums over all of them: its time is predicted from it,
/// not from size.
pub fn pairs(method: &str, vertices: usize, samples: usize) -> Option<f64> {
    (method == "reference").then_some(vertices as f64 * samples as f64)
}
