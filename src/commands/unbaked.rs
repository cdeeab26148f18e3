//! A model in the place of an asset: baked in memory, so that one command shows it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use super::baking;
use super::console::Console;
use super::model;
use crate::asset::Asset;
use crate::error::Result;
use crate::evaluate::Model;
use crate::import::file::suffix;
use crate::import::{ImportOptions, Source};
use crate::io::gltf::base_colour::read_base_colours;
use crate::report::text::duration;
use crate::transport::calibration::Walks;

/// What the help of an asset's argument says of models.
pub(super) const HELP: &str = "Asset, or a model (.glb, .gltf, .obj) that is baked in memory: materials, size and parts are then those of the bake, and what nobody \
    says of a material is guessed";

/// For what a model is baked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Purpose {
    /// One light: sums over the samples, none of which is prepared.
    #[default]
    Once,
    /// Lights and media that move: sums that are fast in every frame.
    Frames,
}

impl Purpose {
    fn method(self) -> &'static str {
        match self {
            Self::Once => "two_pass",
            Self::Frames => "editable",
        }
    }
}

/// The asset of a model, which is baked once.
#[derive(Clone, Debug, Default)]
pub(super) struct Unbaked {
    purpose: Purpose,
    baked: Arc<OnceLock<Baked>>,
}

#[derive(Debug)]
struct Baked {
    asset: Arc<Asset>,
    /// The model, where its base colours lie over guessed media.
    base_colours: Option<PathBuf>,
}

/// Whether a path is that of a model, by its suffix.
pub(super) fn is_model(path: &Path) -> bool {
    matches!(suffix(path).as_str(), "obj" | "gltf" | "glb")
}

/// A model whose base colours can be shown; what stands in the way is told.
fn base_colours(model: &Path, console: &Console) -> Option<PathBuf> {
    if suffix(model) == "obj" {
        return None;
    }
    match read_base_colours(model) {
        Ok(_) => Some(model.to_owned()),
        Err(error) => {
            console.warn(&format!("its base colours are left out: {}", error.message()));
            None
        }
    }
}

impl Unbaked {
    /// Nothing yet.
    pub(super) fn new(purpose: Purpose) -> Self {
        Self { purpose, ..Self::default() }
    }

    /// The asset, once it has been baked.
    pub(super) fn asset(&self) -> Option<Arc<Asset>> {
        self.baked.get().map(|baked| Arc::clone(&baked.asset))
    }

    /// The model, where its base colours lie over guessed media.
    pub(super) fn base_colours(&self) -> Option<&Path> {
        self.baked.get().and_then(|baked| baked.base_colours.as_deref())
    }

    /// Bakes a model, unless that was done before; with a profile, which takes their place, without calibrated kernels.
    ///
    /// # Errors
    /// Those of the import and of the bake.
    pub(super) fn bake(
        &self,
        path: &Path,
        (mut options, has_profile): (ImportOptions, bool),
        console: &Console,
    ) -> Result<Arc<Asset>> {
        if let Some(asset) = self.asset() {
            return Ok(asset);
        }
        let begin = console.seconds();
        options.materials.guess = true;
        let source = Source::read(path, &options.materials, console)?;
        let imported = model::import(source, &options, None, console).map_err(|e| e.in_file(path))?;
        let guessed = imported.from_file.iter().any(|material| material.is_of_guessed_colour());
        let mut recipe = console.registry.method(self.purpose.method())?.default_recipe()?;
        if !has_profile {
            recipe.settings.model = Model::Calibrated(Walks::default());
        }
        let asset = Arc::new(baking::bake_unmeasured(recipe, imported, console)?);
        let base_colours = if guessed { base_colours(path, console) } else { None };
        let (path, took) = (path.display(), duration(console.seconds() - begin));
        console.note(&format!(
            "{path}: baked in memory, {took}; `translux bake {path} -o FILE.tlux` keeps an asset, and measures its errors"
        ));
        let baked = self.baked.get_or_init(|| Baked { asset, base_colours });
        Ok(Arc::clone(&baked.asset))
    }
}
