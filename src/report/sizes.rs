//! Bytes of an asset by section and purpose.

use serde::Serialize;
use translux_format::{Budget, Kind, Reader, SectionInfo};

use crate::error::{Error, Result};

/// Bytes of an asset by purpose.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Sizes {
    /// The whole file.
    pub file: u64,
    /// Stored bytes of all sections except the mesh's and the environment's.
    pub stored_without_mesh: u64,
    /// Decoded bytes of these sections.
    pub decoded_without_mesh: u64,
    /// Stored bytes of the sections for environments.
    pub stored_environment: u64,
    /// Decoded bytes of these sections.
    pub decoded_environment: u64,
    /// Sizes by the purpose of the sections, every kind.
    pub(super) kinds: Vec<KindSize>,
    /// Sizes of the sections in the order of the file.
    pub(super) sections: Vec<SectionSize>,
}

/// All sections of one kind.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct KindSize {
    pub(super) kind: &'static str,
    pub(super) sections: usize,
    pub(super) stored_bytes: u64,
    pub(super) decoded_bytes: u64,
}

/// One section.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct SectionSize {
    pub(super) tag: String,
    pub(super) kind: &'static str,
    pub(super) element: &'static str,
    pub(super) components: u16,
    pub(super) codec: &'static str,
    pub(super) rows: u64,
    pub(super) stored_bytes: u64,
    pub(super) decoded_bytes: u64,
}

/// Sizes of the sections of a file.
///
/// # Errors
/// Invalid input: bytes that are no asset.
pub fn sizes(bytes: &[u8]) -> Result<Sizes> {
    let reader = Reader::parse(bytes, Budget::bytes(u64::MAX)).map_err(|e| Error::input(e.to_string()))?;
    Ok(of_sections(bytes.len() as u64, reader.sections()))
}

/// Sizes of the sections of a file of a length.
pub(super) fn of_sections(file: u64, sections: &[SectionInfo]) -> Sizes {
    let mut result = Sizes { file, ..Sizes::default() };
    let rows = Kind::ALL.iter().map(|kind| {
        let mut row = KindSize { kind: kind.name(), sections: 0, stored_bytes: 0, decoded_bytes: 0 };
        for section in sections.iter().filter(|section| section.kind == *kind) {
            row.sections += 1;
            row.stored_bytes += section.stored_bytes;
            row.decoded_bytes += section.decoded_bytes;
        }
        row
    });
    result.kinds = rows.collect();
    for (kind, row) in Kind::ALL.iter().zip(&result.kinds) {
        let (stored, decoded) = match kind {
            Kind::Mesh => continue,
            Kind::Environment => (&mut result.stored_environment, &mut result.decoded_environment),
            Kind::Samples | Kind::Method | Kind::Metadata => {
                (&mut result.stored_without_mesh, &mut result.decoded_without_mesh)
            }
        };
        *stored += row.stored_bytes;
        *decoded += row.decoded_bytes;
    }
    let section = |section: &SectionInfo| SectionSize {
        tag: section.tag.to_string(),
        kind: section.kind.name(),
        element: section.element.name(),
        components: section.components,
        codec: section.codec.name(),
        rows: section.rows(),
        stored_bytes: section.stored_bytes,
        decoded_bytes: section.decoded_bytes,
    };
    result.sections = sections.iter().map(section).collect();
    result
}
