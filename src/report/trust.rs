//! The map of where an asset is wrong, as columns of a PLY file and as a report.

use serde::Serialize;

use super::text::percent;
use crate::light::Light;
use crate::math::statistics::VertexError;
use crate::measure::trust::{Stages, Trust, VertexTrust};

/// The map as a report: what each column is relative to stands in the comments of the file.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct TrustReport {
    /// Lights that were tried, each alone, in the order of the column `trust_light`.
    pub(crate) lights: Vec<String>,
    /// Columns of the file, in order.
    pub(crate) columns: Vec<&'static str>,
    /// Error over all vertices under the worst of these lights.
    pub(crate) total: VertexError,
    /// Samples of the exact sums under sharp lights.
    pub(crate) samples: usize,
    /// Error that was asked of the hierarchy of these sums; none where they are over all pairs.
    pub(crate) hierarchy: Option<f64>,
    /// Error of these sums themselves under the first light, RMS.
    pub(crate) own_error: f64,
    /// Whether sampling and transport are told apart.
    pub(crate) stages_apart: bool,
    /// Vertices at which a channel is cut off at 0.
    pub(crate) clamped: usize,
}

/// A light as it is typed; the built-in sky has no file.
fn name(light: &Light) -> String {
    match light {
        Light::Environment { rotate_degrees, .. } => format!("sky:rotate={rotate_degrees}"),
        _ => light.to_string(),
    }
}

/// Values of one column.
type Of<T> = fn(&T) -> f64;

/// Columns of every map.
const COLUMNS: [(&str, Of<VertexTrust>); 12] = [
    ("trust_r", |v| v.error.x),
    ("trust_g", |v| v.error.y),
    ("trust_b", |v| v.error.z),
    ("trust_local", |v| v.local),
    ("trust_worst", |v| v.worst),
    ("trust_light", |v| f64::from(v.worst_light)),
    ("trust_from_x", |v| v.from.x),
    ("trust_from_y", |v| v.from.y),
    ("trust_from_z", |v| v.from.z),
    ("trust_clamped", |v| f64::from(u8::from(v.clamped))),
    ("trust_between", |v| v.between),
    ("trust_thickness", |v| v.thickness),
];

/// Columns of the stages.
const SAMPLING: (&str, Of<Stages>) = ("trust_sampling", |s| s.sampling);
const TRANSPORT: (&str, Of<Stages>) = ("trust_transport", |s| s.transport);
const ENVIRONMENT: (&str, Of<Stages>) = ("trust_environment", |s| s.environment);

/// The columns of a map, a name and one value for each source vertex.
pub(crate) fn columns(trust: &Trust) -> Vec<(&'static str, Vec<f32>)> {
    let narrow = |value: f64| (value as f32).clamp(f32::MIN, f32::MAX);
    let mut columns: Vec<(&'static str, Vec<f32>)> =
        COLUMNS.iter().map(|(name, of)| (*name, trust.vertices.iter().map(|v| narrow(of(v))).collect())).collect();
    let stored = [ENVIRONMENT].into_iter().filter(|_| trust.stores_environment);
    if let Some(stages) = &trust.stages {
        let of = |(name, of): (&'static str, Of<Stages>)| (name, stages.iter().map(|s| narrow(of(s))).collect());
        columns.extend([SAMPLING, TRANSPORT].into_iter().chain(stored).map(of));
    }
    columns
}

/// Comments of a file with these columns.
pub(crate) fn comments(trust: &Trust) -> Vec<String> {
    let mut lines = vec![
        "trust_r, _g, _b: mean over the lights below of the absolute error against exact sums, over the RMS of the radiosity"
            .to_owned(),
        "trust_local: the same over the radiosity of the vertex; trust_worst: the largest; trust_light: of which light"
            .to_owned(),
        "trust_from: unit vector to that light, 0 for a sky; trust_clamped: 1 where a channel is cut off at 0"
            .to_owned(),
        "trust_between: error of what is drawn around the vertex; trust_thickness: of the body, in mean free paths"
            .to_owned(),
    ];
    lines.push(match trust.stages {
        Some(_) => "trust_sampling, trust_transport, trust_environment: the stages of trust_r, _g, _b, worst channel"
            .to_owned(),
        None => "stages are not told apart: the asset's own samples and vertices are too many pairs".to_owned(),
    });
    lines.extend(trust.lights.iter().enumerate().map(|(index, light)| format!("trust light {index} {}", name(light))));
    lines
}

impl TrustReport {
    pub(crate) fn new(trust: &Trust) -> Self {
        Self {
            lights: trust.lights.iter().map(name).collect(),
            columns: columns(trust).into_iter().map(|(name, _)| name).collect(),
            total: trust.total,
            samples: trust.sums.samples,
            hierarchy: trust.sums.hierarchy,
            own_error: trust.sums.error,
            stages_apart: trust.stages.is_some(),
            clamped: trust.vertices.iter().filter(|vertex| vertex.clamped).count(),
        }
    }

    /// A line for people.
    pub(crate) fn line(&self) -> String {
        let Self { total, samples, own_error, .. } = self;
        let [rms, worst, own] = [total.rms, total.worst, *own_error].map(percent);
        let how = self.hierarchy.map_or("over all pairs", |_| "through the hierarchy");
        format!(
            "trust: {rms} RMS, {worst} worst vertex under the worst of {} lights, against {samples} samples {how} ({own} off)",
            self.lights.len()
        )
    }
}
