//! The report of what was handed on to engines.

use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Value, json};

use super::text::{megabytes, percent, significant};
use crate::evaluate::Cost;
use crate::export::basis::EditError;
use crate::export::harmonics::Flattening;
use crate::import::file::Input;
use crate::render::frame::ExitanceAt;

/// What was written for engines.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ExportReport {
    pub(crate) method: String,
    /// What was written: `vertex-colors`, `lightmap`, `sh1`, `sh2`, `basis` or `page`.
    #[serde(rename = "as")]
    pub(crate) kind: String,
    /// Media of the asset.
    pub(crate) materials: Vec<String>,
    /// Lights that colours are of; with harmonics, those under which the error was measured.
    pub(crate) lights: Vec<String>,
    /// Files of the lights, and the file that attributes were added to.
    pub(crate) inputs: Vec<Input>,
    #[serde(serialize_with = "super::paths")]
    #[cfg_attr(test, schemars(with = "Vec<String>"))]
    pub(crate) outputs: Vec<PathBuf>,
    /// Source vertices of the asset.
    pub(crate) vertices: usize,
    /// Names of the attributes that were added.
    pub(crate) attributes: Vec<String>,
    /// Bytes of the GLB; none where none was written.
    pub(crate) glb_bytes: Option<usize>,
    /// Millimetres of the asset in a metre of the file: 1000 where it has its true size.
    pub(crate) mm_per_metre: f64,
    /// How colours were exposed; none with harmonics.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) exposure: Option<ExposureReport>,
    /// The light map, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) lightmap: Option<LightmapReport>,
    /// Error of harmonics against the asset under the lights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) flattening: Option<Flattening>,
    /// What serves edits of the material, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) basis: Option<BasisReport>,
    /// The page, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) page: Option<PageReport>,
    pub(crate) cost: Cost,
}

/// Functions of the vertices that serve edits of the material.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct BasisReport {
    /// Functions over the vertices, four bytes each at every vertex.
    pub(crate) functions: usize,
    /// Factors of the absorption, and of the size, at which transfer was computed, ascending.
    pub(crate) absorption: Vec<f64>,
    pub(crate) size: Vec<f64>,
    /// How far edits between these are from the asset in their materials.
    pub(crate) errors: Vec<EditError>,
}

impl BasisReport {
    fn lines(&self) -> Vec<String> {
        let within = |of: &[f64]| match of {
            [first, .., last] => format!("x {} to x {}", significant(*first), significant(*last)),
            _ => "as it is".to_owned(),
        };
        let worst = self.errors.iter().max_by(|a, b| a.rms.total_cmp(&b.rms)).map(|of| {
            format!(
                "; edits between those that were computed are at most {} RMS from the asset (absorption x {}, size x {}; {} worst vertex)",
                percent(of.rms),
                significant(of.absorption),
                significant(of.size),
                percent(of.worst)
            )
        });
        vec![format!(
            "EDITS {} functions of the vertices; absorption {}, size {}{}",
            self.functions,
            within(&self.absorption),
            within(&self.size),
            worst.unwrap_or_default()
        )]
    }
}

/// A page with a light that turns.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct PageReport {
    /// Bytes of the page.
    pub(crate) bytes: usize,
    /// Directions from which the asset was lit.
    pub(crate) directions: usize,
    /// Functions over the vertices, a byte each at every vertex.
    pub(crate) functions: usize,
    /// Errors against the asset, each channel's RMS over its RMS, the worst channel, weighted by area: the mean and the largest over
    /// parallel lights that the page was not made of.
    pub(crate) mean_rms: f64,
    pub(crate) worst_rms: f64,
    /// The worst vertex under any of these lights, in the same unit.
    pub(crate) worst_vertex: f64,
    /// Number of these lights.
    pub(crate) probes: usize,
    /// The same RMS under the first light alone, under light from everywhere, and under the lights that do not turn; none where it is dark.
    pub(crate) first_rms: Option<f64>,
    pub(crate) ambient_rms: Option<f64>,
    pub(crate) fixed_rms: Option<f64>,
    /// Light and camera of the first view as options of `render`.
    pub(crate) render: String,
}

impl PageReport {
    /// What the page loses, a line each.
    pub(crate) fn lines(&self) -> Vec<String> {
        let [mean, worst, vertex] = [self.mean_rms, self.worst_rms, self.worst_vertex].map(percent);
        let others =
            [("ambient", self.ambient_rms), ("the other lights", self.fixed_rms), ("the first light", self.first_rms)];
        let others = others.into_iter().filter_map(|(name, rms)| Some(format!("; {name} {}", percent(rms?))));
        vec![
            format!(
                "PAGE {} functions of {} directions, a byte each a vertex: {mean} RMS against the asset under parallel light ({worst} at worst of \
                 {} lights that it was not made of, {vertex} worst vertex){}",
                self.functions,
                self.directions,
                self.probes,
                others.collect::<String>()
            ),
            format!("PAGE {}", megabytes(self.bytes as u64)),
        ]
    }
}

/// How radiosity became colours.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ExposureReport {
    /// As it was asked for: `auto` or stops.
    pub(crate) asked: String,
    /// Colours are radiosity times this, at most 1.
    pub(crate) factor: f64,
    /// Share of the area where a channel was cut at 1.
    pub(crate) clamped_share: f64,
}

/// A light map that was written.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct LightmapReport {
    /// Texels of a side.
    pub(crate) resolution: u32,
    /// Whether it lies on the texture coordinates of the mesh as they are.
    pub(crate) own_coordinates: bool,
    /// Number of charts.
    pub(crate) charts: u32,
    /// Share of the texels that show the surface.
    pub(crate) coverage: f64,
    /// Share of the mapped area that is covered again.
    pub(crate) overlap: f64,
    /// Where exitance was evaluated: at the vertices, or at what each texel shows (`pixels`).
    pub(crate) exitance: ExitanceAt,
}

impl LightmapReport {
    /// What it lies on and shows, in a line.
    pub(crate) fn line(&self) -> String {
        let on = if self.own_coordinates { "its own texture coordinates" } else { "new texture coordinates" };
        let at = match self.exitance {
            ExitanceAt::Vertices => "interpolated between the vertices, where the transport in this asset ends",
            ExitanceAt::Pixels => "evaluated at each texel",
        };
        let (side, charts, coverage) = (self.resolution, self.charts, percent(self.coverage));
        format!("LIGHT MAP {side} x {side} on {on}, {charts} charts, {coverage} covered; {at}")
    }
}

/// What the header of an OpenEXR file says of the radiosity in it.
pub(crate) fn radiosity_attributes(method: &str, materials: &[String], lights: &[String]) -> Vec<(String, String)> {
    let all = [
        ("software", format!("translux {}", env!("CARGO_PKG_VERSION"))),
        ("method", method.to_owned()),
        ("materials", materials.join("; ")),
        ("lights", lights.join("; ")),
        ("units", "radiosity: linear sRGB, in the unit of the irradiance of the lights".to_owned()),
    ];
    all.map(|(name, value)| (name.to_owned(), value)).into()
}

impl ExportReport {
    /// What a file says of itself in its extras, for shaders and for people.
    pub(crate) fn extras(&self) -> Value {
        let mut extras = json!({
            "as": self.kind, "method": self.method, "materials": self.materials,
            "unit": "radiosity in linear sRGB, in the unit of the irradiance of the light; lengths in metres",
            "mmPerMetre": self.mm_per_metre,
        });
        if let Some(exposure) = &self.exposure {
            extras["lights"] = self.lights.clone().into();
            extras["exposure"] = exposure.factor.into();
            extras["colours"] = "radiosity times exposure, at most 1".into();
        }
        if self.flattening.is_some() {
            extras["harmonics"] =
                "real, orthonormal, +Y up, all signs positive: 1, y, z, x, xy, yz, 3zz-1, xz, xx-yy".into();
            extras["radiosity"] = match self.basis {
                Some(_) => "max(0, sum of functions times weights, which follow from asset.extras.translux.basis, edit and light)",
                None => "max(0, sum of transfer times the coefficients of the light's radiance)",
            }
            .into();
        }
        extras
    }

    /// The same in the header of an OpenEXR file.
    pub(crate) fn attributes(&self) -> Vec<(String, String)> {
        radiosity_attributes(&self.method, &self.materials, &self.lights)
    }

    /// What is lost on the way, a line each.
    pub(crate) fn lines(&self) -> Vec<String> {
        let exposure = self.exposure.as_ref().map(|exposure| {
            let (factor, cut) = (significant(exposure.factor), percent(exposure.clamped_share));
            format!("EXPOSURE colours are radiosity x {factor}, at most 1: {cut} of the surface is cut there")
        });
        let lightmap = self.lightmap.as_ref().map(LightmapReport::line);
        let flattening = self.flattening.as_ref().map(|of| {
            let [rms, worst, negative, uncut] = [of.error.rms, of.error.worst, of.negative_share, of.uncut.rms].map(percent);
            let under = self.lights.join(" + ");
            let ringing = match of.negative_share > 0.0 {
                true => format!(
                    "ringing: {negative} of the surface below 0, at most by {} of the mean, cut to 0 ({uncut} RMS without the cut)",
                    percent(of.lowest.abs())
                ),
                false => "no ringing below 0".to_owned(),
            };
            format!("FLATTENING {rms} RMS against the asset under {under}, {worst} worst vertex; {ringing}")
        });
        let page = self
            .page
            .as_ref()
            .map(|page| page.lines().into_iter().chain([format!("FIRST VIEW render {}", page.render)]));
        let basis = self.basis.iter().flat_map(BasisReport::lines);
        [exposure, lightmap, flattening].into_iter().flatten().chain(basis).chain(page.into_iter().flatten()).collect()
    }
}
