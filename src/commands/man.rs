//! `translux man [COMMAND]`.

use std::path::{Path, PathBuf};

use clap::{Args, Command};
use clap_mangen::Man;

use super::console::{Console, print_line};
use crate::error::{Error, ExitCode, Result};
use crate::io::atomic;

#[derive(Clone, Debug, Args)]
pub(super) struct ManArgs {
    /// Page of this command in place of that of the program
    command: Option<String>,
    /// Folder for the pages of the program and of all its commands, in place of printing one
    #[arg(short, long, value_name = "DIR", conflicts_with = "command")]
    output: Option<PathBuf>,
}

/// Prints a page, or writes all of them; `command` is the whole command line.
pub(super) fn run(args: &ManArgs, command: Command, console: &Console) -> Result<ExitCode> {
    let mut command = command.disable_help_subcommand(true);
    command.build();
    if let Some(folder) = &args.output {
        return write(folder, &command, console);
    }
    let page = match &args.command {
        Some(name) => command.find_subcommand(name).ok_or_else(|| {
            let names: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
            Error::command_line(format!("man {name}: there are pages of {}", names.join(", ")))
        })?,
        None => &command,
    };
    print_line(render(page)?.trim_end())?;
    Ok(ExitCode::Ok)
}

/// Writes all pages into a folder, which is made where it is not there.
fn write(folder: &Path, command: &Command, console: &Console) -> Result<ExitCode> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
    for page in std::iter::once(command).chain(command.get_subcommands()) {
        let path = folder.join(Man::new(page.clone()).get_filename());
        atomic::write(&path, render(page)?.as_bytes())?;
        console.say(&path.display().to_string())?;
    }
    Ok(ExitCode::Ok)
}

/// A page as roff.
fn render(command: &Command) -> Result<String> {
    let mut page = Vec::new();
    let fail = |e: &dyn std::fmt::Display| Error::runtime(format!("man: {e}"));
    Man::new(command.clone()).render(&mut page).map_err(|e| fail(&e))?;
    String::from_utf8(page).map_err(|e| fail(&e))
}
