//! One file for each command: arguments as typed, arguments as resolved, library call, report.

mod bake;
mod baking;
mod blame;
mod caching;
mod chart;
mod compare;
mod completions;
mod configuration;
mod console;
mod demo;
mod device;
mod evaluate;
mod exitance;
mod export;
mod failures;
mod fixtures;
mod inspect;
mod interrupts;
mod jobs;
mod light_map;
mod lights;
mod man;
mod many;
mod media;
mod merge;
mod meter;
mod methods;
mod model;
mod on_mesh;
mod opening;
mod output;
mod page;
mod planning;
mod pose_check;
mod rebuild;
mod reference;
mod relight;
mod render;
#[cfg(test)]
mod schemas;
mod shards;
mod sheet;
mod unbaked;
mod validate;
mod view;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::error::{Error, ExitCode, Result};
use crate::evaluate::Registry;
use crate::report::materials::MaterialsReport;
use configuration::{File, Options, Schema};
use console::{Console, Global, in_range, print_line};

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
    /// Put the shards of a bake together (`bake --shard`) and write the asset
    Merge(merge::MergeArgs),
    /// Per-vertex radiosity of an asset under lights, as PLY
    Evaluate(evaluate::EvaluateArgs),
    /// A picture of an asset under lights, as OpenEXR or PNG
    Render(render::RenderArgs),
    /// One picture of several materials, sizes and lights of a model, from one bake
    Sheet(sheet::SheetArgs),
    /// Radiosity or transfer of an asset for engines, as glTF, or as a page with a light that turns
    Export(export::ExportArgs),
    /// Turn the lights of an asset in a window, or without one as pictures and timings
    Relight(relight::RelightArgs),
    /// The brute-force truth of a model under lights, as PLY
    Reference(reference::ReferenceArgs),
    /// Sections, bytes, bytes per vertex, error ledger and provenance of an asset
    Inspect(inspect::InspectArgs),
    /// The error of an asset at a vertex or a pixel, by stage, and what mends it
    Blame(blame::BlameArgs),
    /// How wrong the rest pose's result is in other poses of the object
    PoseCheck(pose_check::PoseCheckArgs),
    /// Everything that is wrong with an asset, as numbered findings
    Validate(validate::ValidateArgs),
    /// Speed against accuracy against size: every method at several settings, against one reference
    Chart(chart::ChartArgs),
    /// Compare two PLY or EXR files or two assets
    Compare(compare::CompareArgs),
    /// List the materials that --material knows by name, measured or chosen by eye
    Materials,
    /// List the methods and the keys that --set takes
    Methods(methods::MethodsArgs),
    /// Bake a built-in model under a built-in sky, render it and say what to type next
    Demo(demo::DemoArgs),
    /// Make what tests keep under `fixtures/` again, or compare it
    Fixtures(fixtures::FixturesArgs),
    /// Completions for a shell: methods, their keys and the words that these take among them
    Completions(completions::CompletionsArgs),
    /// The manual's page of the program or of a command, for `man`
    Man(man::ManArgs),
}

/// What the arguments ask for.
enum Work {
    /// A command as it is typed.
    Typed(Cli),
    /// A bake with options of a file.
    Configured(Cli, File, Options),
    /// The options of a bake, to be printed, and the file that some are from.
    Printed(Cli, Option<File>, Options, String),
    /// Bakes of a list.
    Listed(Global, jobs::List),
}

/// Why arguments ask for nothing that can be done.
enum Refused {
    Parser(clap::Error),
    Other(Error),
}

impl From<clap::Error> for Refused {
    fn from(error: clap::Error) -> Self {
        Self::Parser(error)
    }
}

impl From<Error> for Refused {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

/// Runs the program on its arguments (the first is the program's name) and returns its exit code.
///
/// Errors go to standard error, one line each.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    run_with(crate::methods::built_in(), arguments)
}

/// Runs the program with a registry of other methods and forms.
pub fn run_with(registry: Registry, arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    // Where the command line is wrong nothing else says how errors are wanted.
    let json = arguments.iter().any(|argument| argument == "--json");
    let work = match read(arguments) {
        Ok(work) => work,
        Err(Refused::Parser(error)) => return failures::of_parser(&error, json),
        Err(Refused::Other(error)) => return failures::tell(&error, json),
    };
    let json = json || work.global().json;
    let reported = Arc::new(AtomicBool::new(false));
    let outcome = failures::guarded(|| dispatch(work, registry, Arc::clone(&reported)));
    match outcome {
        Ok(code) => code,
        Err(error) => failures::tell(&error, json && !reported.load(Ordering::Relaxed)),
    }
}

/// The command line, with the exit codes in its help.
fn command() -> clap::Command {
    let codes: Vec<String> =
        ExitCode::ALL.iter().map(|(code, meaning)| format!("  {}  {meaning}", *code as u8)).collect();
    Cli::command().after_help(format!("Exit codes:\n{}", codes.join("\n")))
}

/// The work that arguments ask for, with the options that files give.
fn read(arguments: Vec<OsString>) -> std::result::Result<Work, Refused> {
    let parsed = |arguments: &[OsString]| {
        let matches = command().try_get_matches_from(arguments)?;
        Cli::from_arg_matches(&matches).map(|cli| (cli, matches))
    };
    if !configuration::are_wanted(&arguments) {
        return Ok(Work::Typed(parsed(&arguments)?.0));
    }
    // What a file has need not be typed.
    let mut open = command().mut_subcommand("bake", |bake| bake.mut_args(|arg| arg.required(false)));
    let matches = open.try_get_matches_from_mut(&arguments)?;
    let Some(("bake", of_bake)) = matches.subcommand() else { return Ok(Work::Typed(parsed(&arguments)?.0)) };
    open.build();
    let Some(bake) = open.find_subcommand("bake") else { return Ok(Work::Typed(parsed(&arguments)?.0)) };
    let schema = Schema::new(bake);
    let typed = schema.typed(of_bake);
    let path = |key: &str| of_bake.get_one::<PathBuf>(key);
    if let Some(list) = path("jobs") {
        let parse = |options: &Options| match parsed(&schema.arguments(options))?.0 {
            Cli { command: Command::Bake(args), global } => Ok((args, global.strict)),
            _ => Err(command().error(ErrorKind::InvalidSubcommand, "a list is of bakes")),
        };
        let list = jobs::read(list, &typed, &schema, parse)?;
        return Ok(Work::Listed(Global::from_arg_matches(&matches)?, list));
    }
    let (file, options) = match path("config") {
        Some(path) => {
            let file = File::read(path)?;
            let of_file = schema.of_table(&file, &file.parse()?, |_| None)?;
            let options = schema.over(&typed, &of_file);
            (Some(file), options)
        }
        None => (None, typed),
    };
    let (mut cli, matches) = parsed(&schema.arguments(&options)).map_err(|error| {
        let located = file.as_ref().and_then(|file| file.of_parser(&error, &options));
        located.map_or(Refused::Parser(error), Refused::Other)
    })?;
    if let Command::Bake(args) = &mut cli.command
        && args.shards.shard.is_some()
    {
        args.shards.options = schema.to_toml(&schema.without(&options, &shards::OF_THE_PROCESS))?;
    }
    match (file, matches.subcommand()) {
        (file, Some((_, all))) if of_bake.get_flag("print_config") => {
            let text = schema.to_toml(&schema.complete(all))?;
            Ok(Work::Printed(cli, file, options, text))
        }
        (Some(file), _) => Ok(Work::Configured(cli, file, options)),
        (None, _) => Ok(Work::Typed(cli)),
    }
}

/// The arguments of a bake from options that a file keeps, with another output.
fn kept_bake(path: &Path, options: String, output: &Path) -> Result<bake::BakeArgs> {
    let mut open = command();
    open.build();
    let Some(bake) = open.find_subcommand("bake") else { return Err(Error::runtime("there is no bake")) };
    let schema = Schema::new(bake);
    let file = File::of(path, options);
    let options = schema.of_table(&file, &file.parse()?, |_| None)?;
    let mut words = schema.arguments(&options);
    let mut word = OsString::from("--output=");
    word.push(output);
    words.insert(2, word);
    let matches = command().try_get_matches_from(words);
    match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(Cli { command: Command::Bake(args), .. }) => Ok(args),
        Ok(_) => Err(Error::runtime("the options are not of a bake")),
        Err(error) => Err(Error::input(configuration::parser_message(&error)).in_file(path)),
    }
}

impl Work {
    fn global(&self) -> &Global {
        match self {
            Self::Typed(cli) | Self::Configured(cli, ..) | Self::Printed(cli, ..) => &cli.global,
            Self::Listed(global, _) => global,
        }
    }
}

/// Does the work; `reported` becomes true where it printed a report.
fn dispatch(work: Work, registry: Registry, reported: Arc<AtomicBool>) -> Result<ExitCode> {
    interrupts::watch()?;
    let global = work.global().clone();
    let console = Console::new(&global, registry, reported)?;
    if let Some(widest) = global.instructions {
        widest.limit();
    }
    let threads = global.threads.map(|threads| in_range("--threads", threads, 1..=4096)).transpose()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .build()
        .map_err(|e| Error::runtime(format!("the worker threads could not be started: {e}")))?;
    match work {
        Work::Typed(cli) => run_command(cli, &console, pool),
        Work::Configured(cli, file, options) => run_command(cli, &console, pool).map_err(|e| file.located(e, &options)),
        Work::Printed(Cli { command: Command::Bake(args), .. }, file, options, text) => {
            let checked = bake::check(&args, &console);
            checked.map_err(|e| file.map_or(e.clone(), |file| file.located(e, &options)))?;
            print_line(text.trim_end())?;
            Ok(ExitCode::Ok)
        }
        Work::Printed(..) => Ok(ExitCode::Ok),
        Work::Listed(_, list) => pool.install(|| jobs::run(&list, &console)),
    }
}

/// Runs a command.
fn run_command(cli: Cli, console: &Console, pool: rayon::ThreadPool) -> Result<ExitCode> {
    if let Command::Relight(args) = &cli.command {
        return relight::run(args, console, Arc::new(pool)).and_then(|code| console.verdict(code));
    }
    let done = pool.install(|| match cli.command {
        Command::Bake(args) => bake::run(&args, console),
        Command::Merge(args) => merge::run(&args, kept_bake, console),
        Command::Evaluate(args) => evaluate::run(&args, console),
        Command::Render(args) => render::run(&args, console),
        Command::Sheet(args) => sheet::run(&args, console),
        Command::Export(args) => export::run(&args, console),
        Command::Reference(args) => reference::run(&args, console),
        Command::Inspect(args) => inspect::run(&args, console),
        Command::Blame(args) => blame::run(&args, console),
        Command::PoseCheck(args) => pose_check::run(&args, console),
        Command::Validate(args) => validate::run(&args, console),
        Command::Chart(args) => chart::run(&args, console),
        Command::Compare(args) => compare::run(&args, console),
        Command::Materials => console.show("materials", &MaterialsReport::of_presets()),
        Command::Methods(args) => methods::run(&args, console),
        Command::Demo(args) => demo::run(&args, console),
        Command::Fixtures(args) => fixtures::run(&args, console),
        Command::Completions(args) => completions::run(&args, command(), console),
        Command::Man(args) => man::run(&args, command(), console),
        // Has run above: a window must be on the main thread.
        Command::Relight(_) => Ok(ExitCode::Ok),
    });
    done.and_then(|code| console.verdict(code))
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
