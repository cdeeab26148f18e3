//! Findings about assets that a reader accepts but that should not have been written: the catalogue, and the search in
//! a scan.

use std::collections::BTreeSet;

use glam::{DVec3, Vec3};
use serde::Serialize;
use translux_format::far_field::{self, FarField, Shape};
use translux_format::profile_basis::{self, ProfileBasis};
use translux_format::rows::{self, IrradianceRows};
use translux_format::{
    COMMON_TAGS, FormatError, Scan, Tag, VERSION_MAJOR, VERSION_MINOR, atlas, calibration, distant_transport,
    filtered_normals, mesh, metadata, multilevel, parts, quantised_lights, quantised_values, samples, scattering_lists,
    texture_space,
};

use super::quality::missed_quality;
use crate::asset::{ALGORITHM_REVISION, REQUEST, entry_from_file};
use crate::compress::ledger::Ledger;
use crate::evaluate::Registry;
use crate::evaluate::keys::share;
use crate::geometry::mesh::Mesh;
use crate::geometry::parts::inconsistent_edges;
use crate::geometry::samples::{Facet, area};
use crate::import::FAULT_NOTE;
use crate::medium::entrance_basis::EntranceBasis;

/// Severity of a finding: whether the asset can be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// The asset cannot be used, or gives wrong results.
    Error,
    /// The asset can be used, but something is odd.
    Warning,
}

impl Severity {
    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

/// An entry of the catalogue. Numbers are never reused.
pub struct FindingKind {
    /// Number from 100 on; smaller ones are the format's.
    pub number: u16,
    /// Severity of the finding.
    pub severity: Severity,
    /// Name in capitalised words.
    pub name: &'static str,
    /// Description in one line without values.
    pub meaning: &'static str,
}

/// A fault of an asset, or an oddity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Finding {
    /// Number, whose meaning never changes: those of the format up to 99, those of [`CATALOGUE`] from 100 on.
    pub number: u16,
    /// Name in capitalised words.
    pub name: &'static str,
    /// Severity of the finding.
    pub severity: Severity,
    /// Section of the finding.
    pub section: Option<String>,
    /// The fault with its values.
    pub message: String,
}

impl Finding {
    /// A finding about the bytes.
    pub fn of_format(error: &FormatError) -> Self {
        Self {
            number: error.code(),
            name: error.name(),
            severity: Severity::Error,
            section: error.tag().map(|tag| tag.to_string()),
            message: error.to_string(),
        }
    }

    pub(super) fn new(kind: &FindingKind, section: Option<Tag>, message: String) -> Self {
        let (number, name, severity) = (kind.number, kind.name, kind.severity);
        Self { number, name, severity, section: section.map(|tag| tag.to_string()), message }
    }
}

macro_rules! catalogue {
    ($($constant:ident = $number:literal $severity:ident $name:literal $meaning:literal;)*) => {
        $(pub(super) const $constant: FindingKind =
            FindingKind { number: $number, severity: Severity::$severity, name: $name, meaning: $meaning };)*
        /// Every finding about assets that a reader accepts.
        pub const CATALOGUE: &[FindingKind] = &[$($constant),*];
    };
}

catalogue! {
    UNKNOWN_METHOD = 100 Error "UnknownMethod" "this build does not have the method of the asset";
    REFUSED = 101 Error "Refused" "the method does not open the asset, or what it stores is more than light could bring";
    MAX_RMS = 102 Error "MaxRms" "the setting max-rms is no share in (0, 1]";
    TERMS = 103 Error "Terms" "far field and basis have unlike numbers of functions";
    NO_SAMPLES = 104 Error "NoSamples" "light travels in a part that has no samples";
    SAMPLE_AREA = 105 Error "SampleArea" "the samples of a part do not cover its surface once";
    ANGLES = 106 Error "Angles" "the irradiance rows have useless functions of the angle";
    OPAQUE_SAMPLES = 110 Warning "OpaqueSamples" "a part that only casts shadows has samples";
    EMPTY_PATCHES = 111 Warning "EmptyPatches" "samples have no area";
    EMPTY_TRIANGLES = 112 Warning "EmptyTriangles" "triangles have no area";
    UNUSED_VERTICES = 113 Warning "UnusedVertices" "no triangle has these vertices";
    UNUSED_MATERIALS = 114 Warning "UnusedMaterials" "no triangle has these materials";
    UNUSED_MEDIA = 115 Warning "UnusedMedia" "no part has these media";
    WINDINGS = 116 Warning "Windings" "neighbouring triangles of a part are wound against each other";
    SETTINGS = 120 Warning "Settings" "the settings are not those that the method has";
    SAMPLE_COUNT = 121 Warning "SampleCount" "the setting samples is not the number of samples";
    NO_LEDGER = 122 Warning "NoLedger" "no stage has told its error";
    QUALITY = 123 Warning "Quality" "the errors are larger than was asked for, or a plan's request is not met";
    FAULT = 124 Warning "Fault" "the bake warned of something that makes results wrong or poor";
    UNKNOWN_SECTION = 130 Warning "UnknownSection" "this build does not know the section";
    NEWER_REVISION = 131 Warning "NewerRevision" "made by newer algorithms than those of this build";
    NEWER_VERSION = 132 Warning "NewerVersion" "a newer minor version of the format";
}

/// Largest difference of the samples' area from their part's, as a share.
const AREA_TOLERANCE: f64 = 1e-5;

/// Sections of methods that are evaluated without samples.
fn without_samples(registry: &Registry) -> Vec<Tag> {
    let lights = quantised_lights::tags::SETS.iter().flat_map(|set| set.all());
    let single = [quantised_lights::tags::NUMBERS, scattering_lists::tags::NUMBERS];
    let rows = [rows::tags::TRANSPORT, rows::tags::SINGLE].map(rows::tags::Set::all);
    let (normals, texture) =
        (&filtered_normals::tags::ALL, [&atlas::tags::ALL[..], &texture_space::tags::ALL].concat());
    let all = [
        &single[..],
        &quantised_values::tags::ALL,
        &distant_transport::tags::ALL,
        normals,
        &texture,
        rows.as_flattened(),
    ];
    let outside = registry.forms().iter().flat_map(|form| form.tags).copied();
    lights.chain(all.concat()).chain(outside).collect()
}

/// Findings on versions, and on sections that no form here reads.
pub fn of_version(scan: &Scan, registry: &Registry) -> Vec<Finding> {
    let mut out = Vec::new();
    if let Some((major, minor)) = scan.version.filter(|(_, minor)| *minor > VERSION_MINOR) {
        let known = format!("this build knows {VERSION_MAJOR}.{VERSION_MINOR}");
        out.push(Finding::new(&NEWER_VERSION, None, format!("version {major}.{minor}; {known}")));
    }
    for section in &scan.sections {
        let of_form = [metadata::tags::FORM, metadata::tags::SETTINGS];
        let others = [profile_basis::tags::TOTALS, rows::tags::BLOCKS, multilevel::tags::NUMBERS];
        let far = [&far_field::tags::ALL[..], &far_field::tags::OPTIONAL].concat();
        let sampled =
            [&far[..], &profile_basis::tags::ALL, &rows::tags::ALL, &calibration::tags::ALL, &others, &of_form]
                .concat();
        if ![&COMMON_TAGS[..], &sampled, &without_samples(registry)].concat().contains(&section.tag) {
            let (bytes, kind) = (section.stored_bytes, section.kind);
            let message = format!("section {} ({kind}, {bytes} bytes) is unknown", section.tag);
            out.push(Finding::new(&UNKNOWN_SECTION, Some(section.tag), message));
        }
    }
    out
}

/// Findings on mesh, parts and samples.
pub fn of_geometry(scan: &Scan, registry: &Registry) -> Vec<Finding> {
    let mut out = Vec::new();
    let Some(file) = &scan.mesh else { return out };
    let used: BTreeSet<u32> = file.triangles.iter().flatten().copied().collect();
    let unused = file.positions_mm.len() - used.len();
    if unused > 0 {
        let message = format!("{unused} of {} vertices belong to no triangle", file.positions_mm.len());
        out.push(Finding::new(&UNUSED_VERTICES, Some(mesh::tags::POSITIONS), message));
    }
    let used: BTreeSet<u32> = file.triangle_material.iter().copied().collect();
    let names = unused_names(file.materials.iter().map(String::as_str), &used);
    if !names.is_empty() {
        let message = format!("no triangle has the materials {}", names.join(", "));
        out.push(Finding::new(&UNUSED_MATERIALS, Some(mesh::tags::MATERIALS), message));
    }
    let mesh = geometry_of(file);
    let areas: Vec<f64> = (0..mesh.triangles.len() as u32).map(|t| mesh.area_mm2(t)).collect();
    let empty = areas.iter().filter(|area| **area == 0.0).count();
    if empty > 0 {
        let message = format!("{empty} of {} triangles have no area", areas.len());
        out.push(Finding::new(&EMPTY_TRIANGLES, Some(mesh::tags::TRIANGLES), message));
    }
    let Some(parts) = &scan.parts else { return out };
    let used: BTreeSet<u32> = parts.parts.iter().map(|part| part.medium).collect();
    let names = unused_names(parts.media.iter().map(|medium| medium.name.as_str()), &used);
    if !names.is_empty() {
        let message = format!("no part has the media {}", names.join(", "));
        out.push(Finding::new(&UNUSED_MEDIA, Some(parts::tags::MEDIA), message));
    }
    let edges = inconsistent_edges(&mesh, &parts.triangle_part, parts.parts.len());
    for (part, edges) in parts.parts.iter().zip(edges).filter(|(part, edges)| !part.opaque && *edges > 0) {
        let name = &part.name;
        let message = format!("{edges} edges of the part `{name}` join triangles of opposite winding");
        out.push(Finding::new(&WINDINGS, Some(mesh::tags::TRIANGLES), message));
    }
    if let Some(samples) = &scan.samples {
        let tags = without_samples(registry);
        let is_without = samples.patch_count() == 0 && scan.sections.iter().any(|s| tags.contains(&s.tag));
        if !is_without {
            out.extend(of_samples(&mesh, parts, samples, &areas));
        }
    }
    out
}

/// Findings on the samples of a part, all of them valid and consistent.
fn of_samples(
    mesh: &Mesh,
    parts: &translux_format::Parts,
    samples: &translux_format::Samples,
    triangle_areas: &[f64],
) -> Vec<Finding> {
    let mut out = Vec::new();
    let facet = |&[triangle, path]: &[u32; 2]| area(Facet { triangle, path }.corners_local_mm(mesh));
    let facets = |range: &[u32]| &samples.facets[range[0] as usize..range[1] as usize];
    let patch_areas: Vec<f64> = samples.patch_offsets.windows(2).map(|r| facets(r).iter().map(facet).sum()).collect();
    let empty = patch_areas.iter().filter(|area| **area == 0.0).count();
    if empty > 0 {
        let message = format!("{empty} of {} samples have no area", patch_areas.len());
        out.push(Finding::new(&EMPTY_PATCHES, Some(samples::tags::PATCH_OFFSETS), message));
    }
    let mut part_areas = vec![0.0; parts.parts.len()];
    for (part, area) in parts.triangle_part.iter().zip(triangle_areas) {
        if let Some(sum) = part_areas.get_mut(*part as usize) {
            *sum += area;
        }
    }
    for ((part, whole), range) in parts.parts.iter().zip(&part_areas).zip(samples.part_offsets.windows(2)) {
        let tag = Some(samples::tags::PART_OFFSETS);
        let name = &part.name;
        let sum: f64 = patch_areas[range[0] as usize..range[1] as usize].iter().sum();
        let has_samples = range[0] < range[1];
        if part.opaque && has_samples {
            out.push(Finding::new(&OPAQUE_SAMPLES, tag, format!("part `{name}` only casts shadows and has samples")));
        } else if !part.opaque && !has_samples {
            out.push(Finding::new(&NO_SAMPLES, tag, format!("part `{name}` has no samples")));
        } else if !part.opaque && (sum - whole).abs() > AREA_TOLERANCE * whole {
            let message = format!("the samples of part `{name}` cover {sum:.6} mm^2 and the part has {whole:.6}");
            out.push(Finding::new(&SAMPLE_AREA, tag, message));
        }
    }
    out
}

/// Names whose index is not used.
fn unused_names<'a>(names: impl Iterator<Item = &'a str>, used: &BTreeSet<u32>) -> Vec<String> {
    (0..).zip(names).filter(|(index, _)| !used.contains(index)).map(|(_, name)| format!("`{name}`")).collect()
}

/// A mesh of positions and triangles only.
fn geometry_of(file: &translux_format::Mesh) -> Mesh {
    Mesh {
        origin_mm: DVec3::from_array(file.origin_mm),
        local_mm: file.positions_mm.iter().map(|p| Vec3::from_array(*p)).collect(),
        triangles: file.triangles.clone(),
        triangle_material: Vec::new(),
        materials: Vec::new(),
        weld: file.weld.clone(),
        normals: None,
        uvs: None,
    }
}

/// Findings on method, settings and the ledger.
pub fn of_provenance(scan: &Scan, registry: &Registry) -> Vec<Finding> {
    let mut out = Vec::new();
    let ledger = Some(metadata::tags::LEDGER);
    let Some(provenance) = &scan.provenance else { return out };
    let tag = Some(metadata::tags::PROVENANCE);
    let revision = provenance.algorithm_revision;
    if revision > ALGORITHM_REVISION {
        let message = format!("algorithm revision {revision}; this build has {ALGORITHM_REVISION}");
        out.push(Finding::new(&NEWER_REVISION, tag, message));
    }
    let setting = |key: &str| provenance.settings.iter().find(|(k, _)| k == key).map(|(_, value)| value.as_str());
    let max_rms = setting("max-rms").map(|text| (text, share(text, "max-rms")));
    for fault in provenance.notes.iter().filter_map(|note| note.strip_prefix(FAULT_NOTE)) {
        out.push(Finding::new(&FAULT, tag, fault.to_owned()));
    }
    match (&max_rms, &scan.ledger) {
        (Some((text, Err(_))), _) => {
            let message = format!("the setting max-rms is `{text}`: a share such as 1% or 0.01 is needed");
            out.push(Finding::new(&MAX_RMS, tag, message));
        }
        (Some((_, Ok(asked))), Some(entries)) => {
            let all = Ledger { entries: entries.iter().cloned().map(entry_from_file).collect() };
            let missed = missed_quality(&provenance.notes, &all, *asked);
            out.extend(missed.map(|message| Finding::new(&QUALITY, ledger, message)));
        }
        _ => {}
    }
    if let (Some(text), Some(samples)) = (setting("samples"), &scan.samples)
        && text.parse() != Ok(samples.patch_count())
    {
        let message = format!("the setting samples is `{text}` and there are {}", samples.patch_count());
        out.push(Finding::new(&SAMPLE_COUNT, tag, message));
    }
    out.extend(of_method(provenance, registry));
    out
}

fn of_method(provenance: &translux_format::Provenance, registry: &Registry) -> Vec<Finding> {
    let tag = Some(metadata::tags::PROVENANCE);
    let Ok(method) = registry.method(&provenance.method) else {
        let known: Vec<&str> = registry.methods().iter().map(|m| m.name()).collect();
        let message = format!("method `{}`; this build has {}", provenance.method, known.join(", "));
        return vec![Finding::new(&UNKNOWN_METHOD, tag, message)];
    };
    let of_every_method = ["for-lights", "max-rms", "samples"];
    let wanted: BTreeSet<&str> = method.keys().iter().map(|key| key.name()).chain(of_every_method).collect();
    let there: BTreeSet<&str> = provenance.settings.iter().map(|(key, _)| key.as_str()).collect();
    let list = |keys: BTreeSet<&str>| keys.into_iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ");
    let mut out = Vec::new();
    // Assets of the dipole do not say so, and those that the library has baked had no command line.
    let unknown = &(&there - &wanted) - &BTreeSet::from(["model", REQUEST]);
    let missing = &wanted - &there;
    if !missing.is_empty() {
        let message = format!("{} lacks the settings {}", method.name(), list(missing));
        out.push(Finding::new(&SETTINGS, tag, message));
    }
    if !unknown.is_empty() {
        let message = format!("{} does not know the settings {}", method.name(), list(unknown));
        out.push(Finding::new(&SETTINGS, tag, message));
    }
    for key in method.keys() {
        let text = provenance.settings.iter().find(|(name, _)| name == key.name()).map(|(_, text)| text);
        if let Some(text) = text.filter(|text| key.check(text).is_err()) {
            let message = format!("`{}` is `{text}`; {} is needed", key.name(), key.values());
            out.push(Finding::new(&SETTINGS, tag, message));
        }
    }
    out
}

/// Findings on far field, basis and irradiance rows, where present.
///
/// # Errors
/// The faults for which sections are refused.
pub fn of_method_sections(scan: &Scan) -> Result<Vec<Finding>, Vec<FormatError>> {
    // A section that does not decode has been found already; the others would be blamed for missing it.
    let damaged: Vec<_> = scan.errors.iter().filter_map(FormatError::tag).collect();
    let intact = |tags: &[Tag]| !tags.iter().any(|tag| damaged.contains(tag));
    let far_tags = [&far_field::tags::ALL[..], &far_field::tags::OPTIONAL].concat();
    let basis_tags = [&profile_basis::tags::ALL[..], &[profile_basis::tags::TOTALS]].concat();
    let mut errors = Vec::new();
    let (mut field, mut basis, mut stored_rows) = (None, None, None);
    if let (Some(mesh), Some(samples), true) = (&scan.mesh, &scan.samples, intact(&far_tags)) {
        match FarField::from_sections(&scan.extra, &Shape::new(mesh.positions_mm.len(), samples)) {
            Ok(found) => field = found,
            Err(error) => errors.push(error),
        }
    }
    if intact(&basis_tags) {
        match ProfileBasis::from_sections(&scan.extra) {
            Ok(found) => basis = found,
            Err(error) => errors.push(error),
        }
    }
    let rows_are_intact = intact(&rows::tags::ALL) && intact(&[rows::tags::BLOCKS]);
    if let (Some(samples), true) = (&scan.samples, rows_are_intact) {
        match IrradianceRows::from_sections(&scan.extra, samples.patch_count()) {
            Ok(found) => stored_rows = found,
            Err(error) => errors.push(error),
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let mut out = Vec::new();
    if let (Some(field), Some(basis)) = (field, basis)
        && field.terms != basis.terms()
    {
        let message = format!("{} functions in the far field, {} in the basis", field.terms, basis.terms());
        out.push(Finding::new(&TERMS, Some(far_field::tags::STEPS), message));
    }
    if let Some(Err(refused)) = stored_rows.map(|rows| EntranceBasis::from_polynomials(&rows.functions)) {
        out.push(Finding::new(&ANGLES, Some(rows::tags::FUNCTIONS), refused.message().to_owned()));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::CATALOGUE;

    #[test]
    fn numbers_ascend_and_leave_the_format_its_own() {
        assert!(CATALOGUE[0].number == 100 && CATALOGUE.windows(2).all(|pair| pair[0].number < pair[1].number));
    }
}
