//! Points as comma-separated values (RFC 4180), one line each.

use super::super::chart::table::{Column, lines, number};
use super::{Costs, Point};
use crate::math::statistics::Quantiles;

/// Every column of the table; a cell is empty where it was not measured.
const COLUMNS: &[Column<Point>] = &[
    ("axis", |p| p.axis.name().to_owned()),
    ("method", |p| p.method.clone()),
    ("size", |p| number(p.size)),
    ("vertices", |p| p.vertices.to_string()),
    ("samples", |p| cost(p, |c| c.samples.to_string())),
    ("size_mm", |p| number(p.size_mm)),
    ("size_over_mean_free_path", |p| number(p.size_over_mean_free_path)),
    ("bake_s", |p| cost(p, |c| number(c.bake_seconds))),
    ("peak_memory_bytes", |p| cost(p, |c| c.peak_memory_bytes.to_string())),
    ("file_bytes", |p| cost(p, |c| c.file_bytes.to_string())),
    ("bytes_without_mesh_and_environment", |p| cost(p, |c| c.bytes.to_string())),
    ("environment_bytes", |p| cost(p, |c| c.environment_bytes.to_string())),
    ("resident_bytes", |p| cost(p, |c| c.resident_bytes.to_string())),
    ("open_ms", |p| cost(p, |c| number(c.open_ms))),
    ("relight_ms", |p| relight(p, |q| q.median)),
    ("relight_ms_p10", |p| relight(p, |q| q.p10)),
    ("relight_ms_p90", |p| relight(p, |q| q.p90)),
    ("relights", |p| cost(p, |c| c.relights.to_string())),
    ("skipped", |p| p.skipped.as_ref().map_or_else(String::new, |s| s.what.name().to_owned())),
    ("reason", |p| p.skipped.as_ref().map_or_else(String::new, |s| s.reason.clone())),
    ("command", |p| p.command.clone()),
];

fn cost(point: &Point, text: fn(&Costs) -> String) -> String {
    point.costs.as_ref().map_or_else(String::new, text)
}

fn relight(point: &Point, value: fn(&Quantiles) -> f64) -> String {
    point.costs.as_ref().and_then(|c| c.relight_ms).map_or_else(String::new, |q| number(value(&q)))
}

/// The table with its header.
pub fn csv(points: &[Point]) -> String {
    lines(COLUMNS, points)
}
