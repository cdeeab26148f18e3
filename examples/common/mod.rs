//! What the examples that measure the figures of a page share.
//! No page needs all of it.
#![allow(dead_code)]

pub(crate) mod bench;
pub(crate) mod finer;
pub(crate) mod lit;
pub(crate) mod runner;
pub(crate) mod sheet;
