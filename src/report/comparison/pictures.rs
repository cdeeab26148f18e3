//! Comparison of two OpenEXR pictures: RMS over covered pixels, and HDR-FLIP.

use std::path::Path;

use serde::Serialize;

use super::vertices::in_both;
use crate::error::{Error, ExitCode, Result};
use crate::io::exr::{ExrPlane, read_exr_channels};
use crate::measure::flip::{self, Exposures, Picture};
use crate::measure::image_error::{ImageError, image_error};

/// HDR-FLIP of two pictures.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FlipReport {
    /// Mean over the whole picture.
    pub mean: f64,
    /// Mean over the pixels that either picture covers; none without any.
    pub mean_covered: Option<f64>,
    /// Resolution of the eye.
    pub pixels_per_degree: f64,
    /// Exposures in stops at which the pictures were compared.
    pub exposures: Exposures,
}

/// Errors of the first of two pictures against the second.
pub(super) struct Pictures {
    /// Whether all channels are the same.
    pub(super) equal: bool,
    pub(super) error: ImageError,
    pub(super) flip: Option<FlipReport>,
    pub(super) notes: Vec<String>,
}

/// Compares two files, with HDR-FLIP where it is asked for.
pub(super) fn compare(paths: [&Path; 2], with_flip: bool) -> Result<Pictures> {
    let [a, b] = [read_exr_channels(paths[0])?, read_exr_channels(paths[1])?];
    let layer = if find(&a, "diffuse.R").is_some() && find(&b, "diffuse.R").is_some() { "diffuse." } else { "" };
    // The parts of a file may differ in size.
    let size = |planes: &[ExrPlane]| find(planes, &format!("{layer}R")).map(|p| (p.width, p.height));
    if size(&a).is_some() && size(&b).is_some() && size(&a) != size(&b) {
        return Err(Error::new(ExitCode::Difference, "the pictures have different sizes"));
    }
    let (mut picture, mut reference) = (rgb(&a, layer, paths[0])?, rgb(&b, layer, paths[1])?);
    let has_single = [&a, &b].map(|planes| find(planes, "single.R").is_some());
    let mut notes = Vec::new();
    // The beauty has it anyway.
    if !layer.is_empty() && in_both(has_single, paths, &mut notes) {
        add(&mut picture, &rgb(&a, "single.", paths[0])?);
        add(&mut reference, &rgb(&b, "single.", paths[1])?);
    }
    let covered: Vec<bool> = match (coverage(&a), coverage(&b)) {
        (Some(a), Some(b)) => a.iter().zip(b).map(|(a, b)| *a > 0.0 || *b > 0.0).collect(),
        _ => vec![true; picture.len()],
    };
    let flip = with_flip.then(|| flip_report(size(&b), &picture, &reference, &covered)).transpose();
    let against = || format!("{} against the reference {}", paths[0].display(), paths[1].display());
    Ok(Pictures {
        equal: a == b,
        error: image_error(&picture, &reference, &covered),
        flip: flip.map_err(|e| e.at(against()))?,
        notes,
    })
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
