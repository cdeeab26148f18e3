//! The content of an asset: sections, bytes, bytes per vertex, ledger, provenance, allowed edits.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use translux_format::{
    Budget, Excerpt, MediumRecord, PartRecord, RawSection, ReadError, Reader, Tag, mesh, metadata, parts, samples,
};

use super::materials::MediumReport;
use super::sizes::{KindSize, SectionSize, Sizes, of_sections};
use super::text::{megabytes, percent, significant, titled};
use crate::asset::{self, Asset, Provenance};
use crate::compress::ledger::Ledger;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::memory::Limits;
use crate::evaluate::{AnyForm, Capabilities, Cost, MaterialEdit, ProfileEdit, Registry, SourceFields};
use crate::geometry::part_table::PartEntry;
use crate::medium::material::Medium;

/// What the notes of a plan begin with.
pub(crate) const PLAN: &str = "plan: ";

/// The contents of an asset.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Inspection {
    /// The asset's file.
    #[serde(serialize_with = "super::path")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub asset: PathBuf,
    /// Method that baked it.
    pub method: String,
    /// Vertices of the source.
    pub vertices: usize,
    /// Triangles that have area.
    pub triangles: usize,
    parts: Vec<PartRow>,
    /// Optical properties of the bake.
    pub media: Vec<MediumReport>,
    /// Diagonal of the bounding box, mm; none where only the directory was read.
    pub diagonal_mm: Option<f64>,
    /// Bytes by section.
    pub sizes: Sizes,
    /// Stored bytes per vertex of all sections except the mesh's and the environment's.
    pub bytes_per_vertex_on_disk: f64,
    /// Bytes per vertex that the evaluator holds; none without its form, or where only the directory was read.
    pub bytes_per_vertex_resident: Option<f64>,
    /// Stored bytes per vertex of the sections for environments.
    pub environment_bytes_per_vertex_on_disk: f64,
    /// Decoded bytes per vertex of the sections for environments.
    pub environment_bytes_per_vertex_resident: f64,
    /// Size of the evaluator; none without its form, or where only the directory was read.
    pub cost: Option<Cost>,
    /// Edits that need no new bake; none without its form.
    pub edits: Option<Capabilities>,
    /// Errors recorded by the bake.
    pub ledger: Ledger,
    /// Settings, files and unit.
    pub provenance: Provenance,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct PartRow {
    name: String,
    medium: Option<String>,
    /// None where only the directory was read.
    triangles: Option<usize>,
    /// None where only the directory was read.
    area_mm2: Option<f64>,
    samples: usize,
}

/// How much of a file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// Header, directory and records: milliseconds, however large the file is. Damage elsewhere is not noticed.
    Directory,
    /// Everything, and the evaluator is made.
    Everything,
}

/// Inspects a file; an asset whose form is not in the registry has no evaluator.
///
/// # Errors
/// I/O, bytes that are no asset, more of them than the budget allows, and errors of its form.
pub fn inspect(path: &Path, registry: &Registry, depth: Depth, limits: Limits<'_>) -> Result<Inspection> {
    let inspection = match depth {
        Depth::Directory => of_directory(path, registry, limits.budget),
        Depth::Everything => of_everything(path, registry, limits),
    };
    inspection.map_err(|e| if e.code() == ExitCode::Io { e } else { e.in_file(path) })
}

/// Sections that are read beside header and directory, all of them small.
const READ: [Tag; 9] = [
    metadata::tags::PROVENANCE,
    metadata::tags::LEDGER,
    metadata::tags::DARK,
    metadata::tags::FORM,
    metadata::tags::SETTINGS,
    parts::tags::PARTS,
    parts::tags::MEDIA,
    samples::tags::PART_OFFSETS,
    mesh::tags::ORIGIN,
];

fn of_directory(path: &Path, registry: &Registry, budget: Budget) -> Result<Inspection> {
    let fail = |error: ReadError| match error {
        ReadError::Io(e) => Error::io(path, &e),
        ReadError::Format(e) => asset::refused(&e),
    };
    let mut file = std::fs::File::open(path).map_err(|e| Error::io(path, &e))?;
    let excerpt = Excerpt::read(&mut file, budget, |info| READ.contains(&info.tag)).map_err(fail)?;
    let reader = excerpt.reader();
    let refuse = |e: translux_format::FormatError| asset::refused(&e);
    let rows = |tag: Tag| {
        let info = excerpt.directory().iter().find(|info| info.tag == tag);
        info.map(|info| info.rows() as usize)
            .ok_or_else(|| refuse(translux_format::FormatError::MissingSection { tag }))
    };
    let (vertices, triangles) = (rows(mesh::tags::POSITIONS)?, rows(mesh::tags::TRIANGLES)?);
    let records: Vec<MediumRecord> = reader.record(parts::tags::MEDIA).map_err(refuse)?;
    let media = records.iter().map(asset::medium_from_file).collect::<Result<Vec<_>>>()?;
    let parts = parts_of_records(&reader, &media).map_err(refuse)?;
    let provenance = asset::provenance_from_file(metadata::provenance(&reader).map_err(refuse)?);
    let ledger = metadata::ledger(&reader).map_err(refuse)?;
    let sections = [metadata::tags::FORM, metadata::tags::SETTINGS].map(|tag| RawSection::of(&reader, tag));
    let [name, settings] = sections;
    let sections = vec![name.map_err(refuse)?, settings.map_err(refuse)?];
    // As with everything read: what no form here is fits no evaluator.
    let form = registry.form_of(&sections).ok();
    let has = |tag: Tag| excerpt.directory().iter().any(|info| info.tag == tag);
    let sizes = of_sections(excerpt.length(), excerpt.directory());
    Ok(Inspection {
        asset: path.to_owned(),
        method: provenance.method.clone(),
        vertices,
        triangles,
        parts,
        media: media.iter().map(MediumReport::of).collect(),
        diagonal_mm: None,
        bytes_per_vertex_on_disk: per(vertices, sizes.stored_without_mesh),
        environment_bytes_per_vertex_on_disk: per(vertices, sizes.stored_environment),
        environment_bytes_per_vertex_resident: per(vertices, sizes.decoded_environment),
        bytes_per_vertex_resident: None,
        sizes,
        cost: None,
        edits: form.and_then(|form| form.edits(&has)),
        ledger: Ledger { entries: ledger.into_iter().map(asset::entry_from_file).collect() },
        provenance,
    })
}

fn per(vertices: usize, bytes: u64) -> f64 {
    bytes as f64 / vertices.max(1) as f64
}

fn parts_of_records(reader: &Reader<'_>, media: &[Medium]) -> translux_format::Result<Vec<PartRow>> {
    let records: Vec<PartRecord> = reader.record(parts::tags::PARTS)?;
    let offsets: Vec<u32> = reader.array(samples::tags::PART_OFFSETS)?;
    let row = |(index, part): (usize, PartRecord)| PartRow {
        name: part.name,
        medium: media.get(part.medium as usize).filter(|_| !part.opaque).map(|medium| medium.name.clone()),
        triangles: None,
        area_mm2: None,
        samples: match (offsets.get(index), offsets.get(index + 1)) {
            (Some(first), Some(end)) => end.saturating_sub(*first) as usize,
            _ => 0,
        },
    };
    Ok(records.into_iter().enumerate().map(row).collect())
}

fn of_everything(path: &Path, registry: &Registry, Limits { budget, admit }: Limits<'_>) -> Result<Inspection> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, &e))?;
    let asset = Arc::new(Asset::from_bytes_within(&bytes, budget)?);
    let reader = Reader::parse(&bytes, budget).map_err(|e| asset::refused(&e))?;
    let sizes = of_sections(bytes.len() as u64, reader.sections());
    drop(bytes);
    let open = |form: Box<dyn AnyForm>| {
        admit(form.run_memory(&asset))?;
        form.open(Arc::clone(&asset))
    };
    let evaluator = registry.form(&asset).ok().map(open).transpose()?;
    let vertices = asset.scene.mesh.local_mm.len();
    let cost = evaluator.as_ref().map(|e| e.cost());
    Ok(Inspection {
        asset: path.to_owned(),
        method: asset.provenance.method.clone(),
        vertices,
        triangles: asset.scene.mesh.triangles.len(),
        parts: parts_of(&asset),
        media: asset.scene.media.iter().map(MediumReport::of).collect(),
        diagonal_mm: Some(asset.scene.mesh.diagonal_mm()),
        bytes_per_vertex_on_disk: per(vertices, sizes.stored_without_mesh),
        environment_bytes_per_vertex_on_disk: per(vertices, sizes.stored_environment),
        environment_bytes_per_vertex_resident: per(vertices, sizes.decoded_environment),
        bytes_per_vertex_resident: cost.map(|c| per(vertices, c.resident_bytes as u64)),
        sizes,
        cost,
        edits: evaluator.map(|e| e.capabilities()),
        ledger: asset.ledger.clone(),
        provenance: asset.provenance.clone(),
    })
}

fn parts_of(asset: &Asset) -> Vec<PartRow> {
    let row = |(index, part): (usize, &PartEntry)| PartRow {
        name: part.name.clone(),
        medium: part.medium.map(|m| asset.scene.media[m as usize].name.clone()),
        triangles: Some(part.triangle_count),
        area_mm2: Some(part.area_mm2),
        samples: asset.samples.part(index).len(),
    };
    asset.scene.parts.parts.iter().enumerate().map(row).collect()
}

/// Bytes by kind; decoded bytes are those of the sections, not of the evaluator.
fn kinds(r: &Inspection) -> String {
    let per_vertex = |bytes: u64| format!("{:.1}", bytes as f64 / r.vertices.max(1) as f64);
    let row = |k: &KindSize| {
        [
            k.kind.to_owned(),
            k.sections.to_string(),
            megabytes(k.stored_bytes),
            megabytes(k.decoded_bytes),
            per_vertex(k.stored_bytes),
            per_vertex(k.decoded_bytes),
        ]
    };
    let titles = ["kind", "sections", "stored", "decoded", "bytes/vertex stored", "decoded"];
    titled(titles, r.sizes.kinds.iter().map(row))
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { method, vertices, triangles, .. } = self;
        let (asset, size) = (self.asset.display(), megabytes(self.sizes.file));
        let across = self.diagonal_mm.map_or_else(String::new, |across| format!(", {across:.1} mm across"));
        writeln!(f, "{asset}: {size}, method {method}, {vertices} vertices, {triangles} triangles{across}")?;
        let resident = self.bytes_per_vertex_resident.map_or_else(String::new, |b| format!(", {b:.1} resident"));
        let on_disk = significant(self.bytes_per_vertex_on_disk);
        writeln!(f, "bytes/vertex without mesh and environment: {on_disk} on disk{resident}")?;
        if self.sizes.stored_environment > 0 {
            let disk = self.environment_bytes_per_vertex_on_disk;
            let resident = self.environment_bytes_per_vertex_resident;
            writeln!(f, "bytes/vertex for environments: {disk:.1} on disk, {resident:.1} resident")?;
        }
        if let Some(edits) = self.edits {
            writeln!(f, "without a new bake: {}", edits_of(edits))?;
        }
        writeln!(f, "{}", kinds(self))?;
        let section = |s: &SectionSize| {
            [
                s.tag.clone(),
                s.kind.to_owned(),
                format!("{} x{}", s.element, s.components),
                s.codec.to_owned(),
                s.rows.to_string(),
                megabytes(s.stored_bytes),
                megabytes(s.decoded_bytes),
            ]
        };
        let titles = ["section", "kind", "type", "codec", "rows", "stored", "decoded"];
        writeln!(f, "{}", titled(titles, self.sizes.sections.iter().map(section)))?;
        let unknown = || "-".to_owned();
        let part = |p: &PartRow| {
            [
                p.name.clone(),
                p.medium.clone().unwrap_or_else(|| "opaque".to_owned()),
                p.triangles.map_or_else(unknown, |triangles| triangles.to_string()),
                p.area_mm2.map_or_else(unknown, |area| format!("{area:.1}")),
                p.samples.to_string(),
            ]
        };
        let titles = ["part", "medium", "triangles", "area mm^2", "samples"];
        writeln!(f, "{}", titled(titles, self.parts.iter().map(part)))?;
        for entry in &self.ledger.entries {
            writeln!(f, "error of {}: {} RMS ({})", entry.stage, percent(entry.error.rms), entry.note)?;
        }
        let from = &self.provenance.origin;
        for input in &from.inputs {
            writeln!(f, "from {} ({} bytes, BLAKE3 {})", input.name, input.bytes, input.blake3)?;
        }
        writeln!(f, "scale {} mm in a unit of the source ({})", from.mm_per_source_unit, from.source_unit)?;
        let settings: Vec<String> = self.provenance.settings.iter().map(|(k, v)| format!("{k}={v}")).collect();
        write!(f, "settings {}", settings.join(" "))?;
        from.notes.iter().try_for_each(|note| match note.strip_prefix(PLAN) {
            // Sentences of their own.
            Some(_) => write!(f, "\n{note}"),
            None => write!(f, "\nnote {note}"),
        })
    }
}

/// Text of the edits that need no new bake.
fn edits_of(edits: Capabilities) -> String {
    let material = match edits.material {
        MaterialEdit::None => "the material is baked in",
        MaterialEdit::Any => "any material",
    };
    let profile = match edits.profile {
        ProfileEdit::None => "profile, size and mesh are baked in",
        ProfileEdit::Calibrated => "kernels calibrated by walks, any size, other meshes of the same object",
        ProfileEdit::OnCpu => "any profile (on the CPU), any size, other meshes of the same object",
        ProfileEdit::Any => "any profile, any size, other meshes of the same object",
    };
    let fields = match edits.source_fields {
        SourceFields::None => "no source radiance fields (field=) of area lights",
        SourceFields::Any => "area lights through source radiance fields where they ask for it (field=)",
    };
    format!("{material}; {profile}; {fields}")
}
