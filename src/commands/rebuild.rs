//! Bakes in builds: whether one is needed, and what it depends on.

use std::fs::File;
use std::path::{Path, PathBuf};

use clap::Args;
use translux_format::{Excerpt, metadata};

use super::console::Console;
use super::model::ModelArgs;
use super::output::probe;
use crate::asset::{ALGORITHM_REVISION, REQUEST, provenance_from_file};
use crate::error::{Error, Result};
use crate::import::dependencies;
use crate::import::file::Input;
use crate::io::atomic;
use crate::medium::inversion::Reflector;

/// Options of a bake in a build.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "In builds")]
pub(super) struct BuildOptions {
    /// Do nothing where the output is of the same request, files and algorithms
    #[arg(long)]
    pub(super) if_changed: bool,
    /// Write the files that the output depends on, as a rule for make and ninja
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
    /// Say what the bake is expected to take (time, memory, bytes) and do not bake
    #[arg(long, conflicts_with = "if_changed")]
    pub(super) dry_run: bool,
    /// Write the asset although it misses what was asked for
    #[arg(long)]
    pub(super) keep_on_fail: bool,
}

/// A hash of what a command line asks for: the model's options and those of the method, whatever their order, and no folder. What looks
/// are inverted through follows from the method.
pub(super) fn request(model: &ModelArgs, of_method: &str) -> String {
    let mut options = model.options(Reflector::default());
    for text in &mut options.materials.texts {
        let (name, value) = text.split_once('=').map_or(("", text.as_str()), |(name, value)| (name, value));
        let value = Path::new(value).file_name().map_or(value.into(), |file| file.to_string_lossy());
        *text = format!("{name}={value}");
    }
    // Nothing is added where nothing is refined: assets that were baked before there was refinement stay current.
    let refined = model.refined().map(|option| format!(" {option}")).unwrap_or_default();
    blake3::hash(format!("{ALGORITHM_REVISION} {options:?} {of_method}{refined}").as_bytes()).to_hex().to_string()
}

impl BuildOptions {
    /// Refuses a depfile that cannot be written, before the work rather than after it.
    pub(super) fn check(&self, asset: &Path) -> Result<()> {
        let Some(path) = &self.depfile else { return Ok(()) };
        if path == asset || path == Path::new("-") {
            return Err(Error::command_line(format!("--depfile {}: a file of its own is needed", path.display())));
        }
        probe("--depfile", path)
    }

    /// Writes the depfile where it is asked for.
    pub(super) fn write(&self, asset: &Path, model: &ModelArgs) -> Result<()> {
        let Some(path) = &self.depfile else { return Ok(()) };
        let files = dependencies(&model.model, &model.options(Reflector::default()).materials)?;
        let words: Vec<String> = files.iter().map(|file| escaped(file)).collect();
        atomic::write(path, format!("{}: {}\n", escaped(asset), words.join(" ")).as_bytes())
    }

    /// Returns whether the output is there, of the same request and of the same files.
    pub(super) fn is_current(&self, asset: &Path, request: &str, model: &ModelArgs, console: &Console) -> Result<bool> {
        if !self.if_changed {
            return Ok(false);
        }
        let Ok(mut file) = File::open(asset) else { return Ok(false) };
        // Whatever is wrong with the old one, a new one is needed.
        let Ok(found) = Excerpt::read(&mut file, console.budget(), |info| info.tag == metadata::tags::PROVENANCE)
        else {
            return Ok(false);
        };
        let Ok(provenance) = metadata::provenance(&found.reader()) else { return Ok(false) };
        if provenance.algorithm_revision != ALGORITHM_REVISION {
            return Ok(false);
        }
        let provenance = provenance_from_file(provenance);
        if provenance.settings.get(REQUEST).is_none_or(|of_asset| of_asset != request) {
            return Ok(false);
        }
        Ok(inputs(model)? == provenance.origin.inputs)
    }
}

/// The files that a scene is made from.
pub(super) fn inputs(model: &ModelArgs) -> Result<Vec<Input>> {
    let files = dependencies(&model.model, &model.options(Reflector::default()).materials)?;
    files.iter().map(|file| Input::read(file)).collect()
}

/// A name as rules have it.
fn escaped(path: &Path) -> String {
    let mut text = String::new();
    for c in path.to_string_lossy().chars() {
        match c {
            ' ' | '#' | '\\' | ':' if c != ':' || cfg!(not(windows)) => text.extend(['\\', c]),
            '$' => text.push_str("$$"),
            _ => text.push(c),
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_rules_are_escaped() {
        assert_eq!(escaped(Path::new("a b#c/d$e.obj")), "a\\ b\\#c/d$$e.obj");
    }
}
