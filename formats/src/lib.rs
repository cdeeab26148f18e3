//! The `.tlux` asset: bytes to plain arrays and back, for engines that read baked assets.
//!
//! A file is a list of checksummed sections, each an array of rows (say `f32 x 3`) or a small record. [`Reader`] and
//! [`Writer`] handle sections; [`AssetFile`] is the typed content that all methods share. `SPEC.md` beside this crate
//! describes every byte and the conventions (mm, linear sRGB, +Y up, cube-map faces).
//!
//! A reader trusts nothing: it has a [`Budget`], checks every length before it takes memory, verifies checksums, and
//! answers any bytes with a value or a [`FormatError`], never with a panic.
//!
//! # Features
//!
//! `zstd`, the default, compresses and decompresses by the library of the format's authors, in C. With `--no-default-features --features
//! ruzstd` the crate decompresses in Rust alone, about five times slower, and builds for `wasm32-unknown-unknown`; writing compressed sections
//! is an error then. Without both only sections that are stored as they are can be read.
//!
//! # Example
//!
//! ```
//! use translux_format::{AssetFile, Budget, Mesh, Parts, Reader, Samples, mesh};
//!
//! let triangle = Mesh {
//!     positions_mm: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
//!     triangles: vec![[0, 1, 2]],
//!     triangle_material: vec![0],
//!     materials: vec!["default".into()],
//!     weld: vec![0, 1, 2],
//!     ..Default::default()
//! };
//! let parts = Parts { triangle_part: vec![translux_format::NO_PART], ..Default::default() };
//! let asset = AssetFile { mesh: triangle, parts, samples: Samples::none(0), ..Default::default() };
//! let bytes = asset.to_bytes()?;
//!
//! let reader = Reader::parse(&bytes, Budget::default())?;
//! for section in reader.sections() {
//!     println!("{:8} {} x {}: {} rows", section.tag, section.element, section.components, section.rows());
//! }
//! let positions: Vec<[f32; 3]> = reader.array(mesh::tags::POSITIONS)?;
//! assert_eq!(positions[1], [1.0, 0.0, 0.0]);
//! # Ok::<(), translux_format::FormatError>(())
//! ```

#![warn(clippy::exit, clippy::panic, clippy::print_stderr, clippy::print_stdout)]

#[cfg(not(target_endian = "little"))]
compile_error!("sections are little-endian and read in place: this crate needs a little-endian target");

mod asset;
pub mod atlas;
pub mod calibration;
mod checks;
mod codec;
pub mod coefficients;
mod compression;
mod container;
pub mod distant_transport;
mod error;
mod excerpt;
mod far_coded;
mod far_data;
pub mod far_field;
mod far_functions;
mod far_sums;
mod far_values;
pub mod filtered_normals;
mod frame;
pub mod mesh;
pub mod metadata;
pub mod multilevel;
pub mod parts;
pub mod profile_basis;
pub mod quantised_lights;
pub mod quantised_values;
pub mod range_coder;
mod reader;
pub mod rows;
pub mod sample_rule;
pub mod samples;
mod scan;
pub mod scattering_lists;
pub mod subdivision;
pub mod texture_space;
mod types;
mod varints;
mod writer;

pub use asset::{AssetFile, COMMON_TAGS, RawSection};
pub use checks::MAX_STRING_BYTES;
pub use codec::MAX_RECORD_BYTES;
pub use compression::ZSTD_LEVEL;
pub use container::{MAGIC, SectionInfo};
pub use error::{FormatError, Result};
pub use excerpt::{Excerpt, ReadError};
pub use mesh::{CornerAttribute, Mesh};
pub use metadata::{InputRecord, LedgerEntry, Provenance};
pub use parts::{MediumRecord, NO_MEDIUM, NO_PART, PartRecord, Parts};
pub use reader::Reader;
pub use samples::{Samples, WHOLE_TRIANGLE};
pub use scan::{Scan, scan};
pub use types::{
    Budget, Codec, Element, ElementType, F16Bits, Kind, MAX_SECTIONS, Scalar, Tag, VERSION_MAJOR, VERSION_MINOR,
};
pub use writer::Writer;
