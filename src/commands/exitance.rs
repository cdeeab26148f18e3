//! Where the light that leaves the surface is evaluated for pictures: as it is asked for, and as it is done.

use clap::{Args, ValueEnum};

use super::console::Console;
use crate::error::{ExitCode, Result};
use crate::evaluate::Evaluator;
use crate::math::statistics::VertexError;
use crate::measure::between_vertices::too_coarse;
use crate::render::frame::ExitanceAt;
use crate::report::text::percent;

/// Where exitance is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Asked {
    /// At pixels where the mesh is too coarse for its material and the asset gathers at run time, else at the vertices
    #[default]
    Auto,
    /// At the vertices, linear over each triangle
    Vertices,
    /// At what each pixel sees, for meshes of large triangles: a sum over the samples for each triangle in each pixel, seconds more
    Pixels,
}

/// The option of every command that makes pictures.
#[derive(Clone, Copy, Debug, Args)]
#[command(next_help_heading = "Picture")]
pub(super) struct ExitanceArg {
    /// Where the light that leaves the surface is evaluated; pixels with assets that gather at run time (reference, two_pass,
    /// texture_space, editable without stored transport)
    #[arg(long, value_name = "WHERE", default_value = "auto")]
    exitance: Asked,
}

/// How wrong pictures would be that are linear between the vertices, and what was asked for; for the media in force, whatever the lights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coarseness {
    asked: Asked,
    /// The error between vertices, where it was measured and is too large.
    pub(super) between: Option<VertexError>,
}

impl ExitanceArg {
    /// Measures what the choice between vertices and pixels needs.
    pub(super) fn measure(self, evaluator: &dyn Evaluator, console: &Console) -> Result<Coarseness> {
        let asked = self.exitance;
        let between = match asked {
            Asked::Auto => too_coarse(evaluator.scene(), Some(evaluator.bvh()), console)?,
            Asked::Vertices | Asked::Pixels => None,
        };
        Ok(Coarseness { asked, between })
    }
}

impl Coarseness {
    /// Prepares exitance under the lights in force: at points where that is chosen.
    pub(super) fn prepare(&self, evaluator: &mut dyn Evaluator, console: &Console) -> Result<ExitanceAt> {
        match (self.asked, self.between) {
            (Asked::Vertices, _) | (Asked::Auto, None) => Ok(ExitanceAt::Vertices),
            (Asked::Pixels, _) => {
                evaluator.prepare_points(console).map_err(|e| e.at("--exitance pixels"))?;
                Ok(ExitanceAt::Pixels)
            }
            (Asked::Auto, Some(_)) => match evaluator.prepare_points(console) {
                Ok(()) => Ok(ExitanceAt::Pixels),
                Err(error) if error.code() == ExitCode::Unsupported => Ok(ExitanceAt::Vertices),
                Err(error) => Err(error),
            },
        }
    }

    /// Tells of a mesh that is too coarse, and what was done about it.
    pub(super) fn tell(&self, at: ExitanceAt, console: &Console) {
        let Some(VertexError { rms, worst, .. }) = self.between else { return };
        let [rms, worst] = [rms, worst].map(percent);
        let off = format!(
            "linear over each triangle, light would be {rms} off between vertices (worst {worst}), under a few probe lights"
        );
        match at {
            ExitanceAt::Pixels => console.note(&format!(
                "exitance at pixels: {off}; --exitance vertices takes less time"
            )),
            ExitanceAt::Vertices => console.fault(&format!(
                "{}: the transport in this asset ends at its vertices; bake with --refine auto, or with --method editable, whose pictures take \
                 the exitance at each pixel",
                off.replace("would be", "is")
            )),
        }
    }
}
