//! Small tables of one key column and three channels; errors name the line.

use std::path::Path;

use crate::error::{Error, Result};
use crate::medium::toml_text::read_text;

/// A line of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Row {
    /// Line in the file, from 1.
    pub line: usize,
    /// First column, finite.
    pub key: f64,
    /// The other columns, finite.
    pub rgb: [f64; 3],
}

/// Rows of the file, whose header must be `key,r,g,b`. Blank lines and comments after a `#` are skipped.
pub(super) fn read(path: &Path, key: &str) -> Result<Vec<Row>> {
    let text = read_text(path, "table of a profile", 4)?;
    parse(&text, &path.display().to_string(), key)
}

/// Like [`read`] for a text; `place` names it in errors.
pub(super) fn parse(text: &str, place: &str, key: &str) -> Result<Vec<Row>> {
    let header = [key, "r", "g", "b"];
    let mut rows = Vec::new();
    let mut seen_header = false;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    for (index, line) in text.lines().enumerate() {
        let number = index + 1;
        let fail = |what: String| Error::input(what).at(format!("{place}:{number}"));
        let content = line.split('#').next().unwrap_or("").trim();
        if content.is_empty() {
            continue;
        }
        let fields: Vec<&str> = content.split(',').map(str::trim).collect();
        if !seen_header {
            if !(fields.len() == 4 && fields.iter().zip(header).all(|(got, want)| got.eq_ignore_ascii_case(want))) {
                return Err(fail(format!("the first line must be the header `{}`", header.join(","))));
            }
            seen_header = true;
            continue;
        }
        let &[first, r, g, b] = fields.as_slice() else {
            return Err(fail(format!("{} columns; there must be 4: {}", fields.len(), header.join(","))));
        };
        let value = |name: &str, text: &str| match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(fail(format!("`{text}` in column {name} is not a finite number"))),
        };
        let rgb = [value("r", r)?, value("g", g)?, value("b", b)?];
        rows.push(Row { line: number, key: value(key, first)?, rgb });
    }
    if !seen_header {
        return Err(Error::input(format!("empty; it must start with the header `{}`", header.join(","))).at(place));
    }
    Ok(rows)
}
