//! Patterns that multiply scattered light when it is seen, and that transport does not depend on (Wang, Tran and Luebke
//! 2005, section 5, multiply marble likewise). Reflected light stays unchanged.

pub mod marble;
pub mod noise;
pub mod picture;
pub mod spec;

use std::fmt;
use std::path::Path;

use glam::{DVec2, DVec3};

use self::marble::Marble;
use self::picture::PictureTexture;
use self::spec::TextureSpec;
use crate::error::Result;
use crate::geometry::mesh::Mesh;

/// The texture of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// Solid marble, fixed to the centre of the mesh's bounding box.
    Marble(Marble),
    /// Pictures over the texture coordinates, and factors of materials.
    Picture(PictureTexture),
}

impl Texture {
    /// The texture that `spec` gives on a mesh; none for no texture.
    ///
    /// # Errors
    /// Errors of [`Marble::new`], [`PictureTexture::read_image`] and [`PictureTexture::read_model`].
    pub fn new(spec: &TextureSpec, mesh: &Mesh) -> Result<Option<Self>> {
        match spec {
            TextureSpec::None => Ok(None),
            TextureSpec::Marble(spec) => Marble::new(*spec, mesh.diagonal_mm()).map(Self::Marble).map(Some),
            TextureSpec::Image(path) => PictureTexture::read_image(path, mesh).map(Self::Picture).map(Some),
            TextureSpec::BaseColour(path) => PictureTexture::read_model(path, mesh).map(Self::Picture).map(Some),
        }
    }

    /// The albedo at a point of a triangle, RGB in [0, 1]; `local_mm` is the point relative to the mesh's origin.
    pub fn albedo(&self, mesh: &Mesh, triangle: u32, weights: [f64; 3], local_mm: DVec3) -> DVec3 {
        match self {
            Self::Marble(marble) => marble.albedo(local_mm),
            Self::Picture(picture) => {
                let material = mesh.triangle_material.get(triangle as usize).map_or(0, |m| *m as usize);
                picture.albedo(material, uv(mesh, triangle, weights))
            }
        }
    }

    /// The file that the texture was read from.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Picture(PictureTexture {
                spec: TextureSpec::Image(path) | TextureSpec::BaseColour(path), ..
            }) => Some(path),
            _ => None,
        }
    }

    /// Warnings for the user, one line each.
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Marble(_) => &[],
            Self::Picture(picture) => &picture.warnings,
        }
    }

    /// The albedo at each source vertex; at a seam, on one of its sides.
    pub fn of_vertices(&self, mesh: &Mesh) -> Vec<DVec3> {
        let mut albedo = vec![DVec3::ONE; mesh.local_mm.len()];
        for (triangle, vertices) in (0u32..).zip(&mesh.triangles) {
            for (corner, vertex) in vertices.iter().enumerate() {
                let weights = std::array::from_fn(|i| f64::from(u8::from(i == corner)));
                if let (Some(out), Some(at)) = (albedo.get_mut(*vertex as usize), mesh.local_mm.get(*vertex as usize)) {
                    *out = self.albedo(mesh, triangle, weights, at.as_dvec3());
                }
            }
        }
        albedo
    }
}

/// The text form of the texture, with all defaults filled in.
impl fmt::Display for Texture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Marble(marble) => marble.spec.fmt(f),
            Self::Picture(picture) => picture.spec.fmt(f),
        }
    }
}

/// Texture coordinates of a point of a triangle, v up.
pub(crate) fn uv(mesh: &Mesh, triangle: u32, weights: [f64; 3]) -> Option<DVec2> {
    let uvs = mesh.uvs.as_ref()?;
    let corners = uvs.corners.get(triangle as usize)?;
    let mut sum = DVec2::ZERO;
    for (corner, weight) in corners.iter().zip(weights) {
        sum += uvs.values.get(*corner as usize)?.as_dvec2() * weight;
    }
    Some(sum)
}
