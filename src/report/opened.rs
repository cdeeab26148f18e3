//! An asset opened and lit, as commands do it: the finding about what fails then.

use std::sync::Arc;

use translux_format::{metadata, rows};

use super::findings::{Finding, NO_LEDGER, REFUSED};
use crate::asset::Asset;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::memory::Limits;
use crate::evaluate::{AnyForm, Evaluator, Registry};
use crate::light::Light;
use crate::measure::probes::{Half, constant, directional, environments, points};
use crate::progress::Silent;

/// Opens an asset without other findings, as every command does; returns a finding if that fails or the ledger is
/// empty.
///
/// # Errors
/// Run time: an evaluator that the limits do not admit.
pub(super) fn of_opening(
    provenance: &translux_format::Provenance,
    bytes: &[u8],
    (registry, limits): (&Registry, Limits<'_>),
) -> Result<Option<Finding>> {
    let Ok(method) = registry.method(&provenance.method) else { return Ok(None) };
    let refused = |e: Error| Finding::new(&REFUSED, None, format!("method {}: {e}", method.name()));
    let read = Asset::from_bytes_within(bytes, limits.budget).and_then(|asset| Ok((registry.form(&asset)?, asset)));
    let (form, asset) = match read {
        Ok(read) => read,
        Err(error) => return Ok(Some(refused(error))),
    };
    (limits.admit)(form.run_memory(&asset))?;
    // What stores no transport has lost nothing before it is evaluated.
    let untold = asset.ledger.entries.is_empty() && form.holds_transport();
    let has_rows = asset.sections.iter().any(|section| section.tag == rows::tags::COUNTS);
    Ok(match form.open(Arc::new(asset)).and_then(|evaluator| lit((form.as_ref(), has_rows), evaluator)) {
        Err(error) => Some(refused(error)),
        Ok(()) if untold => {
            Some(Finding::new(&NO_LEDGER, Some(metadata::tags::LEDGER), "the ledger is empty".to_owned()))
        }
        Ok(()) => None,
    })
}

/// Puts what is stored, transport or rows of irradiance, under a light of each kind that it serves: it must not hold more than light could
/// bring.
fn lit((form, has_rows): (&dyn AnyForm, bool), mut evaluator: Box<dyn Evaluator>) -> Result<()> {
    let mesh = &evaluator.scene().mesh;
    let near: Vec<Light> = match form.holds_transport() {
        true => directional(Half::Figures)
            .into_iter()
            .take(1)
            .chain(points(mesh, Half::Figures).into_iter().take(1))
            .collect(),
        false => Vec::new(),
    };
    // Details of a row add up to nothing under constant light.
    let far = match form.holds_transport() || has_rows {
        true => environments(Half::Figures).into_iter().take(1).chain([constant()]).collect(),
        false => Vec::new(),
    };
    let lights: Vec<Light> = near.into_iter().chain(far).collect();
    for light in lights.into_iter().filter(|light| form.kinds().contains(&light.kind())) {
        match evaluator.set_lights(vec![light], &Silent) {
            // Of some kinds only those that the bake was told of.
            Err(error) if error.code() == ExitCode::Unsupported => {}
            Err(error) => return Err(error),
            Ok(()) => {
                evaluator.radiosity(&Silent)?;
                evaluator.single_scattering(&Silent)?;
            }
        }
    }
    Ok(())
}
