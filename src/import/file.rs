//! The files of a model: their list, contents and hashes.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::geometry::source::SourceModel;
use crate::io;

/// A file that a scene, a light or a picture was made from.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Input {
    /// File name without its folder.
    pub name: String,
    /// BLAKE3 hash of the file, hexadecimal.
    pub blake3: String,
    /// Length of the file.
    pub bytes: u64,
}

impl Input {
    /// Reads a file and hashes it.
    ///
    /// # Errors
    /// I/O; the message starts with the path.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
        let name = path.file_name().map_or_else(|| "-".to_owned(), |n| n.to_string_lossy().into_owned());
        Ok(Self { name, blake3: blake3::hash(&bytes).to_hex().to_string(), bytes: bytes.len() as u64 })
    }
}

/// The suffix of a path in lower case, without the dot.
pub fn suffix(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// The file of a model and those that it refers to; material libraries of OBJ files are not read.
///
/// # Errors
/// A glTF file that cannot be read.
pub fn files_of(model: &Path) -> Result<Vec<PathBuf>> {
    let mut files = vec![model.to_owned()];
    if matches!(suffix(model).as_str(), "gltf" | "glb") {
        files.extend(io::gltf::external_files(model)?);
    }
    Ok(files)
}

/// Reads a model by the suffix of its name.
///
/// # Errors
/// I/O, an invalid file, or a suffix other than .obj, .gltf and .glb (unsupported).
pub fn read_model(path: &Path) -> Result<SourceModel> {
    match suffix(path).as_str() {
        "obj" => io::obj::read_obj(path),
        "gltf" | "glb" => io::gltf::read_gltf(path),
        _ => Err(Error::unsupported(format!("{}: models are .obj, .gltf or .glb files", path.display()))),
    }
}
