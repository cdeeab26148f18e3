//! Radiosity in a texture: a map of the surface to the unit square, and what each texel of it shows.

use glam::{DVec3, Vec2};

use super::raster::{dilate, nearest};
use super::translucent_triangles;
use crate::error::{Error, Result};
use crate::evaluate::exitance::{Exitance, MeshPoint};
use crate::geometry::atlas::{Atlas, Map, Report};
use crate::geometry::mesh::Mesh;
use crate::io::exr_write::{ExrChannel, ExrImage, ExrLayer, SampleKind};
use crate::io::png::encode_png;
use crate::progress::Progress;
use crate::scene::Scene;

use super::colours::Exposed;

/// Texels of a side, least and most.
pub const SIDES: [u32; 2] = [16, 8192];

/// Points that are evaluated together.
const TOGETHER: usize = 1 << 20;

/// A map of the surface to the unit square.
pub struct Placed {
    /// The map.
    pub atlas: Atlas,
    /// What it covers and how it stretches.
    pub report: Report,
    is_own: bool,
}

impl Placed {
    /// The mesh's own texture coordinates where they are one-to-one, otherwise charts as rigid as possible, with gutters for a texture of
    /// this side.
    ///
    /// # Errors
    /// Run time where the surface cannot be unwrapped.
    pub fn new(mesh: &Mesh, side: u32) -> Result<Self> {
        let (atlas, report) = Atlas::new(mesh, Map::Auto, side)?;
        Ok(Self { is_own: report.own && is_unmoved(mesh, &atlas), atlas, report })
    }

    /// Whether it is the mesh's texture coordinates as they are, so that none need be added.
    pub fn is_own(&self) -> bool {
        self.is_own
    }
}

/// Whether a map of the texture coordinates leaves them where they are, up to its steps.
fn is_unmoved(mesh: &Mesh, atlas: &Atlas) -> bool {
    let Some(uvs) = &mesh.uvs else { return false };
    let value = |index: u32| uvs.values.get(index as usize).copied().unwrap_or(Vec2::NAN);
    let pairs = uvs.corners.iter().zip(&atlas.corners);
    pairs.flat_map(|(a, b)| a.iter().zip(b)).all(|(index, at)| (value(*index) - *at).abs().max_element() < 1e-4)
}

/// Radiosity of the texels of a map.
pub struct Lightmap {
    /// Texels of a side.
    pub side: u32,
    /// Radiosity of each texel, row by row from the top; those that show nothing are filled from their neighbours.
    pub texels: Vec<DVec3>,
    /// For each texel, 1 where its centre lies on the surface, 0 where not.
    pub covered: Vec<f64>,
}

impl Lightmap {
    /// Evaluates exitance at the centre of each texel, and beyond the edges of charts at the nearest point of the surface.
    ///
    /// # Errors
    /// Unsupported: a map that has no texel on a translucent part. Run time: exitance that is not finite.
    pub fn new(
        scene: &Scene,
        placed: &Placed,
        side: u32,
        exitance: &dyn Exitance,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let corners = |triangle: u32| Some((triangle, *placed.atlas.corners.get(triangle as usize)?));
        let nearest = nearest(translucent_triangles(scene).filter_map(corners), side);
        let mut known: Vec<usize> = (0..nearest.len()).filter(|i| nearest[*i].is_some()).collect();
        if known.is_empty() {
            return Err(Error::unsupported("no texel shows a translucent part: ask for a larger --resolution"));
        }
        // Neighbours on the surface share work.
        known.sort_by_key(|i| nearest[*i].map(|found| found.triangle));
        let mut values: Vec<Option<DVec3>> = vec![None; nearest.len()];
        for known in known.chunks(TOGETHER) {
            let point = |i: &usize| nearest[*i].and_then(|at| MeshPoint::new(&scene.mesh, at.triangle, at.weights));
            let points: Vec<MeshPoint> = known.iter().filter_map(point).collect();
            for (i, value) in known.iter().zip(exitance.at_each(&points, progress)) {
                if !value.is_finite() {
                    return Err(Error::runtime(format!("the exitance of texel {i} is not finite")));
                }
                values[*i] = Some(value);
            }
        }
        dilate(&mut values, side as usize);
        let covered =
            |found: &Option<super::raster::Nearest>| f64::from(u8::from(found.is_some_and(|at| at.distance2 == 0.0)));
        Ok(Self {
            side,
            texels: values.into_iter().map(Option::unwrap_or_default).collect(),
            covered: nearest.iter().map(covered).collect(),
        })
    }

    /// Share of the texels whose centre lies on a translucent part.
    pub fn coverage(&self) -> f64 {
        self.covered.iter().sum::<f64>() / self.covered.len().max(1) as f64
    }

    /// Radiosity as OpenEXR of 32 bits, never exposed, with the coverage as alpha.
    ///
    /// # Errors
    /// As [`ExrImage::encode`].
    pub fn to_exr(&self, attributes: Vec<(String, String)>) -> Result<Vec<u8>> {
        let channel = |name: &str, value: &dyn Fn(usize) -> f64| ExrChannel {
            name: name.to_owned(),
            kind: SampleKind::Float,
            samples: (0..self.texels.len()).map(|i| value(i).min(f64::from(f32::MAX)) as f32).collect(),
        };
        let mut channels: Vec<ExrChannel> =
            ["R", "G", "B"].iter().enumerate().map(|(c, name)| channel(name, &|i| self.texels[i][c])).collect();
        channels.push(channel("A", &|i| self.covered[i]));
        let (width, height) = (self.side as usize, self.side as usize);
        ExrImage { width, height, layers: vec![ExrLayer { name: String::new(), channels }], attributes }.encode()
    }

    /// Colours as 8-bit sRGB PNG.
    ///
    /// # Errors
    /// As [`encode_png`].
    pub fn to_png(&self, exposed: &Exposed) -> Result<Vec<u8>> {
        let rgb: Vec<[f32; 3]> = self.texels.iter().map(|b| exposed.colour(*b)).collect();
        encode_png(self.side as usize, self.side as usize, &rgb, None)
    }
}
