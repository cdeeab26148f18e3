//! The files of a chart and of a growth measurement: tables, drawings and the page.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::{Error, Result};
use crate::io::atomic;
use crate::io::png::encode_png;
use crate::measure::chart::draw::{Bars, Front, Point, Scatter, Unit, as_png, as_svg};
use crate::measure::chart::front::pareto;
use crate::measure::chart::page::{Triple, page};
use crate::measure::chart::table::csv;
use crate::measure::chart::{Chart, Row, Truth};
use crate::measure::growth::draw::Curves;
use crate::measure::growth::{self, Axis, Growth, Quantity, table};
use crate::render::film::Exposure;
use crate::render::frame::Frame;

/// The pictures of a row on the page: its first view, and the reference's.
pub(crate) struct Shown {
    /// Picture by the method.
    pub(crate) frame: Frame,
    /// Picture by the reference.
    pub(crate) truth: Frame,
}

/// A cost against which the error is drawn.
struct Cost {
    file: &'static str,
    title: &'static str,
    axis: &'static str,
    unit: Unit,
    of: fn(&Row) -> f64,
}

const COSTS: &[Cost] = &[
    Cost {
        file: "relight",
        title: "Error against the time to a new light",
        axis: "time from a new light to new radiosity",
        unit: Unit::Milliseconds,
        of: |r| r.relight_ms.median,
    },
    Cost {
        file: "bytes",
        title: "Error against size",
        axis: "bytes a vertex on disk, without mesh and environment",
        unit: Unit::BytesPerVertex,
        of: |r| r.bytes_per_vertex,
    },
    Cost {
        file: "bake",
        title: "Error against the time to bake",
        axis: "time to bake",
        unit: Unit::Seconds,
        of: |r| r.bake_seconds,
    },
];

/// Amplification of the difference that is shown.
const AMPLIFICATION: f32 = 10.0;

/// Writes tables, charts and the page; `shown` has one entry for each row. Returns the page's path.
pub(crate) fn write(chart: &Chart, shown: &[Shown], folder: &Path) -> Result<PathBuf> {
    let (mut drawings, mut members) = (Vec::new(), Vec::new());
    for (index, truth) in chart.truths.iter().enumerate() {
        let rows: Vec<(usize, &Row)> = chart.rows.iter().enumerate().filter(|(_, row)| is_of(row, truth)).collect();
        let name = |what: &str| if index == 0 { what.to_owned() } else { format!("{what}-{}", index + 1) };
        for cost in COSTS {
            let places: Vec<(f64, f64)> = rows.iter().map(|(_, r)| ((cost.of)(r), r.error.rms)).collect();
            members.extend(pareto(&places).into_iter().map(|i| rows[i].0));
            let scatter = scatter(cost, truth, &rows);
            let (svg, png) = (as_svg(&scatter)?, as_png(&scatter)?);
            drawings.push((name(cost.file), scatter.title, svg, png));
        }
        let bars = bars(truth, &rows);
        let (svg, png) = (as_svg(&bars)?, as_png(&bars)?);
        drawings.push((name("stages"), bars.title, svg, png));
    }
    let charts = tables_and_drawings(folder, "chart", chart, &csv(chart), drawings)?;
    members.sort_unstable();
    members.dedup();
    let triple = |&index: &usize| triple(&chart.rows[index], &shown[index]);
    let pictures: Vec<Triple> = members.iter().map(triple).collect::<Result<_>>()?;
    let path = folder.join("index.html");
    atomic::write(&path, page(chart, &charts, &pictures).as_bytes())?;
    Ok(path)
}

/// Writes tables, charts and the page of a growth measurement; returns the page's path.
pub(crate) fn write_growth(growth: &Growth, folder: &Path) -> Result<PathBuf> {
    let mut drawings = Vec::new();
    for (axis, quantity) in Axis::ALL.into_iter().flat_map(|axis| Quantity::ALL.map(|quantity| (axis, quantity))) {
        if let Some(curves) = Curves::of(growth, axis, quantity) {
            let (svg, png) = (as_svg(&curves)?, as_png(&curves)?);
            drawings.push((format!("{}-{}", axis.name(), quantity.name()), curves.title, svg, png));
        }
    }
    let charts = tables_and_drawings(folder, "growth", growth, &table::csv(&growth.points), drawings)?;
    let path = folder.join("growth.html");
    atomic::write(&path, growth::page::page(growth, &charts).as_bytes())?;
    Ok(path)
}

/// Writes figures as JSON and CSV, and drawings (name, title, SVG, PNG); returns titles and SVGs.
fn tables_and_drawings<T: Serialize>(
    folder: &Path,
    stem: &str,
    figures: &T,
    csv: &str,
    drawings: Vec<(String, String, String, Vec<u8>)>,
) -> Result<Vec<(String, String)>> {
    let put = |name: String, bytes: &[u8]| atomic::write(&folder.join(name), bytes);
    let json = serde_json::to_string_pretty(figures).map_err(|e| Error::runtime(format!("{stem}.json: {e}")))?;
    put(format!("{stem}.json"), format!("{json}\n").as_bytes())?;
    put(format!("{stem}.csv"), csv.as_bytes())?;
    let mut charts = Vec::new();
    for (name, title, svg, png) in drawings {
        put(format!("{name}.svg"), svg.as_bytes())?;
        put(format!("{name}.png"), &png)?;
        charts.push((title, svg));
    }
    Ok(charts)
}

fn is_of(row: &Row, truth: &Truth) -> bool {
    row.model == truth.model && row.material == truth.material
}

fn scatter(cost: &Cost, truth: &Truth, rows: &[(usize, &Row)]) -> Scatter {
    let point = |(_, row): &(usize, &Row)| Point { series: row.method.clone(), x: (cost.of)(row), y: row.error.rms };
    let mut lines = vec![(truth.own_rms, "the reference's own error".to_owned())];
    lines.extend(truth.model_rms().map(|[rms, _]| (rms, "the dipole's own, against a random walk".to_owned())));
    Scatter {
        title: format!("{}: {} in {}", cost.title, truth.model, truth.material),
        axes: [cost.axis.to_owned(), "RMS error over the vertices, worst light".to_owned()],
        units: [cost.unit, Unit::Percent],
        points: rows.iter().map(point).collect(),
        lines,
        front: Front::Drawn,
    }
}

/// The ledgers of all rows, with the measured errors.
fn bars(truth: &Truth, rows: &[(usize, &Row)]) -> Bars {
    let mut stages: Vec<String> = Vec::new();
    for (stage, _) in rows.iter().flat_map(|(_, row)| &row.ledger) {
        if !stages.contains(stage) {
            stages.push(stage.clone());
        }
    }
    let of_row = |row: &Row| {
        let value = |stage: &String| row.ledger.iter().find(|(s, _)| s == stage).map_or(0.0, |(_, rms)| *rms);
        (
            format!("{} {}", row.method, row.setting).trim_end().to_owned(),
            stages.iter().map(value).collect(),
            row.error.rms,
        )
    };
    let with_ledger = rows.iter().filter(|(_, row)| !row.ledger.is_empty());
    let rows = with_ledger.map(|(_, row)| of_row(row)).collect();
    Bars { title: format!("Error by stage: {} in {}", truth.model, truth.material), stages, rows }
}

/// The pictures of a row.
fn triple(row: &Row, Shown { frame, truth }: &Shown) -> Result<Triple> {
    let factor = Exposure::Auto.factor(truth) as f32;
    let exposed = |v: [f32; 3]| v.map(|c| (c * factor).clamp(0.0, 1.0));
    let (width, height) = (frame.resolution.width, frame.resolution.height);
    let encode = |rgb: Vec<[f32; 3]>| encode_png(width, height, &rgb, None);
    let difference = frame.pixels.iter().zip(&truth.pixels).map(|(a, b)| {
        let c = |i: usize| ((a.diffuse[i] - b.diffuse[i]).abs() * factor * AMPLIFICATION).min(1.0);
        [c(0), c(1), c(2)]
    });
    let pngs = [
        encode(frame.pixels.iter().map(|p| exposed(p.diffuse)).collect())?,
        encode(truth.pixels.iter().map(|p| exposed(p.diffuse)).collect())?,
        encode(difference.collect())?,
    ];
    let setting = if row.setting.is_empty() { "defaults" } else { &row.setting };
    let Row { method, model, material, .. } = row;
    let rms = Unit::Percent.text(row.error.rms);
    let caption = format!("{method} {setting}, {model} in {material}: {rms} RMS over the vertices");
    Ok(Triple { caption, pngs })
}
