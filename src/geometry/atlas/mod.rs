//! Texture atlases: a map of every triangle of a mesh to the unit square, and the surface cut by its texels.
//!
//! `u` points right, `v` up. A map of our own keeps the winding of the triangles, and charts are two texels apart at the
//! resolution that it is packed for. Coordinates are whole steps of 1/65535: what is stored is what is computed with.
//!
//! A closed surface has no isometric map; what a map gives up is for [`Map`] to choose, and [`Report`] says how much.

mod cut;
mod flatten;
mod measure;
mod outline;
#[cfg(test)]
mod tests;
pub mod texels;
mod unwrap;

use glam::Vec2;

use self::cut::{Codes, STEPS};
use self::flatten::Kind;
pub use self::measure::Report;
pub use self::outline::Outline;
use super::mesh::Mesh;
use crate::error::{Error, Result};

/// Largest overlap, and share of the surface without an area in the map, of texture coordinates that count as bijective.
pub const MOST_OVERLAP: f64 = 1e-3;

/// How far texture coordinates may lie beyond the unit square.
const SLACK: f32 = 1e-4;

/// A map of every triangle to the unit square, bijective over the whole mesh up to what [`Report`] says.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Atlas {
    /// Place of each corner of each triangle of the mesh, opaque parts too: multiples of 1/65535.
    pub corners: Vec<[Vec2; 3]>,
}

/// Which map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Map {
    /// The mesh's own texture coordinates where they are bijective, otherwise [`Map::Shape`].
    #[default]
    Auto,
    /// The mesh's own texture coordinates, moved and scaled into the unit square where they leave it.
    Own,
    /// Charts as rigid as possible (Liu et al. 2008).
    Shape,
    /// Charts that keep angles (Levy et al. 2002); areas vary.
    Conformal,
    /// Charts whose stretch is evened out, so that areas vary little (Yoshizawa, Belyaev and Seidel 2004).
    Area,
}

impl Atlas {
    /// The map of a mesh, with gutters for `page` texels a side (at least 16).
    ///
    /// # Errors
    /// Invalid input where its own texture coordinates are asked for and there are none, or they are not bijective.
    /// Run time where the surface cannot be unwrapped.
    pub fn new(mesh: &Mesh, map: Map, page: u32) -> Result<(Self, Report)> {
        let own = if matches!(map, Map::Auto | Map::Own) { Some(own(mesh)) } else { None };
        let codes = match (own, map) {
            (Some(Ok((codes, report))), _) => return Ok((Self::from_codes(&codes), report)),
            (Some(Err(error)), Map::Own) => return Err(error),
            (_, Map::Conformal | Map::Area) => {
                let mut charts = unwrap::charts(mesh)?;
                flatten::flatten(mesh, &mut charts, if map == Map::Area { Kind::Area } else { Kind::Conformal });
                unwrap::repacked(mesh, &charts, page)?
            }
            _ => unwrap::rigid(mesh, page)?,
        };
        Ok((Self::from_codes(&codes), Report::new(mesh, &codes, false)))
    }

    /// The map with these corners, in steps of 1/65535.
    pub fn from_codes(codes: &[[[u16; 2]; 3]]) -> Self {
        let place = |code: [u16; 2]| Vec2::from(code.map(|c| f32::from(c) / STEPS as f32));
        Self { corners: codes.iter().map(|corners| corners.map(place)).collect() }
    }

    /// The corners in steps of 1/65535; those beyond the unit square are clamped to it.
    pub fn codes(&self) -> Vec<[[u16; 2]; 3]> {
        self.corners.iter().map(|corners| corners.map(code)).collect()
    }

    /// Measures of the map; `own` says whether it is that of the mesh's texture coordinates.
    pub fn report(&self, mesh: &Mesh, own: bool) -> Report {
        let mut codes = self.codes();
        codes.resize(mesh.triangles.len(), Codes::default());
        Report::new(mesh, &codes, own)
    }
}

fn code(place: Vec2) -> [u16; 2] {
    place.to_array().map(|v| (f64::from(v) * STEPS).round() as u16)
}

/// The shift and the scale that bring a range of texture coordinates into the unit square: whole tiles where that will do, since they are
/// the same texture, otherwise the corner of the range, scaled down evenly where the range is larger than the square.
fn into_square(low: Vec2, high: Vec2) -> (Vec2, f32) {
    let tile = (low + SLACK).floor();
    if (high - tile).max_element() <= 1.0 + SLACK {
        return (tile, 1.0);
    }
    (low, 1.0 / (high - low).max_element().max(1.0))
}

/// The map of a mesh's own texture coordinates, if it is bijective.
fn own(mesh: &Mesh) -> Result<(Vec<Codes>, Report)> {
    let remedy = "let the map be made (`shape`)";
    let uvs = mesh.uvs.as_ref().filter(|uvs| !uvs.values.is_empty() && uvs.corners.len() == mesh.triangles.len());
    let Some(uvs) = uvs else { return Err(Error::input(format!("the mesh has no texture coordinates: {remedy}"))) };
    let place = |index: u32| uvs.values.get(index as usize).copied().unwrap_or(Vec2::NAN);
    let used = || uvs.corners.iter().flatten().map(|index| place(*index));
    if !used().all(Vec2::is_finite) {
        return Err(Error::input(format!("texture coordinates of the mesh are not finite: {remedy}")));
    }
    let (low, high) = used().fold((Vec2::INFINITY, Vec2::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    let (origin, scale) = into_square(low, high);
    let in_square = |index: u32| code(scale * (place(index) - origin));
    let codes: Vec<Codes> = uvs.corners.iter().map(|corners| corners.map(in_square)).collect();
    let report = Report::new(mesh, &codes, true);
    let area = |flat: bool| {
        let passing = codes.iter().enumerate().filter(|(_, c)| !flat || cut::doubled_area(c) == 0);
        passing.map(|(t, _)| mesh.area_mm2(t as u32)).sum::<f64>()
    };
    let (overlap, flat) = (report.overlap, area(true) / area(false));
    if overlap > MOST_OVERLAP || flat > MOST_OVERLAP {
        let percent = |share: f64| (100.0 * share * 10.0).round() / 10.0;
        return Err(Error::input(format!(
            "the mesh's texture coordinates are no map of its surface: {} % of the mapped area is covered again, {} % of \
             the surface has no area there; {remedy}",
            percent(overlap),
            percent(flat)
        )));
    }
    Ok((codes, report))
}
