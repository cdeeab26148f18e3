//! Remakes figures 5, 9 and 11 and Table I of Hao & Varshney 2004 for `quantized_lights`, and the page that shows them.
//!
//! ```text
//! cargo run --release --example quantized_lights -- DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]
//! ```
//!
//! `DATA` holds `meshes/*.obj`; `DOCS` receives `quantized_lights.md` and charts and pictures in `pictures/`. Each part leaves its
//! piece of the page in the folder of the fragments, so that one part can be measured again alone; `--only page` measures nothing.
//! `--quick` takes a minute or two: one small mesh, few lights and views.

mod bench;
mod components;
mod encodings;
mod figure11;
mod figure5;
mod figure9;
mod page;
mod sweep;
mod views;

use std::path::PathBuf;
use std::time::Instant;

use translux::error::{Error, Result};
use translux::io::atomic;

use self::bench::Context;

/// A part of the page: its name and what measures it.
type Part = (&'static str, fn(&Context) -> Result<String>);

const PARTS: &[Part] = &[
    ("figure5", figure5::run),
    ("encodings", encodings::run),
    ("figure9", figure9::run),
    ("figure11", figure11::run),
    ("sweep", sweep::run),
    ("components", components::run),
];

/// No part: the page alone, from what was measured before.
const PAGE: &str = "page";

const USAGE: &str = "usage: quantized_lights DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]";

fn main() {
    if let Err(error) = run() {
        eprintln!("quantized_lights: {}", error.message());
        std::process::exit(1);
    }
}

fn run() -> Result<()> {
    let (mut folders, mut only, mut quick) = (Vec::new(), Vec::new(), false);
    let mut fragments = PathBuf::from("target/quantized_lights");
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| Error::command_line(USAGE));
        match argument.as_str() {
            "--quick" => quick = true,
            "--only" => only.push(value()?),
            "--fragments" => fragments = PathBuf::from(value()?),
            flag if flag.starts_with('-') => return Err(Error::command_line(format!("{flag}: {USAGE}"))),
            folder => folders.push(PathBuf::from(folder)),
        }
    }
    let Ok([data, docs]) = <[PathBuf; 2]>::try_from(folders) else { return Err(Error::command_line(USAGE)) };
    let names: Vec<&str> = PARTS.iter().map(|(part, _)| *part).chain([PAGE]).collect();
    if let Some(name) = only.iter().find(|name| !names.contains(&name.as_str())) {
        return Err(Error::command_line(format!("no part `{name}`; there are {}", names.join(", "))));
    }
    let pictures = docs.join("pictures");
    for folder in [&fragments, &pictures] {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
    }
    let context = Context { data, pictures, quick, start: Instant::now() };
    let mut pieces = Vec::new();
    for (name, measure) in PARTS {
        let path = fragments.join(format!("{name}.md"));
        if only.is_empty() || only.iter().any(|o| o == name) {
            atomic::write(&path, measure(&context)?.as_bytes())?;
            context.say(&format!("{name}: done"));
        }
        let piece = std::fs::read_to_string(&path).unwrap_or_else(|_| "(Not measured.)\n".to_owned());
        pieces.push((*name, piece));
    }
    atomic::write(&docs.join("quantized_lights.md"), page::assembled(&pieces).as_bytes())
}
