//! The sizes that are varied, the costs that are measured, and known reasons why costs grow faster than size.

use serde::{Deserialize, Serialize};

/// The size that is varied; everything else is fixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// Vertices of the surface.
    Vertices,
    /// Surface samples.
    Samples,
    /// Diagonal of the bounding box over the shortest mean free path.
    Ratio,
}

impl Axis {
    /// All axes in the order of the page.
    pub const ALL: [Self; 3] = [Self::Vertices, Self::Samples, Self::Ratio];

    /// Name, title and unit.
    fn words(self) -> [&'static str; 3] {
        match self {
            Self::Vertices => ["vertices", "vertices", "vertices"],
            Self::Samples => ["samples", "surface samples", "samples"],
            Self::Ratio => ["ratio", "size of the object in mean free paths", "mean free paths across"],
        }
    }

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        self.words()[0]
    }

    /// Title beside the axis of a chart.
    pub fn title(self) -> &'static str {
        self.words()[1]
    }

    /// Unit that follows the number of a size.
    pub fn unit(self) -> &'static str {
        self.words()[2]
    }
}

/// A measured cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Duration of the whole bake, s.
    BakeSeconds,
    /// Peak memory of the bake, bytes.
    PeakMemoryBytes,
    /// Bytes of the sections on disk, without the mesh's and the environment's.
    Bytes,
    /// Bytes of the environment's sections on disk.
    EnvironmentBytes,
    /// Bytes of the opened method's data in memory.
    ResidentBytes,
    /// Time from a new light to new radiosity, ms.
    RelightMs,
}

/// The reason of a finding, if one is known; `fixed_samples` is the number of samples of every bake, where it does not
/// follow the surface.
pub(super) fn why(axis: Axis, method: &str, quantity: Quantity, fixed_samples: Option<usize>) -> Option<&'static str> {
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
