//! One self-contained HTML page: table, charts, pictures.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::draw::Unit;
use super::{Chart, Machine, ModelLine, Row, Truth};

/// Three pictures of one row as PNG: its own, the reference's, and their difference.
pub struct Triple {
    /// Caption of the three pictures.
    pub caption: String,
    /// PNG files in this order.
    pub pngs: [Vec<u8>; 3],
}

/// A cell: the text, and the number by which the column is sorted.
type Cell = (String, f64);

/// A column of the page's table: title, explanation shown by the pointer, and cells.
type Column = (&'static str, &'static str, fn(&Row) -> Cell);

const COLUMNS: &[Column] = &[
    ("RMS", "Error over the vertices, worst channel and served light, relative to the reference", |r| {
        percent(r.error.rms)
    }),
    ("lights", "Lights that the figures are the worst of, of all", |r| {
        let (served, all) = (r.lights.len(), r.lights.len() + r.unserved.len());
        (format!("{served} of {all}"), all as f64 - served as f64)
    }),
    (
        "off the volume",
        "RMS against a random walk through the volume: the model's error and the method's together",
        |r| match r.volume_rms {
            None => ("not known".to_owned(), f64::MAX),
            Some([rms, error]) => (format!("{} <small>&plusmn; {}</small>", percent(rms).0, percent(error).0), rms),
        },
    ),
    ("bias", "Mean error, signed", |r| percent(r.error.bias)),
    ("99.9 %", "99.9th percentile of the error", |r| percent(r.error.p999)),
    ("worst", "Worst vertex", |r| percent(r.error.worst)),
    ("negative", "Share of the area with negative radiosity", |r| percent(r.negative_share)),
    ("picture", "RMS over covered pixels, worst of the views and lights", |r| percent(r.picture.rms)),
    ("with background", "RMS over all pixels, as the papers have it", |r| percent(r.picture.rms_with_background)),
    ("FLIP", "Mean HDR-FLIP, worst of the views and lights", |r| (format!("{:.4}", r.picture.flip), r.picture.flip)),
    ("promised", "Error that the asset states of itself", |r| match r.ledger.is_empty() {
        true => ("nothing".to_owned(), f64::MAX),
        false => percent(r.promised_rms),
    }),
    (
        "measured/promised",
        "RMS over what the asset promises, the sum of its stages; more than 1 is a broken promise",
        |r| match r.promised_rms > 0.0 {
            true => (format!("{:.2}", r.error.rms / r.promised_rms), r.error.rms / r.promised_rms),
            false => ("".to_owned(), f64::MAX),
        },
    ),
    ("bytes/vertex", "On disk, without the mesh and the environment", |r| {
        (Unit::BytesPerVertex.text(r.bytes_per_vertex), r.bytes_per_vertex)
    }),
    ("environment", "Bytes a vertex of what environments need, on disk", |r| {
        (Unit::BytesPerVertex.text(r.environment_bytes_per_vertex), r.environment_bytes_per_vertex)
    }),
    ("in memory", "Bytes a vertex of the opened method, without the mesh", |r| {
        (Unit::BytesPerVertex.text(r.resident_bytes_per_vertex), r.resident_bytes_per_vertex)
    }),
    ("bake", "The whole bake", |r| (Unit::Seconds.text(r.bake_seconds), r.bake_seconds)),
    ("peak", "Most memory of the bake", |r| {
        (format!("{} MB", r.peak_memory_bytes / 1_000_000), r.peak_memory_bytes as f64)
    }),
    ("open", "From the file to the first light", |r| (Unit::Milliseconds.text(r.open_ms), r.open_ms)),
    ("relight", "A new light, the median one: median (10 % to 90 %)", |r| times(Some(r.relight_ms))),
    ("edit", "A new material", |r| times(r.edit_ms)),
    ("shaders: relight", "A new light on the adapter, the light's rays on the processor", |r| match &r.device {
        None => ("not timed".to_owned(), f64::MAX),
        Some(device) => {
            let (text, key) = times(Some(device.relight_ms));
            (format!("{text} <small>{}</small>", escaped(&device.adapter)), key)
        }
    }),
];

fn percent(value: f64) -> Cell {
    (Unit::Percent.text(value), value)
}

fn times(quantiles: Option<crate::math::statistics::Quantiles>) -> Cell {
    match quantiles {
        None => ("baked in".to_owned(), f64::MAX),
        Some(q) => {
            let text = |v| Unit::Milliseconds.text(v);
            (format!("{} <small>({} to {})</small>", text(q.median), text(q.p10), text(q.p90)), q.median)
        }
    }
}

/// The page; `charts` are SVG documents with their titles, already in a sensible order.
pub fn page(chart: &Chart, charts: &[(String, String)], pictures: &[Triple]) -> String {
    let title = ["speed, accuracy, size", "Speed against accuracy against size"];
    let mut text = head(title, &chart.version, &chart.machine);
    for truth in &chart.truths {
        text += &paragraph(truth);
    }
    text += &table(chart);
    text += &figures(charts);
    if !pictures.is_empty() {
        text += "<h2>What the errors look like</h2>\n<p>Members of a Pareto front: the method, the reference, and ten times \
                 their difference.</p>\n";
    }
    for Triple { caption, pngs } in pictures {
        text += "<figure class=\"triple\">";
        for (png, what) in pngs.iter().zip(["method", "reference", "difference"]) {
            let data = STANDARD.encode(png);
            text += &format!("<img alt=\"{what}\" src=\"data:image/png;base64,{data}\">");
        }
        text += &format!("<figcaption>{}</figcaption></figure>\n", escaped(caption));
    }
    text + TAIL
}

/// The beginning of a page, with its title in the window and on the page.
pub(in crate::measure) fn head([window, title]: [&str; 2], version: &str, machine: &Machine) -> String {
    let load = machine.load.map_or_else(String::new, |load| format!(", load {load} when it began"));
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>translux: {window}</title>\n\
         <style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n\
         <p>translux {}, {} threads of {}{load}. Times are medians.</p>\n",
        escaped(version),
        machine.threads,
        escaped(&machine.processor)
    )
}

/// SVG documents with their titles.
pub(in crate::measure) fn figures(charts: &[(String, String)]) -> String {
    let figure = |(title, svg): &(String, String)| {
        format!("<figure>{}<figcaption>{}</figcaption></figure>\n", inline(svg), escaped(title))
    };
    charts.iter().map(figure).collect()
}

/// The paragraph on the reference of one model and material, and on its accuracy.
fn paragraph(truth: &Truth) -> String {
    let mut text = format!(
        "<p>{} in {}: compared with all pairs of {} samples, which is itself {} RMS off: <code>{}</code><br>\n",
        escaped(&truth.model),
        escaped(&truth.material),
        truth.samples,
        Unit::Percent.text(truth.own_rms),
        escaped(&truth.command)
    );
    if let Some(reason) = &truth.no_model_errors {
        text += &format!("The dipole's own error is not known: {}", escaped(reason));
    } else if !truth.model_errors.is_empty() {
        let one = |line: &ModelLine| {
            let [rms, error] = line.error.worst();
            let bias = line.error.bias.iter().fold(0.0f64, |a, &b| if b.abs() > a.abs() { b } else { a });
            format!(
                "<span title=\"{}\">{} &plusmn; {} RMS, bias {}, under {}</span>",
                escaped(&line.command),
                Unit::Percent.text(rms),
                Unit::Percent.text(error),
                Unit::Percent.text(bias),
                escaped(&rounded(&line.light))
            )
        };
        let all: Vec<String> = truth.model_errors.iter().map(one).collect();
        text += &format!("The dipole itself, against a random walk through the volume:<br>{}", all.join("<br>"));
    }
    text + "</p>\n"
}

/// A light with the decimals of its numbers cut to four.
fn rounded(light: &str) -> String {
    let is_number = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let mut text = String::new();
    let mut rest = light;
    while !rest.is_empty() {
        let end = rest.find(is_number).unwrap_or(rest.len());
        let (words, after) = rest.split_at(end);
        let (number, after) = after.split_at(after.find(|c| !is_number(c)).unwrap_or(after.len()));
        text += words;
        text += &match number.parse::<f64>() {
            Ok(value) if number.contains('.') && !number.ends_with('.') => format!("{}", (value * 1e4).round() / 1e4),
            _ => number.to_owned(),
        };
        rest = after;
    }
    text
}

fn table(chart: &Chart) -> String {
    let mut text =
        "<table id=\"rows\"><thead><tr><th>model</th><th>material</th><th>method</th><th>setting</th>".to_owned();
    for (title, explanation, _) in COLUMNS {
        text += &format!("<th title=\"{}\">{}</th>", escaped(explanation), escaped(title));
    }
    text += "</tr></thead><tbody>\n";
    for row in &chart.rows {
        let setting = if row.setting.is_empty() { "defaults" } else { &row.setting };
        text += &format!("<tr title=\"{}\">", escaped(&row.command));
        for cell in [&row.model, &row.material, &row.method, setting] {
            text += &format!("<td>{}</td>", escaped(cell));
        }
        for (_, _, cell) in COLUMNS {
            let (shown, key) = cell(row);
            text += &format!("<td data-key=\"{key}\">{shown}</td>");
        }
        text += "</tr>\n";
    }
    text + "</tbody></table>\n<p>A click on a title sorts; a row's command appears under the pointer.</p>\n"
}

/// An SVG document without its prologue.
fn inline(svg: &str) -> &str {
    svg.find("<svg").map_or("", |at| &svg[at..])
}

/// Text as it stands in a page.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:1250px;padding:0 1em;color:#222}\
    table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}\
    th{cursor:pointer;text-align:left;border-bottom:2px solid #444;padding:4px 8px;white-space:nowrap}\
    td{border-bottom:1px solid #ddd;padding:3px 8px;white-space:nowrap;font-variant-numeric:tabular-nums}\
    th.up::after{content:' \\25B2'}th.down::after{content:' \\25BC'}\
    figure{margin:1.5em 0}figure svg{max-width:100%;height:auto}figcaption{color:#555}\
    .triple img{width:32%;max-width:320px;image-rendering:auto;background:#000}code{font-size:12px;overflow-wrap:anywhere}\
    small{color:#777}";

/// The end of a page: the table sorts by the column that is clicked.
pub(in crate::measure) const TAIL: &str = "<script>const table=document.getElementById('rows'),body=table.tBodies[0];\
    const key=(row,i)=>row.cells[i].dataset.key===undefined?row.cells[i].textContent:Number(row.cells[i].dataset.key);\
    table.querySelectorAll('th').forEach((th,i)=>th.addEventListener('click',()=>{\
    const down=th.classList.contains('up');table.querySelectorAll('th').forEach(t=>t.classList.remove('up','down'));\
    th.classList.add(down?'down':'up');const sign=down?-1:1;\
    [...body.rows].sort((a,b)=>{const x=key(a,i),y=key(b,i);return sign*(x<y?-1:x>y?1:0)}).forEach(r=>body.append(r));}));</script>\n</body></html>\n";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_rounded_and_names_left_alone() {
        assert_eq!(
            rounded("directional:from=-0.28555822,0.90625,1:irradiance=3"),
            "directional:from=-0.2856,0.9063,1:irradiance=3"
        );
        assert_eq!(rounded("maps/a-1.hdr:rotate=63"), "maps/a-1.hdr:rotate=63");
        assert_eq!(rounded(""), "");
    }

    #[test]
    fn prologues_are_left_out() {
        assert_eq!(inline("<?xml version=\"1.0\"?><svg>x</svg>"), "<svg>x</svg>");
        assert_eq!(inline("nothing"), "");
    }
}
