//! Measures `texture_space` (Chang et al. 2008) and writes its page: errors by number of samples, the hybrid method, maps, speed, pictures.
//!
//! ```text
//! cargo run --release --example texture_space -- DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]
//! ```
//!
//! `DATA` holds `meshes/*.obj`; `DOCS` receives `texture_space.md` and pictures in `pictures/`.

mod bench;
#[path = "../common/mod.rs"]
mod common;
mod hybrid;
mod maps;
mod page;
mod pictures;
mod reuse;
mod samples;
mod speed;

use self::common::runner::{Page, main as measure};

const PAGE: Page = Page {
    name: "texture_space",
    parts: &[
        ("samples", samples::run),
        ("hybrid", hybrid::run),
        ("maps", maps::run),
        ("speed", speed::run),
        ("reuse", reuse::run),
        ("pictures", pictures::run),
    ],
    words: page::WORDS,
};

fn main() {
    measure(&PAGE);
}
