//! How cost grows: bake time, memory, bytes and relight time against vertices, samples and the size of the object over the
//! mean free path, with fitted exponents.

mod axis;
pub mod draw;
pub mod explain;
pub mod fit;
pub mod limits;
pub mod page;
pub mod surface;
pub mod table;

use serde::{Deserialize, Serialize};

pub use self::axis::{Axis, Quantity};
use self::fit::{PowerLaw, end_slope, power_law};
use super::chart::Machine;
use crate::math::statistics::Quantiles;

/// Identifies the shape of the JSON.
pub const SCHEMA: &str = "translux-growth/1";

/// A cost with an exponent above this grows faster than size.
pub const FASTER_THAN_SIZE: f64 = 1.1;

/// As [`FASTER_THAN_SIZE`] for the two largest points alone, which are noisier than a fit.
pub const FASTER_AT_THE_END: f64 = 1.25;

impl Quantity {
    /// In the order of the page.
    pub const ALL: [Self; 6] = [
        Self::BakeSeconds,
        Self::PeakMemoryBytes,
        Self::Bytes,
        Self::EnvironmentBytes,
        Self::ResidentBytes,
        Self::RelightMs,
    ];

    /// In file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::BakeSeconds => "bake",
            Self::PeakMemoryBytes => "memory",
            Self::Bytes => "bytes",
            Self::EnvironmentBytes => "environment",
            Self::ResidentBytes => "resident",
            Self::RelightMs => "relight",
        }
    }

    /// For people.
    pub fn title(self) -> &'static str {
        match self {
            Self::BakeSeconds => "time to bake",
            Self::PeakMemoryBytes => "most memory of the bake",
            Self::Bytes => "bytes on disk without mesh and environment",
            Self::EnvironmentBytes => "bytes on disk of what environments need",
            Self::ResidentBytes => "bytes in memory when opened, without the mesh",
            Self::RelightMs => "time from a new light to new radiosity",
        }
    }

    /// Values below this are mostly what every process and file has, and are left out of fits.
    pub fn floor(self) -> f64 {
        match self {
            Self::BakeSeconds => 5e-3,
            Self::PeakMemoryBytes => 32e6,
            Self::Bytes | Self::EnvironmentBytes | Self::ResidentBytes => 4096.0,
            Self::RelightMs => 0.1,
        }
    }

    /// Of a point, if it has it.
    pub fn of(self, point: &Point) -> Option<f64> {
        let costs = point.costs.as_ref()?;
        let value = match self {
            Self::BakeSeconds => costs.bake_seconds,
            Self::PeakMemoryBytes => costs.peak_memory_bytes as f64,
            Self::Bytes => costs.bytes as f64,
            Self::EnvironmentBytes => costs.environment_bytes as f64,
            Self::ResidentBytes => costs.resident_bytes as f64,
            Self::RelightMs => costs.relight_ms?.median,
        };
        (value > 0.0).then_some(value)
    }
}

/// What was measured of an asset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Costs {
    /// Surface samples that the bake placed.
    pub samples: usize,
    /// The whole bake by its own clock, s.
    pub bake_seconds: f64,
    /// Its stages, s.
    pub bake_stages: Vec<(String, f64)>,
    /// Most memory that the bake had.
    pub peak_memory_bytes: u64,
    /// The whole file.
    pub file_bytes: u64,
    /// Sections on disk but the mesh's and the environment's.
    pub bytes: u64,
    /// The environment's sections on disk.
    pub environment_bytes: u64,
    /// The opened method's data in memory, mesh and occluders apart.
    pub resident_bytes: u64,
    /// From the file to an evaluator, ms.
    pub open_ms: f64,
    /// From a new light to new radiosity, ms; none where it was not timed.
    pub relight_ms: Option<Quantiles>,
    /// How often it was timed.
    pub relights: usize,
}

/// What was not measured of a point, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skipped {
    /// The bake (and with it everything) or the relight alone.
    pub what: Missing,
    /// For people.
    pub reason: String,
}

/// What a point lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Missing {
    /// Everything.
    Bake,
    /// The time of a new light.
    Relight,
}

impl Missing {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bake => "bake",
            Self::Relight => "relight",
        }
    }
}

/// A method at one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// What is varied.
    pub axis: Axis,
    /// Method.
    pub method: String,
    /// Value on the axis: as asked for where nothing was baked, else as it came out.
    pub size: f64,
    /// Vertices of the surface.
    pub vertices: usize,
    /// Diagonal of its bounding box, mm.
    pub size_mm: f64,
    /// The diagonal over the shortest mean free path.
    pub size_over_mean_free_path: f64,
    /// The command that bakes the asset.
    pub command: String,
    /// None where nothing was baked.
    pub costs: Option<Costs>,
    /// What is missing, and why.
    pub skipped: Option<Skipped>,
}

/// How one cost of one method grows along one axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Growing {
    /// What is varied.
    pub axis: Axis,
    /// Method.
    pub method: String,
    /// Cost.
    pub quantity: Quantity,
    /// Through all points above the floor; none with fewer than three.
    pub law: Option<PowerLaw>,
    /// Exponent between the two largest points.
    pub end_exponent: Option<f64>,
    /// Sizes of the points that are below the floor, which the fit leaves out.
    pub below_floor: Vec<f64>,
    /// Grows faster than size.
    pub finding: bool,
    /// Why, where it is a finding and the reason is known.
    pub explanation: Option<String>,
}

/// What bounds the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// A bake, or a new light, that is predicted to take longer (by more than [`limits::MARGIN`]) is not started, s.
    pub seconds: f64,
    /// A bake that is estimated to need more is not started, bytes.
    pub memory_bytes: u64,
}

/// All of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Growth {
    /// [`SCHEMA`].
    pub schema: String,
    /// Version of the program.
    pub version: String,
    /// Where it was measured.
    pub machine: Machine,
    /// What bounded it.
    pub limits: Limits,
    /// Material.
    pub material: String,
    /// The light that is timed, as it would be typed.
    pub light: String,
    /// The surface, in words.
    pub surface: String,
    /// Samples of every bake whose samples are not varied; none where the methods choose.
    pub fixed_samples: Option<usize>,
    /// In the order of axes, methods and sizes.
    pub points: Vec<Point>,
    /// In the order of axes, quantities and methods.
    pub growing: Vec<Growing>,
}

impl Growth {
    /// Fits every cost of the points.
    pub fn fit(&mut self) {
        let methods = self.methods();
        let of_axis = |axis: Axis| Quantity::ALL.into_iter().map(move |quantity| (axis, quantity));
        let kinds = Axis::ALL.into_iter().flat_map(of_axis);
        let all = kinds.flat_map(|(axis, quantity)| methods.iter().map(move |method| (axis, quantity, method)));
        self.growing = all.filter_map(|(axis, quantity, method)| self.growing(axis, method, quantity)).collect();
    }

    /// The growth of one cost; none where no point has it.
    fn growing(&self, axis: Axis, method: &str, quantity: Quantity) -> Option<Growing> {
        let all = places(&self.points, axis, method, quantity);
        if all.is_empty() {
            return None;
        }
        let (used, below): (Vec<_>, Vec<_>) = all.into_iter().partition(|p| p.1 >= quantity.floor());
        let law = power_law(&used);
        let end_exponent = end_slope(&used);
        let finding = law.is_some_and(|law| law.exponent > FASTER_THAN_SIZE)
            || end_exponent.is_some_and(|exponent| exponent > FASTER_AT_THE_END);
        let why = || explain::why(axis, method, quantity, self.fixed_samples);
        let explanation = finding.then(why).flatten().map(str::to_owned);
        let method = method.to_owned();
        let below_floor = below.into_iter().map(|p| p.0).collect();
        Some(Growing { axis, method, quantity, law, end_exponent, below_floor, finding, explanation })
    }

    /// In the order of their first points.
    pub fn methods(&self) -> Vec<String> {
        let mut methods: Vec<String> = Vec::new();
        for point in &self.points {
            if !methods.contains(&point.method) {
                methods.push(point.method.clone());
            }
        }
        methods
    }

    /// What grows faster than size.
    pub fn findings(&self) -> impl Iterator<Item = &Growing> {
        self.growing.iter().filter(|g| g.finding)
    }
}

/// Places (size, cost) of one method on one axis, by ascending size.
pub fn places(points: &[Point], axis: Axis, method: &str, quantity: Quantity) -> Vec<(f64, f64)> {
    let of_method = points.iter().filter(|p| p.axis == axis && p.method == method);
    let mut places: Vec<(f64, f64)> = of_method.filter_map(|p| Some((p.size, quantity.of(p)?))).collect();
    places.sort_by(|a, b| a.0.total_cmp(&b.0));
    places
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests;
