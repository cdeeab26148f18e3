//! The precomputation methods. A method is one folder and one line in [`ALL`].

pub mod all_frequency;
mod baked_in;
mod components;
pub mod editable;
mod inter_reflection;
pub mod quantized_lights;
pub mod reference;
mod references;
pub mod sampling;
pub mod settings;
mod single_keys;
mod stage;
pub mod two_pass;

use crate::asset::{Asset, Provenance};
use crate::error::{Error, Result};
use crate::evaluate::{BakeSettings, Method};
use crate::progress::Progress;
use crate::transport::scene::Scene;

/// Every method.
pub const ALL: [&dyn Method; 5] = [
    &reference::Reference,
    &two_pass::TwoPass,
    &editable::Editable,
    &quantized_lights::QuantizedLights,
    &all_frequency::AllFrequency,
];

/// The method of a name.
///
/// # Errors
/// Command line: no such method; the message lists them.
pub fn named(name: &str) -> Result<&'static dyn Method> {
    ALL.into_iter().find(|m| m.name() == name).ok_or_else(|| {
        let names: Vec<&str> = ALL.iter().map(|m| m.name()).collect();
        Error::command_line(format!("no method `{name}`; there are {}", names.join(", ")))
    })
}

/// Bakes a scene into an asset; the method and the resolved settings enter the provenance.
///
/// # Errors
/// Those of the method.
pub fn bake(
    method: &dyn Method,
    scene: Scene,
    settings: &BakeSettings,
    mut provenance: Provenance,
    progress: &dyn Progress,
) -> Result<Asset> {
    let parts = method.bake(&scene, settings, progress)?;
    provenance.method = method.name().to_owned();
    provenance.settings = settings.values.clone();
    provenance.settings.insert("max-rms".to_owned(), settings.max_rms.to_string());
    let kinds: Vec<&str> = settings.for_lights.iter().map(|k| k.name()).collect();
    provenance.settings.insert("for-lights".to_owned(), kinds.join(","));
    provenance.settings.insert("samples".to_owned(), parts.samples.len().to_string());
    Ok(Asset { scene, samples: parts.samples, provenance, ledger: parts.ledger, sections: parts.sections })
}
