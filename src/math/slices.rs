//! Pieces of slices for tasks.

/// Cuts a slice into successive pieces of some lengths; what is beyond its end is missing from the last ones.
pub(crate) fn cut<T>(mut rest: &mut [T], lengths: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    lengths.map(|length| rest.split_off_mut(..length.min(rest.len())).unwrap_or_default()).collect()
}
