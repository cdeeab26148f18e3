//! A few functions over the vertices whose sums are many columns of radiosity: their leading left singular vectors, weighted by area.

use crate::error::Result;
use crate::math::leading::leading_eigen;
use crate::parallel::*;

/// Functions over the vertices, and what each of them has of every column.
pub(super) struct LeadingFunctions {
    /// Values at the vertices, at most 1.
    pub(super) functions: Vec<Vec<f64>>,
    /// For each function its factor in each column: a column is nearly the sum of factors times functions.
    pub(super) factors: Vec<Vec<f64>>,
}

/// Sum of products of two columns, weighted by area.
pub(super) fn product(a: &[f32], b: &[f32], areas: &[f64]) -> f64 {
    let pairs = a.iter().zip(b).zip(areas);
    pairs.map(|((a, b), area)| f64::from(*a) * f64::from(*b) * area).sum()
}

impl LeadingFunctions {
    /// The fewest functions, at most `most`, that leave out no more than this part of the squares of the scaled columns.
    ///
    /// # Errors
    /// As [`leading_eigen`].
    pub(super) fn new(
        columns: &[Vec<f32>],
        scales: &[f64],
        areas: &[f64],
        (most, left_out): (usize, f64),
    ) -> Result<Self> {
        let count = columns.len();
        let mut gram = vec![0.0; count * count];
        gram.par_chunks_mut(count.max(1)).enumerate().for_each(|(i, row)| {
            let others = columns[..=i].iter().zip(scales);
            row.iter_mut()
                .zip(others)
                .for_each(|(out, (other, scale))| *out = product(&columns[i], other, areas) * scale * scales[i]);
        });
        let trace: f64 = (0..count).map(|i| gram[i * count + i]).sum();
        let vectors = leading_eigen(&gram, count, most, left_out * trace)?.pairs.vectors;
        let function = |vector: &Vec<f64>| -> (Vec<f64>, Vec<f64>) {
            let mut sums = vec![0.0_f64; areas.len()];
            for ((column, share), scale) in columns.iter().zip(vector).zip(scales) {
                let factor = share * scale;
                sums.iter_mut().zip(column).for_each(|(sum, value)| *sum += factor * f64::from(*value));
            }
            let most = sums.iter().fold(0.0_f64, |most, sum| most.max(sum.abs())).max(f64::MIN_POSITIVE);
            sums.iter_mut().for_each(|sum| *sum /= most);
            // A column without a scale is black, and has nothing of any function.
            let factor = |(share, scale): (&f64, &f64)| if *scale > 0.0 { share * most / scale } else { 0.0 };
            (sums, vector.iter().zip(scales).map(factor).collect())
        };
        let both: Vec<(Vec<f64>, Vec<f64>)> = vectors.par_iter().map(function).collect();
        let (functions, factors) = both.into_iter().unzip();
        Ok(Self { functions, factors })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Columns of two functions, one of which is black, as a channel without scattering is.
    #[test]
    fn few_functions_give_every_column_back_and_black_ones_have_none_of_them() {
        let areas: Vec<f64> = (0..40).map(|v| 1.0 + f64::from(v % 3)).collect();
        let of = |a: f64, b: f64| -> Vec<f32> {
            (0..40).map(|v| (a * (0.1 * f64::from(v)).sin() + b * f64::from(v * v) * 1e-3) as f32).collect()
        };
        let columns = [of(1.0, 0.0), of(3.0, -2.0), of(0.0, 0.0), of(0.2, 5.0)];
        let norm = |column: &Vec<f32>| product(column, column, &areas).sqrt();
        let scales: Vec<f64> = columns.iter().map(norm).map(|n| if n > 0.0 { 1.0 / n } else { 0.0 }).collect();
        let LeadingFunctions { functions, factors } =
            LeadingFunctions::new(&columns, &scales, &areas, (8, 1e-12)).unwrap();
        assert_eq!(functions.len(), 2);
        for (index, column) in columns.iter().enumerate() {
            for (vertex, value) in column.iter().enumerate() {
                let sum: f64 = functions.iter().zip(&factors).map(|(u, w)| u[vertex] * w[index]).sum();
                assert!((sum - f64::from(*value)).abs() < 1e-5, "{index} {vertex}: {sum} {value}");
            }
        }
        assert!(factors.iter().all(|of_function| of_function[2] == 0.0), "{factors:?}");
    }
}
