//! Where results of a bake are kept for later ones, and for the processes that share one: who computes what, and where it is left.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::error::Result;

/// One of the processes that share a bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Shard {
    /// From 0.
    pub index: u32,
    /// Number of processes.
    pub count: u32,
}

impl Shard {
    /// Returns whether a block of a stage is computed by this process: every block by one. Neighbours, which take about as long, go to
    /// different ones, and stages of a single block too.
    pub fn has(self, stage: &str, block: usize) -> bool {
        let first = stage.bytes().fold(0u32, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte.into()));
        (block as u64 + u64::from(first)) % u64::from(self.count.max(1)) == u64::from(self.index)
    }
}

/// As people count: from 1.
impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of {}", u64::from(self.index) + 1, self.count)
    }
}

/// Where results are kept. Whatever goes wrong there is no error of a stage, which computes what it does not find.
pub trait Keep: Send + Sync {
    /// The bytes that were put there under a name, unless they are gone or damaged.
    fn get(&self, stage: &'static str, name: &[u8; 32]) -> Option<Vec<u8>>;

    /// Puts bytes there.
    fn put(&self, stage: &'static str, name: &[u8; 32], bytes: &[u8]);
}

/// Where the processes of a bake leave blocks for the one that puts them together, and what all of them need for each other.
pub trait Division: Keep {
    /// The shard of this process; none where it puts together what the others left.
    fn shard(&self) -> Option<Shard>;

    /// Takes note that this process has left all of its blocks: the bake ends.
    fn finish(&self);

    /// Leaves a block.
    ///
    /// # Errors
    /// What keeps it from being left.
    fn leave(&self, stage: &'static str, name: &[u8; 32], block: usize, bytes: &[u8]) -> Result<()>;

    /// Returns whether other processes left the blocks of a name.
    fn has(&self, stage: &'static str, name: &[u8; 32]) -> bool;

    /// A block that another process left.
    ///
    /// # Errors
    /// The block is missing or damaged.
    fn take(&self, stage: &'static str, name: &[u8; 32], block: usize) -> Result<Vec<u8>>;
}
