//! Parts of a page: each is measured alone and leaves a piece of the page in a folder; the page is put together from them.

use std::path::PathBuf;
use std::time::Instant;

use translux::error::{Error, Result};
use translux::io::atomic;

use super::bench::Context;

/// A part of a page: its name and what measures it.
pub(crate) type Part = (&'static str, fn(&Context) -> Result<String>);

/// A page: its name, the parts in their order, and what makes it from their text.
pub(crate) struct Page {
    pub(crate) name: &'static str,
    pub(crate) parts: &'static [Part],
    pub(crate) words: Words,
}

/// What a page says around what was measured.
pub(crate) struct Words {
    /// Before all parts, up to the head of the first table.
    pub(crate) head: &'static str,
    /// Before each part.
    pub(crate) before: &'static [(&'static str, &'static str)],
    /// What stands for marks in the text of the parts.
    pub(crate) places: &'static [(&'static str, &'static str)],
    /// After all parts.
    pub(crate) tail: &'static str,
}

/// No part: the page alone, from what was measured before.
const PAGE: &str = "page";

/// Marks a row of the page's first table in a part's text.
const SUMMARY: &str = "@summary ";

/// A row of the page's first table: a figure, what the paper says, what is wanted here, what was measured.
pub(crate) fn summary(figure: &str, paper: &str, wanted: &str, measured: &str) -> String {
    format!("{SUMMARY}| {figure} | {paper} | {wanted} | {measured} |\n")
}

impl Words {
    /// The page from the text of its parts.
    fn assembled(&self, parts: &[(&str, String)]) -> String {
        let mut page = self.head.to_owned();
        let rows = parts.iter().flat_map(|(_, text)| text.lines()).filter_map(|line| line.strip_prefix(SUMMARY));
        rows.for_each(|row| page.extend([row, "\n"]));
        for (name, text) in parts {
            page.push_str(self.before.iter().find(|(part, _)| part == name).map_or("", |(_, before)| before));
            let mut text: String =
                text.lines().filter(|line| !line.starts_with(SUMMARY)).flat_map(|l| [l, "\n"]).collect();
            for (mark, words) in self.places {
                text = text.replace(mark, words);
            }
            page.push_str(text.trim());
            page.push('\n');
        }
        page.push_str(self.tail);
        page
    }
}

/// Measures what the command line asks for; the exit code of the process.
pub(crate) fn main(page: &Page) {
    if let Err(error) = run(page) {
        eprintln!("{}: {}", page.name, error.message());
        std::process::exit(1);
    }
}

fn run(page: &Page) -> Result<()> {
    let name = page.name;
    let usage = format!("usage: {name} DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]");
    let (mut folders, mut only, mut quick) = (Vec::new(), Vec::new(), false);
    let mut fragments = PathBuf::from("target").join(name);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| Error::command_line(usage.clone()));
        match argument.as_str() {
            "--quick" => quick = true,
            "--only" => only.push(value()?),
            "--fragments" => fragments = PathBuf::from(value()?),
            flag if flag.starts_with('-') => return Err(Error::command_line(format!("{flag}: {usage}"))),
            folder => folders.push(PathBuf::from(folder)),
        }
    }
    let Ok([data, docs]) = <[PathBuf; 2]>::try_from(folders) else { return Err(Error::command_line(usage)) };
    let names: Vec<&str> = page.parts.iter().map(|(part, _)| *part).chain([PAGE]).collect();
    if let Some(name) = only.iter().find(|name| !names.contains(&name.as_str())) {
        return Err(Error::command_line(format!("no part `{name}`; there are {}", names.join(", "))));
    }
    let path = docs.join(format!("{name}.md"));
    let fragment = |part: &str| fragments.join(format!("{part}.md"));
    let is_asked = |part: &str| only.is_empty() || only.iter().any(|o| o == part);
    // Told before the work: the page that is there would lose what was measured of them.
    let lost = page.parts.iter().map(|(part, _)| *part).filter(|part| !is_asked(part) && !fragment(part).is_file());
    let lost: Vec<&str> = lost.collect();
    if path.is_file() && !lost.is_empty() {
        return Err(Error::command_line(format!(
            "{} would lose {}, of which {} has no text: measure them as well, all parts without --only, or write to a folder without that page",
            path.display(),
            lost.join(", "),
            fragments.display()
        )));
    }
    let pictures = docs.join("pictures");
    for folder in [&fragments, &pictures] {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, &e))?;
    }
    let context = Context { data, pictures, quick, start: Instant::now() };
    let mut pieces = Vec::new();
    for (part, measure) in page.parts {
        if is_asked(part) {
            atomic::write(&fragment(part), measure(&context)?.as_bytes())?;
            context.say(&format!("{part}: done"));
        }
        let piece = std::fs::read_to_string(fragment(part)).unwrap_or_else(|_| "(Not measured.)\n".to_owned());
        pieces.push((*part, piece));
    }
    atomic::write(&path, page.words.assembled(&pieces).as_bytes())
}
