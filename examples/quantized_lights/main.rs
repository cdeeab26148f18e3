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
#[path = "../common/mod.rs"]
mod common;
mod components;
mod encodings;
mod figure11;
mod figure5;
mod figure9;
#[path = "../papers/hao/mod.rs"]
mod hao;
mod page;
mod sweep;
mod views;

use self::common::runner::{Page, main as measure};

const PAGE: Page = Page {
    name: "quantized_lights",
    parts: &[
        ("figure5", figure5::run),
        ("encodings", encodings::run),
        ("figure9", figure9::run),
        ("figure11", figure11::run),
        ("sweep", sweep::run),
        ("components", components::run),
    ],
    words: page::WORDS,
};

fn main() {
    measure(&PAGE);
}
