//! Remakes figures 5 and 6 and the table of Wang, Tran & Luebke 2005 for `all_frequency`, measures what the paper claims and where
//! the method fails, and writes the page that shows it.
//!
//! ```text
//! cargo run --release --example all_frequency -- DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]
//! ```
//!
//! `DATA` holds `meshes/*.obj` and `env/*`; `DOCS` receives `all_frequency.md` and charts and pictures in `pictures/`. Each part
//! leaves its piece of the page in the folder of the fragments, so that one part can be measured again alone; `--only page` measures
//! nothing. `--quick` takes a minute or two: one small mesh, few lights.

mod bases;
mod bench;
mod coding;
#[path = "../common/mod.rs"]
mod common;
mod failures;
mod figure5;
mod figure6;
mod lights;
mod meshes;
mod page;
mod profile;
mod separable;
mod single;
mod thin;

use self::common::runner::{Page, main as measure};

const PAGE: Page = Page {
    name: "all_frequency",
    parts: &[
        ("table", profile::run),
        ("lights-marble", lights::marble),
        ("lights-skin1", lights::skin1),
        ("bases", bases::run),
        ("coding", coding::run),
        ("figure5", figure5::run),
        ("figure6", figure6::run),
        ("suns", failures::between_texels),
        ("contact", failures::contact),
        ("forward", failures::forward),
        ("thin", thin::run),
        ("open", failures::open_mesh),
    ],
    words: page::WORDS,
};

fn main() {
    measure(&PAGE);
}
