//! An asset opened for evaluation, with the materials that the command line asks for.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::console::Console;
use super::media::{MediumArgs, edited_media};
use crate::asset::{Asset, Provenance};
use crate::error::{Error, Result};
use crate::evaluate::{Evaluator, Method};
use crate::methods;

/// An asset and its materials.
#[derive(Clone, Debug, Args)]
pub(super) struct AssetArgs {
    /// Asset
    pub(super) asset: PathBuf,
    #[command(flatten)]
    media: MediumArgs,
}

/// An asset with its evaluator.
pub(super) struct Opened {
    pub(super) provenance: Provenance,
    pub(super) method: &'static dyn Method,
    pub(super) evaluator: Box<dyn Evaluator>,
}

impl AssetArgs {
    /// Reads the asset and puts the materials in force.
    pub(super) fn open(&self, console: &Console) -> Result<Opened> {
        let asset = Arc::new(console.stage("open", || Asset::read(&self.asset))?);
        let method = methods::named(&asset.provenance.method).map_err(|_| {
            let (path, method) = (self.asset.display(), &asset.provenance.method);
            Error::unsupported(format!("{path}: baked by the method `{method}`, which this build does not have"))
        })?;
        let needed = methods::sampling::memory(asset.samples.len(), &asset.scene);
        console.check_memory(needed, "raise --max-memory, or bake with fewer --samples")?;
        let mut evaluator = console.stage("prepare", || method.open(Arc::clone(&asset)))?;
        if let Some(media) = edited_media(&self.media, evaluator.scene())? {
            evaluator.set_media(media)?;
        }
        // The asset goes, and with it what the evaluator has in another form.
        Ok(Opened { provenance: asset.provenance.clone(), method, evaluator })
    }
}

/// The evaluator of an asset as it was baked, with isotropic single scattering in its radiosity.
#[cfg(feature = "gui")]
pub(super) fn evaluator_of(path: &std::path::Path) -> Result<Box<dyn Evaluator>> {
    let asset = Arc::new(Asset::read(path)?);
    Ok(crate::evaluate::summed::Summed::of(methods::named(&asset.provenance.method)?.open(asset)?))
}
