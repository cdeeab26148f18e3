//! Remakes figures 3 to 5 and tables 1 and 2 of Wang et al. 2008 for `editable`, and the page that shows them.
//!
//! ```text
//! cargo run --release --example editable -- DATA DOCS [--quick] [--only PART]... [--fragments FOLDER]
//! ```
//!
//! `DATA` holds `meshes/*.obj`; `DOCS` receives `editable.md` and charts and pictures in `pictures/`. Each part leaves its piece of
//! the page in the folder of the fragments, so that one part can be measured again alone; `--only page` measures nothing. `--quick`
//! takes a few minutes: one small mesh, few materials.

mod bench;
mod cdf97;
#[path = "../common/mod.rs"]
mod common;
mod environment;
mod fields;
mod figure3;
mod figure4;
mod figure5;
mod geometry_image;
mod page;
mod profiles;
mod spatial;
mod surface_wavelet;
mod tables;
mod together;
mod transfer;

use self::common::runner::{Page, main as measure};

const PAGE: Page = Page {
    name: "editable",
    parts: &[
        ("tables", tables::run),
        ("together", together::run),
        ("figure3", figure3::run),
        ("figure4", figure4::run),
        ("figure5", figure5::run),
        ("spatial", spatial::run),
        ("transfer", transfer::run),
        ("environment", environment::run),
        ("profiles", profiles::run),
        ("fields", fields::run),
    ],
    words: page::WORDS,
};

fn main() {
    measure(&PAGE);
}
