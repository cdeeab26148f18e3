//! An asset opened for evaluation, with the materials that the command line asks for.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::console::{Console, significant};
use super::media::{MediumArgs, ProfileArg};
use crate::asset::{Asset, Provenance};
use crate::error::{Error, Result};
use crate::evaluate::{AnyForm, Evaluator, Registry};
use crate::forms::density;

/// An asset and its materials.
#[derive(Clone, Debug, Args)]
pub(super) struct AssetArgs {
    /// Asset
    pub(super) asset: PathBuf,
    #[command(flatten)]
    media: MediumArgs,
    #[command(flatten)]
    profile: ProfileArg,
    /// Another size of the object: its diagonal in mm. For assets that hold no transport (two_pass, reference); lights stay where
    /// they are
    #[arg(long, value_name = "MM", allow_negative_numbers = true, help_heading = "Size")]
    size_mm: Option<f64>,
}

/// An asset with its evaluator.
pub(super) struct Opened {
    pub(super) provenance: Provenance,
    pub(super) evaluator: Box<dyn Evaluator>,
}

impl AssetArgs {
    /// Reads the asset and puts the materials in force.
    pub(super) fn open(&self, console: &Console) -> Result<Opened> {
        let asset = console.stage("open", || Asset::read(&self.asset))?;
        let form = console.registry.form(&asset).map_err(|e| e.at(self.asset.display()))?;
        let asset = Arc::new(match self.size_mm {
            Some(size_mm) => self.resized(asset, form.as_ref(), size_mm)?,
            None => asset,
        });
        let needed = density::memory(asset.samples.len(), &asset.scene);
        console.check_memory(needed, "raise --max-memory, or bake with fewer --samples")?;
        let mut evaluator = console.stage("prepare", || form.open(Arc::clone(&asset)))?;
        if let Some(media) = self.media.choice().of_scene(evaluator.scene())? {
            evaluator.set_media(media)?;
        }
        self.profile.put(evaluator.as_mut())?;
        // The asset goes, and with it what the evaluator has in another form.
        Ok(Opened { provenance: asset.provenance.clone(), evaluator })
    }
}

impl AssetArgs {
    fn resized(&self, asset: Asset, form: &dyn AnyForm, size_mm: f64) -> Result<Asset> {
        if form.holds_transport() {
            let (path, baked) = (self.asset.display(), asset.scene.mesh.diagonal_mm());
            return Err(Error::unsupported(format!(
                "{path}: --size-mm {size_mm}: the transport of `{}` was computed for {} mm; bake again with that size, or with \
                 --method editable, which stores none",
                asset.provenance.method,
                significant(baked)
            )));
        }
        asset.resized(size_mm)
    }
}

#[cfg(feature = "gui")]
impl AssetArgs {
    /// The profile that is asked for.
    pub(super) fn profile(&self) -> Result<crate::medium::profiles::model::ProfileModel> {
        self.profile.model()
    }

    /// An asset as it was baked, this one in its other size where one is asked for, with a profile in the dipole's place where
    /// there is one and isotropic single scattering in its radiosity.
    pub(super) fn again(
        &self,
        registry: &Registry,
        path: &std::path::Path,
        profile: Option<&crate::medium::profiles::model::LoadedProfile>,
    ) -> Result<Box<dyn Evaluator>> {
        let asset = Asset::read(path)?;
        let form = registry.form(&asset)?;
        let asset = match self.size_mm {
            Some(size_mm) if path == self.asset => self.resized(asset, form.as_ref(), size_mm)?,
            _ => asset,
        };
        let mut evaluator = form.open(Arc::new(asset))?;
        if let Some(profile) = profile {
            evaluator.set_profile(profile.clone())?;
        }
        Ok(crate::evaluate::summed::Summed::of(evaluator))
    }
}
