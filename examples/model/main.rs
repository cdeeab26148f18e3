//! Measures the calibrated kernel against the volume and writes its page.
//!
//! ```text
//! cargo run --release --example model -- DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]
//! ```
//!
//! `DATA` holds `meshes/*.obj`, and beside it `truth/volumetric/`; `DOCS` receives `model.md` and pictures in `pictures/`.

#[path = "../common/mod.rs"]
mod common;
mod page;
mod pictures;
mod truth;
mod unseen;

use self::common::runner::{Page, main as measure};

const PAGE: Page = Page {
    name: "model",
    parts: &[("truth", truth::run), ("unseen", unseen::run), ("pictures", pictures::run)],
    words: page::WORDS,
};

fn main() {
    measure(&PAGE);
}
