//! The `translux` program: parse, run, map the error to an exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(translux::commands::run(std::env::args_os()) as u8)
}
