//! Poses of a scene's mesh, from files: the same mesh with its vertices elsewhere.

use std::path::{Path, PathBuf};

use super::file::{read_model, suffix};
use crate::error::{Error, Result};
use crate::geometry::mesh::{Mesh, Positions};
use crate::io::gltf::{PoseSampling, read_poses};
use crate::progress::{Progress, stage};

/// Share of the diagonal by which a pose may be larger or smaller before it is asked whether it has the unit of the rest pose.
const SAME_UNIT: f64 = 3.0;

/// A pose of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// The file that it is from.
    pub file: PathBuf,
    /// Time in the animation of the file, s; none without one.
    pub seconds: Option<f64>,
    /// Where the vertices are.
    pub positions: Positions,
}

impl Pose {
    /// Name for people: that of the file, with the time.
    pub fn name(&self) -> String {
        let file = self.file.file_name().map_or_else(|| "-".to_owned(), |name| name.to_string_lossy().into_owned());
        match self.seconds {
            Some(seconds) => format!("{file} at {seconds:.3} s"),
            None => file,
        }
    }
}

/// The poses of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Poses {
    /// The poses, in the order of their times.
    pub poses: Vec<Pose>,
    /// Name of the animation that they are from.
    pub animation: Option<String>,
    /// Warnings to the user, one line each.
    pub warnings: Vec<String>,
}

/// Reads the poses of a file (.obj, .gltf or .glb) of the mesh that an asset was made of, whose source unit has so many mm.
///
/// # Errors
/// As [`read_model`] and [`read_poses`]; a mesh of another connectivity; command line: an animation of a file that has none. The message
/// starts with the path.
pub fn load_poses(
    path: &Path,
    (rest, mm_per_unit): (&Mesh, f64),
    sampling: PoseSampling<'_>,
    progress: &dyn Progress,
) -> Result<Poses> {
    let in_file = |e: Error| e.in_file(path);
    let (model, animation, poses) = if matches!(suffix(path).as_str(), "gltf" | "glb") {
        let read = stage(progress, "import", || read_poses(path, sampling))?;
        let poses = read.poses.into_iter().map(|pose| (pose.seconds, pose.positions)).collect();
        (read.model, read.animation, poses)
    } else {
        if let Some(name) = sampling.animation {
            return Err(in_file(Error::command_line(format!("--animation {name}: files of this kind have none"))));
        }
        let model = stage(progress, "import", || read_model(path))?;
        let positions = model.positions.clone();
        (model, None, vec![(None, positions)])
    };
    rest.check_pose(&model).map_err(in_file)?;
    let mut warnings = model.warnings;
    let place = |(seconds, positions): (Option<f64>, Vec<glam::DVec3>)| -> Result<Pose> {
        let positions = rest.posed(&positions, mm_per_unit).map_err(in_file)?;
        Ok(Pose { file: path.to_owned(), seconds, positions })
    };
    let poses: Vec<Pose> = poses.into_iter().map(place).collect::<Result<_>>()?;
    let diagonal = rest.diagonal_mm();
    let across = |pose: &Pose| rest.in_pose(&pose.positions).diagonal_mm();
    if let Some(first) =
        poses.first().map(across).filter(|d| !(diagonal / SAME_UNIT..=diagonal * SAME_UNIT).contains(d))
    {
        warnings.push(format!(
            "the pose is {first:.3} mm across, and the rest pose {diagonal:.3} mm: it may have another unit, or a skin whose bind pose has another \
             scale than the mesh as it is stored, of which the asset was baked"
        ));
    }
    Ok(Poses { poses, animation, warnings })
}
