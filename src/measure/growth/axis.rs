//! The sizes that are varied and the costs that are measured.

use serde::{Deserialize, Serialize};

/// What is varied; everything else is fixed.
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
    /// In the order of the page.
    pub const ALL: [Self; 3] = [Self::Vertices, Self::Samples, Self::Ratio];

    /// In files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Samples => "samples",
            Self::Ratio => "ratio",
        }
    }

    /// Beside the axis of a chart.
    pub fn title(self) -> &'static str {
        match self {
            Self::Vertices => "vertices",
            Self::Samples => "surface samples",
            Self::Ratio => "size of the object in mean free paths",
        }
    }

    /// What a size counts, after the number.
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
    /// The whole bake, s.
    BakeSeconds,
    /// Most memory of the bake, bytes.
    PeakMemoryBytes,
    /// Sections on disk but the mesh's and the environment's.
    Bytes,
    /// The environment's sections on disk.
    EnvironmentBytes,
    /// The opened method's data in memory.
    ResidentBytes,
    /// From a new light to new radiosity, ms.
    RelightMs,
}
