//! Eight numbers at a time, on the instructions that the CPU has.
//!
//! Nothing here changes an answer: additions, products and comparisons of `f32` are the same on every path, and
//! [`Lanes::mul_sub`], which may or may not round in between, serves boxes only, whose growth covers both.

use std::mem::MaybeUninit;

use super::build::{Children, WIDTH};

/// An entry of a stack of references; clearing stacks for every ray would cost as much as a node.
pub(super) type Slot = MaybeUninit<u32>;

/// Instruction set of the traversal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Path {
    /// Arrays, as the compiler vectorises them.
    Portable,
    /// AVX2 and FMA, and the bit instructions that come with them.
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Path {
    /// The best path of this CPU.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::is_x86_feature_detected as has;
            let vectors = has!("avx2") && has!("fma");
            if vectors && has!("bmi1") && has!("bmi2") && has!("lzcnt") && has!("popcnt") {
                return Self::Avx2;
            }
        }
        Self::Portable
    }
}

/// Defines a function that runs another on the lanes of a path.
macro_rules! on_lanes {
    ($(#[$meta:meta])* $vis:vis fn $name:ident $(<$visit:ident>)? ($($arg:ident: $type:ty),*) -> $out:ty => $body:ident) => {
        $(#[$meta])*
        $vis fn $name $(<$visit: Visit>)? (path: Path, $($arg: $type),*) -> $out {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
            fn avx2 $(<$visit: Visit>)? ($($arg: $type),*) -> $out {
                $body::<super::lanes::Avx2 $(, $visit)?>($($arg),*)
            }
            match path {
                Path::Portable => $body::<Portable $(, $visit)?>($($arg),*),
                #[cfg(target_arch = "x86_64")]
                // SAFETY: `Path::detect` returns this path only on a CPU that has these features.
                Path::Avx2 => unsafe { avx2($($arg),*) },
            }
        }
    };
}
pub(super) use on_lanes;

/// Eight `f32` in a register or in several.
pub(super) trait Lanes {
    /// The registers.
    type V: Copy;

    fn load(from: &[f32; WIDTH]) -> Self::V;
    fn to_array(v: Self::V) -> [f32; WIDTH];
    fn splat(x: f32) -> Self::V;
    fn sub(a: Self::V, b: Self::V) -> Self::V;
    fn mul(a: Self::V, b: Self::V) -> Self::V;
    /// `a * b - c`, rounded once or twice.
    fn mul_sub(a: Self::V, b: Self::V, c: Self::V) -> Self::V;
    /// The smaller; `b` where either is no number.
    fn min(a: Self::V, b: Self::V) -> Self::V;
    /// The larger; `b` where either is no number.
    fn max(a: Self::V, b: Self::V) -> Self::V;
    /// Bit `i` set where `a <= b` in lane `i`.
    fn less_equal(a: Self::V, b: Self::V) -> u32;
    /// Bit `i` set where `least < 0` and `most > 0` in lane `i`.
    fn opposite_signs(least: Self::V, most: Self::V) -> u32;
    /// Appends the children whose bit is set to a stack of `len` entries that has room for 8 more; the new length.
    fn push(stack: &mut [Slot], len: usize, children: &Children, mask: u32) -> usize;
}

/// Arrays.
pub(super) struct Portable;

impl Lanes for Portable {
    type V = [f32; WIDTH];

    #[inline(always)]
    fn load(from: &[f32; WIDTH]) -> Self::V {
        *from
    }
    #[inline(always)]
    fn to_array(v: Self::V) -> [f32; WIDTH] {
        v
    }
    #[inline(always)]
    fn splat(x: f32) -> Self::V {
        [x; WIDTH]
    }
    #[inline(always)]
    fn sub(a: Self::V, b: Self::V) -> Self::V {
        std::array::from_fn(|i| a[i] - b[i])
    }
    #[inline(always)]
    fn mul(a: Self::V, b: Self::V) -> Self::V {
        std::array::from_fn(|i| a[i] * b[i])
    }
    #[inline(always)]
    fn mul_sub(a: Self::V, b: Self::V, c: Self::V) -> Self::V {
        std::array::from_fn(|i| a[i] * b[i] - c[i])
    }
    #[inline(always)]
    fn min(a: Self::V, b: Self::V) -> Self::V {
        std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn max(a: Self::V, b: Self::V) -> Self::V {
        std::array::from_fn(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(always)]
    fn less_equal(a: Self::V, b: Self::V) -> u32 {
        (0..WIDTH).fold(0, |mask, i| mask | (u32::from(a[i] <= b[i]) << i))
    }
    #[inline(always)]
    fn opposite_signs(least: Self::V, most: Self::V) -> u32 {
        (0..WIDTH).fold(0, |mask, i| mask | (u32::from(least[i] < 0.0 && most[i] > 0.0) << i))
    }
    #[inline(always)]
    fn push(stack: &mut [Slot], mut len: usize, children: &Children, mut mask: u32) -> usize {
        while mask != 0 {
            stack[len].write(children.0[mask.trailing_zeros() as usize % WIDTH]);
            len += 1;
            mask &= mask - 1;
        }
        len
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use self::avx2::Avx2;

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    use super::super::build::{Children, WIDTH};
    use super::{Lanes, Slot};

    /// AVX2 and FMA. Every caller is compiled for both and entered only after [`super::Path::detect`] found them,
    /// which is what the `unsafe` blocks below rely on.
    pub(crate) struct Avx2;

    /// For each mask the positions of its set bits, ascending.
    static COMPACT: [[u8; 8]; 256] = {
        let mut table = [[0u8; 8]; 256];
        let mut mask = 0;
        while mask < 256 {
            let (mut bit, mut n) = (0, 0);
            while bit < 8 {
                if mask >> bit & 1 == 1 {
                    table[mask][n] = bit as u8;
                    n += 1;
                }
                bit += 1;
            }
            mask += 1;
        }
        table
    };

    #[expect(clippy::undocumented_unsafe_blocks, reason = "what `Avx2` says above holds for each")]
    impl Lanes for Avx2 {
        type V = __m256;

        #[inline(always)]
        fn load(from: &[f32; WIDTH]) -> Self::V {
            unsafe { _mm256_loadu_ps(from.as_ptr()) }
        }
        #[inline(always)]
        fn to_array(v: Self::V) -> [f32; WIDTH] {
            let mut out = [0.0; WIDTH];
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), v) };
            out
        }
        #[inline(always)]
        fn splat(x: f32) -> Self::V {
            unsafe { _mm256_set1_ps(x) }
        }
        #[inline(always)]
        fn sub(a: Self::V, b: Self::V) -> Self::V {
            unsafe { _mm256_sub_ps(a, b) }
        }
        #[inline(always)]
        fn mul(a: Self::V, b: Self::V) -> Self::V {
            unsafe { _mm256_mul_ps(a, b) }
        }
        #[inline(always)]
        fn mul_sub(a: Self::V, b: Self::V, c: Self::V) -> Self::V {
            unsafe { _mm256_fmsub_ps(a, b, c) }
        }
        #[inline(always)]
        fn min(a: Self::V, b: Self::V) -> Self::V {
            unsafe { _mm256_min_ps(a, b) }
        }
        #[inline(always)]
        fn max(a: Self::V, b: Self::V) -> Self::V {
            unsafe { _mm256_max_ps(a, b) }
        }
        #[inline(always)]
        fn less_equal(a: Self::V, b: Self::V) -> u32 {
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32 }
        }
        #[inline(always)]
        fn opposite_signs(least: Self::V, most: Self::V) -> u32 {
            unsafe {
                let zero = _mm256_setzero_ps();
                let below = _mm256_cmp_ps::<_CMP_LT_OQ>(least, zero);
                let above = _mm256_cmp_ps::<_CMP_GT_OQ>(most, zero);
                _mm256_movemask_ps(_mm256_and_ps(below, above)) as u32
            }
        }
        #[inline(always)]
        fn push(stack: &mut [Slot], len: usize, children: &Children, mask: u32) -> usize {
            // One check for the whole store, which always writes eight entries.
            let Some(top) = stack.get_mut(len..len + WIDTH) else { return len };
            unsafe {
                let order = _mm_loadl_epi64(COMPACT[(mask & 255) as usize].as_ptr().cast());
                let all = _mm256_loadu_si256(children.0.as_ptr().cast());
                let packed = _mm256_permutevar8x32_epi32(all, _mm256_cvtepu8_epi32(order));
                _mm256_storeu_si256(top.as_mut_ptr().cast(), packed);
            }
            len + mask.count_ones() as usize
        }
    }
}
