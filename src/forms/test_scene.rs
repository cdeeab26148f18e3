//! Scenes for the tests of this layer.
#![allow(clippy::unwrap_used)]

use crate::geometry::mesh::{Mesh, Scale, resolve_scale};
use crate::geometry::part_table::PartTable;
use crate::geometry::parts::{Analysis, MaterialRoles, PartsRule};
use crate::geometry::source::SourceModel;
use crate::medium::material::{Medium, preset};
use crate::scene::Scene;

/// A medium of a published material.
pub(super) fn medium(name: &str) -> Medium {
    Medium { name: name.to_owned(), properties: preset(name).unwrap().properties() }
}

/// A model in mm, all of one material.
pub(super) fn scene(model: SourceModel, material: &str) -> Scene {
    let placement = resolve_scale(&model, Some(Scale::MillimetresPerUnit(1.0))).unwrap();
    let (mut mesh, mut report) = Mesh::from_source(model, &placement).unwrap();
    let parts = Analysis::new(&mut mesh, &MaterialRoles::single(1), PartsRule::Auto, &mut report).parts;
    let parts = PartTable::of(&mesh, &parts);
    Scene { mesh, parts, media: vec![medium(material)] }
}
