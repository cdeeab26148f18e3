//! x
use translux::error::Result;
use crate::bench::Context;
pub(crate) fn run(_: &Context) -> Result<String> { Ok(String::new()) }
