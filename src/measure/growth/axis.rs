//! The sizes that are varied and the costs that are measured.

use serde::{Deserialize, Serialize};

/// The size that is varied; everything else is fixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
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

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Samples => "samples",
            Self::Ratio => "ratio",
        }
    }

    /// Title beside the axis of a chart.
    pub fn title(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Samples => "surface samples",
            Self::Ratio => "size of the object in mean free paths",
        }
    }

    /// Unit that follows the number of a size.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Samples => "samples",
            Self::Ratio => "mean free paths across",
        }
    }
}

/// A measured cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
