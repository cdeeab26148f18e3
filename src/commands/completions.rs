//! `translux completions SHELL`.

use clap::Args;
use clap::builder::PossibleValuesParser;
use clap_complete::Shell;

use super::console::{Console, print_line};
use super::planning::AUTO;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Registry;
use crate::evaluate::keys::AnyKey;

#[derive(Clone, Debug, Args)]
pub(super) struct CompletionsArgs {
    /// The shell; its own manual says where it looks for the script that is printed
    shell: Shell,
}

/// Prints the completions; `command` is the whole command line.
pub(super) fn run(args: &CompletionsArgs, command: clap::Command, console: &Console) -> Result<ExitCode> {
    let mut command = with_words(command, &console.registry);
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "translux", &mut script);
    let script = String::from_utf8(script).map_err(|e| Error::runtime(format!("completions: {e}")))?;
    print_line(script.trim_end())?;
    Ok(ExitCode::Ok)
}

/// Completions of `--set`: each key with each of its words, or with its default where it takes numbers.
fn settings(registry: &Registry) -> Vec<String> {
    let keys = registry.methods().iter().flat_map(|method| method.keys());
    let of_key = |key: &&dyn AnyKey| {
        let words = if key.words().is_empty() { vec![key.default()] } else { key.words() };
        let name = key.name();
        words.into_iter().map(move |word| format!("{name}={word}")).collect::<Vec<_>>()
    };
    let mut all: Vec<String> = keys.flat_map(of_key).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// The command line with the names of methods and keys as values: for scripts alone, since other values are valid too.
pub(super) fn with_words(command: clap::Command, registry: &Registry) -> clap::Command {
    let methods: Vec<&'static str> = registry.methods().iter().map(|method| method.name()).collect();
    let settings = settings(registry);
    let has = |command: &clap::Command, id: &str| command.get_arguments().any(|arg| arg.get_id() == id);
    command.mut_subcommands(|mut command| {
        if has(&command, "set") {
            command = command.mut_arg("set", |arg| arg.value_parser(PossibleValuesParser::new(settings.clone())));
        }
        for id in ["method", "methods"].into_iter().filter(|id| has(&command, id)).collect::<Vec<_>>() {
            let auto = (command.get_name() == "bake").then_some(AUTO);
            let names: Vec<&str> = auto.into_iter().chain(methods.iter().copied()).collect();
            command = command.mut_arg(id, |arg| arg.value_parser(PossibleValuesParser::new(names)));
        }
        if command.get_name() == "methods" {
            command = command.mut_arg("name", |arg| arg.value_parser(PossibleValuesParser::new(methods.clone())));
        }
        command
    })
}
