//! The parts as transport and the asset see them: which triangles exchange light, and in which medium.

use super::mesh::Mesh;
use super::parts::{Parts, Role};

/// One part.
#[derive(Clone, Debug, PartialEq)]
pub struct PartEntry {
    /// Name for people.
    pub name: String,
    /// Index of its medium; none for an opaque part, which only casts shadows.
    pub medium: Option<u32>,
    /// Area in mm^2.
    pub area_mm2: f64,
    /// Number of triangles.
    pub triangle_count: usize,
}

impl PartEntry {
    /// True if light enters the part.
    pub fn transfers(&self) -> bool {
        self.medium.is_some()
    }
}

/// The parts of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartTable {
    /// For each triangle, an index into `parts`.
    pub triangle_part: Vec<u32>,
    /// The parts.
    pub parts: Vec<PartEntry>,
}

impl PartTable {
    /// The table of parts with these names and media; areas and counts follow from the mesh. `triangle_part` has one
    /// entry for each triangle; entries beyond the parts belong to none.
    pub fn new(mesh: &Mesh, triangle_part: Vec<u32>, parts: Vec<(String, Option<u32>)>) -> Self {
        let mut parts: Vec<PartEntry> = parts
            .into_iter()
            .map(|(name, medium)| PartEntry { name, medium, area_mm2: 0.0, triangle_count: 0 })
            .collect();
        for (triangle, &part) in triangle_part.iter().enumerate() {
            if let Some(part) = parts.get_mut(part as usize) {
                part.area_mm2 += mesh.area_mm2(triangle as u32);
                part.triangle_count += 1;
            }
        }
        Self { triangle_part, parts }
    }

    /// True if light enters the part of a triangle.
    pub fn transfers(&self, triangle: u32) -> bool {
        let part = self.triangle_part.get(triangle as usize).and_then(|&part| self.parts.get(part as usize));
        part.is_some_and(PartEntry::transfers)
    }

    /// The table of the same mesh scaled by `factor`.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.parts.iter_mut().for_each(|part| part.area_mm2 *= factor * factor);
        self
    }

    /// The table of the parts that the analysis of a mesh found.
    pub fn of(mesh: &Mesh, parts: &Parts) -> Self {
        let medium = |role: Role| match role {
            Role::Medium(medium) => Some(medium),
            Role::Opaque => None,
        };
        let entries = parts.parts.iter().map(|p| (p.name.clone(), medium(p.role))).collect();
        Self::new(mesh, parts.triangle_part.clone(), entries)
    }
}
