//! Names of saved pictures, and kinds of dropped files.

use std::path::{Path, PathBuf};

use crate::import::file::suffix;

/// Largest number in the name of a saved picture.
const MAX_NUMBER: u32 = 9999;

/// The first of `picture-001.png`, `picture-002.png`, ... in `folder` that is free in all of `suffixes`; none where all
/// are taken.
pub fn free_picture(folder: &Path, suffixes: &[&str]) -> Option<PathBuf> {
    let stem = |number: u32| folder.join(format!("picture-{number:03}"));
    let free = |path: &PathBuf| {
        // A broken link is in the way as well.
        suffixes.iter().all(|suffix| path.with_extension(suffix).symlink_metadata().is_err())
    };
    (1..=MAX_NUMBER).map(stem).find(free)
}

/// Name of a frame of an animation of `frames` frames.
pub fn frame_name(frame: usize, frames: usize) -> String {
    let digits = frames.saturating_sub(1).to_string().len().max(4);
    format!("frame_{frame:0digits$}.png")
}

/// The kind of a dropped file, by its suffix.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Dropped {
    /// An asset that takes the place of the model.
    Asset(PathBuf),
    /// A picture that becomes the environment.
    Environment(PathBuf),
    /// Something else, with the message to show.
    Other(String),
}

impl Dropped {
    /// The kind of the file at `path`.
    pub fn new(path: &Path) -> Self {
        let name = path.file_name().map_or_else(|| path.to_string_lossy(), |n| n.to_string_lossy());
        match suffix(path).as_str() {
            "tlux" => Self::Asset(path.to_owned()),
            "hdr" | "exr" => Self::Environment(path.to_owned()),
            "obj" | "ply" | "gltf" | "glb" => {
                Self::Other(format!("{name}: a model must be baked first: translux bake {name} -o model.tlux"))
            }
            _ => Self::Other(format!("{name}: drop an asset (.tlux) or an environment (.hdr, .exr)")),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn pictures_never_take_a_name_that_is_in_use() {
        let folder = tempfile::tempdir().unwrap();
        let name = |suffixes: &[&str]| {
            let path = free_picture(folder.path(), suffixes).unwrap();
            path.file_name().unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!(name(&["png"]), "picture-001");
        std::fs::write(folder.path().join("picture-001.png"), b"").unwrap();
        std::fs::write(folder.path().join("picture-002.exr"), b"").unwrap();
        assert_eq!(name(&["png"]), "picture-002");
        assert_eq!(name(&["png", "exr"]), "picture-003");
    }

    #[test]
    fn frames_sort_by_name() {
        assert_eq!(frame_name(0, 1), "frame_0000.png");
        assert_eq!(frame_name(7, 24), "frame_0007.png");
        assert_eq!(frame_name(12, 20_000), "frame_00012.png");
    }

    #[test]
    fn dropped_files_are_told_by_their_suffix() {
        assert_eq!(Dropped::new(Path::new("a/B.TLUX")), Dropped::Asset("a/B.TLUX".into()));
        for name in ["sky.hdr", "sky.EXR"] {
            assert_eq!(Dropped::new(Path::new(name)), Dropped::Environment(name.into()));
        }
        for (name, fragment) in [("a.obj", "bake a.obj"), ("b.jpg", ".tlux"), ("none", "drop"), ("", "drop")] {
            let Dropped::Other(message) = Dropped::new(Path::new(name)) else { panic!("{name}") };
            assert!(message.contains(fragment), "{message}");
        }
    }
}
