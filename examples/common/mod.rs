//! What the examples that measure the figures of a page share.

pub(crate) mod bench;
pub(crate) mod runner;
pub(crate) mod sheet;
