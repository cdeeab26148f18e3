//! The image error: linear RGB, the reference's highlights scaled to 1, clamped, RMS over covered pixels and channels.

/// Errors of one pair of pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ImageError {
    /// RMS over the covered pixels and the three channels.
    pub rms: f64,
    /// The same over all pixels (the papers' figure, smaller by the share of background).
    pub rms_with_background: f64,
    /// 99.9th percentile of the largest channel's absolute difference over covered pixels.
    pub p999: f64,
    /// Largest absolute difference over covered pixels.
    pub worst: f64,
    /// Factor that both pictures were scaled by.
    pub scale: f64,
    /// Covered pixels.
    pub covered: usize,
}

/// The factor that brings the 99.5th percentile (nearest rank) of max(R, G, B) over covered pixels to 1.
///
/// Pixels that are not finite are left out. Where fewer than one in 200 is lit, the brightest becomes 1; the factor of
/// a black picture is 1.
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
    let rank = nearest_rank(brightest.len(), 0.995);
    let (_, percentile, above) = brightest.select_nth_unstable_by(rank, f32::total_cmp);
    let percentile = *percentile;
    let white = if percentile > 0.0 { percentile } else { above.iter().copied().fold(percentile, f32::max) };
    if white > 0.0 { 1.0 / f64::from(white) } else { 1.0 }
}

/// Index of a percentile among `count` ascending values.
fn nearest_rank(count: usize, share: f64) -> usize {
    ((count as f64 * share).ceil() as usize).clamp(1, count.max(1)) - 1
}

/// Compares two pictures pixel by pixel. The mask says which pixels are covered, usually those that either shows.
///
/// A NaN in either picture counts as the largest difference there is.
pub fn image_error(picture: &[[f32; 3]], reference: &[[f32; 3]], covered: &[bool]) -> ImageError {
    let scale = exposure(reference, covered);
    let clamp = |v: f32| (f64::from(v) * scale).clamp(0.0, 1.0);
    let difference = |a: f32, b: f32| if a.is_nan() || b.is_nan() { 1.0 } else { (clamp(a) - clamp(b)).abs() };
    let (mut inside, mut outside, mut largest, mut pixels) = (0.0, 0.0, Vec::new(), 0usize);
    for ((a, b), &covered) in picture.iter().zip(reference).zip(covered) {
        let differences = [0, 1, 2].map(|c| difference(a[c], b[c]));
        let sum: f64 = differences.iter().map(|d| d * d).sum();
        pixels += 1;
        if covered {
            inside += sum;
            largest.push(differences.into_iter().fold(0.0, f64::max));
        } else {
            outside += sum;
        }
    }
    largest.sort_unstable_by(f64::total_cmp);
    let at = |share| largest.get(nearest_rank(largest.len(), share)).copied().unwrap_or(0.0);
    let root_mean = |sum: f64, pixels: usize| (sum / (3 * pixels).max(1) as f64).sqrt();
    ImageError {
        rms: root_mean(inside, largest.len()),
        rms_with_background: root_mean(inside + outside, pixels),
        p999: at(0.999),
        worst: at(1.0),
        scale,
        covered: largest.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_and_empty_pictures_are_safe() {
        let black = [[0.0; 3]; 4];
        assert_eq!(image_error(&black, &black, &[true; 4]).rms, 0.0);
        assert_eq!(image_error(&[], &[], &[]).rms, 0.0);
        assert_eq!(image_error(&black, &black, &[false; 4]).covered, 0);
    }

    #[test]
    fn one_channel_of_one_pixel_weighs_a_third_of_a_pixel() {
        let reference = [[1.0; 3]; 5];
        for channel in 0..3 {
            let mut picture = reference;
            picture[2][channel] = 0.4;
            let e = image_error(&picture, &reference, &[true; 5]);
            assert!((e.rms - (0.36f64 / 15.0).sqrt()).abs() < 1e-7, "{e:?}");
            assert_eq!((e.rms, e.scale), (e.rms_with_background, 1.0));
            assert!((e.worst - 0.6).abs() < 1e-7 && e.worst == e.p999);
        }
    }

    /// 1 to 1000 in the blue channel, in an order that is not sorted.
    fn ramp() -> Vec<[f32; 3]> {
        (0..1000).map(|i| [0.5, 0.25, ((i * 7) % 1000 + 1) as f32]).collect()
    }

    #[test]
    fn the_exposure_is_the_995th_of_a_thousand() {
        let ramp = ramp();
        assert_eq!(exposure(&ramp, &[true; 1000]), 1.0 / 995.0);
        // The brighter half covered: 501 to 1000, of which rank 498 is 998.
        let covered: Vec<bool> = ramp.iter().map(|p| p[2] > 500.0).collect();
        assert_eq!(exposure(&ramp, &covered), 1.0 / 998.0);
        for (value, scale) in [(4.0, 0.25), (0.0, 1.0), (-3.0, 1.0), (1e-40, 1.0 / f64::from(1e-40f32))] {
            assert_eq!(exposure(&[[value; 3]], &[true]), scale);
        }
        assert_eq!(exposure(&[[f32::INFINITY; 3], [2.0; 3], [f32::NAN; 3]], &[true; 3]), 0.5);
    }

    #[test]
    fn a_few_lit_pixels_still_set_the_exposure() {
        let mut sparse = vec![[0.0; 3]; 1000];
        sparse[3] = [0.0, 8.0, 1.0];
        sparse[900] = [2.0, 0.0, 0.0];
        assert_eq!(exposure(&sparse, &[true; 1000]), 0.125);
    }

    #[test]
    fn what_is_brighter_than_the_highlights_is_white_and_what_is_negative_black() {
        let ramp = ramp();
        let brighter = |p: &[f32; 3], by: f32| [p[0], p[1], p[2] * by];
        // The five brightest are clamped in both; 5 % more pushes 948 and up beyond white, too.
        let picture: Vec<[f32; 3]> = ramp.iter().map(|p| brighter(p, 1.05)).collect();
        let e = image_error(&picture, &ramp, &[true; 1000]);
        let blue = |v: f64| ((v * 1.05 / 995.0).min(1.0) - (v / 995.0).min(1.0)).abs();
        let expected: f64 = (1..=1000).map(|v| blue(f64::from(v)).powi(2)).sum();
        assert!((e.rms - (expected / 3000.0).sqrt()).abs() < 1e-7, "{e:?}");
        // The largest is that of 947, where 1.05 times is just below white; the second largest is rank 999.
        let mut all: Vec<f64> = (1..=1000).map(|v| blue(f64::from(v))).collect();
        all.sort_unstable_by(f64::total_cmp);
        assert!((e.worst - all[999]).abs() < 1e-6 && (e.p999 - all[998]).abs() < 1e-6, "{e:?}");
        let negative = image_error(&[[-5.0; 3], [1.0; 3]], &[[0.0; 3], [1.0; 3]], &[true; 2]);
        assert_eq!(negative.rms, 0.0);
    }

    #[test]
    fn the_mask_takes_pixels_out_of_all_figures_but_the_one_with_background() {
        let reference = [[1.0; 3], [1.0; 3], [100.0; 3], [0.0; 3]];
        let picture = [[0.5; 3], [1.0; 3], [0.0; 3], [0.0; 3]];
        let inside = image_error(&picture, &reference, &[true, true, false, false]);
        assert_eq!((inside.scale, inside.covered, inside.worst, inside.p999), (1.0, 2, 0.5, 0.5));
        assert!((inside.rms - 0.125f64.sqrt()).abs() < 1e-12);
        assert!((inside.rms_with_background - (1.25f64 / 4.0).sqrt()).abs() < 1e-12);
        // An empty background only dilutes.
        let all = image_error(&picture[..2], &reference[..2], &[true; 2]);
        assert_eq!((all.rms, all.rms_with_background), (inside.rms, inside.rms));
    }

    #[test]
    fn the_unit_of_light_does_not_matter() {
        let reference = [[3.0, 1.0, 2.0], [0.5, 0.1, 0.0], [1.0, 1.5, 2.5]];
        let picture = [[2.5, 1.5, 2.0], [0.25, 0.5, 0.0], [1.0, 1.0, 2.0]];
        let times = |rgb: [[f32; 3]; 3], by: f32| rgb.map(|p| p.map(|v| v * by));
        let one = image_error(&picture, &reference, &[true; 3]);
        let other = image_error(&times(picture, 64.0), &times(reference, 64.0), &[true; 3]);
        assert_eq!((one.rms, one.p999, one.worst, one.scale), (other.rms, other.p999, other.worst, other.scale * 64.0));
    }

    #[test]
    fn what_is_no_number_is_as_wrong_as_can_be() {
        let nan = [[f32::NAN, 0.0, 0.0], [1.0; 3]];
        let fine = [[0.0; 3], [1.0; 3]];
        for (picture, reference) in [(nan, fine), (fine, nan), (nan, nan)] {
            let e = image_error(&picture, &reference, &[true; 2]);
            assert!((e.rms - (1.0f64 / 6.0).sqrt()).abs() < 1e-12 && e.worst == 1.0, "{e:?}");
        }
        let infinite = image_error(&[[f32::INFINITY; 3], [1.0; 3]], &[[1.0; 3]; 2], &[true; 2]);
        assert_eq!(infinite.rms, 0.0);
    }
}
