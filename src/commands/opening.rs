//! An asset opened for evaluation, with the materials that the command line asks for.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use translux_format::{Budget, Excerpt};

use super::console::Console;
use super::media::{MediumArgs, ProfileArg, tell};
use super::model::PlacementArgs;
use super::unbaked::{self, Purpose, Unbaked, is_model};
use crate::asset::{Asset, Provenance};
use crate::error::{Error, Result};
use crate::evaluate::{Evaluator, Registry};
use crate::import::materials::{MaterialChoice, SceneMedia};
use crate::medium::inversion::Reflector;
use crate::medium::profiles::model::LoadedProfile;
use crate::report::radiosity_ply::{DIPOLE, model_of};
use crate::report::text::significant;

/// An asset and its materials.
#[derive(Clone, Debug, Args)]
pub(super) struct AssetArgs {
    #[arg(help = unbaked::HELP)]
    pub(super) asset: PathBuf,
    /// The asset of a model.
    #[arg(skip)]
    unbaked: Unbaked,
    #[command(flatten)]
    media: MediumArgs,
    #[command(flatten)]
    profile: ProfileArg,
    #[command(flatten)]
    placement: PlacementArgs,
}

/// An asset with its evaluator.
pub(super) struct Opened {
    pub(super) provenance: Provenance,
    pub(super) evaluator: Box<dyn Evaluator>,
}

impl Opened {
    /// Relative error that the bake aimed at.
    pub(super) fn asked_rms(&self) -> Option<f64> {
        self.provenance.settings.get("max-rms").and_then(|text| text.parse().ok())
    }
}

/// The evaluator of an asset that was baked in memory.
pub(super) fn baked(asset: Asset, console: &Console) -> Result<Box<dyn Evaluator>> {
    console.stage("prepare", || console.registry.open(Arc::new(asset)))
}

/// What to do where the memory limit does not allow an asset.
pub(super) const FEWER: &str = "raise --max-memory, or bake a smaller asset";

/// Refuses a file whose content would take more memory than is allowed, before it is read: `copies` of what is decoded beside its bytes.
/// What is no asset is told by whoever reads it.
pub(super) fn check_file(path: &Path, copies: u64, console: &Console) -> Result<()> {
    let Some(found) =
        File::open(path).ok().and_then(|mut file| Excerpt::read(&mut file, console.budget(), |_| false).ok())
    else {
        return Ok(());
    };
    let decoded = found.directory().iter().map(|info| info.decoded_bytes).fold(0, u64::saturating_add);
    let needed = found.length().saturating_add(decoded.saturating_mul(copies));
    console.check_memory(needed, FEWER).map_err(|e| e.in_file(path))
}

/// Makes the evaluators of assets after a check of their memory.
pub(super) fn within_memory(console: &Console) -> impl Fn(&Arc<Asset>, &Path) -> Result<Box<dyn Evaluator>> {
    |asset, path| {
        let form = console.registry.form(asset).map_err(|e| e.in_file(path))?;
        console.check_memory(form.run_memory(asset), FEWER).map_err(|e| e.in_file(path))?;
        console.stage("prepare", || form.open(Arc::clone(asset))).map_err(|e| e.in_file(path))
    }
}

impl AssetArgs {
    /// Reads the asset and puts the materials in force.
    pub(super) fn open(&self, console: &Console) -> Result<Opened> {
        // The asset goes, and with it what the evaluator has in another form.
        self.open_beside(console).map(|(opened, _)| opened)
    }

    /// The same arguments; a model is baked for frames.
    pub(super) fn for_frames(&self) -> Self {
        Self { unbaked: Unbaked::new(Purpose::Frames), ..self.clone() }
    }

    /// The model whose base colours lie over media that were guessed, once it has been opened.
    pub(super) fn base_colours(&self) -> Option<&Path> {
        self.unbaked.base_colours()
    }

    /// The same with the asset beside it, for whoever measures its error.
    pub(super) fn open_beside(&self, console: &Console) -> Result<(Opened, Arc<Asset>)> {
        let is_model = is_model(&self.asset);
        let asset = if is_model {
            self.baked(console)?
        } else {
            if let Some(option) = self.placement.given_of_model() {
                let asset = self.asset.display();
                return Err(Error::command_line(format!(
                    "{asset}: {option} is of models; an asset has it since its bake"
                )));
            }
            check_file(&self.asset, 1, console)?;
            console.stage("open", || self.read(&console.registry, &self.asset, console.budget()))?
        };
        let mut evaluator = within_memory(console)(&asset, &self.asset)?;
        let is_walked = !self.profile.is_given() && model_of(&asset.provenance) != DIPOLE;
        let reflector = if is_walked { Reflector::Volume } else { self.profile.reflector()? };
        // A model was baked with them.
        let choice = if is_model { MaterialChoice::default() } else { self.media.choice(reflector) };
        if let Some(SceneMedia { media, looks }) = choice.of_scene(evaluator.scene())? {
            evaluator.set_media(media)?;
            tell(&looks, console);
        }
        self.profile.put(evaluator.as_mut())?;
        Ok((Opened { provenance: asset.provenance.clone(), evaluator }, asset))
    }

    /// The profile that was put in the dipole's place.
    pub(super) fn loaded_profile(&self) -> Result<Option<LoadedProfile>> {
        self.profile.is_given().then(|| self.profile.model()?.load()).transpose()
    }

    /// Bakes the model that stands in the place of an asset.
    fn baked(&self, console: &Console) -> Result<Arc<Asset>> {
        let has_profile = self.profile.is_given();
        let reflector = if has_profile { self.profile.reflector()? } else { Reflector::Volume };
        let options = self.placement.options(self.media.choice(reflector));
        self.unbaked.bake(&self.asset, (options, has_profile), console)
    }

    /// Reads an asset; the asset of these arguments is resized where another size is asked for.
    fn read(&self, registry: &Registry, path: &Path, budget: Budget) -> Result<Arc<Asset>> {
        if let Some(asset) = self.unbaked.asset().filter(|_| path == self.asset) {
            return Ok(asset);
        }
        let asset = Asset::read_within(path, budget)?;
        let Some(size_mm) = self.placement.size_mm.filter(|_| path == self.asset) else { return Ok(Arc::new(asset)) };
        if registry.form(&asset).map_err(|e| e.in_file(path))?.holds_transport() {
            let (path, baked) = (path.display(), asset.scene.mesh.diagonal_mm());
            return Err(Error::unsupported(format!(
                "{path}: --size-mm {size_mm}: the transport of `{}` was computed for {} mm; bake again with that size, or with \
                 --method editable, which stores none",
                asset.provenance.method,
                significant(baked)
            )));
        }
        asset.resized(size_mm).map(Arc::new)
    }
}

#[cfg(feature = "gui")]
impl AssetArgs {
    /// The profile that was given, otherwise the dipole.
    pub(super) fn profile(&self) -> Result<crate::medium::profiles::model::ProfileModel> {
        self.profile.model()
    }

    /// An asset as it was baked, resized if it is the asset of these arguments and another size is asked for, with the
    /// given profile in place of the dipole.
    pub(super) fn again(
        &self,
        registry: &Registry,
        path: &Path,
        profile: Option<&LoadedProfile>,
    ) -> Result<(Box<dyn Evaluator>, Arc<Asset>)> {
        let asset = self.read(registry, path, Budget::default())?;
        let mut evaluator = registry.open(Arc::clone(&asset))?;
        if let Some(profile) = profile {
            evaluator.set_profile(profile.clone())?;
        }
        Ok((evaluator, asset))
    }
}
