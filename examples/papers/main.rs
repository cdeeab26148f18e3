//! What the papers have to the letter, where something better took its place: `cargo run --release --example papers -- bake MODEL
//! --method hao_varshney --set encoding=lloyd8 ...` is the whole program with these methods and forms; `methods hao_varshney --all` lists their keys.

mod hao;

#[cfg(test)]
#[path = "../../tests/in_memory/mod.rs"]
mod in_memory;
#[cfg(test)]
#[path = "../../tests/oracle/mod.rs"]
mod oracle;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(translux::commands::run_with(hao::registry(), std::env::args_os()) as u8)
}
