//! Blocks of a stage that several processes share: each computes some of them, and one puts all together.
//!
//! A bake that is shared runs to the point from which it needs blocks of others ([`StageCache::gather`]) in every process, and beyond it in the
//! one that has all of them. Up to there it does the same work everywhere, so that all agree on what a block is.

use bytemuck::Pod;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::stage_cache::{Key, StageCache};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// The blocks of a stage.
pub struct Blocks<'a> {
    cache: &'a StageCache,
    stage: &'static str,
    name: [u8; 32],
    count: usize,
}

impl StageCache {
    /// `count` blocks of a stage. `input` tells what they depend on beside the request and the files of the bake: what was chosen on the way.
    pub fn blocks(&self, stage: &'static str, count: usize, input: impl FnOnce(&mut Key)) -> Blocks<'_> {
        let mut key = Key::new(stage);
        key.number(count as u64);
        if self.division().is_some() {
            input(&mut key);
        }
        Blocks { cache: self, stage, name: key.name(), count }
    }

    /// A result that every process of a shared bake needs: one computes it, and leaves it for those that start from what it left. `input` tells
    /// what it depends on beside the request and the files of the bake. Where a bake is not shared, `make` makes it.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn common<T: Serialize + DeserializeOwned>(
        &self,
        stage: &'static str,
        input: impl FnOnce(&mut Key),
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let Some(division) = self.division() else { return make() };
        let mut key = Key::new(stage);
        input(&mut key);
        let name = key.name();
        if let Some(left) = division.get(stage, &name).and_then(|bytes| bincode::deserialize(&bytes).ok()) {
            return Ok(left);
        }
        let made = make()?;
        let bytes = bincode::serialize(&made)
            .map_err(|e| Error::runtime(format!("the result of `{stage}` could not be written: {e}")))?;
        division.put(stage, &name, &bytes);
        Ok(made)
    }

    /// Stands where a bake needs all blocks that are computed ahead. A process that has a shard of them alone has done its work.
    ///
    /// # Errors
    /// The end of such a process, which is no failure: whoever gave it its shard knows.
    pub fn gather(&self) -> Result<()> {
        let Some((division, shard)) = self.division().and_then(|division| Some((division, division.shard()?))) else {
            return Ok(());
        };
        division.finish();
        Err(Error::runtime(format!("the blocks of shard {shard} are computed")))
    }
}

impl Blocks<'_> {
    /// Where the bake is shared, computes and leaves the blocks of this process; otherwise [`Self::get`] computes each when it is needed.
    ///
    /// # Errors
    /// Those of `make`, and of leaving blocks.
    pub fn ahead<T: Pod>(&self, progress: &dyn Progress, make: impl Fn(usize) -> Result<Vec<T>>) -> Result<()> {
        let Some(division) = self.cache.division() else { return Ok(()) };
        let Some(shard) = division.shard() else { return Ok(()) };
        let own: Vec<usize> = (0..self.count).filter(|block| shard.has(self.stage, *block)).collect();
        progress.start(self.stage, own.len() as u64);
        for block in own {
            division.leave(self.stage, &self.name, block, bytemuck::cast_slice(&make(block)?))?;
            progress.advance(1);
        }
        progress.finish();
        Ok(())
    }

    /// As [`Self::get`], for a block of so many rows.
    ///
    /// # Errors
    /// As [`Self::get`]; a block of another length.
    pub fn rows<T: Pod>(&self, (block, rows): (usize, usize), make: impl FnOnce() -> Result<Vec<T>>) -> Result<Vec<T>> {
        let found = self.get(block, make)?;
        if found.len() != rows {
            let (stage, found) = (self.stage, found.len());
            return Err(Error::input(format!("block {block} of `{stage}` has {found} rows in place of {rows}")));
        }
        Ok(found)
    }

    /// As [`Self::ahead`], for blocks that are records.
    ///
    /// # Errors
    /// As [`Self::ahead`].
    pub fn records_ahead<T: Serialize>(
        &self,
        progress: &dyn Progress,
        make: impl Fn(usize) -> Result<T>,
    ) -> Result<()> {
        self.ahead(progress, |block| {
            let record = make(block)?;
            bincode::serialize(&record)
                .map_err(|e| Error::runtime(format!("block {block} of `{}` could not be written: {e}", self.stage)))
        })
    }

    /// As [`Self::get`], for blocks that are records.
    ///
    /// # Errors
    /// As [`Self::get`].
    pub fn record<T: DeserializeOwned>(&self, block: usize, make: impl FnOnce() -> Result<T>) -> Result<T> {
        if self.are_computed() {
            return make();
        }
        let bytes: Vec<u8> = self.get(block, || Err(Error::runtime("a block is gone that was there")))?;
        bincode::deserialize(&bytes)
            .map_err(|e| Error::input(format!("block {block} of `{}` cannot be read: {e}", self.stage)))
    }

    /// Returns whether this process computes blocks: not where others left them.
    pub fn are_computed(&self) -> bool {
        !self.cache.division().is_some_and(|division| division.has(self.stage, &self.name))
    }

    /// A block: what a process left, otherwise what `make` computes.
    ///
    /// # Errors
    /// Those of `make`; a block that is missing, damaged or of another length than whole rows.
    pub fn get<T: Pod>(&self, block: usize, make: impl FnOnce() -> Result<Vec<T>>) -> Result<Vec<T>> {
        let Some(division) = self.cache.division().filter(|division| division.has(self.stage, &self.name)) else {
            return make();
        };
        let bytes = division.take(self.stage, &self.name, block)?;
        let odd =
            || Error::input(format!("block {block} of `{}` has {} bytes, no whole rows", self.stage, bytes.len()));
        if size_of::<T>() == 0 || bytes.len() % size_of::<T>() != 0 {
            return Err(odd());
        }
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::HashMap;
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::evaluate::division::{Division, Keep, Shard};
    use crate::progress::Silent;

    /// Name of a stage's blocks and number of one.
    type Place = ([u8; 32], usize);

    /// Blocks in memory, and the shard of whoever computes them.
    #[derive(Default)]
    struct Left {
        shard: Option<Shard>,
        blocks: Mutex<HashMap<Place, Vec<u8>>>,
        common: Mutex<HashMap<[u8; 32], Vec<u8>>>,
    }

    impl Keep for Left {
        fn get(&self, _: &'static str, name: &[u8; 32]) -> Option<Vec<u8>> {
            self.common.lock().unwrap().get(name).cloned()
        }

        fn put(&self, _: &'static str, name: &[u8; 32], bytes: &[u8]) {
            self.common.lock().unwrap().insert(*name, bytes.to_vec());
        }
    }

    impl Division for Left {
        fn shard(&self) -> Option<Shard> {
            self.shard
        }

        fn finish(&self) {}

        fn leave(&self, _: &'static str, name: &[u8; 32], block: usize, bytes: &[u8]) -> Result<()> {
            let before = self.blocks.lock().unwrap().insert((*name, block), bytes.to_vec());
            assert!(before.is_none(), "block {block} twice");
            Ok(())
        }

        fn has(&self, _: &'static str, name: &[u8; 32]) -> bool {
            self.blocks.lock().unwrap().keys().any(|(of, _)| of == name)
        }

        fn take(&self, _: &'static str, name: &[u8; 32], block: usize) -> Result<Vec<u8>> {
            let missing = || Error::input(format!("block {block} is missing"));
            self.blocks.lock().unwrap().get(&(*name, block)).cloned().ok_or_else(missing)
        }
    }

    /// What depends on all blocks of two stages, of which the second needs nothing of the first.
    fn work(cache: &StageCache, factor: u32) -> Result<Vec<f64>> {
        let squares = cache.blocks("squares", 7, |key| {
            key.number(u64::from(factor));
        });
        let roots = cache.blocks("roots", 2, |_| ());
        let square = |block: usize| Ok(vec![factor * block as u32; block]);
        let root = |block: usize| Ok(vec![(block as f64).sqrt()]);
        squares.ahead(&Silent, square)?;
        roots.ahead(&Silent, root)?;
        cache.gather()?;
        let mut sums = Vec::new();
        for block in 0..7 {
            sums.push(f64::from(squares.get(block, || square(block))?.iter().sum::<u32>()));
        }
        for block in 0..2 {
            sums.extend(roots.get(block, || root(block))?);
        }
        Ok(sums)
    }

    #[test]
    fn shares_put_together_are_the_whole() {
        let whole = work(&StageCache::default(), 3).unwrap();
        for count in [1u32, 2, 3, 9] {
            let mut all = HashMap::new();
            for index in (0..count).rev() {
                let left = Arc::new(Left { shard: Some(Shard { index, count }), ..Left::default() });
                // The end of a shard is told as an error.
                assert!(work(&StageCache::default().divided(left.clone()), 3).is_err());
                all.extend(left.blocks.lock().unwrap().drain());
            }
            assert_eq!(all.len(), 9, "{count}");
            let merge = StageCache::default().divided(Arc::new(Left { blocks: Mutex::new(all), ..Left::default() }));
            assert_eq!(work(&merge, 3).unwrap(), whole);
            // Blocks of another choice are others: these are computed.
            assert_eq!(work(&merge, 4).unwrap()[6], 144.0);
        }
    }

    #[test]
    fn what_all_need_is_computed_once() {
        let cache = StageCache::default().divided(Arc::new(Left::default()));
        let get = |cache: &StageCache, input: u64, made: Result<(f64, Vec<u32>)>| {
            let key = |key: &mut Key| {
                key.number(input);
            };
            cache.common("tuning", key, || made)
        };
        let failed = || Err(Error::runtime("made again"));
        assert_eq!(get(&cache, 1, Ok((0.1, vec![7]))).unwrap(), (0.1, vec![7]));
        assert_eq!(get(&cache, 1, failed()).unwrap(), (0.1, vec![7]));
        assert!(get(&cache, 2, failed()).is_err());
        // A bake that is not shared keeps nothing.
        let alone = StageCache::default();
        assert!(get(&alone, 1, Ok((0.1, Vec::new()))).is_ok() && get(&alone, 1, failed()).is_err());
    }

    #[test]
    fn half_a_row_is_refused() {
        let left = Left::default();
        let name = StageCache::default().blocks("roots", 2, |_| ()).name;
        left.leave("roots", &name, 0, &[1, 2, 3]).unwrap();
        let error = work(&StageCache::default().divided(Arc::new(left)), 3).unwrap_err();
        assert!(error.message().contains("3 bytes"), "{error}");
    }
}
