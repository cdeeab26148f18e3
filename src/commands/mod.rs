//! One file for each command: arguments as typed, arguments as resolved, library call, report.

mod bake;
mod baking;
mod chart;
mod compare;
mod completions;
mod console;
mod demo;
mod device;
mod evaluate;
mod inspect;
mod lights;
mod media;
mod methods;
mod model;
mod on_mesh;
mod opening;
mod output;
mod planning;
mod reference;
mod relight;
mod render;
mod validate;
mod view;

use std::ffi::OsString;
use std::io::Write;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Registry;
use crate::report::materials::MaterialsReport;
use console::{Console, Global, in_range};

/// Precompute, inspect, relight and render light transport in translucent meshes.
#[derive(Debug, Parser)]
#[command(name = "translux", version, max_term_width = 110, subcommand_required = true, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Precompute a model and write an asset
    Bake(bake::BakeArgs),
    /// Per-vertex radiosity of an asset under lights, as PLY
    Evaluate(evaluate::EvaluateArgs),
    /// A picture of an asset under lights, as OpenEXR or PNG
    Render(render::RenderArgs),
    /// Turn the lights of an asset in a window, or without one as pictures and timings
    Relight(relight::RelightArgs),
    /// The brute-force truth of a model under lights, as PLY
    Reference(reference::ReferenceArgs),
    /// Sections, bytes, bytes per vertex, error ledger and provenance of an asset
    Inspect(inspect::InspectArgs),
    /// Everything that is wrong with an asset, as numbered findings
    Validate(validate::ValidateArgs),
    /// Speed against accuracy against size: every method at several settings, against one reference
    Chart(chart::ChartArgs),
    /// Compare two PLY or EXR files or two assets
    Compare(compare::CompareArgs),
    /// List the measured materials
    Materials,
    /// List the methods and the keys that --set takes
    Methods(methods::MethodsArgs),
    /// Bake a built-in model under a built-in sky, render it and say what to type next
    Demo(demo::DemoArgs),
    /// Completions for a shell: methods, their keys and the words that these take among them
    Completions(completions::CompletionsArgs),
}

/// Runs the program on its arguments (the first is the program's name) and returns its exit code.
///
/// Errors go to standard error, one line each.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    run_with(crate::methods::built_in(), arguments)
}

/// Runs the program with a registry of other methods and forms.
pub fn run_with(registry: Registry, arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let parsed = command().try_get_matches_from(arguments).and_then(|m| Cli::from_arg_matches(&m));
    let cli = match parsed {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version arrive as errors that are not errors; a closed pipe is nobody's fault.
            let _ = error.print();
            return if error.use_stderr() { ExitCode::CommandLine } else { ExitCode::Ok };
        }
    };
    match dispatch(cli, registry) {
        Ok(code) => code,
        Err(error) => {
            // The exit code tells it too where standard error cannot be written.
            let _ = writeln!(std::io::stderr(), "translux: {error}");
            error.code()
        }
    }
}

/// The command line, with the exit codes in its help.
fn command() -> clap::Command {
    let codes: Vec<String> =
        ExitCode::ALL.iter().map(|(code, meaning)| format!("  {}  {meaning}", *code as u8)).collect();
    Cli::command().after_help(format!("Exit codes:\n{}", codes.join("\n")))
}

fn dispatch(cli: Cli, registry: Registry) -> Result<ExitCode> {
    let console = Console::new(&cli.global, registry)?;
    if let Some(widest) = cli.global.instructions {
        widest.limit();
    }
    let threads = cli.global.threads.map(|threads| in_range("--threads", threads, 1..=4096)).transpose()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|e| Error::runtime(format!("the worker threads could not be started: {e}")))?;
    watch_for_interrupts()?;
    if let Command::Relight(args) = &cli.command {
        return relight::run(args, &console, std::sync::Arc::new(pool)).and_then(|code| console.verdict(code));
    }
    let done = pool.install(|| match cli.command {
        Command::Bake(args) => bake::run(&args, &console),
        Command::Evaluate(args) => evaluate::run(&args, &console),
        Command::Render(args) => render::run(&args, &console),
        Command::Reference(args) => reference::run(&args, &console),
        Command::Inspect(args) => inspect::run(&args, &console),
        Command::Validate(args) => validate::run(&args, &console),
        Command::Chart(args) => chart::run(&args, &console),
        Command::Compare(args) => compare::run(&args, &console),
        Command::Materials => console.show("materials", &MaterialsReport::of_presets()),
        Command::Methods(args) => methods::run(&args, &console),
        Command::Demo(args) => demo::run(&args, &console),
        Command::Completions(args) => completions::run(&args, command(), &console),
        // Has run above: a window must be on the main thread.
        Command::Relight(_) => Ok(ExitCode::Ok),
    });
    done.and_then(|code| console.verdict(code))
}

/// On Ctrl-C and SIGTERM, removes unfinished files and ends the process with 130.
#[expect(clippy::exit, reason = "an interrupt ends the process from a thread of its own")]
fn watch_for_interrupts() -> Result<()> {
    let handler = || {
        crate::io::atomic::remove_unfinished();
        let _ = writeln!(std::io::stderr(), "\ntranslux: interrupted; no file was left unfinished");
        std::process::exit(130);
    };
    match ctrlc::set_handler(handler) {
        Ok(()) | Err(ctrlc::Error::MultipleHandlers) => Ok(()),
        Err(e) => Err(Error::runtime(format!("interrupts cannot be watched: {e}"))),
    }
}

#[cfg(test)]
mod tests {
    use clap_complete::Shell;

    use super::command;

    #[test]
    fn the_command_line_is_consistent() {
        command().debug_assert();
    }

    #[test]
    fn every_shell_knows_commands_methods_and_keys() {
        let registry = crate::methods::built_in();
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::Elvish, Shell::PowerShell] {
            let mut script = Vec::new();
            let mut command = super::completions::with_words(command(), &registry);
            clap_complete::generate(shell, &mut command, "translux", &mut script);
            let script = String::from_utf8_lossy(&script);
            // The scripts of PowerShell and elvish know no values of options; that of fish writes options without dashes.
            let words: &[&str] = match shell {
                Shell::Bash | Shell::Zsh | Shell::Fish => &["bake", "two_pass", "transport=stored", "max-memory"],
                _ => &["bake", "--max-memory"],
            };
            words.iter().for_each(|word| assert!(script.contains(word), "{shell}: {word}"));
        }
    }
}
