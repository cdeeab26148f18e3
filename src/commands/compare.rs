//! `translux compare A B`: pairs of PLY, EXR or assets; exact equality without a threshold.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Serialize;

use super::compare_assets::{self, AssetDifference};
use super::console::{Console, Format, percent};
use super::evaluate::SINGLE_INCLUDED;
use super::{output, report};
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::keys::share;
use crate::import::file::suffix;
use crate::io::exr::{ExrPlane, read_exr_channels};
use crate::io::ply::{PlyVertexTable, read_ply};
use crate::math::statistics::{VertexError, vertex_error};
use crate::measure::flip::{self, Exposures, Picture};
use crate::measure::image_error::{ImageError, image_error};

#[derive(Clone, Debug, Args)]
pub(super) struct CompareArgs {
    /// File to judge (.ply, .exr or .tlux)
    a: PathBuf,
    /// Reference of the same kind
    b: PathBuf,
    /// Figure that --fail-above judges
    #[arg(long, default_value = "rms")]
    metric: Metric,
    /// Exit with 7 if the metric is above this, such as 0.5%; without it anything but equality does. Assets are
    /// evaluated under fixed probe lights then
    #[arg(long, value_name = "E")]
    fail_above: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Metric {
    /// Area-weighted RMS over vertices, worst channel; RMS over covered pixels for pictures
    Rms,
    /// 99.9th percentile
    P999,
    /// Worst vertex or pixel
    Worst,
    /// HDR-FLIP of pictures: mean of what a person sees who flips between them, 0 to 1
    Flip,
}

impl Metric {
    /// `None` for a figure that vertices do not have.
    fn of(self, error: &VertexError) -> Option<f64> {
        match self {
            Self::Rms => Some(error.rms),
            Self::P999 => Some(error.p999),
            Self::Worst => Some(error.worst),
            Self::Flip => None,
        }
    }
}

/// HDR-FLIP of two pictures.
#[derive(Serialize)]
struct FlipReport {
    /// Over the whole picture.
    mean: f64,
    /// Over the pixels that either picture covers; none without any.
    mean_covered: Option<f64>,
    pixels_per_degree: f64,
    /// Stops that the pictures were compared at.
    exposures: Exposures,
}

#[derive(Serialize)]
struct CompareReport {
    #[serde(serialize_with = "report::path")]
    a: PathBuf,
    #[serde(serialize_with = "report::path")]
    b: PathBuf,
    equal: bool,
    metric: Metric,
    /// The metric; none for assets without a threshold, whose bytes are compared.
    value: Option<f64>,
    threshold: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    vertices: Option<VertexError>,
    /// Of single scattering alone, where both files have it; `vertices` is the worse of the radiosity and the sum of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    single_scattering: Option<VertexError>,
    #[serde(skip_serializing_if = "Option::is_none")]
    image: Option<ImageError>,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<FlipReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    assets: Option<AssetDifference>,
}

pub(super) fn run(args: &CompareArgs, console: &Console) -> Result<ExitCode> {
    let threshold = args.fail_above.as_deref().map(threshold).transpose()?;
    let suffixes = (suffix(&args.a), suffix(&args.b));
    let mut result = CompareReport {
        a: args.a.clone(),
        b: args.b.clone(),
        equal: false,
        metric: args.metric,
        value: None,
        threshold,
        vertices: None,
        single_scattering: None,
        image: None,
        flip: None,
        assets: None,
    };
    match (suffixes.0.as_str(), suffixes.1.as_str()) {
        ("ply", "ply") | ("tlux", "tlux") if args.metric == Metric::Flip => {
            let (a, b) = (args.a.display(), args.b.display());
            return Err(Error::command_line(format!(
                "{a} and {b}: --metric flip compares pictures; render both to .exr files and compare those"
            )));
        }
        ("ply", "ply") => compare_ply(&mut result, console)?,
        ("exr", "exr") => compare_exr(&mut result, console)?,
        ("tlux", "tlux") => compare_assets(&mut result, console)?,
        _ => {
            let (a, b) = (args.a.display(), args.b.display());
            return Err(Error::command_line(format!("{a} and {b}: two .ply, two .exr or two .tlux files are needed")));
        }
    }
    let differs = match (threshold, result.value) {
        (Some(limit), Some(value)) => value > limit,
        _ => !result.equal,
    };
    if console.format == Format::Text && console.verbosity == super::console::Verbosity::Normal {
        output::print_line(&describe(&result))?;
    }
    report::print(console, "compare", &result)?;
    Ok(if differs { ExitCode::Difference } else { ExitCode::Ok })
}

/// Zero is a threshold too.
fn threshold(text: &str) -> Result<f64> {
    if text.trim().trim_end_matches('%').trim().parse() == Ok(0.0) { Ok(0.0) } else { share(text, "--fail-above") }
}

fn describe(r: &CompareReport) -> String {
    let figures = match (&r.vertices, &r.image) {
        (Some(v), _) => {
            let single = r.single_scattering.map_or_else(String::new, |s| {
                format!(
                    " (the worse of radiosity alone and with single scattering; single scattering alone: RMS {})",
                    percent(s.rms)
                )
            });
            format!(
                "RMS {}, bias {}, 99.9th percentile {}, worst vertex {}{single}",
                percent(v.rms),
                percent(v.bias),
                percent(v.p999),
                percent(v.worst)
            )
        }
        (_, Some(i)) => {
            flip_text(r.flip.as_ref())
                + &format!(
                    "RMS {} over {} covered pixels ({} with background), 99.9th percentile {}, worst pixel {}",
                    percent(i.rms),
                    i.covered,
                    percent(i.rms_with_background),
                    percent(i.p999),
                    percent(i.worst)
                )
        }
        _ => String::new(),
    };
    let verdict = if r.equal { "equal" } else { "different" };
    match (&r.assets, figures.as_str()) {
        (Some(assets), "") => format!("{verdict}: {}", assets.describe()),
        (Some(assets), _) => format!("{verdict}: {figures}, worst light each\n{}", assets.describe()),
        _ => format!("{verdict}: {figures}"),
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

/// Columns of radiosity and of single scattering.
const B: [&str; 3] = ["b_r", "b_g", "b_b"];
const S: [&str; 3] = ["s_r", "s_g", "s_b"];

fn compare_ply(result: &mut CompareReport, console: &Console) -> Result<()> {
    let (a, b) = (read_ply(&result.a)?, read_ply(&result.b)?);
    if a.vertex_count != b.vertex_count {
        let counts = format!("{} and {} vertices", a.vertex_count, b.vertex_count);
        return Err(Error::new(ExitCode::Difference, format!("the files have {counts}")));
    }
    result.equal = a.columns == b.columns && a.triangles == b.triangles;
    let of = |table: &PlyVertexTable, path: &Path, names: [&str; 3]| -> Result<Vec<DVec3>> {
        let missing = || Error::input(format!("{}: no properties {}", path.display(), names.join(" ")));
        Ok(table.triples(names).ok_or_else(missing)?.into_iter().map(DVec3::from_array).collect())
    };
    let radiosity = [of(&a, &result.a, B)?, of(&b, &result.b, B)?];
    let single = [(&a, &result.a), (&b, &result.b)].map(|(table, path)| of(table, path, S).ok());
    let included = [&a, &b].map(|table| table.comments.iter().any(|c| c == SINGLE_INCLUDED));
    // Equal weights for a file without faces.
    let areas = match b.triples(["x", "y", "z"]).filter(|_| !b.triangles.is_empty()) {
        Some(positions) => vertex_areas(|v| DVec3::from_array(positions[v as usize]), b.vertex_count, &b.triangles),
        None => vec![1.0; b.vertex_count],
    };
    let error = |values: [&Vec<DVec3>; 2]| vertex_error(values[0], values[1], &areas);
    let sum = |side: usize| match &single[side] {
        Some(single) => radiosity[side].iter().zip(single).map(|(b, s)| *b + *s).collect(),
        None => radiosity[side].clone(),
    };
    let has = [0, 1].map(|side| included[side] || single[side].is_some());
    for side in (0..2).filter(|&side| included[side] && !has[1 - side]) {
        let with = [&result.a, &result.b][side].display();
        console.warn(&format!("the radiosity of {with} has single scattering in it, that of the other file has not"));
    }
    let worst = if included == [false; 2] && !in_both(has[0], has[1], result, console) {
        error([&radiosity[0], &radiosity[1]])
    } else {
        let with = error([&sum(0), &sum(1)]);
        match &single {
            [Some(own), Some(other)] => {
                result.single_scattering = Some(error([own, other]));
                with.max(error([&radiosity[0], &radiosity[1]]))
            }
            _ => with,
        }
    };
    result.value = result.metric.of(&worst);
    result.vertices = Some(worst);
    Ok(())
}

/// Whether single scattering is compared; says so where one file alone has it.
fn in_both(a: bool, b: bool, result: &CompareReport, console: &Console) -> bool {
    if a != b {
        let with = if a { &result.a } else { &result.b };
        console.note(&format!("{} alone has single scattering, which is not compared", with.display()));
    }
    a && b
}

/// A third of the area of the triangles around each vertex.
pub(super) fn vertex_areas(at: impl Fn(u32) -> DVec3, vertices: usize, triangles: &[[u32; 3]]) -> Vec<f64> {
    let mut areas = vec![0.0; vertices];
    for &[a, b, c] in triangles {
        let third = (at(b) - at(a)).cross(at(c) - at(a)).length() / 6.0;
        for v in [a, b, c] {
            areas[v as usize] += third;
        }
    }
    areas
}

/// Bytes alone without a threshold; with one, radiosity under probe lights as well.
fn compare_assets(result: &mut CompareReport, console: &Console) -> Result<()> {
    let read = |path: &PathBuf| std::fs::read(path).map_err(|e| Error::io(path, &e));
    let (a, b) = (read(&result.a)?, read(&result.b)?);
    result.equal = a == b;
    let mut assets = compare_assets::bytes(&a, &b, &result.a, &result.b)?;
    if result.threshold.is_some() {
        let (worst, probes) = compare_assets::radiosity([&a, &b], [&result.a, &result.b], console)?;
        result.value = result.metric.of(&worst);
        result.vertices = Some(worst);
        assets.probes = probes;
    }
    result.assets = Some(assets);
    Ok(())
}

fn compare_exr(result: &mut CompareReport, console: &Console) -> Result<()> {
    let (a, b) = (read_exr_channels(&result.a)?, read_exr_channels(&result.b)?);
    let layer = if find(&a, "diffuse.R").is_some() && find(&b, "diffuse.R").is_some() { "diffuse." } else { "" };
    // The parts of a file may differ in size.
    let size = |planes: &[ExrPlane]| find(planes, &format!("{layer}R")).map(|p| (p.width, p.height));
    if size(&a).is_some() && size(&b).is_some() && size(&a) != size(&b) {
        return Err(Error::new(ExitCode::Difference, "the pictures have different sizes"));
    }
    result.equal = a == b;
    let (mut picture, mut reference) = (rgb(&a, layer, &result.a)?, rgb(&b, layer, &result.b)?);
    let has_single = |planes| find(planes, "single.R").is_some();
    // The beauty has it anyway.
    if !layer.is_empty() && in_both(has_single(&a), has_single(&b), result, console) {
        add(&mut picture, &rgb(&a, "single.", &result.a)?);
        add(&mut reference, &rgb(&b, "single.", &result.b)?);
    }
    let covered: Vec<bool> = match (coverage(&a), coverage(&b)) {
        (Some(a), Some(b)) => a.iter().zip(b).map(|(a, b)| *a > 0.0 || *b > 0.0).collect(),
        _ => vec![true; picture.len()],
    };
    let error = image_error(&picture, &reference, &covered);
    if result.metric == Metric::Flip {
        result.flip = Some(flip_report(size(&b), &picture, &reference, &covered).map_err(|e| {
            let (a, b) = (result.a.display(), result.b.display());
            e.at(format!("{a} against the reference {b}"))
        })?);
    }
    result.value = match result.metric {
        Metric::Rms => Some(error.rms),
        Metric::P999 => Some(error.p999),
        Metric::Worst => Some(error.worst),
        Metric::Flip => result.flip.as_ref().map(|flip| flip.mean),
    };
    result.image = Some(error);
    Ok(())
}

fn flip_report(
    size: Option<(usize, usize)>,
    picture: &[[f32; 3]],
    reference: &[[f32; 3]],
    covered: &[bool],
) -> Result<FlipReport> {
    let (width, height) = size.unwrap_or((0, 0));
    let [test, reference] = [picture, reference].map(|rgb| Picture { width, height, rgb });
    let settings = flip::Settings::default();
    let found = flip::hdr(&reference, &test, &settings)?;
    Ok(FlipReport {
        mean: found.mean,
        mean_covered: found.mean_over(covered),
        pixels_per_degree: settings.pixels_per_degree,
        exposures: found.exposures,
    })
}

fn add(picture: &mut [[f32; 3]], layer: &[[f32; 3]]) {
    for (pixel, more) in picture.iter_mut().flatten().zip(layer.as_flattened()) {
        *pixel += more;
    }
}

fn find<'a>(planes: &'a [ExrPlane], name: &str) -> Option<&'a ExrPlane> {
    planes.iter().find(|p| p.name == name)
}

fn coverage(planes: &[ExrPlane]) -> Option<&[f32]> {
    find(planes, "coverage.A").or_else(|| find(planes, "A")).map(|p| p.samples.as_slice())
}

fn rgb(planes: &[ExrPlane], layer: &str, path: &Path) -> Result<Vec<[f32; 3]>> {
    let plane = |channel: &str| {
        let name = format!("{layer}{channel}");
        find(planes, &name).ok_or_else(|| Error::input(format!("{}: no channel {name}", path.display())))
    };
    let (r, g, b) = (plane("R")?, plane("G")?, plane("B")?);
    Ok(r.samples.iter().zip(&g.samples).zip(&b.samples).map(|((r, g), b)| [*r, *g, *b]).collect())
}
