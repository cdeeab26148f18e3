//! Unsigned numbers in as few bytes as needed (LEB128): seven bits in a byte, the lowest first, the high bit set where
//! more follow.

/// Longest encoding of a `u32`.
const MAX_BYTES: usize = 5;

pub(crate) fn push(bytes: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

/// Reads a number off the front; `None` if it is truncated, longer than needed, or above 2^32 - 1.
#[inline]
pub(crate) fn take(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0u64;
    for (i, &byte) in bytes.iter().take(MAX_BYTES).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * i);
        if byte < 0x80 {
            let shortest = i == 0 || byte != 0;
            *bytes = &bytes[i + 1..];
            return u32::try_from(value).ok().filter(|_| shortest);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_survive_and_have_one_form() {
        for value in [0, 1, 127, 128, 300, 16_383, 16_384, 1 << 21, 1 << 28, u32::MAX] {
            let mut bytes = Vec::new();
            push(&mut bytes, value);
            assert_eq!(take(&mut bytes.as_slice()), Some(value));
            assert_eq!(take(&mut &bytes[..bytes.len() - 1]), None);
        }
        for wrong in [&[0x80, 0][..], &[0xff, 0xff, 0xff, 0xff, 0x10], &[0x80; 6], &[0xff; 9], &[]] {
            assert_eq!(take(&mut &*wrong), None, "{wrong:?}");
        }
        let mut two: &[u8] = &[0xac, 2, 5];
        assert_eq!((take(&mut two), take(&mut two), take(&mut two)), (Some(300), Some(5), None));
    }
}
