//! What rounds on a machine: with the same of it, the same input gives the same bits.

use serde::{Deserialize, Serialize};

/// Elementary functions of the system, and the vector instructions that libraries choose by.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Name of the instruction set.
    pub architecture: String,
    /// Whether there is AVX-512.
    pub avx512: bool,
    /// Whether there are fused multiplications and additions.
    pub fma: bool,
    /// Hash of the bits of elementary functions at some places.
    pub functions: String,
}

impl Machine {
    /// This machine.
    pub fn this() -> Self {
        let functions = [f64::sin, f64::cos, f64::exp, f64::ln, f64::sqrt, f64::cbrt, f64::atan, f64::acos, f64::tanh];
        let values = (1..500u32).map(|i| f64::from(i) * 0.0019);
        let bits = values.flat_map(|x| functions.map(|f| f(x)).into_iter().chain([x.powf(1.7 + x), x.atan2(1.3 - x)]));
        let hash = bits.fold(0xcbf2_9ce4_8422_2325_u64, |hash, x| (hash ^ x.to_bits()).wrapping_mul(0x0100_0000_01b3));
        #[cfg(target_arch = "x86_64")]
        let (fma, avx512) = (is_x86_feature_detected!("fma"), is_x86_feature_detected!("avx512f"));
        #[cfg(not(target_arch = "x86_64"))]
        let (fma, avx512) = (false, false);
        Self { architecture: std::env::consts::ARCH.to_owned(), avx512, fma, functions: format!("{hash:016x}") }
    }
}
