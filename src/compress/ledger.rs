//! The error ledger: the error that each lossy stage added, in the unit of the vertex error.

use crate::math::statistics::VertexError;

/// Stages that only light from an environment passes through; assets of earlier revisions have the last two in place of the second.
pub const ENVIRONMENT_STAGES: [&str; 4] = ["visibility", "environment rows", "cube map", "row truncation"];

/// Stages of quantities separate from the radiosity, whose errors are relative to those alone, that of the model, which transport
/// cannot mend, and that under a sun alone, which few environments are: sums leave them out.
pub const BESIDE_RADIOSITY: [&str; 3] = ["single scattering", MODEL, SUN_ALONE];

/// All stages together under an environment that is dark but for a sun, of methods that allow it more than the asked error.
pub const SUN_ALONE: &str = "sun alone";

/// The stage of the model itself: what its exact sums are off the volume.
pub const MODEL: &str = "model";

/// The stages before it together, where they err independently of each other: sums count it in their place.
pub const TOGETHER: &str = "together";

/// The error that one stage added.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Entry {
    /// Name of the stage.
    pub stage: String,
    /// Error of the stage.
    pub error: VertexError,
    /// Method by which the error was measured, in words.
    pub note: String,
}

/// Errors by stage, in the order of the pipeline.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Ledger {
    /// One entry a stage.
    pub entries: Vec<Entry>,
}

impl Ledger {
    /// Adds the error of a stage.
    pub fn add(&mut self, stage: &str, error: VertexError, note: impl Into<String>) {
        self.entries.push(Entry { stage: stage.to_owned(), error, note: note.into() });
    }

    /// Adds the stages so far together, which err independently of each other: their squares add.
    pub fn add_together(&mut self) {
        let sum = self.of_radiosity().map(|entry| entry.error).reduce(VertexError::beside);
        if let Some(sum) = sum {
            self.add(TOGETHER, sum, "the stages above err independently of each other: their squares add");
        }
    }

    /// Adds the error under a sun alone, [`SUN_ALONE`].
    pub fn add_sun_alone(&mut self, error: VertexError) {
        self.add(SUN_ALONE, error, "all stages together under an environment that is dark but for a sun");
    }

    /// Takes the larger error of each stage of another ledger; stages that are not here are added.
    pub fn worst_of(&mut self, other: Self) {
        for entry in other.entries {
            match self.entries.iter_mut().find(|mine| mine.stage == entry.stage) {
                Some(mine) if entry.error.rms > mine.error.rms => {
                    mine.error = mine.error.max(entry.error);
                    mine.note = entry.note;
                }
                Some(mine) => mine.error = mine.error.max(entry.error),
                None => self.entries.push(entry),
            }
        }
    }

    /// [`Self::total_rms`] without the stages that only light from an environment passes through.
    pub fn total_rms_without_environment(&self) -> f64 {
        self.of_radiosity().filter(|e| !ENVIRONMENT_STAGES.contains(&e.stage.as_str())).map(|e| e.error.rms).sum()
    }

    /// Sum of the stages' RMS, without quantities separate from the radiosity. Errors of different stages may point the
    /// same way, so this sum is the stated error.
    pub fn total_rms(&self) -> f64 {
        self.of_radiosity().map(|e| e.error.rms).sum()
    }

    /// The stages that sums are of.
    pub fn of_radiosity(&self) -> impl Iterator<Item = &Entry> {
        let first = self.entries.iter().rposition(|e| e.stage == TOGETHER).unwrap_or(0);
        self.entries[first..].iter().filter(|e| !BESIDE_RADIOSITY.contains(&e.stage.as_str()))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn independent_stages_add_as_squares_and_others_as_they_are() {
        let error = |rms| VertexError { rms, ..VertexError::default() };
        let mut ledger = Ledger::default();
        ledger.add_together();
        assert_eq!(ledger, Ledger::default());
        ledger.add("sampling", error(0.03), "");
        ledger.add("basis", error(0.04), "");
        assert!((ledger.total_rms() - 0.07).abs() < 1e-15);
        ledger.add_together();
        ledger.add(ENVIRONMENT_STAGES[0], error(0.01), "");
        ledger.add(MODEL, error(0.2), "");
        assert!((ledger.total_rms() - 0.06).abs() < 1e-15, "{ledger:?}");
        assert!((ledger.total_rms_without_environment() - 0.05).abs() < 1e-15);
        assert_eq!(ledger.entries.len(), 5);
    }
}
