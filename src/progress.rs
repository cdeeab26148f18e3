//! Progress of long work: stages report units of work done, and listeners show them.

use std::ops::Range;

use crate::parallel::*;

/// Receives the progress of one stage after another. Implementations must be cheap to call from many threads.
pub trait Progress: Sync {
    /// A stage of `total` units of work starts.
    fn start(&self, stage: &'static str, total: u64);
    /// `units` more units of the current stage are done.
    fn advance(&self, units: u64);
    /// The current stage ended.
    fn finish(&self);
}

/// Runs `work` as a stage without units.
pub fn stage<T>(progress: &dyn Progress, name: &'static str, work: impl FnOnce() -> T) -> T {
    progress.start(name, 0);
    let result = work();
    progress.finish();
    result
}

/// Runs a stage of `count` units in tasks of `each`, side by side; their results in order.
pub fn in_tasks<T: Send>(
    progress: &dyn Progress,
    name: &'static str,
    (count, each): (usize, usize),
    work: impl Fn(Range<usize>) -> T + Sync,
) -> Vec<T> {
    progress.start(name, count as u64);
    let task = |task: usize| {
        let range = task * each..((task + 1) * each).min(count);
        let result = work(range.clone());
        progress.advance(range.len() as u64);
        result
    };
    let results = (0..count.div_ceil(each)).into_par_iter().map(task).collect();
    progress.finish();
    results
}

/// Progress that is not shown.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn finish(&self) {}
}
