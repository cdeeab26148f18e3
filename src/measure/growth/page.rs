//! One self-contained HTML page: findings, exponents, charts, points.

use super::super::chart::page::{TAIL, escaped, figures, head};
use super::draw::{cost_text, exponent, exponent_text, size_text};
use super::{Growing, Growth, KILL, MARGIN, Point, Quantity};

/// A finding, in one sentence.
pub fn finding_text(growing: &Growing) -> String {
    let Growing { axis, method, quantity, end_exponent, explanation, .. } = growing;
    let end = end_exponent.map_or_else(String::new, |e| format!(", {} between the two largest", exponent(e)));
    let why = explanation.as_deref().unwrap_or("not explained");
    let (cost, fitted, size) = (quantity.title(), exponent_text(growing), axis.title());
    format!("{method}: {cost} grows with an exponent of {fitted} in {size}{end}: {why}")
}

/// The page; `charts` are SVG documents with their titles.
pub fn page(growth: &Growth, charts: &[(String, String)]) -> String {
    let samples = growth.fixed_samples.map_or_else(String::new, |n| format!(" and the number of samples, {n}"));
    let mut text = head(["how cost grows", "How cost grows"], &growth.version, &growth.machine);
    text += &format!(
        "<p>The surface is {}, in {}. Every method bakes it at its defaults but for what is varied{samples}; a new light is \
         <code>{}</code>.</p>\n\
         <p>A bake or a new light is not started where its time is predicted from smaller sizes to be above {} (by more than \
         {MARGIN} times), a bake also where its memory is estimated above {}; a bake is ended at {KILL} times that time.</p>\n",
        escaped(&growth.surface),
        escaped(&growth.material),
        escaped(&growth.light),
        cost_text(Quantity::BakeSeconds, growth.limits.seconds),
        cost_text(Quantity::Bytes, growth.limits.memory_bytes as f64),
    );
    text += "<h2>Findings</h2>\n<ul id=\"findings\">";
    for finding in growth.findings() {
        text += &format!("<li>{}</li>\n", escaped(&finding_text(finding)));
    }
    if growth.findings().next().is_none() {
        text += "<li>Nothing grows faster than size.</li>\n";
    }
    text += "</ul>\n";
    text += &skipped(growth);
    text += &exponents(growth);
    text += "<h2>Charts</h2>\n";
    text += &figures(charts);
    text += &points(growth);
    text + TAIL
}

/// The list of points and times that were left out.
fn skipped(growth: &Growth) -> String {
    let line = |p: &Point| {
        let skipped = p.skipped.as_ref()?;
        let (size, what) = (size_text(p.axis, p.size), skipped.what.name());
        Some(format!(
            "<li>{}, {size} {}: {what}: {}</li>\n",
            escaped(&p.method),
            p.axis.unit(),
            escaped(&skipped.reason)
        ))
    };
    let lines: String = growth.points.iter().filter_map(line).collect();
    if lines.is_empty() { String::new() } else { format!("<h2>Not measured</h2>\n<ul id=\"skipped\">{lines}</ul>\n") }
}

fn exponents(growth: &Growth) -> String {
    let mut text = "<h2>Exponents</h2>\n<p>cost = factor &middot; size<sup>exponent</sup>, by least squares in logarithms, with its \
                    standard error. Points below a floor are mostly what every process has, and left out.</p>\n\
                    <table id=\"exponents\"><thead><tr><th>cost</th><th>against</th><th>method</th><th>exponent</th>\
                    <th>points</th><th>between the two largest</th><th>left out</th><th></th></tr></thead><tbody>\n"
        .to_owned();
    for g in &growth.growing {
        let end = g.end_exponent.map_or_else(String::new, exponent);
        let sizes: Vec<String> = g.below_floor.iter().map(|s| size_text(g.axis, *s)).collect();
        let left_out = match sizes.as_slice() {
            [] => String::new(),
            _ => format!("{}: below {}", sizes.join(", "), cost_text(g.quantity, g.quantity.floor())),
        };
        let verdict = if g.finding { "grows faster than size" } else { "" };
        let cells = [
            g.quantity.title(),
            g.axis.title(),
            &g.method,
            &exponent_text(g),
            &g.law.map_or_else(String::new, |law| law.points.to_string()),
            &end,
            &left_out,
            verdict,
        ];
        text += if g.finding { "<tr class=\"finding\">" } else { "<tr>" };
        text += &cells.map(|cell| format!("<td>{}</td>", escaped(cell))).concat();
        text += "</tr>\n";
    }
    text + "</tbody></table>\n"
}

fn points(growth: &Growth) -> String {
    let mut text =
        "<h2>Points</h2>\n<table id=\"rows\"><thead><tr><th>against</th><th>method</th><th>size</th><th>vertices</th>\
                    <th>samples</th><th>mm across</th><th>mean free paths across</th>"
            .to_owned();
    for quantity in Quantity::ALL {
        text += &format!("<th title=\"{}\">{}</th>", escaped(quantity.title()), quantity.name());
    }
    text += "<th>not measured</th></tr></thead><tbody>\n";
    for point in &growth.points {
        text += &format!("<tr title=\"{}\">", escaped(&point.command));
        for cell in [point.axis.title(), &point.method] {
            text += &format!("<td>{}</td>", escaped(cell));
        }
        let samples = point.costs.as_ref().map_or(f64::NAN, |c| c.samples as f64);
        let sizes = [point.size, point.vertices as f64, samples, point.size_mm, point.size_over_mean_free_path];
        for (index, value) in sizes.into_iter().enumerate() {
            // A size as it is, in the unit of its axis; counts in full.
            let shown = match index {
                0 => size_text(point.axis, value),
                1 | 2 if value.is_finite() => format!("{value}"),
                1 | 2 => String::new(),
                _ => super::super::chart::table::number(value),
            };
            text += &cell(&shown, value);
        }
        for quantity in Quantity::ALL {
            let value = quantity.of(point);
            text += &cell(&value.map_or_else(String::new, |v| cost_text(quantity, v)), value.unwrap_or(f64::NAN));
        }
        let reason = point.skipped.as_ref().map_or_else(String::new, |s| format!("{}: {}", s.what.name(), s.reason));
        text += &format!("<td>{}</td></tr>\n", escaped(&reason));
    }
    text + "</tbody></table>\n<p>A click on a title sorts; a point's command appears under the pointer.</p>\n"
}

/// A table cell that sorts by its value; missing values sort last.
fn cell(shown: &str, value: f64) -> String {
    let key = if value.is_finite() { value } else { f64::MAX };
    format!("<td data-key=\"{key}\">{shown}</td>")
}
