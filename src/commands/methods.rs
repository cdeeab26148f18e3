//! `translux methods [NAME]`.

use clap::Args;
use serde::Serialize;

use super::console::{Console, Format, percent};
use super::{output, report};
use crate::error::{ExitCode, Result};
use crate::evaluate::Method;
use crate::methods;

#[derive(Clone, Debug, Args)]
pub(super) struct MethodsArgs {
    /// Show this method only
    name: Option<String>,
}

#[derive(Serialize)]
struct MethodsReport {
    methods: Vec<MethodRow>,
}

#[derive(Serialize)]
struct MethodRow {
    name: &'static str,
    summary: &'static str,
    /// Relative error that a bake aims at without `--max-rms`.
    default_max_rms: f64,
    keys: Vec<KeyRow>,
}

#[derive(Serialize)]
struct KeyRow {
    name: &'static str,
    default: &'static str,
    help: &'static str,
}

impl MethodRow {
    fn of(method: &dyn Method) -> Self {
        let keys = method.keys().iter().map(|k| KeyRow { name: k.name, default: k.default, help: k.help }).collect();
        Self { name: method.name(), summary: method.summary(), default_max_rms: method.default_max_rms(), keys }
    }
}

pub(super) fn run(args: &MethodsArgs, console: &Console) -> Result<ExitCode> {
    let rows: Vec<MethodRow> = match &args.name {
        Some(name) => vec![MethodRow::of(methods::named(name)?)],
        None => methods::ALL.into_iter().map(MethodRow::of).collect(),
    };
    if console.format == Format::Text {
        for row in &rows {
            output::print_line(&format!("{}: {}", row.name, row.summary))?;
            let aim = ["  --max-rms", &percent(row.default_max_rms), "relative error that a bake aims at"];
            let keys = row.keys.iter().map(|k| [format!("  --set {}=", k.name), k.default.into(), k.help.into()]);
            let lines: Vec<[String; 3]> = [aim.map(str::to_owned)].into_iter().chain(keys).collect();
            output::print_line(&output::table(&lines))?;
        }
    }
    report::print(console, "methods", &MethodsReport { methods: rows })?;
    Ok(ExitCode::Ok)
}
