//! glTF 2.0 models, JSON with external or embedded buffers and binary GLB.
//!
//! The file's JSON is parsed by the `gltf` crate; everything it refers to is checked and read here, because the
//! crate's own readers turn a wrong range or type into missing or arbitrary values. Node transforms are applied,
//! a mesh appears once for each node and instance that places it, and lengths are metres.
//!
//! Supported are triangles, strips and fans; `POSITION`, `NORMAL` and `TEXCOORD_0`; sparse accessors;
//! `KHR_mesh_quantization`; `EXT_mesh_gpu_instancing`. Skins and morph targets are not applied (a warning says so), but by
//! [`read_poses`], which samples animations.
//! Compressed geometry (Draco, meshopt) is refused as unsupported.
//!
//! Of materials their names are read and what they say of their inside ([`SourceModel::insides`]).

mod accessor;
mod animation;
mod assemble;
pub mod base_colour;
mod buffers;
mod container;
mod document;
mod extensions;
mod inside;
mod layout;
mod nodes;
mod poses;
mod primitive;
mod skin;
#[cfg(test)]
mod tests;
mod unused;
mod warnings;
pub mod written;

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::geometry::source::SourceModel;

pub use self::assemble::MAX_ELEMENTS;
pub use self::layout::{PlacedMesh, PlacedPrimitive};
pub use self::nodes::MAX_INSTANCES;
pub use self::poses::{Animated, Pose, PoseSampling, read_poses};
use self::warnings::Warnings;

/// Reads a glTF 2.0 file (`.gltf` or `.glb`) in metres.
///
/// Vertices follow the nodes of the default scene depth first, then instance, primitive and vertex. Without a default
/// scene the first one is read, without scenes every root node, without nodes every mesh once. Transforms are applied
/// in f64; one that mirrors reverses the winding, so that outside stays outside. Materials are listed in the order of
/// their first use; two of the same name become one entry (a warning says so where they differ), an unnamed one is called `material_<index>`, none at all
/// `default`. Stored normals that are not of unit length become zero.
///
/// External buffers are read only from the model's folder and the folders in it.
///
/// # Errors
/// I/O (2) for files that cannot be read, invalid input (3) for anything the specification forbids and that would
/// change the geometry, for positions that are not finite and for a model without triangles, unsupported (5) for
/// required extensions that hold geometry this reader does not know.
pub fn read_gltf(path: &Path) -> Result<SourceModel> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    parse_gltf(&bytes, path)
}

/// Parses the bytes of a glTF file; `path` stands in front of every error, and external buffers lie beside it.
///
/// # Errors
/// As [`read_gltf`], but for the file itself.
pub fn parse_gltf(bytes: &[u8], path: &Path) -> Result<SourceModel> {
    read_bytes(bytes, path).map_err(|e| e.in_file(path))
}

/// The files beside a model that hold its buffers, each once, in the order of the document.
///
/// # Errors
/// As [`read_gltf`]; the files themselves are not opened.
pub fn external_files(path: &Path) -> Result<Vec<PathBuf>> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    let root = document::parse(container::split(&bytes, path, &mut Warnings::default())?.json)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut files = Vec::new();
    for uri in root.buffers.iter().filter_map(|b| b.uri.as_deref()).filter(|uri| !uri.starts_with("data:")) {
        let file = folder.join(buffers::confined_path(uri)?);
        if !files.contains(&file) {
            files.push(file);
        }
    }
    Ok(files)
}

fn read_bytes(bytes: &[u8], path: &Path) -> Result<SourceModel> {
    let mut warnings = Warnings::default();
    let (container, root) = checked(bytes, path, &mut warnings)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let data = accessor::Accessors::new(&root, buffers::Buffers::new(&root, container.binary, folder));
    let placements = nodes::placements(&root, &data, &mut warnings)?;
    assemble::assemble(&root, &data, &placements, warnings)
}

/// The chunks of a file, and its document, whose references and required extensions are checked.
fn checked<'a>(
    bytes: &'a [u8],
    path: &Path,
    warnings: &mut Warnings,
) -> Result<(container::Container<'a>, gltf::json::Root)> {
    let container = container::split(bytes, path, warnings)?;
    let root = document::parse(container.json)?;
    extensions::check(&root, warnings)?;
    document::check_references(&root)?;
    Ok((container, root))
}
