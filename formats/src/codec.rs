//! Records: small structures as bytes. The only module that uses the serialiser, so that a successor changes one file.
//!
//! The encoding is bincode 1 with fixed-width little-endian integers; `SPEC.md` describes it in full.

use bincode::Options;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{FormatError, Result};
use crate::types::Tag;

/// Longest record in bytes.
pub const MAX_RECORD_BYTES: u64 = 64 << 20;

fn options() -> impl Options {
    bincode::DefaultOptions::new()
        .with_fixint_encoding()
        .with_little_endian()
        .with_limit(MAX_RECORD_BYTES)
        .reject_trailing_bytes()
}

pub(crate) fn encode<T: Serialize>(tag: Tag, value: &T) -> Result<Vec<u8>> {
    options().serialize(value).map_err(|error| FormatError::Record { tag, reason: error.to_string() })
}

pub(crate) fn decode<T: DeserializeOwned>(tag: Tag, bytes: &[u8]) -> Result<T> {
    options().deserialize(bytes).map_err(|error| FormatError::Record { tag, reason: error.to_string() })
}
