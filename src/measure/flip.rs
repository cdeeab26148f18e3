//! HDR-FLIP: how different two rendered pictures look when a person flips between them, whatever the exposure.
//!
//! Andersson et al., "Visualizing Errors in Rendered High Dynamic Range Images" (2021), over "FLIP: A Difference
//! Evaluator for Alternating Images" (2020). The reference gives a range of exposures; at each of them both pictures
//! are tone-mapped and compared as they look from a distance (LDR-FLIP); a pixel's error is the largest of these.
//!
//! The figures are those of the authors' own evaluator (PyPI `flip-evaluator`) wherever it gives any. Cases that it
//! refuses or leaves open are settled here:
//! - A value that is not finite is an error. A negative value counts as 0.
//! - A black reference has no exposures: they come from the test picture then. Two black pictures are equal.
//! - Equal pictures give 0 in every pixel, and no value is ever outside [0, 1].
//!
//! Pixels do not depend on the number of threads.

mod colour;
mod filters;

use std::f64::consts::PI;
use std::ops::Range;

use glam::DVec3;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::parallel::*;
use colour::{Colours, luminance, tone_curve_inverse, tone_mapped};
use filters::{Filters, Plane};

/// A picture of linear Rec. 709 radiance, row by row from the top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picture<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` pixels.
    pub rgb: &'a [[f32; 3]],
}

/// Viewing conditions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Pixels in a degree of the field of view, 1 to 1000.
    pub pixels_per_degree: f64,
    /// Exposures; from the reference where none are given.
    pub exposures: Option<Exposures>,
}

impl Default for Settings {
    /// The papers' viewer: 0.7 m before a screen of 0.7 m and 3840 pixels, which is 67 pixels per degree (67.02).
    fn default() -> Self {
        Self { pixels_per_degree: 3840.0 * PI / 180.0, exposures: None }
    }
}

/// Exposures at equal distances; a picture is multiplied by 2 to the power of each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Exposures {
    /// The darkest picture, in stops: the brightest pixel is just below white.
    pub start: f64,
    /// The brightest picture, in stops: half of the pixels are as bright.
    pub stop: f64,
    /// Number of exposures; 1 where both ends are the same.
    pub count: usize,
    /// Source of the exposures.
    pub from: ExposuresFrom,
}

/// Source of the exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ExposuresFrom {
    /// The reference picture.
    Reference,
    /// The test picture, where the reference is black.
    Test,
    /// None: both pictures are black, and shown as they are.
    Neither,
    /// The caller's settings.
    Settings,
}

/// Result of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct HdrFlip {
    /// Mean over all pixels, in [0, 1].
    pub mean: f64,
    /// Error of each pixel, in [0, 1], row by row.
    pub per_pixel: Vec<f32>,
    /// The exposures at which the pictures were compared.
    pub exposures: Exposures,
}

impl HdrFlip {
    /// Mean over the pixels of a mask; `None` where the mask has another size or no pixel.
    pub fn mean_over(&self, mask: &[bool]) -> Option<f64> {
        if mask.len() != self.per_pixel.len() {
            return None;
        }
        mean(self.per_pixel.iter().zip(mask).filter(|(_, inside)| **inside).map(|(error, _)| *error))
    }
}

/// HDR-FLIP of a test picture against a reference of the same size. Not symmetric: the reference sets the exposures.
///
/// # Errors
/// Pictures of different sizes or without pixels, a value that is not finite (exit 3); settings out of range (exit 1).
pub fn hdr(reference: &Picture, test: &Picture, settings: &Settings) -> Result<HdrFlip> {
    check(reference, "the reference")?;
    check(test, "the test picture")?;
    let size = |p: &Picture| format!("{}x{}", p.width, p.height);
    if (reference.width, reference.height) != (test.width, test.height) {
        let (reference, test) = (size(reference), size(test));
        return Err(Error::input(format!("the reference has {reference} pixels and the test picture {test}")));
    }
    let per_degree = settings.pixels_per_degree;
    if !(1.0..=1000.0).contains(&per_degree) {
        return Err(Error::command_line(format!("{per_degree} pixels per degree: 1 to 1000 are possible")));
    }
    let exposures = match settings.exposures {
        Some(given) => given.checked()?,
        None => Exposures::of(reference, test),
    };
    let viewing = Viewing { filters: Filters::new(per_degree), colours: Colours::new() };
    let bands: Vec<Range<usize>> = ranges(reference.height, TILE_HEIGHT).collect();
    let tiles: Vec<Vec<Tile>> = bands
        .into_par_iter()
        .map(|rows| {
            let columns = ranges(reference.width, TILE_WIDTH);
            columns.map(|columns| Tile::compare(reference, test, &viewing, &exposures, columns, rows.clone())).collect()
        })
        .collect();
    let mut per_pixel = Vec::with_capacity(reference.rgb.len());
    for band in &tiles {
        let height = band.first().map_or(0, |tile| tile.size.height);
        for row in 0..height {
            for tile in band {
                per_pixel.extend(tile.errors.chunks_exact(tile.size.width).nth(row).unwrap_or(&[]));
            }
        }
    }
    let mean = mean(per_pixel.iter().copied()).unwrap_or(0.0);
    Ok(HdrFlip { mean, per_pixel, exposures })
}

/// Size of a tile in pixels: large enough that margins cost little, small enough that its planes stay in cache.
const TILE_WIDTH: usize = 192;
const TILE_HEIGHT: usize = 48;

fn ranges(length: usize, step: usize) -> impl Iterator<Item = Range<usize>> {
    (0..length).step_by(step).map(move |start| start..(start + step).min(length))
}

fn mean(errors: impl Iterator<Item = f32>) -> Option<f64> {
    let (sum, count) = errors.fold((0.0, 0usize), |(sum, count), e| (sum + f64::from(e), count + 1));
    (count > 0).then(|| sum / count as f64)
}

fn check(picture: &Picture, name: &str) -> Result<()> {
    let Picture { width, height, rgb } = *picture;
    if width.checked_mul(height) != Some(rgb.len()) || rgb.is_empty() {
        return Err(Error::input(format!("{name} has {} pixels for {width}x{height}", rgb.len())));
    }
    match rgb.iter().position(|pixel| !pixel.iter().all(|v| v.is_finite())) {
        Some(i) => {
            let (x, y) = (i % width, i / width);
            Err(Error::input(format!("{name} is not finite at column {x}, row {y}: {:?}", rgb[i])))
        }
        None => Ok(()),
    }
}

/// Linear RGB of a pixel, negative values counted as 0.
fn light(pixel: &[f32; 3]) -> DVec3 {
    DVec3::from_array(pixel.map(f64::from)).max(DVec3::ZERO)
}

impl Exposures {
    /// The exposures of a reference (2021, section 3): from the one that brings its brightest pixel to 85 % of white to
    /// the one that brings its median there, a stop apart or less, two at least.
    fn of(reference: &Picture, test: &Picture) -> Self {
        let of_picture = |picture: &Picture, from| {
            let luminances: Vec<f64> = picture.rgb.iter().map(|pixel| luminance(light(pixel))).collect();
            Self::of_luminances(luminances, from)
        };
        of_picture(reference, ExposuresFrom::Reference)
            .or_else(|| of_picture(test, ExposuresFrom::Test))
            .unwrap_or(Self { start: 0.0, stop: 0.0, count: 1, from: ExposuresFrom::Neither })
    }

    /// The exposures for these luminances; `None` for a black picture.
    fn of_luminances(mut luminances: Vec<f64>, from: ExposuresFrom) -> Option<Self> {
        /// Tone-mapped luminance that the brightest pixel has at one end and the median at the other.
        const BRIGHT: f64 = 0.85;
        /// Least median: a darker one counts as this, which bounds the exposures of an object before black.
        const DARKEST_MEDIAN: f64 = f32::EPSILON as f64;
        let largest = luminances.iter().copied().fold(0.0, f64::max);
        if largest <= 0.0 {
            return None;
        }
        let middle = luminances.len() / 2;
        let (_, median, _) = luminances.select_nth_unstable_by(middle, f64::total_cmp);
        // A picture below the bound altogether has one exposure.
        let median = median.max(DARKEST_MEDIAN).min(largest);
        let bright = tone_curve_inverse(BRIGHT);
        let (start, stop) = ((bright / largest).log2(), (bright / median).log2());
        let count = if start < stop { ((stop - start).ceil() as usize).max(2) } else { 1 };
        Some(Self { start, stop, count, from })
    }

    fn checked(self) -> Result<Self> {
        let range = -300.0..=300.0;
        if range.contains(&self.start) && range.contains(&self.stop) && (1..=1000).contains(&self.count) {
            return Ok(Self { from: ExposuresFrom::Settings, ..self });
        }
        let Self { start, stop, count, .. } = self;
        Err(Error::command_line(format!("{count} exposures from {start} to {stop} stops: 1 to 1000 within +-300")))
    }

    /// Factors that pictures are multiplied by, dark to bright.
    fn factors(&self) -> impl Iterator<Item = f64> {
        let Self { start, stop, count, .. } = *self;
        let step = (stop - start) / (count.max(2) - 1) as f64;
        (0..count).map(move |i| (start + i as f64 * step).exp2())
    }
}

/// A part of the pictures with its errors.
struct Tile {
    size: TileSize,
    errors: Vec<f32>,
}

impl Tile {
    fn compare(
        reference: &Picture,
        test: &Picture,
        viewing: &Viewing,
        exposures: &Exposures,
        columns: Range<usize>,
        rows: Range<usize>,
    ) -> Self {
        let size = TileSize { width: columns.len(), height: rows.len() };
        let reach = viewing.filters.reach();
        let reference = with_margin(reference, &columns, &rows, reach);
        let test = with_margin(test, &columns, &rows, reach);
        let mut errors = vec![0.0f64; size.width * size.height];
        if reference != test {
            for factor in exposures.factors() {
                let shown = |linear: &[DVec3]| linear.iter().map(|v| tone_mapped(*v * factor)).collect::<Vec<_>>();
                let (reference, test) = (shown(&reference), shown(&test));
                // White beside white: nothing to see at this exposure.
                if reference != test {
                    let found = viewing.difference(size, &reference, &test);
                    errors.iter_mut().zip(found).for_each(|(worst, e)| *worst = worst.max(e));
                }
            }
        }
        Self { size, errors: errors.into_iter().map(|e| e.clamp(0.0, 1.0) as f32).collect() }
    }
}

/// The pixels of a tile with its margin; beyond the border the picture's outermost pixels are repeated.
fn with_margin(picture: &Picture, columns: &Range<usize>, rows: &Range<usize>, reach: usize) -> Vec<DVec3> {
    let around = |range: &Range<usize>, length: usize| {
        let (start, end) = (range.start, range.end + 2 * reach);
        (start..end).map(move |i| i.saturating_sub(reach).min(length.saturating_sub(1)))
    };
    let mut pixels = Vec::with_capacity((columns.len() + 2 * reach) * (rows.len() + 2 * reach));
    for y in around(rows, picture.height) {
        let row = picture.rgb.get(y * picture.width..).unwrap_or(&[]);
        pixels.extend(around(columns, picture.width).map(|x| row.get(x).map_or(DVec3::ZERO, light)));
    }
    pixels
}

/// Filters and colours that all tiles of a comparison share.
struct Viewing {
    filters: Filters,
    colours: Colours,
}

/// Size of a tile without its margin, which is as wide as the filters reach.
#[derive(Clone, Copy)]
struct TileSize {
    width: usize,
    height: usize,
}

/// One tile as the eye sees it: filtered colours and the strength of edges and points.
struct Seen {
    hunt_lab: Vec<DVec3>,
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Viewing {
    /// FLIP of each pixel, in [0, 1]; the pictures are linear RGB in [0, 1] with the margin.
    fn difference(&self, size: TileSize, reference: &[DVec3], test: &[DVec3]) -> Vec<f64> {
        let (a, b) = (self.seen(size, reference), self.seen(size, test));
        let colours = a.hunt_lab.iter().zip(&b.hunt_lab);
        let edges = a.edges.iter().zip(&b.edges);
        let points = a.points.iter().zip(&b.points);
        colours.zip(edges.zip(points)).map(|(lab, (edge, point))| self.combined(lab, edge, point)).collect()
    }

    /// The colour difference, amplified where features differ (FLIP 2020, section 4.3).
    fn combined(&self, lab: (&DVec3, &DVec3), edge: (&f64, &f64), point: (&f64, &f64)) -> f64 {
        let colour = self.colours.difference(*lab.0, *lab.1);
        let feature = (edge.0 - edge.1).abs().max((point.0 - point.1).abs());
        // A first or second derivative is at most 1 along an axis, so a feature at most the root of 2.
        let feature = (feature * std::f64::consts::FRAC_1_SQRT_2).min(1.0).sqrt();
        colour.powf(1.0 - feature)
    }

    fn seen(&self, size: TileSize, rgb: &[DVec3]) -> Seen {
        let f = &self.filters;
        let opponent: Vec<DVec3> = rgb.iter().map(|v| self.colours.opponent(*v)).collect();
        let plane = |of: fn(&DVec3) -> f64| {
            let mut plane = Plane::new(size.width, size.height, f.reach());
            plane.values_mut().iter_mut().zip(&opponent).for_each(|(to, from)| *to = of(from));
            plane
        };
        let (y, cx, cz) = (plane(|v| v.x), plane(|v| v.y), plane(|v| v.z));
        let achromatic = y.filtered(&f.achromatic, &f.achromatic);
        let red_green = cx.filtered(&f.red_green, &f.red_green);
        let [(wide, wide_share), (narrow, narrow_share)] = &f.blue_yellow;
        let (wide, narrow) = (cz.filtered(wide, wide), cz.filtered(narrow, narrow));
        let blue_yellow = wide.iter().zip(&narrow).map(|(w, n)| w * wide_share + n * narrow_share);
        let hunt_lab = achromatic
            .iter()
            .zip(red_green)
            .zip(blue_yellow)
            .map(|((y, cx), cz)| self.colours.hunt_lab(self.colours.rgb(DVec3::new(*y, cx, cz))))
            .collect();
        let grey = plane(|v| (v.x + 16.0) / 116.0);
        let smooth = grey.across(&f.smooth);
        let strength = |across: Vec<f64>, down: Vec<f64>| across.iter().zip(down).map(|(x, y)| x.hypot(y)).collect();
        Seen {
            hunt_lab,
            edges: strength(grey.across(&f.slope).down(&f.smooth), smooth.down(&f.slope)),
            points: strength(grey.across(&f.bend).down(&f.smooth), smooth.down(&f.bend)),
        }
    }
}
