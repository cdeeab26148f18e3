//! The domain view of a `.tlux` file: this crate's types on one side, `translux-format`'s plain arrays on the other.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec3};
use translux_format as format;

use crate::compress::ledger::{Entry, Ledger};
use crate::error::{Error, ExitCode, Result};
use crate::geometry::mesh::Mesh;
use crate::geometry::part_table::{PartEntry, PartTable};
use crate::geometry::samples::Samples;
use crate::geometry::source::CornerAttribute;
use crate::import::{Origin, file::Input};
use crate::io::atomic;
use crate::math::statistics::VertexError;
use crate::medium::material::{Medium, OpticalProperties};
use crate::scene::Scene;

/// Revision of the algorithms, raised whenever the same input gives different bytes.
pub const ALGORITHM_REVISION: u32 = 3;

/// Setting that identifies what a command line asked for: a hash of it, so that a bake that would ask for the same is known.
pub const REQUEST: &str = "request";

/// Provenance of an asset, independent of time and place.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Provenance {
    /// Name of the method that baked it.
    pub method: String,
    /// Resolved parameters.
    pub settings: BTreeMap<String, String>,
    /// Files that it was made from, unit and repairs.
    #[serde(flatten)]
    pub origin: Origin,
}

impl From<Origin> for Provenance {
    /// The origin of a scene that no method has baked yet.
    fn from(origin: Origin) -> Self {
        Self { origin, ..Self::default() }
    }
}

/// One scene baked by one method.
#[derive(Clone, Debug)]
pub struct Asset {
    /// Mesh, parts, media.
    pub scene: Scene,
    /// Surface samples.
    pub samples: Samples,
    /// Whether a file holds the samples although they could be made again from the mesh.
    pub samples_stored: bool,
    /// Origin, method and settings.
    pub provenance: Provenance,
    /// The error that each lossy stage added.
    pub ledger: Ledger,
    /// The method's own sections.
    pub sections: Vec<format::RawSection>,
}

impl Asset {
    /// A scene with samples and sections, for evaluators: nothing is known of where it comes from.
    pub fn of_scene(scene: Scene, samples: Samples, sections: Vec<format::RawSection>) -> Self {
        let (provenance, ledger) = (Provenance::default(), Ledger::default());
        Self { scene, samples, samples_stored: false, provenance, ledger, sections }
    }

    /// Encodes the file.
    ///
    /// # Errors
    /// Values that the format refuses.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let file = format::AssetFile {
            mesh: mesh_to_file(&self.scene.mesh),
            parts: parts_to_file(&self.scene),
            samples: self.samples.to_file(),
            samples_stored: self.samples_stored,
            provenance: provenance_to_file(&self.provenance),
            ledger: self.ledger.entries.iter().map(entry_to_file).collect(),
            extra: self.sections.clone(),
        };
        file.to_bytes().map_err(|e| Error::runtime(format!("asset: {e}")))
    }

    /// Reads and validates a file's bytes.
    ///
    /// # Errors
    /// `InvalidInput` for anything that is not a valid asset; `Unsupported` for another major version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Self::from_bytes_within(bytes, format::Budget::default())
    }

    /// Like [`Self::from_bytes`], with a limit on the memory of what is decoded.
    ///
    /// # Errors
    /// As [`Self::from_bytes`]; run time: content beyond the limit.
    pub fn from_bytes_within(bytes: &[u8], budget: format::Budget) -> Result<Self> {
        let file = format::AssetFile::from_bytes(bytes, budget).map_err(|e| refused(&e))?;
        let mut file = file;
        give_parts(&mut file);
        let mesh = mesh_from_file(file.mesh);
        let media: Vec<Medium> = file.parts.media.iter().map(medium_from_file).collect::<Result<_>>()?;
        let entries = file.parts.parts.iter().map(|p| (p.name.clone(), (!p.opaque).then_some(p.medium))).collect();
        let parts = PartTable::new(&mesh, file.parts.triangle_part, entries);
        Ok(Self {
            scene: Scene { mesh, parts, media },
            samples: Samples::from_file(file.samples),
            samples_stored: file.samples_stored,
            provenance: provenance_from_file(file.provenance),
            ledger: Ledger { entries: file.ledger.into_iter().map(entry_from_file).collect() },
            sections: file.extra,
        })
    }

    /// Writes the file atomically; returns its length in bytes.
    ///
    /// # Errors
    /// As [`Self::to_bytes`], and I/O.
    pub fn write(&self, path: &Path) -> Result<u64> {
        let bytes = self.to_bytes()?;
        atomic::write(path, &bytes)?;
        Ok(bytes.len() as u64)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// As [`Self::from_bytes`], and I/O; the message starts with the path.
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_within(path, format::Budget::default())
    }

    /// Like [`Self::read`], with a limit on the memory of what is decoded.
    ///
    /// # Errors
    /// As [`Self::from_bytes_within`], and I/O; the message starts with the path.
    pub fn read_within(path: &Path, budget: format::Budget) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
        Self::from_bytes_within(&bytes, budget).map_err(|e| e.in_file(path))
    }

    /// Resizes the object to a diagonal of `diagonal_mm`, with unchanged materials. For assets that hold no transport:
    /// samples are places on triangles, whatever their size.
    ///
    /// # Errors
    /// Command line: a size that is not positive and finite, or beyond what a mesh may have.
    pub fn resized(mut self, diagonal_mm: f64) -> Result<Self> {
        let factor = self.scene.mesh.resize(diagonal_mm)?;
        self.scene.parts = self.scene.parts.scaled(factor);
        self.provenance.origin.mm_per_source_unit *= factor;
        Ok(self)
    }
}

/// Puts triangles that belong to no part into an opaque one: they cast shadows, and nothing else.
fn give_parts(file: &mut format::AssetFile) {
    let parts = &mut file.parts;
    if !parts.triangle_part.contains(&format::NO_PART) {
        return;
    }
    let own = parts.parts.len() as u32;
    parts.triangle_part.iter_mut().filter(|part| **part == format::NO_PART).for_each(|part| *part = own);
    parts.parts.push(format::PartRecord { name: "no part".to_owned(), opaque: true, medium: format::NO_MEDIUM });
    let end = file.samples.part_offsets.last().copied().unwrap_or_default();
    file.samples.part_offsets.push(end);
}

/// The error of bytes that are no asset, or one of another major version.
pub(crate) fn refused(error: &format::FormatError) -> Error {
    let code = match error {
        format::FormatError::UnsupportedVersion { .. } => ExitCode::Unsupported,
        format::FormatError::OverBudget { .. } | format::FormatError::OutOfMemory { .. } => ExitCode::Runtime,
        _ => ExitCode::InvalidInput,
    };
    Error::new(code, error.to_string())
}

fn attribute_to_file<T: Copy + Into<[f32; N]>, const N: usize>(
    attribute: &CornerAttribute<T>,
) -> format::CornerAttribute<N> {
    let values = attribute.values.iter().map(|v| (*v).into()).collect();
    format::CornerAttribute { values, corners: attribute.corners.clone() }
}

fn attribute_from_file<T: From<[f32; N]>, const N: usize>(file: format::CornerAttribute<N>) -> CornerAttribute<T> {
    CornerAttribute { values: file.values.into_iter().map(T::from).collect(), corners: file.corners }
}

fn mesh_to_file(mesh: &Mesh) -> format::Mesh {
    format::Mesh {
        origin_mm: mesh.origin_mm.to_array(),
        positions_mm: mesh.local_mm.iter().map(|p| p.to_array()).collect(),
        triangles: mesh.triangles.clone(),
        triangle_material: mesh.triangle_material.clone(),
        materials: mesh.materials.clone(),
        weld: mesh.weld.clone(),
        normals: mesh.normals.as_ref().map(attribute_to_file),
        uvs: mesh.uvs.as_ref().map(attribute_to_file),
    }
}

fn mesh_from_file(file: format::Mesh) -> Mesh {
    Mesh {
        origin_mm: DVec3::from_array(file.origin_mm),
        local_mm: file.positions_mm.into_iter().map(Vec3::from_array).collect(),
        triangles: file.triangles,
        triangle_material: file.triangle_material,
        materials: file.materials,
        weld: file.weld,
        normals: file.normals.map(attribute_from_file),
        uvs: file.uvs.map(attribute_from_file),
    }
}

fn parts_to_file(scene: &Scene) -> format::Parts {
    let record = |part: &PartEntry| format::PartRecord {
        name: part.name.clone(),
        opaque: !part.transfers(),
        medium: part.medium.unwrap_or(format::NO_MEDIUM),
    };
    let medium = |m: &Medium| format::MediumRecord {
        name: m.name.clone(),
        sigma_s_reduced_per_mm: m.properties.sigma_s_reduced_per_mm.to_array(),
        sigma_a_per_mm: m.properties.sigma_a_per_mm.to_array(),
        g: m.properties.g,
        eta_inside_over_outside: m.properties.eta_inside_over_outside,
    };
    format::Parts {
        triangle_part: scene.parts.triangle_part.clone(),
        parts: scene.parts.parts.iter().map(record).collect(),
        media: scene.media.iter().map(medium).collect(),
    }
}

pub(crate) fn medium_from_file(record: &format::MediumRecord) -> Result<Medium> {
    let properties = OpticalProperties {
        sigma_s_reduced_per_mm: DVec3::from_array(record.sigma_s_reduced_per_mm),
        sigma_a_per_mm: DVec3::from_array(record.sigma_a_per_mm),
        g: record.g,
        eta_inside_over_outside: record.eta_inside_over_outside,
    };
    let properties = properties.validated().map_err(|e| e.at(format!("medium `{}`", record.name)))?;
    Ok(Medium { name: record.name.clone(), properties })
}

fn provenance_to_file(Provenance { method, settings, origin }: &Provenance) -> format::Provenance {
    let hash = |text: &str| blake3::Hash::from_hex(text).map_or([0; 32], |h| *h.as_bytes());
    format::Provenance {
        algorithm_revision: ALGORITHM_REVISION,
        method: method.clone(),
        settings: settings.iter().map(|(k, v)| (k.clone(), v.clone())).collect(),
        seed: 0,
        inputs: origin
            .inputs
            .iter()
            .map(|i| format::InputRecord { name: i.name.clone(), blake3: hash(&i.blake3), bytes: i.bytes })
            .collect(),
        source_unit: origin.source_unit.clone(),
        mm_per_source_unit: origin.mm_per_source_unit,
        notes: origin.notes.clone(),
    }
}

pub(crate) fn provenance_from_file(p: format::Provenance) -> Provenance {
    let hex = |hash: [u8; 32]| blake3::Hash::from_bytes(hash).to_hex().to_string();
    let origin = Origin {
        inputs: p.inputs.into_iter().map(|i| Input { name: i.name, blake3: hex(i.blake3), bytes: i.bytes }).collect(),
        source_unit: p.source_unit,
        mm_per_source_unit: p.mm_per_source_unit,
        notes: p.notes,
    };
    Provenance { method: p.method, settings: p.settings.into_iter().collect(), origin }
}

fn entry_to_file(entry: &Entry) -> format::LedgerEntry {
    format::LedgerEntry {
        stage: entry.stage.clone(),
        relative_rms: entry.error.rms,
        relative_bias: entry.error.bias,
        p999: entry.error.p999,
        worst: entry.error.worst,
        dark: entry.error.dark,
        note: entry.note.clone(),
    }
}

pub(crate) fn entry_from_file(entry: format::LedgerEntry) -> Entry {
    Entry {
        stage: entry.stage,
        error: VertexError {
            rms: entry.relative_rms,
            bias: entry.relative_bias,
            p999: entry.p999,
            worst: entry.worst,
            dark: entry.dark,
        },
        note: entry.note,
    }
}
