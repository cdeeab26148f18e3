//! A method outside the crate, from one file: `cargo run --release --example toy_method -- bake MODEL --method toy_method ...` is
//! the whole program with one method more.

mod method;

use std::process::ExitCode;

fn main() -> ExitCode {
    let registry = translux::methods::built_in().with_method(&method::ToyMethod);
    ExitCode::from(translux::commands::run_with(registry, std::env::args_os()) as u8)
}
