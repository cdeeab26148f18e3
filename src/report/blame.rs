//! The error at one place, by stage, for people and as JSON.

use std::fmt;

use serde::Serialize;

use super::text::{percent, significant, titled};
use crate::import::file::Input;
use crate::measure::trust::Blame;

/// Report of the error at a place.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct BlameReport {
    pub(crate) method: String,
    /// Model of the light inside: `dipole` or `calibrated`.
    pub(crate) model: String,
    /// Materials in force.
    pub(crate) materials: Vec<String>,
    pub(crate) lights: Vec<String>,
    pub(crate) inputs: Vec<Input>,
    /// Name of the part.
    pub(crate) part: String,
    /// Pixel that was asked for, from the left and from the top.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) pixel: Option<[u32; 2]>,
    #[serde(flatten)]
    pub(crate) blame: Blame,
}

impl fmt::Display for BlameReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Blame { stages, dominant, .. } = &self.blame;
        let triple = |values: [f64; 3]| values.map(significant).join(" ");
        let shares = |values: [f64; 3]| values.map(signed).join(" ");
        let place = match (self.blame.vertex, self.pixel) {
            (Some(vertex), _) => format!("vertex {vertex}"),
            (None, Some([x, y])) => format!("pixel {x},{y} (triangle {})", self.blame.triangle),
            (None, None) => format!("triangle {}", self.blame.triangle),
        };
        writeln!(f, "{place} of `{}`, at {} mm", self.part, triple(self.blame.at_mm))?;
        writeln!(f, "radiosity  {}  RGB, exact {}", triple(self.blame.radiosity), triple(self.blame.exact))?;
        let local = self.blame.local_error.map_or_else(|| "it is black there".to_owned(), shares);
        writeln!(f, "error      {}  of the RMS; of what is there: {local}\n", shares(self.blame.error))?;
        let rows = stages.iter().map(|stage| {
            let joint =
                if stage.joint.is_empty() { String::new() } else { format!("joint: {}", stage.joint.join(", ")) };
            let mark = if stage.stage == *dominant { "dominant" } else { "" };
            let [r, g, b] = stage.error.map(signed);
            [stage.stage.clone(), r, g, b, mark.to_owned(), joint]
        });
        writeln!(f, "{}\n", titled(["stage", "red", "green", "blue", "", ""], rows))?;
        if self.blame.clamped {
            writeln!(f, "a channel is cut off at 0 here")?;
        }
        let thickness = significant(self.blame.thickness);
        match self.blame.model_error {
            Some(error) => writeln!(
                f,
                "model      {} RMS over the surface against walks, which the above does not hold; {thickness} mean free paths thick here",
                percent(error)
            )?,
            None => writeln!(
                f,
                "model      its own error is not told by this asset (bake with --model calibrated, which measures it); {thickness} mean \
                 free paths thick here"
            )?,
        }
        match &self.blame.mend {
            Some(mend) => write!(f, "mend       {mend}"),
            None => write!(f, "mend       nothing: the error is within the asked {}", percent(self.blame.asked_rms)),
        }
    }
}

/// A share in percent, with its sign.
fn signed(share: f64) -> String {
    if share > 0.0 { format!("+{}", percent(share)) } else { percent(share) }
}
