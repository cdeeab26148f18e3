//! The files of a growth measurement.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::io::atomic;
use crate::measure::chart::draw::{as_png, as_svg};
use crate::measure::growth::draw::Curves;
use crate::measure::growth::page::page;
use crate::measure::growth::table::csv;
use crate::measure::growth::{Axis, Growth, Quantity};

/// Writes tables, charts and the page; returns the page's path.
pub(crate) fn write(growth: &Growth, folder: &Path) -> Result<PathBuf> {
    let put = |name: &str, bytes: &[u8]| atomic::write(&folder.join(name), bytes);
    let json = serde_json::to_string_pretty(growth).map_err(|e| Error::runtime(format!("growth.json: {e}")))?;
    put("growth.json", format!("{json}\n").as_bytes())?;
    put("growth.csv", csv(&growth.points).as_bytes())?;
    let mut charts = Vec::new();
    for axis in Axis::ALL {
        for quantity in Quantity::ALL {
            let Some(curves) = Curves::of(growth, axis, quantity) else { continue };
            let svg = as_svg(&curves)?;
            put(&format!("{}-{}.svg", axis.name(), quantity.name()), svg.as_bytes())?;
            put(&format!("{}-{}.png", axis.name(), quantity.name()), &as_png(&curves)?)?;
            charts.push((curves.title, svg));
        }
    }
    let path = folder.join("growth.html");
    atomic::write(&path, page(growth, &charts).as_bytes())?;
    Ok(path)
}
