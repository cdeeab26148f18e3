//! Exitance between whoever computes it and whoever draws it: at the source vertices, or at any point of the surface.

use glam::DVec3;

/// Exitance of a triangle mesh, linear RGB, in the unit of the lights' irradiance.
pub trait Exitance: Sync {
    /// The exitance of every source vertex, in the order of the source; zero for vertices without transferring area.
    fn at_vertices(&self) -> &[DVec3];

    /// The exitance at a point of a triangle (an index into the mesh's triangles); `barycentric` holds the weights of its
    /// corners, which add up to 1. Zero for a triangle that the mesh does not have.
    fn at(&self, triangle: u32, barycentric: [f64; 3]) -> DVec3;
}

/// Exitance of the vertices, interpolated linearly over each triangle.
#[derive(Clone, Copy, Debug)]
pub struct Interpolated<'a> {
    triangles: &'a [[u32; 3]],
    vertices: &'a [DVec3],
}

impl<'a> Interpolated<'a> {
    /// `triangles` name the corners, `vertices` holds the exitance of each vertex.
    pub fn new(triangles: &'a [[u32; 3]], vertices: &'a [DVec3]) -> Self {
        Self { triangles, vertices }
    }
}

impl Exitance for Interpolated<'_> {
    fn at_vertices(&self) -> &[DVec3] {
        self.vertices
    }

    fn at(&self, triangle: u32, barycentric: [f64; 3]) -> DVec3 {
        let Some(corners) = self.triangles.get(triangle as usize) else { return DVec3::ZERO };
        let [a, b, c] = corners.map(|v| self.vertices.get(v as usize).copied().unwrap_or(DVec3::ZERO));
        a * barycentric[0] + b * barycentric[1] + c * barycentric[2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_have_their_values_and_the_centre_their_mean() {
        let values = [DVec3::X, DVec3::Y, DVec3::Z];
        let exitance = Interpolated::new(&[[2, 0, 1]], &values);
        assert_eq!(exitance.at_vertices(), values);
        assert_eq!(exitance.at(0, [1.0, 0.0, 0.0]), DVec3::Z);
        assert_eq!(exitance.at(0, [0.0, 0.0, 1.0]), DVec3::Y);
        let third = 1.0 / 3.0;
        assert!((exitance.at(0, [third; 3]) - DVec3::splat(third)).length() < 1e-15);
        assert_eq!(exitance.at(1, [third; 3]), DVec3::ZERO);
    }
}
