//! Checks for the contents of several sections.

use crate::error::{FormatError, Result};
use crate::types::Tag;

/// Longest string in a record of this crate, in bytes of UTF-8.
pub const MAX_STRING_BYTES: usize = 4096;

pub(crate) fn invalid<T>(tag: Tag, reason: impl Into<String>) -> Result<T> {
    Err(FormatError::Invalid { tag, reason: reason.into() })
}

pub(crate) fn finite_f32<const N: usize>(tag: Tag, rows: &[[f32; N]]) -> Result<()> {
    match rows.iter().position(|row| !row.iter().all(|x| x.is_finite())) {
        Some(i) => invalid(tag, format!("row {i} is not finite")),
        None => Ok(()),
    }
}

/// Checks that every number is at least `least` (or finite, where `least` is negative infinity).
pub(crate) fn in_range(tag: Tag, what: &str, values: &[f64], least: f64) -> Result<()> {
    match values.iter().find(|x| !(x.is_finite() && **x >= least)) {
        Some(x) if least.is_finite() => invalid(tag, format!("{what} is {x}: it must be finite and at least {least}")),
        Some(x) => invalid(tag, format!("{what} is {x}: it must be finite")),
        None => Ok(()),
    }
}

/// Largest number of surface samples that anything was computed from.
const MOST_SAMPLES: u32 = 1 << 28;

/// Checks a number of surface samples.
pub(crate) fn samples(tag: Tag, count: u32) -> Result<()> {
    if count <= MOST_SAMPLES {
        return Ok(());
    }
    invalid(tag, format!("{count} samples are more than {MOST_SAMPLES}"))
}

/// Checks that no number is larger than `most`, whatever its sign.
pub(crate) fn bounded(tag: Tag, what: &str, values: &[f64], most: f64) -> Result<()> {
    match values.iter().find(|x| !(x.is_finite() && x.abs() <= most)) {
        Some(x) => invalid(tag, format!("{what} is {x}: it must lie between -{most:e} and {most:e}")),
        None => Ok(()),
    }
}

pub(crate) fn indices_below(tag: Tag, indices: impl IntoIterator<Item = u32>, limit: usize) -> Result<()> {
    match indices.into_iter().enumerate().find(|(_, index)| *index as usize >= limit) {
        Some((i, index)) => invalid(tag, format!("index {index} at {i} is not below {limit}")),
        None => Ok(()),
    }
}

/// Checks that an array has the expected length.
pub(crate) fn same_length(tag: Tag, what: &str, length: usize, expected: usize) -> Result<()> {
    if length == expected {
        return Ok(());
    }
    invalid(tag, format!("{length} rows for {expected} {what}"))
}

/// Checks that positions of an array fit in `u32`, the largest value being reserved for "none".
pub(crate) fn addressable(tag: Tag, length: usize) -> Result<()> {
    if length < u32::MAX as usize { Ok(()) } else { invalid(tag, format!("{length} rows are more than 2^32 - 2")) }
}

/// Rule for empty ranges between two offsets.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ranges {
    MayBeEmpty,
    NonEmpty,
}

/// Checks the offsets of `offsets.len() - 1` ranges that cover `total` rows in order.
pub(crate) fn offsets(tag: Tag, offsets: &[u32], total: usize, ranges: Ranges) -> Result<()> {
    let (Some(first), Some(last)) = (offsets.first(), offsets.last()) else {
        return invalid(tag, "no offsets: the first must be 0");
    };
    if *first != 0 {
        return invalid(tag, format!("the first offset is {first}, not 0"));
    }
    if *last as usize != total {
        return invalid(tag, format!("the last offset is {last}, not {total}"));
    }
    let wrong = |pair: &[u32]| match ranges {
        Ranges::MayBeEmpty => pair[0] > pair[1],
        Ranges::NonEmpty => pair[0] >= pair[1],
    };
    match offsets.windows(2).position(wrong) {
        Some(i) => invalid(tag, format!("offset {} is out of order", i + 1)),
        None => Ok(()),
    }
}

pub(crate) fn text(tag: Tag, what: &str, text: &str) -> Result<()> {
    if text.len() <= MAX_STRING_BYTES {
        return Ok(());
    }
    invalid(tag, format!("{what} has {} bytes; the limit is {MAX_STRING_BYTES}", text.len()))
}
