//! Comparison of two PLY files, OpenEXR pictures or assets: equality, and the error of the first against the second.

pub mod assets;
pub mod pictures;
mod vertices;

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use translux_format::Budget;

use self::assets::{AssetDifference, Open};
use self::pictures::FlipReport;
pub(crate) use self::vertices::vertex_areas;
use super::text::percent;
use crate::error::{Error, Result};
use crate::import::file::suffix;
use crate::math::statistics::VertexError;
use crate::measure::flip::Exposures;
use crate::measure::image_error::ImageError;
use crate::progress::Progress;

/// The error measure of a comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// Area-weighted RMS over vertices, worst channel; RMS over covered pixels for pictures.
    #[default]
    Rms,
    /// 99.9th percentile.
    P999,
    /// Worst vertex or pixel.
    Worst,
    /// HDR-FLIP of pictures: mean of what a person sees who flips between them, 0 to 1.
    Flip,
}

impl Metric {
    /// The figure that the metric names; none for HDR-FLIP.
    fn of(self, rms: f64, p999: f64, worst: f64) -> Option<f64> {
        match self {
            Self::Rms => Some(rms),
            Self::P999 => Some(p999),
            Self::Worst => Some(worst),
            Self::Flip => None,
        }
    }
}

/// The error of the first of two files against the second.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Comparison {
    /// The file under test.
    #[serde(serialize_with = "super::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub a: PathBuf,
    /// The reference.
    #[serde(serialize_with = "super::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub b: PathBuf,
    /// Whether the contents are the same.
    pub equal: bool,
    /// The metric.
    pub metric: Metric,
    /// Value of the metric; none for assets without a threshold, whose bytes are compared.
    pub value: Option<f64>,
    /// The largest allowed value.
    pub threshold: Option<f64>,
    /// Error of the vertices of PLY files, or of assets under the probe lights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertices: Option<VertexError>,
    /// Error of single scattering alone, where both files have it; `vertices` is the worse of the radiosity and the sum
    /// of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub single_scattering: Option<VertexError>,
    /// Error of pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<ImageError>,
    /// HDR-FLIP of pictures, where it is the metric.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<FlipReport>,
    /// Differences of assets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub assets: Option<AssetDifference>,
    /// Contents that were left out of the comparison, one line each.
    #[serde(skip)]
    pub notes: Vec<String>,
    /// Doubts about the comparison, one line each.
    #[serde(skip)]
    pub warnings: Vec<String>,
}

/// Compares two files of one kind by their suffix.
///
/// Without a threshold anything but equality is a difference, and assets are compared by their bytes alone; with one,
/// assets are evaluated under the probe lights, by the evaluators that `open` makes. What is decoded of each stays within `budget`.
///
/// # Errors
/// I/O, invalid files, files of different kinds or meshes, HDR-FLIP of files that are no pictures.
pub fn compare(
    [a, b]: [&Path; 2],
    metric: Metric,
    threshold: Option<f64>,
    (open, budget): (&Open, Budget),
    progress: &dyn Progress,
) -> Result<Comparison> {
    let mut result = Comparison { a: a.to_owned(), b: b.to_owned(), metric, threshold, ..Comparison::default() };
    match (suffix(a).as_str(), suffix(b).as_str()) {
        ("ply", "ply") | ("tlux", "tlux") if metric == Metric::Flip => {
            let (a, b) = (a.display(), b.display());
            return Err(Error::command_line(format!(
                "{a} and {b}: --metric flip compares pictures; render both to .exr files and compare those"
            )));
        }
        ("ply", "ply") => {
            let found = vertices::compare([a, b])?;
            (result.equal, result.single_scattering) = (found.equal, found.single);
            (result.notes, result.warnings) = (found.notes, found.warnings);
            result.vertices = Some(found.worst);
        }
        ("exr", "exr") => {
            let found = pictures::compare([a, b], metric == Metric::Flip)?;
            (result.equal, result.notes) = (found.equal, found.notes);
            let ImageError { rms, p999, worst, .. } = found.error;
            result.value = metric.of(rms, p999, worst).or(found.flip.as_ref().map(|flip| flip.mean));
            (result.image, result.flip) = (Some(found.error), found.flip);
        }
        ("tlux", "tlux") => {
            let read = |path: &Path| std::fs::read(path).map_err(|e| Error::io(path, &e));
            let bytes = [read(a)?, read(b)?];
            let bytes = bytes.each_ref().map(Vec::as_slice);
            result.equal = bytes[0] == bytes[1];
            let mut found = assets::bytes(bytes, [a, b], budget)?;
            if threshold.is_some() {
                let (worst, probes) = assets::radiosity(bytes, [a, b], (open, budget), progress)?;
                result.vertices = Some(worst);
                found.probes = probes;
            }
            result.assets = Some(found);
        }
        _ => {
            let (a, b) = (a.display(), b.display());
            return Err(Error::command_line(format!("{a} and {b}: two .ply, two .exr or two .tlux files are needed")));
        }
    }
    result.value = result.value.or(result.vertices.and_then(|e| metric.of(e.rms, e.p999, e.worst)));
    Ok(result)
}

impl Comparison {
    /// Returns whether the metric is above the threshold; without a threshold, whether the contents differ.
    pub fn differs(&self) -> bool {
        match (self.threshold, self.value) {
            (Some(limit), Some(value)) => value > limit,
            _ => !self.equal,
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figures = match (&self.vertices, &self.image) {
            (Some(v), _) => {
                let single = self.single_scattering.map_or_else(String::new, |s| {
                    format!(
                        " (the worse of radiosity alone and with single scattering; single scattering alone: RMS {})",
                        percent(s.rms)
                    )
                });
                let [rms, bias, p999, worst] = [v.rms, v.bias, v.p999, v.worst].map(percent);
                format!("RMS {rms}, bias {bias}, 99.9th percentile {p999}, worst vertex {worst}{single}")
            }
            (_, Some(i)) => {
                let [rms, whole, p999, worst] = [i.rms, i.rms_with_background, i.p999, i.worst].map(percent);
                let (flip, covered) = (flip_text(self.flip.as_ref()), i.covered);
                format!(
                    "{flip}RMS {rms} over {covered} covered pixels ({whole} with background), 99.9th percentile {p999}, \
                     worst pixel {worst}"
                )
            }
            _ => String::new(),
        };
        let verdict = if self.equal { "equal" } else { "different" };
        match (&self.assets, figures.as_str()) {
            (Some(assets), "") => write!(f, "{verdict}: {}", assets.describe()),
            (Some(assets), _) => write!(f, "{verdict}: {figures}, worst light each\n{}", assets.describe()),
            _ => write!(f, "{verdict}: {figures}"),
        }
    }
}

fn flip_text(flip: Option<&FlipReport>) -> String {
    let Some(flip) = flip else { return String::new() };
    let covered = flip.mean_covered.map_or_else(String::new, |mean| format!(" ({mean:.4} over covered pixels)"));
    let exposures = match flip.exposures {
        Exposures { count: 1, .. } => "1 exposure".to_owned(),
        Exposures { start, stop, count, .. } => format!("{count} exposures from {start:+.1} to {stop:+.1} stops"),
    };
    format!("HDR-FLIP {:.4}{covered} at {exposures}, ", flip.mean)
}
