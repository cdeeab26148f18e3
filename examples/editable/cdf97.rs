//! The wavelet of Cohen, Daubechies and Feauveau with filters of 9 and 7 taps (that of JPEG 2000), in lifting steps (Daubechies
//! and Sweldens 1998), of lines and pictures of any size.
//!
//! Ends are continued by reflection in the last number. Both the details and the functions that they stand for are blind to polynomials up to
//! the third degree (four vanishing moments on either side). The transform is nearly orthonormal: a constant line of numbers 1 becomes
//! numbers of sqrt(2), and the squares of the coefficients add up to those of the line within some percent.

/// Predict, update, predict, update.
const STEPS: [f64; 4] = [-1.586_134_342_059_924, -0.052_980_118_572_961, 0.882_911_075_530_934, 0.443_506_852_043_971];

/// What the means are multiplied by, and the details divided.
const SCALE: f64 = 1.149_604_398_860_241;

/// Adds to each number at an odd or even place a share of its two neighbours.
fn lift(line: &mut [f64], first: usize, factor: f64) {
    let count = line.len();
    for i in (first..count).step_by(2) {
        let left = if i > 0 { i - 1 } else { 1 };
        let right = if i + 1 < count { i + 1 } else { count - 2 };
        line[i] += factor * (line[left] + line[right]);
    }
}

/// One level of a line, in place: means first (one more of them where the length is odd), then details. `scratch` has as many numbers.
/// A line of one number, and one with another `scratch`, are left as they are.
fn forward(line: &mut [f64], scratch: &mut [f64]) {
    let count = line.len();
    if count < 2 || scratch.len() != count {
        return;
    }
    for (step, factor) in STEPS.into_iter().enumerate() {
        lift(line, (step + 1) % 2, factor);
    }
    let means = count.div_ceil(2);
    for (i, value) in line.iter().enumerate() {
        scratch[if i % 2 == 0 { i / 2 } else { means + i / 2 }] =
            if i % 2 == 0 { value * SCALE } else { value / SCALE };
    }
    line.copy_from_slice(scratch);
}

/// Undoes [`forward`].
fn inverse(line: &mut [f64], scratch: &mut [f64]) {
    let count = line.len();
    if count < 2 || scratch.len() != count {
        return;
    }
    let means = count.div_ceil(2);
    for (i, value) in scratch.iter_mut().enumerate() {
        *value = if i % 2 == 0 { line[i / 2] / SCALE } else { line[means + i / 2] * SCALE };
    }
    line.copy_from_slice(scratch);
    for (step, factor) in STEPS.into_iter().enumerate().rev() {
        lift(line, (step + 1) % 2, -factor);
    }
}

/// Pictures of one size, row by row, transformed by levels: lines, columns, then the upper left quarter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Pictures {
    width: usize,
    height: usize,
    levels: u32,
}

impl Pictures {
    /// Of a width and height; at most so many levels.
    pub(crate) fn new(width: usize, height: usize, levels: u32) -> Self {
        Self { width, height, levels }
    }

    /// Numbers of a picture.
    fn len(&self) -> usize {
        self.width * self.height
    }

    /// Width and height that each level begins with.
    fn sizes(&self) -> Vec<[usize; 2]> {
        let mut size = [self.width, self.height];
        let mut sizes = Vec::new();
        while sizes.len() < self.levels as usize && size.iter().any(|side| *side > 1) {
            sizes.push(size);
            size = size.map(|side| side.div_ceil(2));
        }
        sizes
    }

    /// Transforms a picture in place; one of another size is left as it is.
    pub(crate) fn forward(&self, picture: &mut [f64]) {
        if picture.len() == self.len() {
            for size in self.sizes() {
                self.rows(picture, size, forward);
                self.columns(picture, size, forward);
            }
        }
    }

    /// Undoes [`Self::forward`].
    pub(crate) fn inverse(&self, picture: &mut [f64]) {
        if picture.len() == self.len() {
            for size in self.sizes().into_iter().rev() {
                self.columns(picture, size, inverse);
                self.rows(picture, size, inverse);
            }
        }
    }

    fn rows(&self, picture: &mut [f64], [width, height]: [usize; 2], transform: fn(&mut [f64], &mut [f64])) {
        let mut scratch = vec![0.0; width];
        for row in picture.chunks_exact_mut(self.width.max(1)).take(height) {
            transform(&mut row[..width], &mut scratch);
        }
    }

    fn columns(&self, picture: &mut [f64], [width, height]: [usize; 2], transform: fn(&mut [f64], &mut [f64])) {
        let (mut column, mut scratch) = (vec![0.0; height], vec![0.0; height]);
        for x in 0..width {
            (0..height).for_each(|y| column[y] = picture[y * self.width + x]);
            transform(&mut column, &mut scratch);
            (0..height).for_each(|y| picture[y * self.width + x] = column[y]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use translux::math::random::uniform;

    fn noise(count: usize) -> Vec<f64> {
        (0..count).map(|i| uniform(11, i as u64, 0) - 0.5).collect()
    }

    fn squares(values: &[f64]) -> f64 {
        values.iter().map(|v| v * v).sum()
    }

    /// What one detail of a line stands for.
    fn wavelet(count: usize, detail: usize) -> Vec<f64> {
        let mut line = vec![0.0; count];
        line[count.div_ceil(2) + detail] = 1.0;
        inverse(&mut line, &mut vec![0.0; count]);
        line
    }

    #[test]
    fn lines_of_any_length_come_back() {
        for count in 0..40 {
            let before = noise(count);
            let mut line = before.clone();
            forward(&mut line, &mut vec![0.0; count]);
            assert!(count < 2 || line != before);
            inverse(&mut line, &mut vec![0.0; count]);
            assert!(line.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-14), "{count}");
        }
        let mut line = noise(4);
        forward(&mut line, &mut [0.0; 3]);
        assert_eq!(line, noise(4));
    }

    #[test]
    fn pictures_of_any_size_come_back() {
        for (width, height) in [(1, 1), (1, 9), (8, 8), (13, 5), (64, 64), (31, 1), (0, 4)] {
            for levels in [0, 1, 3, 20] {
                let pictures = Pictures::new(width, height, levels);
                let before = noise(pictures.len());
                let mut picture = before.clone();
                pictures.forward(&mut picture);
                pictures.inverse(&mut picture);
                assert!(picture.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-13), "{width} {height} {levels}");
            }
        }
        assert_eq!(Pictures::new(0, 4, 1).len(), 0);
    }

    /// Four vanishing moments of the analysis: no polynomial of the third degree has details away from the ends.
    #[test]
    fn details_do_not_see_cubic_polynomials() {
        for power in 0..=4 {
            let mut line: Vec<f64> = (0..64).map(|i| (f64::from(i) / 64.0 - 0.4).powi(power)).collect();
            forward(&mut line, &mut [0.0; 64]);
            let worst = line[32 + 4..64 - 4].iter().fold(0.0f64, |m, v| m.max(v.abs()));
            assert_eq!(worst < 1e-12, power < 4, "{power}: {worst}");
        }
    }

    /// Four of the synthesis: what is dropped of the details changes no moment up to the third.
    #[test]
    fn wavelets_have_no_moments_up_to_the_third() {
        let wavelet = wavelet(64, 15);
        for power in 0..=4 {
            let moment: f64 = wavelet.iter().zip(0..).map(|(w, i)| w * (f64::from(i) / 64.0 - 0.5).powi(power)).sum();
            assert_eq!(moment.abs() < 1e-13, power < 4, "{power}: {moment}");
        }
    }

    #[test]
    fn constants_grow_by_the_root_of_two() {
        let mut line = [1.0; 10];
        forward(&mut line, &mut [0.0; 10]);
        assert!(line[..5].iter().all(|v| (v - 2f64.sqrt()).abs() < 1e-12), "{line:?}");
        assert!(line[5..].iter().all(|v| v.abs() < 1e-12));
    }

    /// Nearly orthonormal: norms and energies to a tenth.
    #[test]
    fn energies_are_nearly_kept() {
        let norm = squares(&wavelet(64, 15)).sqrt();
        println!("norm of a wavelet {norm:.4}");
        assert!((0.9..1.1).contains(&norm), "{norm}");
        let mut line = noise(4096);
        let before = squares(&line);
        forward(&mut line, &mut vec![0.0; 4096]);
        let ratio = squares(&line) / before;
        println!("energy of noise {ratio:.4}");
        assert!((0.9..1.1).contains(&ratio), "{ratio}");
        let pictures = Pictures::new(64, 64, 5);
        let mut picture = noise(4096);
        pictures.forward(&mut picture);
        let ratio = squares(&picture) / before;
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
    }
}
