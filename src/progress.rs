//! Progress of long work: stages report units of work done, and listeners show them.

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

/// Progress that is not shown.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _units: u64) {}
    fn finish(&self) {}
}
