//! Blocks of wavelet coefficients: one coefficient of one basis function for neighbouring receivers, kept or dropped
//! together and quantised with one step for each function.
//!
//! The significance of a coefficient is the error of dropping or rounding it: its size in a typical material times the
//! detail that a typical light has there, relative to the radiosity. All coefficients cost about the same bytes, so for
//! a given error one threshold on the significance serves all of them.

/// Number of neighbouring receivers in a block.
pub const LANES: usize = 16;

/// Quantisation step, in typical units, for which rounding adds an RMS of `error`. `gain2` is the sum over a receiver's
/// kept coefficients of the squared detail of the light, as a mean over receivers.
pub fn step(gain2: f64, error: f64) -> f64 {
    // Uniform rounding errors have a variance of step^2 / 12.
    if gain2 > 0.0 { error * (12.0 / gain2).sqrt() } else { error }
}

/// The step, raised where the largest value would not fit into 16 bits.
pub fn fitting_step(step: f64, largest: f64) -> f32 {
    let least = largest / f64::from(i16::MAX - 1);
    let step = step.max(least).max(f64::from(f32::MIN_POSITIVE));
    if step.is_finite() { (step as f32).min(f32::MAX) } else { f32::MAX }
}

/// The transform of a row over its lanes; lanes from `count` on repeat the last valid one, which costs nothing.
pub fn transformed(row: &[f32; LANES], count: usize) -> [f32; LANES] {
    let mut row = *row;
    let last = row[count.clamp(1, LANES) - 1];
    row[count.min(LANES)..].fill(last);
    translux_format::far_field::transform_lanes(row)
}

/// Nearest multiples of the step.
pub fn quantise(values: &[f32; LANES], step: f32) -> [i16; LANES] {
    // The cast saturates and takes NaN to 0.
    values.map(|v| (v / step).round() as i16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_errors_add_up_to_what_was_asked() {
        let values: Vec<f32> = (0..4096).map(|i| crate::math::random::uniform(9, i, 0) as f32 - 0.5).collect();
        // A hundred coefficients meet details of 0.3 each.
        let step = fitting_step(step(100.0 * 0.09, 1e-3), 0.5);
        let mut sum = 0.0;
        for run in values.chunks_exact(LANES) {
            let run: [f32; LANES] = std::array::from_fn(|i| run[i]);
            let rounded = quantise(&run, step).map(|q| f32::from(q) * step);
            sum += run.iter().zip(rounded).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        }
        let rms = (sum / 4096.0 * 100.0 * 0.09).sqrt();
        assert!((rms / 1e-3 - 1.0).abs() < 0.1, "{rms}");
    }

    #[test]
    fn no_value_overflows() {
        let step = fitting_step(1e-6, 5.0);
        assert!(quantise(&[5.0; LANES], step)[0] > 32000);
        assert!((f32::from(quantise(&[-5.0; LANES], step)[3]) * step + 5.0).abs() < 1e-3);
        assert_eq!(quantise(&[f32::NAN; LANES], step), [0; LANES]);
        assert!(fitting_step(0.0, 0.0) > 0.0);
    }
}
