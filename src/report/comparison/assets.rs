//! Comparison of two assets: differences of their bytes, and of their radiosities under the probe lights.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use translux_format::{Budget, FormatError, Provenance, Reader, SectionInfo, Tag, metadata};

use crate::asset::{Asset, REQUEST, refused};
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::measured::{Measured, Truth, measured};
use crate::geometry::mesh::Mesh;
use crate::light::Light;
use crate::math::statistics::VertexError;
use crate::measure::probes;
use crate::progress::Progress;
use crate::report::text::{percent, titled};

/// Makes the evaluator of an asset; the path is for its error messages.
pub type Open<'a> = dyn Fn(&Arc<Asset>, &Path) -> Result<Box<dyn Evaluator>> + 'a;

/// Differences of two assets by section, setting and provenance.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct AssetDifference {
    sections: Vec<SectionPair>,
    settings: Vec<Difference>,
    provenance: Vec<Difference>,
    /// Errors of the first against the second under each probe light, where they were asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) probes: Vec<ProbeError>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
enum Status {
    Equal,
    Different,
    OnlyInA,
    OnlyInB,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct SectionPair {
    tag: String,
    /// Result of the comparison of type and decoded bytes.
    status: Status,
    stored_bytes_a: Option<u64>,
    stored_bytes_b: Option<u64>,
    decoded_bytes_a: Option<u64>,
    decoded_bytes_b: Option<u64>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct Difference {
    key: String,
    a: Option<String>,
    b: Option<String>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ProbeError {
    light: &'static str,
    pub(super) error: VertexError,
}

/// Compares the bytes of two assets.
pub(super) fn bytes([a, b]: [&[u8]; 2], [path_a, path_b]: [&Path; 2], budget: Budget) -> Result<AssetDifference> {
    let (reader_a, reader_b) = (parsed(a, path_a, budget)?, parsed(b, path_b, budget)?);
    let tags_b = reader_b.sections().iter().map(|section| section.tag);
    let mut tags: Vec<Tag> = reader_a.sections().iter().map(|section| section.tag).collect();
    tags.extend(tags_b.filter(|tag| reader_a.find(*tag).is_none()));
    let pair = |tag: &Tag| -> Result<SectionPair> {
        let (in_a, in_b) = (reader_a.find(*tag), reader_b.find(*tag));
        let status = match (in_a, in_b) {
            (Some(x), Some(y)) if kind_of(x) != kind_of(y) => Status::Different,
            (Some(_), Some(_)) => {
                let content_a = reader_a.bytes(*tag).map_err(|e| wrong(&e, path_a))?;
                let content_b = reader_b.bytes(*tag).map_err(|e| wrong(&e, path_b))?;
                if content_a == content_b { Status::Equal } else { Status::Different }
            }
            (Some(_), None) => Status::OnlyInA,
            (None, _) => Status::OnlyInB,
        };
        Ok(SectionPair {
            tag: tag.to_string(),
            status,
            stored_bytes_a: in_a.map(|section| section.stored_bytes),
            stored_bytes_b: in_b.map(|section| section.stored_bytes),
            decoded_bytes_a: in_a.map(|section| section.decoded_bytes),
            decoded_bytes_b: in_b.map(|section| section.decoded_bytes),
        })
    };
    let sections = tags.iter().map(pair).collect::<Result<_>>()?;
    let provenance = |reader: &Reader<'_>, path| -> Result<Provenance> {
        reader.record(metadata::tags::PROVENANCE).map_err(|e| wrong(&e, path))
    };
    let (from_a, from_b) = (provenance(&reader_a, path_a)?, provenance(&reader_b, path_b)?);
    Ok(AssetDifference {
        sections,
        settings: differences(&from_a.settings, &from_b.settings).into_iter().filter(|d| d.key != REQUEST).collect(),
        provenance: differences(&facts(&from_a), &facts(&from_b)),
        probes: Vec::new(),
    })
}

fn wrong(error: &FormatError, path: &Path) -> Error {
    refused(error).in_file(path)
}

fn parsed<'a>(bytes: &'a [u8], path: &Path, budget: Budget) -> Result<Reader<'a>> {
    Reader::parse(bytes, budget).map_err(|e| wrong(&e, path))
}

fn kind_of(section: &SectionInfo) -> impl PartialEq {
    (section.kind, section.element, section.components)
}

/// Provenance without the settings, as keys and values.
fn facts(p: &Provenance) -> Vec<(String, String)> {
    let mut out = vec![
        ("algorithm revision".to_owned(), p.algorithm_revision.to_string()),
        ("method".to_owned(), p.method.clone()),
        ("seed".to_owned(), p.seed.to_string()),
        ("unit of the source".to_owned(), format!("{} mm ({})", p.mm_per_source_unit, p.source_unit)),
        ("notes".to_owned(), p.notes.join("; ")),
    ];
    out.extend(p.inputs.iter().map(|input| {
        let hash = blake3::Hash::from_bytes(input.blake3).to_hex();
        (format!("input {}", input.name), format!("{} bytes, BLAKE3 {hash}", input.bytes))
    }));
    out
}

/// Keys whose values differ or that only one side has, in order.
fn differences(a: &[(String, String)], b: &[(String, String)]) -> Vec<Difference> {
    let value = |pairs: &[(String, String)], key: &str| pairs.iter().find(|(k, _)| k == key).map(|(_, v)| v.clone());
    let keys: BTreeSet<&String> = a.iter().chain(b).map(|(key, _)| key).collect();
    let difference = |key: &String| Difference { key: key.clone(), a: value(a, key), b: value(b, key) };
    keys.into_iter().map(difference).filter(|d| d.a != d.b).collect()
}

impl AssetDifference {
    /// The differences as lines of text.
    pub(super) fn describe(&self) -> String {
        let differing: Vec<&SectionPair> = self.sections.iter().filter(|s| s.status != Status::Equal).collect();
        let mut lines = vec![match differing.len() {
            0 => format!("{} sections, all of the same content", self.sections.len()),
            n => format!("{n} of {} sections differ", self.sections.len()),
        }];
        if !differing.is_empty() {
            let bytes = |b: Option<u64>| b.map_or_else(|| "-".to_owned(), |b| b.to_string());
            let row = |s: &&SectionPair| [s.tag.clone(), bytes(s.decoded_bytes_a), bytes(s.decoded_bytes_b)];
            lines.push(titled(["section", "bytes of A", "bytes of B"], differing.iter().map(row)));
        }
        for (what, list) in [("setting", &self.settings), ("provenance", &self.provenance)] {
            let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "-".to_owned());
            lines.extend(list.iter().map(|d| format!("{what} {}: {} | {}", d.key, text(&d.a), text(&d.b))));
        }
        lines.extend(self.probes.iter().map(|probe| {
            let VertexError { rms, p999, worst, .. } = probe.error;
            let [rms, p999, worst] = [rms, p999, worst].map(percent);
            format!("under {}: RMS {rms}, 99.9th percentile {p999}, worst vertex {worst}", probe.light)
        }));
        lines.join("\n")
    }
}

/// Error of the first asset's radiosity against the second's under fixed lights that no choice saw; worst light of each
/// figure.
pub(super) fn radiosity(
    [a, b]: [&[u8]; 2],
    [path_a, path_b]: [&Path; 2],
    (open, budget): (&Open, Budget),
    progress: &dyn Progress,
) -> Result<(VertexError, Vec<ProbeError>)> {
    let read =
        |bytes: &[u8], path: &Path| Asset::from_bytes_within(bytes, budget).map(Arc::new).map_err(|e| e.in_file(path));
    let (a, b) = (read(a, path_a)?, read(b, path_b)?);
    let (mesh, other) = (&b.scene.mesh, &a.scene.mesh);
    let same =
        |x: &Mesh, y: &Mesh| x.origin_mm == y.origin_mm && x.local_mm == y.local_mm && x.triangles == y.triangles;
    if !same(mesh, other) {
        let (va, ta) = (other.local_mm.len(), other.triangles.len());
        let (vb, tb) = (mesh.local_mm.len(), mesh.triangles.len());
        return Err(Error::input(format!(
            "{} ({va} vertices, {ta} triangles) and {} ({vb}, {tb}) are not of one mesh: vertices cannot be compared; \
             leave --fail-above out to compare the bytes",
            path_a.display(),
            path_b.display()
        )));
    }
    let lights = probe_lights(mesh);
    // One after the other: the second evaluator is gone before the first is opened.
    let mut of_b = Vec::with_capacity(lights.len());
    let mut evaluator = open(&b, path_b)?;
    for (_, light) in &lights {
        evaluator.set_lights(vec![light.clone()], progress)?;
        of_b.push(evaluator.radiosity(progress)?);
    }
    drop(evaluator);
    let mut evaluator = open(&a, path_a)?;
    let errors = lights.into_iter().zip(&of_b).map(|((name, light), truth)| {
        evaluator.set_lights(vec![light], progress)?;
        let Measured { error, .. } = measured(evaluator.as_mut(), Truth::Given(truth), progress)?;
        Ok(ProbeError { light: name, error })
    });
    let errors: Vec<ProbeError> = errors.collect::<Result<_>>()?;
    Ok((errors.iter().fold(VertexError::default(), |worst, probe| worst.max(probe.error)), errors))
}

fn probe_lights(mesh: &Mesh) -> Vec<(&'static str, Light)> {
    let name = |light: &Light| match light {
        Light::Directional { .. } => "a directional light",
        Light::Point { .. } => "a point light",
        _ => "a constant light",
    };
    probes::unseen(mesh).into_iter().chain([probes::constant()]).map(|light| (name(&light), light)).collect()
}
