//! `bake --cache DIR`: results of stages that later bakes of the same input take from a folder.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;

use super::console::{Console, Unitless, parse_size};
use crate::error::Result;
use crate::evaluate::StageCache;
use crate::evaluate::division::Keep;
use crate::io::cache::Cache;

/// Options of the cache of a bake.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "In builds")]
pub(super) struct CacheOptions {
    /// Keep what stages compute that does not depend on the material in this folder, and take what another bake of the same model left there;
    /// the asset is the same
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Size of that folder, beyond which what was used longest ago goes (default: 4GiB)
    #[arg(long, value_name = "SIZE", requires = "cache")]
    cache_size: Option<String>,
}

/// Size of a folder where nobody says another, bytes.
const SIZE: u64 = 4 << 30;

/// The cache of one bake: a folder, and what became of the stages.
pub(super) struct BakeCache {
    folder: Cache,
    done: Mutex<Done>,
}

#[derive(Default)]
struct Done {
    reused: Vec<&'static str>,
    failed: Option<String>,
}

impl CacheOptions {
    /// Opens the folder, where one is given.
    pub(super) fn open(&self) -> Result<Option<Arc<BakeCache>>> {
        let Some(folder) = &self.cache else { return Ok(None) };
        let size = self.cache_size.as_deref();
        let most = size.map_or(Ok(SIZE), |size| parse_size("--cache-size", size, Unitless::Refused))?;
        Ok(Some(Arc::new(BakeCache { folder: Cache::open(folder, most)?, done: Mutex::default() })))
    }
}

impl BakeCache {
    /// The cache as stages see it.
    pub(super) fn for_stages(cache: &Option<Arc<Self>>) -> StageCache {
        cache.as_ref().map_or_else(StageCache::default, |cache| StageCache::new(Arc::clone(cache) as Arc<dyn Keep>))
    }

    /// Tells what was taken from the folder, and what could not be put there.
    pub(super) fn tell(&self, console: &Console) {
        let done = self.done();
        if !done.reused.is_empty() {
            console.note(&format!("from the cache: {}", done.reused.join(", ")));
        }
        console.reused(&done.reused);
        if let Some(failed) = &done.failed {
            console.warn(&format!("the cache does not keep everything: {failed}"));
        }
    }

    fn done(&self) -> std::sync::MutexGuard<'_, Done> {
        self.done.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Keep for BakeCache {
    fn get(&self, stage: &'static str, name: &[u8; 32]) -> Option<Vec<u8>> {
        let found = self.folder.get(name)?;
        let mut done = self.done();
        if !done.reused.contains(&stage) {
            done.reused.push(stage);
        }
        Some(found)
    }

    fn put(&self, stage: &'static str, name: &[u8; 32], bytes: &[u8]) {
        let kept = self.folder.put(name, bytes);
        let mut done = self.done();
        // What was found did not suit: it was made after all.
        done.reused.retain(|reused| *reused != stage);
        if let Err(error) = kept {
            done.failed.get_or_insert_with(|| error.message().to_owned());
        }
    }
}
