//! A model in one material, its bakes, and the machine that measures.

use std::path::{Path, PathBuf};

use super::adapter::Adapter;
use super::child::{Bake, BakeCost, Outcome, bake};
use super::timing::Repetitions;
use crate::commands::console::Console;
use crate::error::{Error, Result};
use crate::light::Light;
use crate::measure::chart::Machine;

/// A model in one material, with everything that the measurement of a method needs.
pub(super) struct Subject<'a> {
    pub(super) model: &'a Path,
    pub(super) material: &'a str,
    /// Options of `bake` that place the model.
    pub(super) placement: &'a [String],
    pub(super) lights: &'a [(String, Light)],
    pub(super) repetitions: Repetitions,
    pub(super) folder: &'a Path,
    pub(super) adapter: &'a Adapter,
    pub(super) console: &'a Console,
}

/// An asset with the cost of its bake.
pub(super) struct Baked {
    pub(super) path: PathBuf,
    /// Command of the bake as it would be typed.
    pub(super) command: String,
    pub(super) cost: BakeCost,
}

impl Subject<'_> {
    /// The last part of the model's path.
    pub(super) fn name(&self) -> String {
        self.model.file_name().map_or_else(|| self.model.display().to_string(), |n| n.to_string_lossy().into_owned())
    }

    /// Bakes with a method and options in another process; an asset and a report that exist already are taken.
    pub(super) fn bake(&self, method: &str, options: &str) -> Result<Baked> {
        let model = self.model.display().to_string();
        let mut words: Vec<String> =
            ["bake", &model, "--method", method, "--material", self.material].map(str::to_owned).into();
        words.extend_from_slice(self.placement);
        words.extend(options.split_whitespace().map(str::to_owned));
        let command = format!("translux {}", words.join(" "));
        let bytes = std::fs::read(self.model).map_err(|e| Error::io(self.model, &e))?;
        let mut hasher = blake3::Hasher::new();
        hasher.update(env!("CARGO_PKG_VERSION").as_bytes()).update(command.as_bytes()).update(&bytes);
        let key = &hasher.finalize().to_hex()[..16];
        match bake(&Bake { words: &words, key, work: self.folder, limits: None })? {
            Outcome::Done(path, cost) => Ok(Baked { path, command, cost }),
            Outcome::Failed(said) => Err(Error::runtime(format!("{command}: {said}"))),
            Outcome::Ended(after) => Err(Error::runtime(format!("{command}: ended after {after:.0} s"))),
        }
    }
}

/// Processor, threads and load of this machine.
pub(super) fn machine() -> Machine {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    Machine {
        processor: name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned()),
        threads: rayon::current_num_threads(),
        load: load.split_whitespace().next().and_then(|l| l.parse().ok()),
    }
}
