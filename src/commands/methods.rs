//! `translux methods [NAME]`.

use clap::Args;
use serde::Serialize;

use super::console::{Console, Format, percent};
use super::{output, report};
use crate::error::{ExitCode, Result};
use crate::evaluate::Method;
use crate::evaluate::keys::{AnyKey, Audience};

#[derive(Clone, Debug, Args)]
pub(super) struct MethodsArgs {
    /// Show this method only, with the keys that everybody needs
    name: Option<String>,
    /// Every key, those for experts among them
    #[arg(long)]
    all: bool,
}

#[derive(Serialize)]
struct MethodsReport {
    methods: Vec<MethodRow>,
}

#[derive(Serialize)]
struct MethodRow {
    name: &'static str,
    summary: &'static str,
    choose_when: &'static str,
    /// Relative error that a bake aims at without `--max-rms`.
    default_max_rms: f64,
    keys: Vec<KeyRow>,
}

#[derive(Serialize)]
struct KeyRow {
    name: &'static str,
    default: &'static str,
    /// What it may be, in words.
    values: String,
    /// Values that are words.
    words: Vec<&'static str>,
    audience: Audience,
    help: &'static str,
}

impl KeyRow {
    fn of(key: &dyn AnyKey) -> Self {
        Self {
            name: key.name(),
            default: key.default(),
            values: key.values(),
            words: key.words(),
            audience: key.audience(),
            help: key.help(),
        }
    }
}

impl MethodRow {
    fn of(method: &dyn Method) -> Self {
        Self {
            name: method.name(),
            summary: method.summary(),
            choose_when: method.choose_when(),
            default_max_rms: method.default_max_rms(),
            keys: method.keys().iter().map(|key| KeyRow::of(*key)).collect(),
        }
    }

    /// The keys as a table, without those for experts unless they are asked for.
    fn table(&self, all: bool) -> Vec<[String; 3]> {
        let aim = ["  --max-rms", &percent(self.default_max_rms), "relative error that a bake aims at"];
        let shown = self.keys.iter().filter(|key| all || key.audience == Audience::Everyday);
        let line = |key: &KeyRow| {
            let help = format!("{} ({})", key.help, key.values);
            [format!("  --set {}=", key.name), key.default.to_owned(), help]
        };
        [aim.map(str::to_owned)].into_iter().chain(shown.map(line)).collect()
    }
}

pub(super) fn run(args: &MethodsArgs, console: &Console) -> Result<ExitCode> {
    let rows: Vec<MethodRow> = match &args.name {
        Some(name) => vec![MethodRow::of(console.registry.method(name)?)],
        None => console.registry.methods().iter().map(|method| MethodRow::of(*method)).collect(),
    };
    if console.format == Format::Text {
        for row in &rows {
            output::print_line(&format!("{}: {}\n  {}", row.name, row.summary, row.choose_when))?;
            if args.name.is_some() || args.all {
                output::print_line(&output::table(&row.table(args.all)))?;
            }
            let hidden = row.keys.iter().filter(|key| key.audience == Audience::Expert).count();
            if args.name.is_some() && !args.all && hidden > 0 {
                output::print_line(&format!("  {hidden} more for experts: translux methods {} --all", row.name))?;
            }
        }
        if args.name.is_none() && !args.all {
            output::print_line("keys of a method: translux methods NAME")?;
        }
    }
    report::print(console, "methods", &MethodsReport { methods: rows })?;
    Ok(ExitCode::Ok)
}
