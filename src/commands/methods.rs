//! `translux methods [NAME]`.

use clap::Args;

use super::console::Console;
use super::planning::AUTO;
use crate::error::{Error, ExitCode, Result};
use crate::report::methods::{MethodsReport, Shown};

#[derive(Clone, Debug, Args)]
pub(super) struct MethodsArgs {
    /// Show this method only, with the keys that everybody needs
    name: Option<String>,
    /// Every key, those for experts among them
    #[arg(long)]
    all: bool,
}

pub(super) fn run(args: &MethodsArgs, console: &Console) -> Result<ExitCode> {
    let shown = match (args.all, &args.name) {
        (true, _) => Shown::All,
        (false, Some(_)) => Shown::Everyday,
        (false, None) => Shown::NoKeys,
    };
    if args.name.as_deref() == Some(AUTO) {
        return Err(Error::command_line(
            "methods auto: that is no method but the choice among them; `translux bake --help` says what it can be asked for, and              `translux inspect` of its asset what it chose and why",
        ));
    }
    let report = match &args.name {
        Some(name) => MethodsReport::of(&[console.registry.method(name)?], shown),
        None => MethodsReport::of(console.registry.methods(), shown),
    };
    console.show("methods", &report)
}
