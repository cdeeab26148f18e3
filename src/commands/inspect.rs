//! `translux inspect A.tlux`: sections, bytes, bytes per vertex, ledger, provenance, allowed edits.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use serde::Serialize;
use translux_format::{Budget, Kind, Reader};

use super::console::{Console, Format, megabytes, percent};
use super::media::MediumReport;
use super::{output, report};
use crate::asset::{Asset, Provenance};
use crate::compress::ledger::Ledger;
use crate::error::{Error, ExitCode, Result};
use crate::evaluate::{Capabilities, Cost, MaterialEdit, ProfileEdit, SourceFields};

#[derive(Clone, Debug, Args)]
pub(super) struct InspectArgs {
    /// Asset
    asset: PathBuf,
}

/// Bytes of an asset by what they are for.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Sizes {
    /// The whole file.
    pub(super) file: u64,
    /// Stored bytes of all sections but the mesh's and the environment's.
    pub(super) stored_without_mesh: u64,
    /// Decoded bytes of the same.
    pub(super) decoded_without_mesh: u64,
    /// Stored bytes of what is there for environments.
    pub(super) stored_environment: u64,
    /// Decoded bytes of the same.
    pub(super) decoded_environment: u64,
    /// By what the sections are for, every kind.
    kinds: Vec<KindRow>,
    sections: Vec<SectionRow>,
}

#[derive(Clone, Debug, Serialize)]
struct KindRow {
    kind: &'static str,
    sections: usize,
    stored_bytes: u64,
    decoded_bytes: u64,
}

#[derive(Clone, Debug, Serialize)]
struct SectionRow {
    tag: String,
    kind: String,
    element: String,
    components: u16,
    codec: String,
    rows: u64,
    stored_bytes: u64,
    decoded_bytes: u64,
}

#[derive(Serialize)]
struct InspectReport {
    #[serde(serialize_with = "report::path")]
    asset: PathBuf,
    method: String,
    vertices: usize,
    triangles: usize,
    parts: Vec<PartRow>,
    media: Vec<MediumReport>,
    diagonal_mm: f64,
    sizes: Sizes,
    bytes_per_vertex_on_disk: f64,
    bytes_per_vertex_resident: Option<f64>,
    environment_bytes_per_vertex_on_disk: f64,
    environment_bytes_per_vertex_resident: f64,
    cost: Option<Cost>,
    edits: Option<Capabilities>,
    ledger: Ledger,
    provenance: Provenance,
}

#[derive(Serialize)]
struct PartRow {
    name: String,
    medium: Option<String>,
    triangles: usize,
    area_mm2: f64,
    samples: usize,
}

/// Sizes of the sections of a file.
pub(super) fn sizes(bytes: &[u8]) -> Result<Sizes> {
    let reader = Reader::parse(bytes, Budget::default()).map_err(|e| Error::input(e.to_string()))?;
    let mut result = Sizes { file: bytes.len() as u64, ..Sizes::default() };
    let rows = Kind::ALL.iter().map(|kind| {
        let mut row = KindRow { kind: kind.name(), sections: 0, stored_bytes: 0, decoded_bytes: 0 };
        for section in reader.sections().iter().filter(|section| section.kind == *kind) {
            row.sections += 1;
            row.stored_bytes += section.stored_bytes;
            row.decoded_bytes += section.decoded_bytes;
        }
        row
    });
    result.kinds = rows.collect();
    for section in reader.sections() {
        match section.kind {
            Kind::Mesh => {}
            Kind::Environment => {
                result.stored_environment += section.stored_bytes;
                result.decoded_environment += section.decoded_bytes;
            }
            Kind::Samples | Kind::Method | Kind::Metadata => {
                result.stored_without_mesh += section.stored_bytes;
                result.decoded_without_mesh += section.decoded_bytes;
            }
        }
        result.sections.push(SectionRow {
            tag: section.tag.to_string(),
            kind: section.kind.name().to_owned(),
            element: section.element.name().to_owned(),
            components: section.components,
            codec: section.codec.name().to_owned(),
            rows: section.rows(),
            stored_bytes: section.stored_bytes,
            decoded_bytes: section.decoded_bytes,
        });
    }
    Ok(result)
}

pub(super) fn run(args: &InspectArgs, console: &Console) -> Result<ExitCode> {
    let bytes = std::fs::read(&args.asset).map_err(|e| Error::io(&args.asset, &e))?;
    let place = |e: Error| e.at(args.asset.display());
    let asset = Arc::new(Asset::from_bytes(&bytes).map_err(place)?);
    let sizes = sizes(&bytes).map_err(place)?;
    let evaluator = console.registry.form(&asset).ok().map(|form| form.open(Arc::clone(&asset))).transpose()?;
    let vertices = asset.scene.mesh.local_mm.len();
    let per_vertex = |bytes: u64| bytes as f64 / vertices.max(1) as f64;
    let cost = evaluator.as_ref().map(|e| e.cost());
    let result = InspectReport {
        asset: args.asset.clone(),
        method: asset.provenance.method.clone(),
        vertices,
        triangles: asset.scene.mesh.triangles.len(),
        parts: parts(&asset),
        media: asset.scene.media.iter().map(MediumReport::of).collect(),
        diagonal_mm: asset.scene.mesh.diagonal_mm(),
        bytes_per_vertex_on_disk: per_vertex(sizes.stored_without_mesh),
        environment_bytes_per_vertex_on_disk: per_vertex(sizes.stored_environment),
        environment_bytes_per_vertex_resident: per_vertex(sizes.decoded_environment),
        bytes_per_vertex_resident: cost.map(|c| per_vertex(c.resident_bytes as u64)),
        sizes,
        cost,
        edits: evaluator.map(|e| e.capabilities()),
        ledger: asset.ledger.clone(),
        provenance: asset.provenance.clone(),
    };
    if console.format == Format::Text {
        print(&result)?;
    }
    report::print(console, "inspect", &result)?;
    Ok(ExitCode::Ok)
}

fn parts(asset: &Asset) -> Vec<PartRow> {
    let row = |(index, part): (usize, &crate::geometry::part_table::PartEntry)| PartRow {
        name: part.name.clone(),
        medium: part.medium.map(|m| asset.scene.media[m as usize].name.clone()),
        triangles: part.triangle_count,
        area_mm2: part.area_mm2,
        samples: asset.samples.part(index).len(),
    };
    asset.scene.parts.parts.iter().enumerate().map(row).collect()
}

/// Bytes by kind; the method's decoded bytes are those of its sections, what an evaluator holds is said above.
fn kinds(r: &InspectReport) -> String {
    let per_vertex = |bytes: u64| format!("{:.1}", bytes as f64 / r.vertices.max(1) as f64);
    let mut rows = vec![["kind", "sections", "stored", "decoded", "bytes/vertex stored", "decoded"].map(str::to_owned)];
    rows.extend(r.sizes.kinds.iter().map(|k| {
        [
            k.kind.to_owned(),
            k.sections.to_string(),
            megabytes(k.stored_bytes),
            megabytes(k.decoded_bytes),
            per_vertex(k.stored_bytes),
            per_vertex(k.decoded_bytes),
        ]
    }));
    output::table(&rows)
}

fn print(r: &InspectReport) -> Result<()> {
    let say = |line: String| output::print_line(&line);
    say(format!(
        "{}: {}, method {}, {} vertices, {} triangles, {:.1} mm across",
        r.asset.display(),
        megabytes(r.sizes.file),
        r.method,
        r.vertices,
        r.triangles,
        r.diagonal_mm
    ))?;
    let resident = r.bytes_per_vertex_resident.map_or_else(|| "?".to_owned(), |b| format!("{b:.1}"));
    let on_disk = r.bytes_per_vertex_on_disk;
    say(format!("bytes/vertex without mesh and environment: {on_disk:.1} on disk, {resident} resident"))?;
    if r.sizes.stored_environment > 0 {
        let (disk, resident) = (r.environment_bytes_per_vertex_on_disk, r.environment_bytes_per_vertex_resident);
        say(format!("bytes/vertex for environments: {disk:.1} on disk, {resident:.1} resident"))?;
    }
    if let Some(edits) = r.edits {
        say(format!("without a new bake: {}", edits_of(edits)))?;
    }
    say(kinds(r))?;
    let mut rows = vec![["section", "kind", "type", "codec", "rows", "stored", "decoded"].map(str::to_owned)];
    for s in &r.sizes.sections {
        rows.push([
            s.tag.clone(),
            s.kind.clone(),
            format!("{} x{}", s.element, s.components),
            s.codec.clone(),
            s.rows.to_string(),
            megabytes(s.stored_bytes),
            megabytes(s.decoded_bytes),
        ]);
    }
    say(output::table(&rows))?;
    let mut rows = vec![["part", "medium", "triangles", "area mm^2", "samples"].map(str::to_owned)];
    for p in &r.parts {
        rows.push([
            p.name.clone(),
            p.medium.clone().unwrap_or_else(|| "opaque".to_owned()),
            p.triangles.to_string(),
            format!("{:.1}", p.area_mm2),
            p.samples.to_string(),
        ]);
    }
    say(output::table(&rows))?;
    for entry in &r.ledger.entries {
        say(format!("error of {}: {} RMS ({})", entry.stage, percent(entry.error.rms), entry.note))?;
    }
    for input in &r.provenance.inputs {
        say(format!("from {} ({} bytes, BLAKE3 {})", input.name, input.bytes, input.blake3))?;
    }
    say(format!(
        "scale {} mm in a unit of the source ({})",
        r.provenance.mm_per_source_unit, r.provenance.source_unit
    ))?;
    let settings: Vec<String> = r.provenance.settings.iter().map(|(k, v)| format!("{k}={v}")).collect();
    say(format!("settings {}", settings.join(" ")))?;
    r.provenance.notes.iter().try_for_each(|note| say(format!("note {note}")))
}

/// What may change at run time, for people.
fn edits_of(edits: Capabilities) -> String {
    let material = match edits.material {
        MaterialEdit::None => "the material is baked in",
        MaterialEdit::Any => "any material",
    };
    let profile = match edits.profile {
        ProfileEdit::None => "profile, size and mesh are baked in",
        ProfileEdit::OnCpu => "any profile (on the CPU), any size, other meshes of the same object",
        ProfileEdit::Any => "any profile, any size, other meshes of the same object",
    };
    let fields = match edits.source_fields {
        SourceFields::None => "no source radiance fields (field=) of area lights",
        SourceFields::Any => "area lights through source radiance fields where they ask for it (field=)",
    };
    format!("{material}; {profile}; {fields}")
}
