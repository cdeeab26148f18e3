//! One source text compiled for several instruction sets, chosen at run time.
//!
//! Every lane of a kernel computes one receiver and lanes never mix, no multiplication is fused with an addition, and
//! division and square root are the exact IEEE operations: all levels give the same bits.

use std::str::FromStr;
use std::sync::OnceLock;

use crate::error::{Error, Result};

/// Instruction sets that the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum InstructionSet {
    /// Instructions that the target guarantees (SSE2 on x86-64, NEON on AArch64).
    Baseline,
    /// AVX2, 8 lanes of f32.
    Avx2,
    /// AVX-512 F/VL/BW/DQ, 16 lanes of f32.
    Avx512,
}

static LIMIT: OnceLock<InstructionSet> = OnceLock::new();

impl InstructionSet {
    /// The widest level that this processor runs, within [`InstructionSet::limit`].
    pub fn detect() -> Self {
        let widest = *Self::available().last().unwrap_or(&Self::Baseline);
        LIMIT.get().map_or(widest, |limit| widest.min(*limit))
    }

    /// Lets kernels use no wider level than this for as long as the program runs; results are the same. Only the first limit
    /// counts.
    pub fn limit(self) {
        LIMIT.get_or_init(|| self);
    }

    /// Every level that this processor runs, narrowest first.
    pub fn available() -> Vec<Self> {
        #[cfg_attr(not(target_arch = "x86_64"), allow(unused_mut))]
        let mut levels = vec![Self::Baseline];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") {
                levels.push(Self::Avx2);
            }
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
            {
                levels.push(Self::Avx512);
            }
        }
        levels
    }
}

/// `sums += factor values`. One call for each row of a product keeps the sums in registers, where compilers spill those
/// of a loop over all rows.
#[inline(always)]
pub(crate) fn add_scaled<const N: usize>(sums: &mut [f32; N], factor: f32, values: &[f32; N]) {
    for i in 0..N {
        sums[i] += factor * values[i];
    }
}

impl FromStr for InstructionSet {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "baseline" => Ok(Self::Baseline),
            "avx2" => Ok(Self::Avx2),
            "avx512" => Ok(Self::Avx512),
            _ => Err(Error::command_line(format!("instructions `{text}`: baseline, avx2 or avx512 is needed"))),
        }
    }
}

/// Prefetches a value that will be read soon, where caches do not foresee it; an index beyond the end does nothing.
#[inline(always)]
pub(crate) fn prefetch<T>(values: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: a hint reads nothing and faults at no address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(values.as_ptr().wrapping_add(index).cast()) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, index);
}

/// Compiles each `$body` (an `#[inline(always)]` function) for every level and defines `$name` that calls one of them; with `up to` a
/// level, none that is wider.
#[macro_export]
macro_rules! multiversion {
    ($($(#[$meta:meta])* $vis:vis fn $name:ident ( $($arg:ident : $ty:ty),* $(,)? ) => $body:path $(, up to $widest:expr)?);+ $(;)?) => {$(
        $(#[$meta])*
        $vis fn $name(level: $crate::math::simd::InstructionSet, $($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $ty),*) {
                    $body($($arg),*)
                }
                #[target_feature(enable = "avx2,avx512f,avx512vl,avx512bw,avx512dq")]
                fn avx512($($arg: $ty),*) {
                    $body($($arg),*)
                }
                match level $(.min($widest))? {
                    $crate::math::simd::InstructionSet::Baseline => $body($($arg),*),
                    // SAFETY: `InstructionSet::available` found these features on this processor.
                    $crate::math::simd::InstructionSet::Avx2 => unsafe { avx2($($arg),*) },
                    // SAFETY: as above.
                    $crate::math::simd::InstructionSet::Avx512 => unsafe { avx512($($arg),*) },
                }
            }
            #[cfg(not(target_arch = "x86_64"))]
            {
                let _ = level;
                $body($($arg),*)
            }
        }
    )+};
}

pub use multiversion;
