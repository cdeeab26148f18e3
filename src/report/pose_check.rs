//! How wrong the rest pose's result is in other poses, for people and as JSON.

use std::fmt;
use std::path::PathBuf;

use glam::DVec3;
use serde::Serialize;

use super::radiosity_ply::{Single, radiosity_ply_with};
use super::text::{percent, significant, titled};
use crate::error::Result;
use crate::geometry::deformation::Deformation;
use crate::geometry::mesh::Mesh;
use crate::import::file::Input;
use crate::import::poses::Pose;
use crate::math::statistics::VertexError;
use crate::measure::pose::{Advice, PoseCheck, PoseError, VertexErrors};

/// Names of the columns of a PLY file, in the order of [`VertexErrors::columns`].
const COLUMNS: [&str; 4] = ["pose_shown", "pose_light", "pose_transport", "pose_relit"];

/// Report of poses.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct PoseCheckReport {
    pub(crate) method: String,
    /// Model of the light inside: `dipole` or `calibrated`.
    pub(crate) model: String,
    /// Materials in force.
    pub(crate) materials: Vec<String>,
    /// Lights that were tried; those of an entry shine together, and each entry alone.
    pub(crate) lights: Vec<String>,
    /// Files that were read beside the asset.
    pub(crate) inputs: Vec<Input>,
    /// Pieces of the surface that exact sums are over, without a hierarchy.
    pub(crate) samples: usize,
    /// Vertices at which errors were measured, evenly spread.
    pub(crate) measured_vertices: usize,
    /// Vertices that there are, each welded place once.
    pub(crate) vertices: usize,
    /// The asset's own error in the rest pose under these lights, which is part of the error as shown.
    pub(crate) own: VertexError,
    /// RMS error up to which a pose is good: what was asked for, or what the asset promises.
    pub(crate) good_below: f64,
    /// Whether light can be traced in a pose and carried through the asset's transport: it keeps the two apart.
    pub(crate) takes_light: bool,
    /// Diffusion length of the medium and channel where it is longest, mm; none without absorption.
    pub(crate) diffusion_length_mm: Option<f64>,
    /// The poses, in the order in which they were named.
    pub(crate) poses: Vec<PoseReport>,
    /// Name of the pose with the largest error as shown.
    pub(crate) worst: String,
}

/// Report of a pose. Errors are relative to the RMS of the exact radiosity in the pose, the worst of the lights.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct PoseReport {
    /// File, and time in its animation.
    pub(crate) name: String,
    /// Time in the animation, s; none without one.
    pub(crate) seconds: Option<f64>,
    /// What the asset gives in the rest pose, against the exact radiosity of the pose.
    pub(crate) shown: VertexError,
    /// Lights under which that is largest.
    pub(crate) worst_light: String,
    /// RMS error as shown under each of the lights.
    pub(crate) shown_by_light: Vec<f64>,
    /// Light alone: irradiance of the rest pose against that of the pose, both through the transport of the rest pose.
    pub(crate) light: VertexError,
    /// Transport alone: that of the rest pose against that of the pose, both for the irradiance of the pose.
    pub(crate) transport: VertexError,
    /// What is left of the error as shown with the light of the pose.
    pub(crate) relit: VertexError,
    /// What the pose does to the translucent parts of the mesh.
    pub(crate) deformation: Deformation,
    /// Mean and largest displacement beyond a rigid motion, in diffusion lengths; none without absorption.
    pub(crate) displacement_in_diffusion_lengths: Option<[f64; 2]>,
    /// What to do about it.
    pub(crate) advice: Advice,
    /// The same in words.
    pub(crate) verdict: String,
    /// File with the error of each vertex.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) output: Option<String>,
}

impl PoseCheckReport {
    /// The report of what was measured of some poses; `origin` is the method, the model and the materials.
    pub(crate) fn new(
        check: &PoseCheck,
        poses: &[Pose],
        (method, model, materials): (String, String, Vec<String>),
        inputs: Vec<Input>,
        outputs: &[PathBuf],
    ) -> Self {
        let [measured_vertices, vertices] = check.vertices;
        let length = Some(check.diffusion_length_mm).filter(|length| length.is_finite() && *length > 0.0);
        let pose = |(index, (error, pose)): (usize, (&PoseError, &Pose))| PoseReport {
            name: pose.name(),
            seconds: pose.seconds,
            shown: error.shown,
            worst_light: check.lights.get(error.worst_light).cloned().unwrap_or_default(),
            shown_by_light: error.shown_by_light.clone(),
            light: error.light,
            transport: error.transport,
            relit: error.relit,
            deformation: error.deformation,
            displacement_in_diffusion_lengths: length.map(|length| {
                [error.deformation.mean_beyond_rigid_mm, error.deformation.max_beyond_rigid_mm].map(|mm| mm / length)
            }),
            advice: error.advice,
            verdict: verdict(error, check),
            output: outputs.get(index).map(|path| path.to_string_lossy().into_owned()),
        };
        let name = |index: usize| poses.get(index).map(Pose::name).unwrap_or_default();
        Self {
            method,
            model,
            materials,
            lights: check.lights.clone(),
            inputs,
            samples: check.samples,
            measured_vertices,
            vertices,
            own: check.own,
            good_below: check.good_below,
            takes_light: check.takes_light,
            diffusion_length_mm: length,
            poses: check.poses.iter().zip(poses).enumerate().map(pose).collect(),
            worst: check.worst().map(name).unwrap_or_default(),
        }
    }

    fn worst(&self) -> Option<&PoseReport> {
        self.poses.iter().find(|pose| pose.name == self.worst)
    }
}

/// What to do about a pose, in words.
fn verdict(error: &PoseError, check: &PoseCheck) -> String {
    let PoseError { shown, relit, light, transport, deformation, .. } = error;
    let [shown, left, light_rms, transport, own, good] =
        [shown.rms, relit.rms, light.rms, transport.rms, check.own.rms, check.good_below].map(percent);
    let in_its_light = if light.rms > check.good_below { " and light it in the pose" } else { "" };
    match error.advice {
        Advice::Keep => format!("good: {shown} off as shown, within {good}"),
        Advice::Light if check.takes_light => {
            format!(
                "light it in the pose: its own shadows and facing leave {left} of {shown}; the transport of the rest pose holds"
            )
        }
        Advice::Light => format!(
            "the transport of the rest pose holds ({transport} off), its light does not ({light_rms} off), and this asset keeps the two \
             together: bake with --method editable and light it in the pose, or bake this pose"
        ),
        Advice::Finer => format!(
            "the asset itself is {own} off in the rest pose, more than {good}: bake it with a smaller --max-rms{in_its_light}; the transport \
             of the rest pose holds here ({transport} off)"
        ),
        Advice::Bake => {
            let stretch = [deformation.shortest_edge, deformation.longest_edge].map(ratio).join(" to ");
            format!(
                "bake this pose: {left} is left even in its own light, since the transport of the rest pose is {transport} off (edges {stretch} \
                 times as long)"
            )
        }
    }
}

impl fmt::Display for PoseCheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { measured_vertices, vertices, samples, own, good_below, .. } = self;
        writeln!(
            f,
            "measured   {measured_vertices} of {vertices} vertices in each pose, all pairs with {samples} samples, {} lights each alone",
            self.lights.len()
        )?;
        writeln!(
            f,
            "rest pose  the asset is {} RMS off, {} worst vertex; a pose is good up to {}\n",
            percent(own.rms),
            percent(own.worst),
            percent(*good_below)
        )?;
        let rows = self.poses.iter().map(|pose| {
            [
                pose.name.clone(),
                percent(pose.shown.rms),
                percent(pose.shown.worst),
                percent(pose.shown.dark),
                percent(pose.light.rms),
                percent(pose.transport.rms),
                percent(pose.relit.rms),
            ]
        });
        let titles = ["pose", "as shown", "worst vertex", "dark part", "light alone", "transport alone", "lit in pose"];
        writeln!(f, "{}\n", titled(titles, rows))?;
        let rows = self.poses.iter().map(|pose| {
            let Deformation { mean_mm, max_mm, mean_beyond_rigid_mm, max_beyond_rigid_mm, .. } = pose.deformation;
            let Deformation { shortest_edge, longest_edge, volume_change, .. } = pose.deformation;
            let pair = |values: [f64; 2]| values.map(significant).join(", ");
            let lengths = pose.displacement_in_diffusion_lengths.map_or_else(|| "-".to_owned(), pair);
            let volume =
                volume_change.map_or_else(|| "-".to_owned(), |change| format!("{}{}", plus(change), percent(change)));
            [
                pose.name.clone(),
                pair([mean_mm, max_mm]),
                pair([mean_beyond_rigid_mm, max_beyond_rigid_mm]),
                lengths,
                [shortest_edge, longest_edge].map(ratio).join(" to "),
                volume,
            ]
        });
        let titles = ["pose", "moved mm: mean, max", "beyond rigid", "in diffusion lengths", "edges times", "volume"];
        writeln!(f, "{}\n", titled(titles, rows))?;
        for pose in &self.poses {
            writeln!(f, "{}: {}", pose.name, pose.verdict)?;
        }
        match self.worst() {
            Some(pose) => write!(
                f,
                "worst pose: {}, {} RMS as shown under {}",
                pose.name,
                percent(pose.shown.rms),
                pose.worst_light
            ),
            None => Ok(()),
        }
    }
}

/// A ratio to three places.
fn ratio(value: f64) -> String {
    significant((1e3 * value).round() / 1e3)
}

/// The sign of what grows.
fn plus(change: f64) -> &'static str {
    if change > 0.0 { "+" } else { "" }
}

/// The bytes of a PLY file of a pose: exact radiosity under the first lights, and the errors of each vertex.
pub(crate) fn pose_ply(
    mesh: &Mesh,
    (name, lights): (&str, &[String]),
    VertexErrors { exact, columns }: &VertexErrors,
) -> Result<Vec<u8>> {
    let first = lights.first().map(String::as_str).unwrap_or_default();
    let mut comments = vec![
        format!("translux pose-check, {name}"),
        format!("b_r, b_g, b_b: exact radiosity in the pose under {first}"),
        "errors over the RMS of the exact radiosity, worst channel, the largest of the lights below".to_owned(),
        "pose_shown: the asset in the rest pose; pose_light: of the light alone; pose_transport: of the transport alone".to_owned(),
        "pose_relit: what is left of pose_shown with the light of the pose".to_owned(),
    ];
    comments.extend(lights.iter().map(|light| format!("light {light}")));
    let columns = COLUMNS.into_iter().zip(columns.iter().cloned()).collect();
    let exact: &[DVec3] = exact;
    radiosity_ply_with(mesh, (exact, Single::None), columns, comments)
}
