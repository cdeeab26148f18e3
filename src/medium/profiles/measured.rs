//! Measured profiles: R_d at a few distances, from CSV.
//!
//! Between two distances R is an exponential (a straight line in the logarithm) where both values are positive,
//! otherwise a straight line; below the first distance it is constant; beyond the last it continues the last piece's
//! exponential if that falls, otherwise it is 0. The tail is the exact integral.

use std::path::Path;

use super::csv::{self, Row};
use crate::error::{Error, Result};
use crate::medium::profile::Profile;

/// Interpolation of R between two distances.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Interpolation {
    /// Exponentials where both ends are positive.
    #[default]
    LogLinear,
    /// Straight lines.
    Linear,
}

/// Largest total of a measured profile, a little above 1 to allow for noise and interpolation.
const LARGEST_TOTAL: f64 = 1.001;

/// R between two distances; x is the distance from the start of the piece.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// `R_0 exp(-rate x)`, in 1/mm.
    Exponential(f64),
    /// `R_0 + slope x`, in 1/mm^3.
    Line(f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Piece {
    from_mm: f64,
    /// R at `from_mm` in 1/mm^2.
    start: f64,
    shape: Shape,
    /// `Int R r dr` beyond the end of the piece.
    beyond: f64,
}

impl Piece {
    fn at(&self, r_mm: f64) -> f64 {
        match self.shape {
            Shape::Exponential(rate) => self.start * (-rate * (r_mm - self.from_mm)).exp(),
            // Rounding at the end of a line that falls to 0.
            Shape::Line(slope) => (self.start + slope * (r_mm - self.from_mm)).max(0.0),
        }
    }

    /// `Int_from^to R r dr`, both within the piece; `to` may be infinite for an exponential that falls.
    fn integral(&self, from_mm: f64, to_mm: f64) -> f64 {
        let (first, width) = (self.at(from_mm), to_mm - from_mm);
        match self.shape {
            Shape::Exponential(rate) if width.is_infinite() => first * (from_mm + 1.0 / rate) / rate,
            Shape::Exponential(rate) => {
                let [mean, centre] = moments(rate * width);
                first * width * (from_mm * mean + width * centre)
            }
            Shape::Line(slope) => {
                width * (first * from_mm + width * (0.5 * (first + slope * from_mm) + width * slope / 3.0))
            }
        }
    }
}

/// `Int_0^1 exp(-y x) dx` and `Int_0^1 x exp(-y x) dx`.
fn moments(y: f64) -> [f64; 2] {
    if y.abs() > 0.5 {
        let decay = (-y).exp();
        return [(1.0 - decay) / y, (1.0 - (1.0 + y) * decay) / y / y];
    }
    let (mut term, mut sums) = (1.0, [0.0, 0.0]);
    for n in 0..16 {
        sums[0] += term / f64::from(n + 1);
        sums[1] += term / f64::from(n + 2);
        term *= -y / f64::from(n + 1);
    }
    sums
}

/// A measured profile of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// In ascending order; the first starts at 0, the last has no end.
    pieces: Vec<Piece>,
}

impl Measured {
    /// The profile through points of distances in mm and R in 1/mm^2.
    ///
    /// # Errors
    /// Invalid input with fewer than two points, when distances are negative or do not ascend, when a value is negative
    /// or not finite, and when the total exceeds 1 by more than 0.1 %.
    pub fn new(points: &[(f64, f64)], interpolation: Interpolation) -> Result<Self> {
        if points.len() < 2 {
            return Err(Error::input(format!("{} points; a profile takes at least 2", points.len())));
        }
        for (i, (r, value)) in points.iter().enumerate() {
            check(i.checked_sub(1).and_then(|i| points.get(i)).map(|p| p.0), *r, *value)?;
        }
        let mut pieces: Vec<Piece> = Vec::with_capacity(points.len() + 1);
        let flat = Shape::Line(0.0);
        if points[0].0 > 0.0 {
            pieces.push(Piece { from_mm: 0.0, start: points[0].1, shape: flat, beyond: 0.0 });
        }
        for pair in points.windows(2) {
            let ((from_mm, start), (to, end)) = (pair[0], pair[1]);
            let shape = if interpolation == Interpolation::LogLinear && start > 0.0 && end > 0.0 {
                Shape::Exponential((start / end).ln() / (to - from_mm))
            } else {
                Shape::Line((end - start) / (to - from_mm))
            };
            pieces.push(Piece { from_mm, start, shape, beyond: 0.0 });
        }
        let [.., before, last] = points else { return Err(Error::input("no points")) };
        let rate = if last.1 > 0.0 && before.1 > last.1 { (before.1 / last.1).ln() / (last.0 - before.0) } else { 0.0 };
        let (start, shape) = if rate > 0.0 { (last.1, Shape::Exponential(rate)) } else { (0.0, flat) };
        pieces.push(Piece { from_mm: last.0, start, shape, beyond: 0.0 });
        let profile = Self { pieces: accumulated(pieces) };
        let total = profile.total();
        if total.is_nan() || total > LARGEST_TOTAL {
            return Err(Error::input(format!(
                "the profile returns {total:.4} of the light that enters (2 pi Int R r dr); it must be at most 1, R in 1/mm^2"
            )));
        }
        Ok(profile)
    }

    fn piece(&self, r_mm: f64) -> Option<(usize, &Piece)> {
        let index = self.pieces.partition_point(|piece| piece.from_mm <= r_mm).checked_sub(1)?;
        self.pieces.get(index).map(|piece| (index, piece))
    }
}

/// Fills in the integral beyond each piece.
fn accumulated(mut pieces: Vec<Piece>) -> Vec<Piece> {
    let (mut sum, mut end) = (0.0, f64::INFINITY);
    for piece in pieces.iter_mut().rev() {
        piece.beyond = sum;
        sum += if piece.start == 0.0 && end.is_infinite() { 0.0 } else { piece.integral(piece.from_mm, end) };
        end = piece.from_mm;
    }
    pieces
}

/// Checks one point, and that it lies beyond the previous distance.
fn check(previous_mm: Option<f64>, r_mm: f64, value: f64) -> Result<()> {
    if !(r_mm >= 0.0 && r_mm.is_finite()) {
        return Err(Error::input(format!("the distance is {r_mm} mm; it must be 0 or more")));
    }
    if let Some(previous) = previous_mm
        && r_mm <= previous
    {
        return Err(Error::input(format!("the distance {r_mm} mm follows {previous} mm; distances must ascend")));
    }
    if !(value >= 0.0 && value.is_finite()) {
        return Err(Error::input(format!("R is {value} per mm^2; it must be 0 or more")));
    }
    Ok(())
}

impl Profile for Measured {
    fn reflectance(&self, r_mm: f64) -> f64 {
        self.piece(r_mm.max(0.0)).map_or(0.0, |(_, piece)| piece.at(r_mm.max(0.0)))
    }

    fn tail(&self, r_mm: f64) -> f64 {
        let r_mm = r_mm.max(0.0);
        let Some((index, piece)) = self.piece(r_mm) else { return 0.0 };
        let end = self.pieces.get(index + 1).map_or(f64::INFINITY, |next| next.from_mm);
        if piece.start == 0.0 && end.is_infinite() || r_mm.is_infinite() {
            return 0.0;
        }
        piece.beyond + piece.integral(r_mm, end)
    }
}

/// Reads a profile from CSV with the header `r_mm,r,g,b`, R in 1/mm^2; blank lines and comments after a `#` are
/// skipped.
///
/// # Errors
/// I/O when it cannot be read; invalid input, with path and line, for its contents.
pub fn read(path: &Path, interpolation: Interpolation) -> Result<[Measured; 3]> {
    from_rows(&csv::read(path, "r_mm")?, &path.display().to_string(), interpolation)
}

/// Like [`read`] for the rows of a table; `place` names it in errors.
pub(super) fn from_rows(rows: &[Row], place: &str, interpolation: Interpolation) -> Result<[Measured; 3]> {
    let names = ["red", "green", "blue"];
    let mut previous = None;
    for row in rows {
        for (name, value) in names.iter().zip(row.rgb) {
            check(previous, row.key, value).map_err(|e| e.at(name).at(format!("{place}:{}", row.line)))?;
        }
        previous = Some(row.key);
    }
    let channel = |c: usize| {
        let points: Vec<(f64, f64)> = rows.iter().map(|row| (row.key, row.rgb[c])).collect();
        Measured::new(&points, interpolation).map_err(|e| e.at(names[c]).at(place))
    };
    Ok([channel(0)?, channel(1)?, channel(2)?])
}
