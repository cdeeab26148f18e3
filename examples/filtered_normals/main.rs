//! Measures `filtered_normals` (Patro 2007) and writes its page: errors beside its nearest rival, the paper's Figure 2, times.
//!
//! ```text
//! cargo run --release --example filtered_normals -- DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]
//! ```
//!
//! `DATA` holds `meshes/*.obj`; `DOCS` receives `filtered_normals.md` and pictures in `pictures/`.

mod bench;
#[path = "../common/mod.rs"]
mod common;
mod errors;
mod figure2;
mod page;
mod speed;

use self::common::runner::{Page, main as measure};

const PAGE: Page = Page {
    name: "filtered_normals",
    parts: &[("errors", errors::run), ("figure2", figure2::run), ("speed", speed::run)],
    words: page::WORDS,
};

fn main() {
    measure(&PAGE);
}
