//! A form outside the crate, and a method that chooses it: `cargo run --release --example toy_form -- bake MODEL --method toy_form ...`
//! is the whole program with both.

mod form;

use std::process::ExitCode;

fn main() -> ExitCode {
    let registry = translux::methods::built_in().with_form(form::ENTRY).with_method(&form::ToyForm);
    ExitCode::from(translux::commands::run_with(registry, std::env::args_os()) as u8)
}
