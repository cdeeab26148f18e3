//! A cost against size on logarithmic axes, with the fitted power laws and their exponents.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::super::chart::draw::{COLOURS, Drawing, Numbers, failed, legend, marks, on_axes, plain as shortest, span};
use super::{Axis, Growing, Growth, Quantity, places};
use crate::error::Result;

/// Decimals of a number at most.
const MOST_DECIMALS: usize = 12;

/// One cost of every method along one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// Title over the chart.
    pub title: String,
    /// The size that is varied.
    pub axis: Axis,
    /// The cost.
    pub quantity: Quantity,
    /// Points (size, cost) and the fitted law of each method.
    pub series: Vec<(Growing, Vec<(f64, f64)>)>,
}

impl Curves {
    /// The curves of a measurement; none where no point has this cost. Colours and marks follow `methods`.
    pub fn of(growth: &Growth, axis: Axis, quantity: Quantity) -> Option<Self> {
        let of_this = growth.growing.iter().filter(|g| g.axis == axis && g.quantity == quantity);
        let series: Vec<_> = of_this.map(|g| (g.clone(), places(&growth.points, axis, &g.method, quantity))).collect();
        let mut title = format!("{} against {}", quantity.title(), axis.title());
        if let Some(first) = title.get_mut(..1) {
            first.make_ascii_uppercase();
        }
        (!series.is_empty()).then_some(Self { title, axis, quantity, series })
    }
}

fn plain(value: f64) -> String {
    shortest(value, MOST_DECIMALS)
}

/// A number in the largest of the units in which it is at least 1, or in the first unit.
fn scaled(value: f64, units: &[(f64, &str)]) -> String {
    let (unit, name) =
        units.iter().rev().find(|(unit, _)| value >= 0.9995 * unit).or(units.first()).unwrap_or(&(1.0, ""));
    format!("{}{name}", plain(value / unit))
}

/// A size on an axis, in words.
pub fn size_text(axis: Axis, size: f64) -> String {
    match axis {
        Axis::Vertices | Axis::Samples => scaled(size, &[(1.0, ""), (1e3, "k"), (1e6, "M")]),
        Axis::Ratio => plain(size),
    }
}

/// A cost, in words.
pub fn cost_text(quantity: Quantity, value: f64) -> String {
    const TIMES: &[(f64, &str)] = &[(1e-3, " ms"), (1.0, " s"), (120.0, "")];
    match quantity {
        Quantity::BakeSeconds if value >= 120.0 => format!("{} min", plain(value / 60.0)),
        Quantity::BakeSeconds => scaled(value, &TIMES[..2]),
        Quantity::RelightMs if value >= 120_000.0 => format!("{} min", plain(value / 60_000.0)),
        Quantity::RelightMs => scaled(value / 1000.0, &TIMES[..2]),
        _ => scaled(value, &[(1.0, " B"), (1e3, " kB"), (1e6, " MB"), (1e9, " GB")]),
    }
}

/// An exponent to two digits, never minus zero.
pub fn exponent(value: f64) -> String {
    format!("{:.2}", (100.0 * value).round() / 100.0 + 0.0)
}

/// A fitted exponent with its standard error.
pub fn exponent_text(growing: &Growing) -> String {
    match growing.law {
        Some(law) => format!("{} \u{b1} {:.2}", exponent(law.exponent), law.standard_error),
        None => "not fitted".to_owned(),
    }
}

/// Text of a method in the legend.
fn named(growing: &Growing) -> String {
    let name = &growing.method;
    let law = growing.law.map_or_else(
        || "fewer than 3 points above the floor".to_owned(),
        |_| format!("exponent {}", exponent_text(growing)),
    );
    format!("{name}: {law}{}", if growing.finding { " (faster than size)" } else { "" })
}

impl Drawing for Curves {
    fn draw<B: DrawingBackend>(&self, root: &DrawingArea<B, Shift>) -> Result<()> {
        root.fill(&WHITE).map_err(|e| failed(&e))?;
        let all = || self.series.iter().flat_map(|(_, points)| points.iter().copied());
        let x = span(all().map(|p| p.0));
        let y = span(all().map(|p| p.1));
        // Room for the legend above the curves, which mostly rise to the right.
        let y = (y.0, y.1 * (y.1 / y.0).powf(0.12 * self.series.len() as f64).max(1.5));
        let names = [self.axis.title(), self.quantity.title()];
        let texts: [Numbers<'_>; 2] = [&|v| size_text(self.axis, *v), &|v| cost_text(self.quantity, *v)];
        let mut chart = on_axes(root, &self.title, [x, y], names, texts)?;
        for (index, (growing, points)) in self.series.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            if let Some(law) = growing.law {
                let above = points.iter().filter(|p| p.1 >= self.quantity.floor()).map(|p| p.0);
                let (from, to) = above.fold((f64::INFINITY, 0.0f64), |(l, h), s| (l.min(s), h.max(s)));
                let ends = [from, to].map(|size| (size, law.at(size)));
                let style = ShapeStyle::from(&colour).stroke_width(2);
                chart.draw_series(LineSeries::new(ends, style)).map_err(|e| failed(&e))?;
            }
            marks(&mut chart, index, named(growing), points)?;
        }
        legend(&mut chart, SeriesLabelPosition::UpperLeft)
    }
}
