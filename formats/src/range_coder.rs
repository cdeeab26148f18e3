//! An adaptive binary range coder: bits with learned probabilities, packed to within a fraction of a percent of their
//! entropy, and integers made of such bits.
//!
//! The interval is held in 64 bits and moves on by 32 bits at a time, so probabilities of 16 bits cost nothing in
//! precision. The stream ends with a mark of 32 bits; of all values in the last interval it has the one with the most
//! zero bits at its end, and trailing zero bytes are not written. A reader sees zeros beyond the end, and
//! [`Decoder::finish`] accepts only streams as written by [`Encoder::finish`]: a stream that decodes is the one that
//! encoding gives again, and a truncated or damaged one passes with a chance of about 2^-32.
//!
//! One function of a [`Coder`] serves both directions, so that writer and reader cannot differ.

/// Shift of a settled probability: each new bit weighs 1/128.
///
/// On Laplacian columns, independent and along a tree, 8 makes 0.0 to 0.2 % fewer bytes and is slower to follow a
/// change, 6 makes 0.1 to 0.4 % more; the mean of two probabilities, one of them quicker (4 or 5 beside 7), 0.2 to 0.8
/// % more.
const SETTLED_SHIFT: u32 = 7;

/// Number of bits seen after which the shift is final.
const SETTLED_AFTER: u32 = (1 << SETTLED_SHIFT) - 2;

/// Probability that a bit is 0, learned from the bits seen so far: their average at first, then a running one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bit {
    /// Probability in units of 2^-24 above 8 bits that count the bits seen.
    state: u32,
}

impl Bit {
    /// A model that has seen nothing.
    pub const NEW: Self = Self { state: 1 << 31 };

    /// Probability of 0 in units of 2^-16: 1 to 65535.
    #[inline(always)]
    fn zero(self) -> u64 {
        // Shifts of at least 1 keep the state below 2^24, but not from falling below a unit of 2^-16.
        u64::from(self.state >> 16).max(1)
    }

    #[inline(always)]
    fn update(&mut self, bit: bool) {
        let (zero, seen) = (self.state >> 8, self.state & 0xff);
        // 1, 1, 2 (four times), 3 (eight times), ...: about the weight of one observation among those seen.
        let shift = (seen + 2).ilog2();
        let zero = if bit { zero - (zero >> shift) } else { zero + (((1 << 24) - zero) >> shift) };
        self.state = zero << 8 | (seen + u32::from(seen < SETTLED_AFTER));
    }
}

impl Default for Bit {
    fn default() -> Self {
        Self::NEW
    }
}

/// Either direction of coding. The encoder writes the given values and returns them; the decoder reads, and ignores the
/// given values.
pub trait Coder {
    /// Codes a bit under a probability, which learns from it.
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool;

    /// Codes `count` bits (at most 16), each with probability 1/2.
    fn direct(&mut self, count: u32, value: u32) -> u32;
}

/// Bits at the end of every stream.
const MARK: [u32; 2] = [0xe7d1, 0xa5c3];

/// Interval length below which it is widened by 32 bits.
const NARROW: u64 = 1 << 32;

/// Distance from the lower end of an interval to its value with the most zero bits at the end, the first of these.
fn roundest(low: u64, range: u64) -> u64 {
    let up = low.wrapping_neg();
    // Clearing bits of `up` from the top keeps the sum on a multiple of what is left.
    (1..=64).rev().map(|bits| up & (u64::MAX >> (64 - bits))).find(|distance| *distance < range).unwrap_or(0)
}

/// The encoder, from bits to bytes.
#[derive(Clone, Debug)]
pub struct Encoder {
    low: u64,
    range: u64,
    bytes: Vec<u8>,
}

impl Encoder {
    /// An encoder without output.
    pub fn new() -> Self {
        Self { low: 0, range: u64::MAX, bytes: Vec::new() }
    }

    #[inline(always)]
    fn advance(&mut self, distance: u64) {
        let (low, carry) = self.low.overflowing_add(distance);
        self.low = low;
        if carry {
            self.carry();
        }
    }

    #[cold]
    fn carry(&mut self) {
        for byte in self.bytes.iter_mut().rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                return;
            }
        }
    }

    #[inline(always)]
    fn widen(&mut self) {
        if self.range < NARROW {
            self.bytes.extend_from_slice(&((self.low >> 32) as u32).to_be_bytes());
            self.low <<= 32;
            self.range <<= 32;
        }
    }

    /// Ends the stream and returns it; its last byte is not 0.
    pub fn finish(mut self) -> Vec<u8> {
        for half in MARK {
            self.direct(16, half);
        }
        self.advance(roundest(self.low, self.range));
        self.bytes.extend_from_slice(&self.low.to_be_bytes());
        let end = self.bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        self.bytes.truncate(end);
        self.bytes
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Coder for Encoder {
    #[inline(always)]
    fn bit(&mut self, model: &mut Bit, bit: bool) -> bool {
        let bound = (self.range >> 16) * model.zero();
        if bit {
            self.advance(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        model.update(bit);
        self.widen();
        bit
    }

    #[inline(always)]
    fn direct(&mut self, count: u32, value: u32) -> u32 {
        let count = count.min(16);
        let value = value & ((1 << count) - 1);
        self.range >>= count;
        self.advance(self.range * u64::from(value));
        self.widen();
        value
    }
}

/// The decoder, from bytes to bits. Any bytes give bits; beyond their end there are zeros. Takes no memory.
#[derive(Clone, Debug)]
pub struct Decoder<'a> {
    bytes: &'a [u8],
    /// Number of bytes of the stream in use, including those beyond its end.
    at: usize,
    /// The last eight bytes in use.
    window: u64,
    /// Distance of the stream from the lower end of the interval.
    code: u64,
    range: u64,
}

impl<'a> Decoder<'a> {
    /// A decoder at the start of a stream.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bytes, at: 0, window: 0, code: 0, range: u64::MAX };
        decoder.pull();
        decoder.pull();
        decoder
    }

    #[inline(always)]
    fn pull(&mut self) {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let word = match rest.first_chunk::<4>() {
            Some(word) => u32::from_be_bytes(*word),
            None => {
                let mut word = [0; 4];
                word[..rest.len()].copy_from_slice(rest);
                u32::from_be_bytes(word)
            }
        };
        self.at = self.at.saturating_add(4);
        self.window = self.window << 32 | u64::from(word);
        self.code = self.code << 32 | u64::from(word);
    }

    #[inline(always)]
    fn widen(&mut self) {
        if self.range < NARROW {
            self.range <<= 32;
            self.pull();
        }
    }

    /// Returns whether the stream ends here and equals the encoder's output for the bits that were read.
    pub fn finish(mut self) -> bool {
        if MARK.iter().any(|half| self.direct(16, 0) != *half) {
            return false;
        }
        let low = self.window.wrapping_sub(self.code);
        self.code == roundest(low, self.range) && self.bytes.len() <= self.at && self.bytes.last() != Some(&0)
    }
}

impl Coder for Decoder<'_> {
    #[inline(always)]
    fn bit(&mut self, model: &mut Bit, _: bool) -> bool {
        let bound = (self.range >> 16) * model.zero();
        let bit = self.code >= bound;
        if bit {
            self.code -= bound;
            self.range -= bound;
        } else {
            self.range = bound;
        }
        model.update(bit);
        self.widen();
        bit
    }

    #[inline(always)]
    fn direct(&mut self, count: u32, _: u32) -> u32 {
        let count = count.min(16);
        self.range >>= count;
        // A damaged stream may lie beyond the interval.
        let value = (self.code / self.range).min((1 << count) - 1);
        self.code -= value * self.range;
        self.widen();
        value as u32
    }
}

/// Largest number of bits of a magnitude.
pub const MAGNITUDE_BITS: usize = 16;

/// Number of learned bits of a magnitude, the highest below its leading one.
const LEARNED_BITS: u32 = 3;

/// Models of lengths: bit `k` tells whether a magnitude of at least `k` bits has more than `k`.
pub type Lengths = [Bit; MAGNITUDE_BITS];

/// Models of the learned bits below the leading one, by length less 1 and by the bits above (with a leading 1).
pub type Mantissas = [[Bit; 1 << LEARNED_BITS]; MAGNITUDE_BITS];

/// Prior knowledge about a magnitude.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Known {
    /// Nothing.
    Nothing,
    /// The magnitude is not 0.
    NotZero,
}

/// Codes a magnitude of at most [`MAGNITUDE_BITS`] bits in Elias' gamma manner: length, then bits from the top.
#[inline(always)]
pub fn magnitude<C: Coder>(
    coder: &mut C,
    known: Known,
    lengths: &mut Lengths,
    mantissas: &mut Mantissas,
    value: u32,
) -> u32 {
    let length = (u32::BITS - value.leading_zeros()) as usize;
    let mut read = usize::from(known == Known::NotZero);
    while read < MAGNITUDE_BITS && coder.bit(&mut lengths[read], length > read) {
        read += 1;
    }
    if read < 2 {
        return read as u32;
    }
    let below = read as u32 - 1;
    let learned = below.min(LEARNED_BITS);
    let (mut top, mut shift) = (1, below);
    for _ in 0..learned {
        shift -= 1;
        let bit = coder.bit(&mut mantissas[read - 1][top], value >> shift & 1 == 1);
        top = top << 1 | usize::from(bit);
    }
    let low = if shift == 0 { 0 } else { coder.direct(shift, value) };
    (top as u32) << shift | low
}

/// Models of signed integers of similar size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signed {
    lengths: Lengths,
    mantissas: Mantissas,
    sign: Bit,
}

impl Signed {
    /// Models that have seen nothing.
    pub const NEW: Self = Self {
        lengths: [Bit::NEW; MAGNITUDE_BITS],
        mantissas: [[Bit::NEW; 1 << LEARNED_BITS]; MAGNITUDE_BITS],
        sign: Bit::NEW,
    };

    /// Codes a number of -65535 to 65535; others are clamped to that range.
    pub fn code<C: Coder>(&mut self, coder: &mut C, value: i32) -> i32 {
        let size = magnitude(
            coder,
            Known::Nothing,
            &mut self.lengths,
            &mut self.mantissas,
            value.unsigned_abs().min((1 << MAGNITUDE_BITS) - 1),
        ) as i32;
        if size > 0 && coder.bit(&mut self.sign, value < 0) { -size } else { size }
    }
}

impl Default for Signed {
    fn default() -> Self {
        Self::NEW
    }
}
