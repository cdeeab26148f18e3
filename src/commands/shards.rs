//! `translux bake --shard I/N`: a bake that several processes share, what each leaves, and all of it together.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use serde::{Deserialize, Serialize};

use super::console::Console;
use crate::asset::ALGORITHM_REVISION;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::division::{Division, Keep, Shard};
use crate::import::file::Input;
use crate::io::bundle::{Bundle, Extent, OpenBundle};
use crate::math::machine::Machine;
use crate::report::text::megabytes;

/// Suffix of files of shards.
pub(super) const SUFFIX: &str = "shard";

/// Name of the layout of [`Manifest`].
const SCHEMA: &str = "translux.shard.v1";

/// Largest number of shards.
const MOST: u32 = 1 << 16;

/// Options of a bake whose work is shared.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "On farms")]
pub(super) struct ShardOptions {
    /// Compute one of N shares of the bake, I from 1, and write it (.shard) in place of the asset; `translux merge` puts all of them together,
    /// to the bytes of the whole bake
    #[arg(long, value_name = "I/N", value_parser = parse_shard, conflicts_with_all = ["if_changed", "dry_run", "keep_on_fail", "depfile", "cache"])]
    pub(super) shard: Option<Shard>,
    /// A shard that is there already: what all shards need is taken from it, and not computed in each
    #[arg(long, value_name = "FILE", requires = "shard")]
    pub(super) from_shard: Option<PathBuf>,
    /// The options of this bake as a file has them.
    #[arg(skip)]
    pub(super) options: String,
}

fn parse_shard(text: &str) -> std::result::Result<Shard, String> {
    let number = |text: &str| text.parse::<u32>().ok().filter(|number| (1..=MOST).contains(number));
    match text.split_once('/').map(|(index, count)| (number(index), number(count))) {
        Some((Some(index), Some(count))) if index <= count => Ok(Shard { index: index - 1, count }),
        _ => Err(format!("I/N is needed, I from 1 to N and N at most {MOST}, such as 2/4")),
    }
}

/// Options that are no part of what is baked: of the place of results and of this machine.
pub(super) const OF_THE_PROCESS: [&str; 3] = ["output", "shard", "from-shard"];

/// What must be equal in all shards of a bake.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Identity {
    /// Version of the program.
    version: String,
    /// Revision of its algorithms.
    revision: u32,
    machine: Machine,
    /// Hash of what was asked for.
    request: String,
    /// Files that the scene was made from.
    inputs: Vec<Kept>,
    /// Number of shards.
    count: u32,
}

/// A file and its hash.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Kept {
    name: String,
    blake3: String,
}

impl Identity {
    fn new(request: &str, inputs: &[Input], count: u32) -> Self {
        let kept = |input: &Input| Kept { name: input.name.clone(), blake3: input.blake3.clone() };
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            revision: ALGORITHM_REVISION,
            machine: Machine::this(),
            request: request.to_owned(),
            inputs: inputs.iter().map(kept).collect(),
            count,
        }
    }

    /// What keeps a shard from being one of the same bake.
    fn differs(&self, other: &Self) -> Option<String> {
        let Self { version, revision, machine, request, inputs, count } = self;
        if (version, revision) != (&other.version, &other.revision) {
            let of =
                |identity: &Self| format!("{} (revision {} of its algorithms)", identity.version, identity.revision);
            return Some(format!("the program's version is {}, not {}", of(other), of(self)));
        }
        if *machine != other.machine {
            return Some(format!("it is from a machine that rounds otherwise ({:?}, not {machine:?})", other.machine));
        }
        if *count != other.count {
            return Some(format!("it is one of {} shards, not of {count}", other.count));
        }
        if *inputs != other.inputs {
            let changed = |kept: &&Kept| !inputs.contains(kept);
            let name = other.inputs.iter().find(changed).or(inputs.first()).map_or("", |kept| kept.name.as_str());
            return Some(format!("the files that it was made from are others, or have changed: {name}"));
        }
        (*request != other.request).then(|| "it is a bake with other options".to_owned())
    }
}

/// A result in the file of a shard.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Entry {
    stage: String,
    /// Hash of what it depends on, hexadecimal.
    name: String,
    /// Its block; none for what all shards need.
    block: Option<usize>,
    at: Extent,
}

/// What the file of a shard says of itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Manifest {
    schema: String,
    #[serde(flatten)]
    identity: Identity,
    /// From 0.
    index: u32,
    /// Options of the bake, as a file for `--config`.
    options: String,
    entries: Vec<Entry>,
}

/// The file of a shard that is there.
struct ShardFile {
    path: PathBuf,
    bundle: OpenBundle,
    identity: Identity,
    index: u32,
    options: String,
    common: BTreeMap<String, Extent>,
    blocks: BTreeMap<(String, usize), Extent>,
}

impl ShardFile {
    fn open(path: &Path) -> Result<Self> {
        let (bundle, text) = OpenBundle::open(path)?;
        let invalid = |what: String| Error::input(what).in_file(path);
        let manifest: Manifest =
            serde_json::from_str(&text).map_err(|e| invalid(format!("what it says of itself cannot be read: {e}")))?;
        let Manifest { schema, identity, index, options, entries } = manifest;
        if schema != SCHEMA || index >= identity.count || identity.count > MOST {
            return Err(invalid(format!("no shard of this program: {schema}, {index} of {}", identity.count)));
        }
        let (mut common, mut blocks) = (BTreeMap::new(), BTreeMap::new());
        for Entry { name, block, at, .. } in entries {
            match block {
                Some(block) => drop(blocks.insert((name, block), at)),
                None => drop(common.insert(name, at)),
            }
        }
        Ok(Self { path: path.to_owned(), bundle, identity, index, options, common, blocks })
    }

    fn shard(&self) -> Shard {
        Shard { index: self.index, count: self.identity.count }
    }

    /// Reads a result.
    fn read(&self, stage: &str, at: &Extent) -> Result<Vec<u8>> {
        let found = self.bundle.read(at).map_err(|e| Error::io(&self.path, &e))?;
        let shard = self.shard();
        found.ok_or_else(|| {
            Error::input(format!("damaged: a result of `{stage}` does not have its hash; bake shard {shard} again"))
                .in_file(&self.path)
        })
    }
}

fn hex(name: &[u8; 32]) -> String {
    blake3::Hash::from_bytes(*name).to_hex().to_string()
}

/// A shard that is being computed.
pub(super) struct Computed {
    shard: Shard,
    before: Option<ShardFile>,
    state: Mutex<State>,
}

struct State {
    bundle: Option<Bundle>,
    entries: Vec<Entry>,
    /// What kept a result from being written.
    failed: Option<Error>,
    is_done: bool,
}

impl Computed {
    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, stage: &'static str, name: &[u8; 32], block: Option<usize>, bytes: &[u8]) -> Result<()> {
        let mut state = self.state();
        let Some(bundle) = &mut state.bundle else {
            return Err(Error::runtime("a shard that is complete takes no more"));
        };
        let at = bundle.add(bytes)?;
        state.entries.push(Entry { stage: stage.to_owned(), name: hex(name), block, at });
        Ok(())
    }
}

impl Keep for Computed {
    fn get(&self, stage: &'static str, name: &[u8; 32]) -> Option<Vec<u8>> {
        // What one file has for all need not be in another.
        let before = self.before.as_ref()?;
        before.read(stage, before.common.get(&hex(name))?).ok()
    }

    fn put(&self, stage: &'static str, name: &[u8; 32], bytes: &[u8]) {
        if let Err(error) = self.add(stage, name, None, bytes) {
            self.state().failed.get_or_insert(error);
        }
    }
}

impl Division for Computed {
    fn shard(&self) -> Option<Shard> {
        Some(self.shard)
    }

    fn finish(&self) {
        self.state().is_done = true;
    }

    fn leave(&self, stage: &'static str, name: &[u8; 32], block: usize, bytes: &[u8]) -> Result<()> {
        self.add(stage, name, Some(block), bytes)
    }

    fn has(&self, _: &'static str, _: &[u8; 32]) -> bool {
        false
    }

    fn take(&self, stage: &'static str, _: &[u8; 32], block: usize) -> Result<Vec<u8>> {
        Err(Error::runtime(format!("block {block} of `{stage}` is asked for by a shard")))
    }
}

/// All shards of a bake.
pub(super) struct Merged {
    files: Vec<ShardFile>,
    /// Names of the blocks that were asked for.
    used: Mutex<BTreeSet<String>>,
}

impl Merged {
    /// Opens all shards of a bake, and tells what is missing, doubled or of another bake.
    pub(super) fn open(paths: &[PathBuf]) -> Result<Self> {
        let mut files = paths.iter().map(|path| ShardFile::open(path)).collect::<Result<Vec<_>>>()?;
        files.sort_by_key(|file| file.index);
        let Some(first) = files.first() else { return Err(Error::command_line("no shard is given")) };
        for file in &files {
            if let Some(why) = first.identity.differs(&file.identity) {
                let message = format!("not of the same bake as {}: {why}", first.path.display());
                return Err(Error::input(message).in_file(&file.path));
            }
        }
        if let Some(pair) = files.windows(2).find(|pair| pair[0].index == pair[1].index) {
            let message = format!("shard {} is in {} too", pair[1].shard(), pair[0].path.display());
            return Err(Error::input(message).in_file(&pair[1].path));
        }
        let count = first.identity.count;
        let missing: Vec<String> = (0..count)
            .filter(|index| files.binary_search_by_key(index, |file| file.index).is_err())
            .map(|index| (index + 1).to_string())
            .collect();
        if !missing.is_empty() {
            let (is, missing) = (if missing.len() == 1 { "is" } else { "are" }, missing.join(", "));
            return Err(Error::input(format!("of {count} shards {missing} {is} missing: all of them are needed")));
        }
        Ok(Self { files, used: Mutex::default() })
    }

    /// The options of the bake as a file has them, and the shard that they are from.
    pub(super) fn options(&self) -> Option<(&Path, &str)> {
        self.files.first().map(|file| (file.path.as_path(), file.options.as_str()))
    }

    /// Refuses what the same options ask for now, of files as they are now, where that is no longer what the shards are of.
    pub(super) fn check(&self, request: &str, inputs: &[Input]) -> Result<()> {
        let Some(first) = self.files.first() else { return Ok(()) };
        match first.identity.differs(&Identity::new(request, inputs, first.identity.count)) {
            Some(why) => {
                let message = format!("not what this bake is now: {why}");
                Err(Error::input(message).in_file(&first.path))
            }
            None => Ok(()),
        }
    }

    /// Refuses a merge that did not need what the shards computed: then they are of another bake after all.
    pub(super) fn check_used(&self) -> Result<()> {
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner);
        let names = self.files.iter().flat_map(|file| file.blocks.keys().map(move |(name, _)| (name, file)));
        match names.into_iter().find(|(name, _)| !used.contains(*name)) {
            Some((_, file)) => {
                let message = "it has blocks that this bake does not ask for: it was computed otherwise";
                Err(Error::runtime(message).in_file(&file.path))
            }
            None => Ok(()),
        }
    }
}

impl Keep for Merged {
    fn get(&self, stage: &'static str, name: &[u8; 32]) -> Option<Vec<u8>> {
        let name = hex(name);
        self.files.iter().find_map(|file| file.read(stage, file.common.get(&name)?).ok())
    }

    fn put(&self, _: &'static str, _: &[u8; 32], _: &[u8]) {}
}

impl Division for Merged {
    fn shard(&self) -> Option<Shard> {
        None
    }

    fn finish(&self) {}

    fn leave(&self, _: &'static str, _: &[u8; 32], _: usize, _: &[u8]) -> Result<()> {
        Ok(())
    }

    fn has(&self, _: &'static str, name: &[u8; 32]) -> bool {
        let name = hex(name);
        let is_there = self
            .files
            .iter()
            .any(|file| file.blocks.range((name.clone(), 0)..).next().is_some_and(|((of, _), _)| *of == name));
        if is_there {
            self.used.lock().unwrap_or_else(PoisonError::into_inner).insert(name);
        }
        is_there
    }

    fn take(&self, stage: &'static str, name: &[u8; 32], block: usize) -> Result<Vec<u8>> {
        let key = (hex(name), block);
        match self.files.iter().find_map(|file| Some((file, file.blocks.get(&key)?))) {
            Some((file, at)) => file.read(stage, at),
            None => {
                let of_it = self.files.iter().find(|file| file.shard().has(stage, block)).or(self.files.first());
                let error = Error::input(format!("block {block} of `{stage}` is not in it: bake it again"));
                Err(of_it.map_or(error.clone(), |file| error.in_file(&file.path)))
            }
        }
    }
}

/// What became of a shard.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ShardReport {
    #[serde(serialize_with = "crate::report::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    output: PathBuf,
    /// Which one, from 1.
    shard: u32,
    /// Number of shards.
    shards: u32,
    /// Blocks in it.
    blocks: usize,
    /// Length of the file.
    bytes: u64,
}

impl Computed {
    /// A shard of a request and its files, and what another one has for all.
    pub(super) fn new(
        (shard, before): (Shard, Option<&Path>),
        output: &Path,
        (request, inputs): (&str, &[Input]),
    ) -> Result<Arc<Self>> {
        let before = before.map(ShardFile::open).transpose()?;
        if let Some(before) = &before
            && let Some(why) = Identity::new(request, inputs, shard.count).differs(&before.identity)
        {
            return Err(Error::input(format!("--from-shard: not of this bake: {why}")).in_file(&before.path));
        }
        let state = State { bundle: Some(Bundle::begin(output)?), entries: Vec::new(), failed: None, is_done: false };
        Ok(Arc::new(Self { shard, before, state: Mutex::new(state) }))
    }

    /// True if all of its blocks are there, and the bake ended for that reason.
    pub(super) fn is_done(&self) -> bool {
        self.state().is_done
    }

    /// Writes the file, and reports it.
    pub(super) fn write(
        &self,
        output: &Path,
        options: &ShardOptions,
        (request, inputs): (&str, &[Input]),
        console: &Console,
    ) -> Result<ExitCode> {
        let (bundle, entries) = {
            let mut state = self.state();
            if let Some(error) = state.failed.take() {
                return Err(error);
            }
            (state.bundle.take(), std::mem::take(&mut state.entries))
        };
        let Some(bundle) = bundle else { return Err(Error::runtime("a shard is written twice")) };
        let blocks = entries.iter().filter(|entry| entry.block.is_some()).count();
        let Shard { index, count } = self.shard;
        let (schema, options) = (SCHEMA.to_owned(), options.options.clone());
        let manifest = Manifest { schema, identity: Identity::new(request, inputs, count), index, options, entries };
        let text = serde_json::to_string(&manifest).map_err(|e| Error::runtime(format!("shard: {e}")))?;
        let bytes = console.stage("write", || bundle.finish(&text))?;
        let (shard, place) = (self.shard, output.display());
        console.note(&format!("SHARD {shard}: {blocks} blocks, {} in {place}", megabytes(bytes)));
        let (shard, shards) = (index + 1, count);
        console.report("bake", &ShardReport { output: output.to_owned(), shard, shards, blocks, bytes })
    }
}
