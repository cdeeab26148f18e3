//! Roles of materials: translucent with a medium, or opaque.

use serde::Serialize;

use crate::error::{Error, Result};
use crate::geometry::mesh::{Mesh, material_indices};

/// Optical role of a material of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Translucent, with the medium of this index.
    Medium(u32),
    /// Casts shadows, exchanges no light.
    Opaque,
}

/// The role of each material of a mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaterialRoles {
    of_material: Vec<Role>,
}

impl MaterialRoles {
    /// Every material is the same medium, with index 0.
    pub fn single(materials: usize) -> Self {
        Self { of_material: vec![Role::Medium(0); materials] }
    }

    /// Roles by name: `media` gives names of materials with the index of their medium, `opaque` names the opaque ones,
    /// and every other material has the medium `rest`.
    ///
    /// # Errors
    /// Command line: a name that no material has (the message lists those that exist), or one that is given twice with
    /// different roles.
    pub fn resolve(materials: &[String], media: &[(String, u32)], rest: u32, opaque: &[String]) -> Result<Self> {
        let mut given: Vec<Option<Role>> = vec![None; materials.len()];
        let names: Vec<String> = media.iter().map(|(name, _)| name.clone()).collect();
        let media_roles = material_indices(materials, &names, "--material")?;
        let media_roles = media_roles.into_iter().zip(media.iter().map(|(_, medium)| Role::Medium(*medium)));
        let opaque_roles = material_indices(materials, opaque, "--opaque")?.into_iter().map(|m| (m, Role::Opaque));
        for (material, role) in media_roles.chain(opaque_roles) {
            let slot = &mut given[material as usize];
            if slot.is_some_and(|old| old != role) {
                return Err(Error::command_line(format!(
                    "the material '{}' is given two roles by --material and --opaque: keep one",
                    materials[material as usize]
                )));
            }
            *slot = Some(role);
        }
        Ok(Self { of_material: given.into_iter().map(|role| role.unwrap_or(Role::Medium(rest))).collect() })
    }

    /// Role of a material; the first medium for an index that the source does not have.
    pub fn of_material(&self, material: u32) -> Role {
        self.of_material.get(material as usize).copied().unwrap_or(Role::Medium(0))
    }

    pub(super) fn of_triangle(&self, mesh: &Mesh, triangle: u32) -> Role {
        self.of_material(mesh.triangle_material[triangle as usize])
    }

    pub(super) fn distinct(&self) -> Vec<Role> {
        let mut roles = self.of_material.clone();
        roles.push(Role::Medium(0));
        roles.sort_unstable();
        roles.dedup();
        roles
    }
}
