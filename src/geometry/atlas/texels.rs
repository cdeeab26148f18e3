//! The surface cut by the texels of a map: exact areas and centroids of the pieces.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::Atlas;
use super::cut::{self, Codes, Piece};
use crate::error::{Error, Result};
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::PartTable;
use crate::parallel::*;

/// The piece of a triangle in a texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fragment {
    /// Triangle of the mesh.
    pub triangle: u32,
    /// Area on the surface, mm^2.
    pub area_mm2: f64,
    /// Centroid on the surface relative to the mesh's origin, mm.
    pub centre_mm: DVec3,
}

/// A texel of one part: the square from `(x, y)` to `(x + 1, y + 1)` over the resolution, in the unit square.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texel {
    /// Column, along u.
    pub x: u32,
    /// Row, along v.
    pub y: u32,
    /// Part of its fragments; a texel that parts share has an entry for each.
    pub part: u32,
    /// Its fragments.
    pub fragments: Range<u32>,
}

/// The surface of the parts that transfer light, cut by the texels of a square map.
///
/// The areas of a triangle's fragments add up to its area. A triangle without area in the map is one fragment, in the
/// texel of its centroid there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Texels {
    /// Texels of a side.
    pub resolution: u32,
    /// Texels that the surface touches, by part, then Morton code (x in the even bits).
    pub texels: Vec<Texel>,
    /// Fragments in the order of the texels, those of a texel by triangle.
    pub fragments: Vec<Fragment>,
    /// Texels of part `i` are `part_offsets[i]..part_offsets[i + 1]`; none for opaque parts.
    pub part_offsets: Vec<u32>,
}

/// A fragment of a triangle with these codes.
fn fragment(mesh: &Mesh, triangle: u32, codes: &Codes, resolution: u32, piece: &Piece) -> Fragment {
    let corners = mesh.corners_local_mm(triangle);
    let surface = mesh.area_mm2(triangle);
    if piece.area == 0.0 {
        let centre_mm = (corners[0] + corners[1] + corners[2]) / 3.0;
        return Fragment { triangle, area_mm2: surface, centre_mm };
    }
    let [a, b, c] = cut::in_texels(codes, resolution).map(|corner| corner - piece.centre);
    let weights = [b.perp_dot(c), c.perp_dot(a), a.perp_dot(b)];
    let doubled = weights[0] + weights[1] + weights[2];
    let sum: DVec3 = corners.iter().zip(weights).map(|(corner, weight)| *corner * (weight / doubled)).sum();
    let map = 0.5 * (DVec2::perp_dot(b - a, c - a)).abs();
    Fragment { triangle, area_mm2: surface * (piece.area / map), centre_mm: sum }
}

impl Texels {
    /// Cuts the surface. The atlas has an entry for each triangle; those beyond it are left out.
    ///
    /// # Errors
    /// Invalid input: a resolution that is no power of two from 16 to 4096, or a map whose triangles would be cut into
    /// more pieces than a bijective one has.
    pub fn new(mesh: &Mesh, parts: &PartTable, atlas: &Atlas, resolution: u32) -> Result<Self> {
        if !resolution.is_power_of_two() || !(16..=4096).contains(&resolution) {
            return Err(Error::input(format!("a map of {resolution} texels a side: take a power of two, 16 to 4096")));
        }
        let mut codes = atlas.codes();
        codes.truncate(mesh.triangles.len());
        if !cut::is_bounded(&codes, resolution) {
            return Err(Error::input("the texture atlas overlaps so often that its texels cannot be told apart"));
        }
        let transfers = |part: &u32| parts.parts.get(*part as usize).is_some_and(|p| p.transfers());
        let part = |triangle: usize| parts.triangle_part.get(triangle).copied().filter(transfers);
        let pairs = cut::blocks(&codes, resolution, part);
        let blocks: Vec<&[(u64, u32)]> = pairs.chunk_by(|a, b| a.0 == b.0).collect();
        let of = |block: &&[(u64, u32)]| {
            let mut pieces = Vec::new();
            for &(key, triangle) in *block {
                let codes = &codes[triangle as usize];
                cut::pieces(codes, resolution, key as u32, |piece| {
                    pieces.push((piece.texel, fragment(mesh, triangle, codes, resolution, &piece)));
                });
            }
            pieces.sort_by_key(|(texel, _)| *texel);
            pieces
        };
        let cut: Vec<Vec<(u32, Fragment)>> = blocks.par_iter().map(of).collect();
        let count = cut.iter().map(Vec::len).sum();
        let mut result = Self { resolution, part_offsets: vec![0], ..Self::default() };
        result.fragments.reserve_exact(count);
        for (block, pieces) in blocks.iter().zip(cut) {
            let part = block.first().map_or(0, |(key, _)| (key >> 32) as u32);
            for same in pieces.chunk_by(|a, b| a.0 == b.0) {
                let first = result.fragments.len() as u32;
                result.fragments.extend(same.iter().map(|(_, fragment)| *fragment));
                let [x, y] = same.first().map_or([0; 2], |(texel, _)| cut::from_morton(*texel));
                result.texels.push(Texel { x, y, part, fragments: first..result.fragments.len() as u32 });
            }
        }
        for part in 0..parts.parts.len() as u32 {
            result.part_offsets.push(result.texels.partition_point(|texel| texel.part <= part) as u32);
        }
        result.rescale(mesh);
        Ok(result)
    }

    /// Makes the areas of each triangle's fragments add up to its own.
    fn rescale(&mut self, mesh: &Mesh) {
        let mut sums = vec![0.0; mesh.triangles.len()];
        self.fragments.iter().for_each(|f| sums[f.triangle as usize] += f.area_mm2);
        self.fragments.par_iter_mut().for_each(|f| {
            let sum = sums[f.triangle as usize];
            if sum > 0.0 {
                f.area_mm2 *= mesh.area_mm2(f.triangle) / sum;
            }
        });
    }
}
