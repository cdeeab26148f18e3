//! Growth of cost: bake time, memory, bytes and relight time against vertices, samples and the size of the object over
//! the mean free path, with fitted exponents.

mod axis;
pub mod draw;
pub mod fit;
pub mod page;
pub mod surface;
pub mod table;

use serde::{Deserialize, Serialize};

use self::axis::why;
pub use self::axis::{Axis, Quantity, pairs};
use self::fit::{PowerLaw, end_slope, power_law};
use super::chart::Machine;
use crate::math::statistics::Quantiles;

/// Identifies the shape of the JSON.
pub const SCHEMA: &str = "translux.growth-file.v1";

/// A cost with an exponent above this grows faster than size.
pub const FASTER_THAN_SIZE: f64 = 1.1;

/// Like [`FASTER_THAN_SIZE`], for the two largest points alone, which are noisier than a fit.
pub const FASTER_AT_THE_END: f64 = 1.25;

/// Factor on the limit up to which work is started, since predictions are rough.
pub const MARGIN: f64 = 1.25;

/// Factor on the limit at which a running bake is ended.
pub const KILL: f64 = 2.0;

impl Quantity {
    /// All costs in the order of the page.
    pub const ALL: [Self; 6] = [
        Self::BakeSeconds,
        Self::PeakMemoryBytes,
        Self::Bytes,
        Self::EnvironmentBytes,
        Self::ResidentBytes,
        Self::RelightMs,
    ];

    /// Name, title and floor.
    fn words(self) -> (&'static str, &'static str, f64) {
        match self {
            Self::BakeSeconds => ("bake", "time to bake", 5e-3),
            Self::PeakMemoryBytes => ("memory", "most memory of the bake", 32e6),
            Self::Bytes => ("bytes", "bytes on disk without mesh and environment", 4096.0),
            Self::EnvironmentBytes => ("environment", "bytes on disk of what environments need", 4096.0),
            Self::ResidentBytes => ("resident", "bytes in memory when opened, without the mesh", 4096.0),
            Self::RelightMs => ("relight", "time from a new light to new radiosity", 0.1),
        }
    }

    /// Name in files.
    pub fn name(self) -> &'static str {
        self.words().0
    }

    /// Title for people.
    pub fn title(self) -> &'static str {
        self.words().1
    }

    /// The cost below which a value is mostly the overhead of any process or file; such values are left out of fits.
    pub fn floor(self) -> f64 {
        self.words().2
    }

    /// The cost of a point, if it was measured.
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

/// The measured costs of an asset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Costs {
    /// Surface samples that the bake placed.
    pub samples: usize,
    /// Duration of the whole bake by its own clock, s.
    pub bake_seconds: f64,
    /// Duration of each of its stages, s.
    pub bake_stages: Vec<(String, f64)>,
    /// Peak memory of the bake, bytes.
    pub peak_memory_bytes: u64,
    /// Size of the whole file, bytes.
    pub file_bytes: u64,
    /// Bytes of the sections on disk, without the mesh's and the environment's.
    pub bytes: u64,
    /// Bytes of the environment's sections on disk.
    pub environment_bytes: u64,
    /// Bytes of the opened method's data in memory, mesh and occluders apart.
    pub resident_bytes: u64,
    /// Time from the file to an evaluator, ms.
    pub open_ms: f64,
    /// Time from a new light to new radiosity, ms; none where it was not timed.
    pub relight_ms: Option<Quantiles>,
    /// Number of relights that were timed.
    pub relights: usize,
}

/// The part of a point that was not measured, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Skipped {
    /// The missing part.
    pub what: Missing,
    /// The reason in words.
    pub reason: String,
}

/// The part of a point that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Missing {
    /// The bake, and with it everything.
    Bake,
    /// The time of a new light.
    Relight,
}

impl Missing {
    /// Name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bake => "bake",
            Self::Relight => "relight",
        }
    }
}

/// The measurement of a method at one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Point {
    /// The size that is varied.
    pub axis: Axis,
    /// Method.
    pub method: String,
    /// Value on the axis: as asked for where nothing was baked, otherwise as it came out.
    pub size: f64,
    /// Vertices of the surface.
    pub vertices: usize,
    /// Diagonal of its bounding box, mm.
    pub size_mm: f64,
    /// The diagonal over the shortest mean free path.
    pub size_over_mean_free_path: f64,
    /// The command that bakes the asset.
    pub command: String,
    /// Measured costs; none where nothing was baked.
    pub costs: Option<Costs>,
    /// The missing part and the reason.
    pub skipped: Option<Skipped>,
}

/// Growth of one cost of one method along one axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Growing {
    /// The size that is varied.
    pub axis: Axis,
    /// Method.
    pub method: String,
    /// The cost.
    pub quantity: Quantity,
    /// Power law through all points above the floor; none with fewer than three.
    pub law: Option<PowerLaw>,
    /// Exponent between the two largest points.
    pub end_exponent: Option<f64>,
    /// Sizes of the points that are below the floor, which the fit leaves out.
    pub below_floor: Vec<f64>,
    /// Whether the cost grows faster than size.
    pub finding: bool,
    /// The reason of a finding, where it is known.
    pub explanation: Option<String>,
}

/// Limits of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Limits {
    /// Largest predicted duration, s, of a bake or a new light that is started; [`MARGIN`] is allowed on top.
    pub seconds: f64,
    /// Largest estimated memory, bytes, of a bake that is started.
    pub memory_bytes: u64,
}

impl Limits {
    /// The reason why work of this predicted duration is not started; none where it is started, or where nothing is
    /// known.
    pub fn too_long(&self, predicted_seconds: Option<f64>, say: fn(f64) -> String) -> Option<String> {
        let predicted = predicted_seconds?;
        // What is not a number is over the limit.
        let fits = predicted <= MARGIN * self.seconds;
        (!fits).then(|| {
            format!("about {} predicted from the smaller sizes, {} allowed", say(predicted), say(self.seconds))
        })
    }

    /// The reason why a bake of this estimated memory is not started.
    pub fn too_large(&self, estimated_bytes: u64, say: fn(u64) -> String) -> Option<String> {
        (estimated_bytes > self.memory_bytes)
            .then(|| format!("about {} of memory estimated, {} allowed", say(estimated_bytes), say(self.memory_bytes)))
    }

    /// Duration at which a running bake is ended, s.
    pub fn kill_seconds(&self) -> f64 {
        KILL * self.seconds
    }
}

/// The whole measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Growth {
    /// Always [`SCHEMA`].
    pub schema: String,
    /// Version of the program.
    pub version: String,
    /// The machine on which it was measured.
    pub machine: Machine,
    /// Limits of the measurement.
    pub limits: Limits,
    /// Material.
    pub material: String,
    /// The light that is timed, as it would be typed.
    pub light: String,
    /// The surface, in words.
    pub surface: String,
    /// Samples of every bake along the axes other than samples; none where the methods choose.
    pub fixed_samples: Option<usize>,
    /// Points in the order of axes, methods and sizes.
    pub points: Vec<Point>,
    /// Growth of every cost, in the order of axes, quantities and methods.
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
        let reason = || why(axis, method, quantity, self.fixed_samples);
        let explanation = finding.then(reason).flatten().map(str::to_owned);
        let method = method.to_owned();
        let below_floor = below.into_iter().map(|p| p.0).collect();
        Some(Growing { axis, method, quantity, law, end_exponent, below_floor, finding, explanation })
    }

    /// Names of the methods in the order of their first points.
    pub fn methods(&self) -> Vec<String> {
        let mut methods: Vec<String> = Vec::new();
        for point in &self.points {
            if !methods.contains(&point.method) {
                methods.push(point.method.clone());
            }
        }
        methods
    }

    /// The costs that grow faster than size.
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
