//! Extensions that a file may require: those that are read, and those that change shading only.

use gltf::json::Root;

use super::warnings::Warnings;
use crate::error::{Error, Result};

/// Integer vertex attributes.
pub(super) const QUANTIZATION: &str = "KHR_mesh_quantization";
/// Several placements of one node's mesh.
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// Compressed primitives.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// Extensions that leave every vertex and triangle in place. A name that ends in `_` is a prefix.
const WITHOUT_GEOMETRY: [&str; 14] = [
    "KHR_materials_",
    "EXT_materials_",
    "ADOBE_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "MSFT_packing_",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "KHR_techniques_webgl",
    "KHR_animation_pointer",
    "EXT_mesh_manifold",
];

/// Refuses required extensions that may hold geometry; warns about required ones whose effect is lost.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Result<()> {
    let required = || root.extensions_required.iter().map(String::as_str).filter(|name| !is_read(name));
    if let Some(name) = required().find(|name| !is_without_geometry(name)) {
        return Err(refusal(name));
    }
    let ignored: Vec<_> = required().collect();
    if !ignored.is_empty() {
        warnings.add(format!("required extensions without effect on the geometry are ignored: {ignored:?}"));
    }
    let used = root.extensions_used.iter().map(String::as_str);
    let unknown: Vec<_> = used.filter(|name| !is_read(name) && !is_without_geometry(name)).collect();
    if !unknown.is_empty() {
        warnings.add(format!("optional extensions are not read: {unknown:?}"));
    }
    Ok(())
}

/// Returns whether the document declares an extension.
pub(super) fn declares(root: &Root, name: &str) -> bool {
    root.extensions_used.iter().chain(&root.extensions_required).any(|used| used == name)
}

/// Returns whether the document declares an extension that compresses buffer views.
pub(super) fn declares_meshopt(root: &Root) -> bool {
    root.extensions_used.iter().chain(&root.extensions_required).any(|name| is_meshopt(name))
}

/// The error for geometry that only an unknown extension could give.
pub(super) fn refusal(name: &str) -> Error {
    let way_out = if name == DRACO || is_meshopt(name) {
        "compressed geometry is not read; decompress it first, for example with `gltf-transform copy IN.glb OUT.glb`"
    } else {
        "it may hold geometry that this reader does not know; export the model without it"
    };
    Error::unsupported(format!("the file requires the extension {}: {way_out}", name.escape_debug()))
}

fn is_read(name: &str) -> bool {
    name == QUANTIZATION || name == INSTANCING
}

fn is_meshopt(name: &str) -> bool {
    name == "EXT_meshopt_compression" || name == "KHR_meshopt_compression"
}

fn is_without_geometry(name: &str) -> bool {
    WITHOUT_GEOMETRY.iter().any(|known| name == *known || (known.ends_with('_') && name.starts_with(known)))
}
