//! Rows as comma-separated values (RFC 4180), one line each.

use super::{Chart, Row};

/// A column of rows: its name with its unit, and the cell of a row.
pub(in crate::measure) type Column<R> = (&'static str, fn(&R) -> String);

/// Every column of the table.
const COLUMNS: &[Column<Row>] = &[
    ("model", |r| r.model.clone()),
    ("material", |r| r.material.clone()),
    ("method", |r| r.method.clone()),
    ("setting", |r| r.setting.clone()),
    ("vertices", |r| r.vertices.to_string()),
    ("samples", |r| r.samples.to_string()),
    ("bake_s", |r| number(r.bake_seconds)),
    ("peak_memory_bytes", |r| r.peak_memory_bytes.to_string()),
    ("file_bytes", |r| r.file_bytes.to_string()),
    ("bytes_per_vertex", |r| number(r.bytes_per_vertex)),
    ("environment_bytes_per_vertex", |r| number(r.environment_bytes_per_vertex)),
    ("resident_bytes_per_vertex", |r| number(r.resident_bytes_per_vertex)),
    ("open_ms", |r| number(r.open_ms)),
    ("relight_ms", |r| number(r.relight_ms.median)),
    ("relight_ms_p10", |r| number(r.relight_ms.p10)),
    ("relight_ms_p90", |r| number(r.relight_ms.p90)),
    ("edit_ms", |r| r.edit_ms.map_or_else(String::new, |q| number(q.median))),
    ("adapter", |r| r.device.as_ref().map_or_else(String::new, |d| d.adapter.clone())),
    ("adapter_relight_ms", |r| r.device.as_ref().map_or_else(String::new, |d| number(d.relight_ms.median))),
    ("adapter_edit_ms", |r| r.device.as_ref().and_then(|d| d.edit_ms).map_or_else(String::new, |q| number(q.median))),
    ("rms", |r| number(r.error.rms)),
    ("volume_rms", |r| r.volume_rms.map_or_else(String::new, |[rms, _]| number(rms))),
    ("bias", |r| number(r.error.bias)),
    ("p999", |r| number(r.error.p999)),
    ("worst_vertex", |r| number(r.error.worst)),
    ("negative_share", |r| number(r.negative_share)),
    ("picture_rms", |r| number(r.picture.rms)),
    ("picture_rms_with_background", |r| number(r.picture.rms_with_background)),
    ("hdr_flip", |r| number(r.picture.flip)),
    ("promised_rms", |r| number(r.promised_rms)),
    ("unserved_lights", |r| r.unserved.join(" ")),
    ("command", |r| r.command.clone()),
];

/// A number with six digits, in the shortest form.
pub(in crate::measure) fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.5e}").parse().unwrap_or(value);
    rounded.to_string()
}

/// Rows as lines below the names of their columns.
pub(in crate::measure) fn lines<R>(columns: &[Column<R>], rows: &[R]) -> String {
    let line = |cells: Vec<String>| cells.iter().map(|cell| quoted(cell)).collect::<Vec<_>>().join(",") + "\r\n";
    let header = line(columns.iter().map(|(name, _)| (*name).to_owned()).collect());
    let of_row = |row: &R| line(columns.iter().map(|(_, value)| value(row)).collect());
    rows.iter().fold(header, |text, row| text + &of_row(row))
}

/// The table with its header.
pub fn csv(chart: &Chart) -> String {
    lines(COLUMNS, &chart.rows)
}

fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.to_owned() }
}
