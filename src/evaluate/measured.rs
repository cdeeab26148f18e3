//! The error of any evaluator against a truth.

use std::borrow::Cow;

use glam::DVec3;

use super::evaluator::Evaluator;
use crate::error::Result;
use crate::math::statistics::{VertexError, vertex_error};
use crate::progress::Progress;

/// Radiosity that an evaluator is judged by.
#[derive(Clone, Copy, Debug)]
pub enum Truth<'a> {
    /// The given radiosity of every source vertex: a reference, or another asset of the same mesh.
    Given(&'a [DVec3]),
    /// The radiosity of the evaluator's own samples over all pairs ([`Evaluator::all_pairs`]).
    OwnSamples,
}

/// Radiosity of an evaluator under the lights in force, with the truth and the error.
#[derive(Clone, Debug)]
pub struct Measured<'a> {
    /// Radiosity of every source vertex, RGB.
    pub radiosity: Vec<DVec3>,
    /// True radiosity of every source vertex, RGB.
    pub truth: Cow<'a, [DVec3]>,
    /// A third of the transferring area around each vertex, mm^2.
    pub areas_mm2: Vec<f64>,
    /// The error: RMS, bias, 99.9th percentile, worst vertex and dark part.
    pub error: VertexError,
}

/// Measures an evaluator under the lights and media in force at its source vertices.
///
/// # Errors
/// Failures of the work.
pub fn measured<'a>(evaluator: &mut dyn Evaluator, truth: Truth<'a>, progress: &dyn Progress) -> Result<Measured<'a>> {
    let radiosity = evaluator.radiosity(progress)?;
    let truth = match truth {
        Truth::Given(values) => Cow::Borrowed(values),
        Truth::OwnSamples => Cow::Owned(evaluator.all_pairs(progress)?),
    };
    let areas_mm2 = evaluator.scene().vertex_areas_mm2();
    let error = vertex_error(&radiosity, &truth, &areas_mm2);
    Ok(Measured { radiosity, truth, areas_mm2, error })
}
