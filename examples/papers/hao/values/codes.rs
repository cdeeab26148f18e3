//! One byte a value (the paper's section 4): tables, and codes less what earlier neighbours predict.

use rayon::prelude::*;
use translux_format::coefficients::{decode, encode};
use translux_format::quantised_values::{LEVELS, tags};
use translux_format::{Budget, FormatError};

use super::matrix::{Cells, Matrix};
use super::prediction::Earlier;
use crate::hao::quantiser::Quantiser8;
use translux::error::{Error, Result};

/// How tables are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Table {
    /// Equal steps.
    Uniform,
    /// Lloyd's.
    Lloyd,
}

/// Values in one byte each.
pub(super) struct Coded {
    pub(super) matrix: Matrix,
    /// Signal over noise of all values together; infinite where nothing is lost.
    pub(super) signal_to_noise_db: f64,
}

/// Quantises values `[row][plane][column]` with a table for each plane.
pub(super) fn quantised(values: &[f32], planes: usize, columns: usize, table: Table) -> Result<Coded> {
    let size = (planes * columns).max(1);
    let mut codes = vec![0u8; values.len()];
    let mut tables = Vec::with_capacity(planes * LEVELS);
    let (mut signal, mut noise) = (0.0, 0.0);
    for plane in 0..planes {
        let cells = plane * columns..(plane + 1) * columns;
        let own: Vec<f32> = values.chunks_exact(size).flat_map(|row| &row[cells.clone()]).copied().collect();
        let quantiser = match table {
            Table::Lloyd => Quantiser8::lloyd(&own)?,
            Table::Uniform => {
                let range = own.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
                Quantiser8::uniform(range.0, range.1)?
            }
        };
        signal += own.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>();
        noise += quantiser.square_error(&own);
        let found = quantiser.encode_all(&own);
        codes.par_chunks_exact_mut(size).zip(found.par_chunks_exact(columns.max(1))).for_each(|(row, own)| {
            row[cells.clone()].copy_from_slice(own);
        });
        tables.extend(quantiser.table());
    }
    let signal_to_noise_db = if noise > 0.0 { 10.0 * (signal / noise).log10() } else { f64::INFINITY };
    Ok(Coded { matrix: Matrix { planes, columns, cells: Cells::Codes { codes, tables } }, signal_to_noise_db })
}

/// Codes as they lie in a file.
pub(super) fn write(matrix: &Matrix, earlier: &Earlier) -> Result<(Vec<f32>, Vec<u8>)> {
    let Cells::Codes { codes, tables } = &matrix.cells else { return Err(Error::runtime("no codes to write")) };
    let values: Vec<i16> = codes.iter().map(|code| i16::from(*code)).collect();
    let residuals = earlier.residuals(&values, matrix.planes * matrix.columns);
    let rows = matrix.rows() * matrix.planes;
    let coded = encode(tags::CODES, rows, matrix.columns, &residuals, Some(&earlier.similar(matrix.planes)));
    Ok((tables.clone(), coded.map_err(|e| Error::runtime(format!("asset: {e}")))?))
}

/// Undoes [`write`].
pub(super) fn read(bytes: &[u8], tables: &[f32], planes: usize, columns: usize, earlier: &Earlier) -> Result<Matrix> {
    let fail = |e: FormatError| Error::input(e.to_string());
    let similar = earlier.similar(planes);
    let found = decode(tags::CODES, bytes, Some(&similar), Budget::default()).map_err(fail)?;
    let mut values = found.values;
    earlier.restore(&mut values, planes * columns);
    let codes: Vec<u8> = values.iter().map_while(|v| u8::try_from(*v).ok()).collect();
    if codes.len() != values.len() {
        return Err(Error::input(format!("section {}: code {} is no byte", tags::CODES, codes.len())));
    }
    Ok(Matrix { planes, columns, cells: Cells::Codes { codes, tables: tables.to_vec() } })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use translux::error::ExitCode;
    use translux::math::random::uniform;

    #[test]
    fn constant_values_are_exact_and_others_close() {
        for table in [Table::Uniform, Table::Lloyd] {
            for value in [0.0, 0.3, -2.0] {
                let coded = quantised(&[value; 24], 3, 4, table).unwrap();
                assert!(coded.signal_to_noise_db == f64::INFINITY);
                assert!((0..24).all(|i| coded.matrix.value(i / 12, i / 4 % 3, i % 4) == value));
            }
            let values: Vec<f32> = (0..24_000).map(|i| uniform(1, i, 0) as f32 * (1 + i / 4 % 3) as f32).collect();
            let coded = quantised(&values, 3, 4, table).unwrap();
            assert!(coded.signal_to_noise_db > 51.0, "{}", coded.signal_to_noise_db);
            let close = |(i, v): (usize, &f32)| (coded.matrix.value(i / 12, i / 4 % 3, i % 4) - v).abs() < 0.01;
            assert!(values.iter().enumerate().all(close));
        }
    }

    #[test]
    fn codes_are_read_back_and_others_refused() {
        let earlier = Earlier::new(5, &[[0, 1, 2], [2, 3, 4]]);
        let values: Vec<f32> = (0..60).map(|i| uniform(2, i, 0) as f32).collect();
        let coded = quantised(&values, 3, 4, Table::Lloyd).unwrap();
        let (tables, bytes) = write(&coded.matrix, &earlier).unwrap();
        assert_eq!(read(&bytes, &tables, 3, 4, &earlier).unwrap(), coded.matrix);
        // Residuals that leave the byte.
        let residuals = vec![200i16; 60];
        let bytes = encode(tags::CODES, 15, 4, &residuals, Some(&earlier.similar(3))).unwrap();
        assert_eq!(read(&bytes, &tables, 3, 4, &earlier).unwrap_err().code(), ExitCode::InvalidInput);
        let other = Earlier::new(6, &[]);
        assert_eq!(read(&bytes, &tables, 3, 4, &other).unwrap_err().code(), ExitCode::InvalidInput);
    }
}
