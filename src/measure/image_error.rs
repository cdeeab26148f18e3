//! The image error: linear RGB, the reference's highlights scaled to 1, clamped, RMS over covered pixels and channels.

/// Figures of one pair of pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ImageError {
    /// RMS over the pixels that either picture covers and the three channels.
    pub rms: f64,
    /// The same over all pixels (the papers' figure, smaller by the share of background).
    pub rms_with_background: f64,
    /// 99.9th percentile of the largest channel's absolute difference over covered pixels.
    pub p999: f64,
    /// Largest absolute difference.
    pub worst: f64,
    /// Factor that both pictures were scaled by.
    pub scale: f64,
    /// Pixels that either picture covers.
    pub covered: usize,
}

/// The factor that brings the 99.5th percentile of max(R, G, B) over covered pixels to 1; 1 for a black picture.
pub fn exposure(rgb: &[[f32; 3]], covered: &[bool]) -> f64 {
    let mut brightest: Vec<f32> = rgb
        .iter()
        .zip(covered)
        .filter(|(pixel, covered)| **covered && pixel.iter().all(|v| v.is_finite()))
        .map(|(pixel, _)| pixel[0].max(pixel[1]).max(pixel[2]))
        .collect();
    if brightest.is_empty() {
        return 1.0;
    }
    let rank = ((brightest.len() as f64 * 0.995).ceil() as usize).clamp(1, brightest.len()) - 1;
    let (_, value, _) = brightest.select_nth_unstable_by(rank, f32::total_cmp);
    if *value > 0.0 { 1.0 / f64::from(*value) } else { 1.0 }
}

/// Compares two pictures of one size; a pixel counts as covered if it is in either.
pub fn image_error(picture: &[[f32; 3]], reference: &[[f32; 3]], covered: &[bool]) -> ImageError {
    let scale = exposure(reference, covered);
    let clamp = |v: f32| {
        let scaled = f64::from(v) * scale;
        if scaled.is_nan() { 0.0 } else { scaled.clamp(0.0, 1.0) }
    };
    let (mut inside, mut outside, mut largest, mut count) = (0.0, 0.0, Vec::new(), 0);
    for ((a, b), &covered) in picture.iter().zip(reference).zip(covered) {
        let differences = [0, 1, 2].map(|c| (clamp(a[c]) - clamp(b[c])).abs());
        let sum: f64 = differences.iter().map(|d| d * d).sum();
        if covered {
            inside += sum;
            count += 1;
            largest.push(differences.into_iter().fold(0.0, f64::max));
        } else {
            outside += sum;
        }
    }
    largest.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| {
        let rank = ((largest.len() as f64 * share).ceil() as usize).clamp(1, largest.len().max(1)) - 1;
        largest.get(rank).copied().unwrap_or(0.0)
    };
    ImageError {
        rms: (inside / (3 * count).max(1) as f64).sqrt(),
        rms_with_background: ((inside + outside) / (3 * picture.len()).max(1) as f64).sqrt(),
        p999: at(0.999),
        worst: at(1.0),
        scale,
        covered: count,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_sets_the_scale_and_the_mask_the_pixels() {
        let reference = [[2.0; 3], [1.0; 3], [0.0; 3], [9.0; 3]];
        let picture = [[2.0; 3], [0.5; 3], [0.0; 3], [0.0; 3]];
        let covered = [true, true, true, false];
        let e = image_error(&picture, &reference, &covered);
        assert_eq!((e.scale, e.covered), (0.5, 3));
        assert!((e.rms - (0.25f64 * 0.25 / 3.0).sqrt()).abs() < 1e-12, "{e:?}");
        assert!((e.rms_with_background - ((0.25f64 * 0.25 + 1.0) / 4.0).sqrt()).abs() < 1e-12, "{e:?}");
        assert!((e.worst - 0.25).abs() < 1e-12);
    }

    #[test]
    fn black_and_empty_pictures_are_safe() {
        let black = [[0.0; 3]; 4];
        assert_eq!(image_error(&black, &black, &[true; 4]).rms, 0.0);
        assert_eq!(image_error(&[], &[], &[]).rms, 0.0);
        assert_eq!(image_error(&black, &black, &[false; 4]).covered, 0);
    }
}
