//! `validate` finds what is wrong with an asset, all of it, under stable numbers.
#![allow(clippy::unwrap_used, missing_docs)]

use std::sync::LazyLock;

use crate::common::Folder;
use serde_json::Value;
use translux::geometry::shapes;
use translux_format::far_field::{FarField, NO_RECEIVER, Shape};
use translux_format::profile_basis::ProfileBasis;
use translux_format::rows::IrradianceRows;
use translux_format::{AssetFile, Budget, Codec, Kind, LedgerEntry, MediumRecord, RawSection, Reader, Tag};

/// A small asset that nothing is wrong with.
static GOOD: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = Folder::new();
    // Small, so that what is drawn between its vertices is right.
    folder.obj("ball.obj", &shapes::icosphere(1.5, 2));
    folder.run("bake ball.obj --unit mm --material skin1 --samples 500 --method two_pass -o a.tlux").ok();
    let asset = AssetFile::from_bytes(&folder.read("a.tlux"), Budget::default()).unwrap();
    assert_eq!(asset.ledger.iter().map(|e| e.stage.as_str()).collect::<Vec<_>>(), ["nothing stored"]);
    asset.to_bytes().unwrap()
});

fn validate(bytes: &[u8]) -> (i32, Value) {
    let folder = Folder::new();
    folder.write("a.tlux", bytes);
    let outcome = folder.run("validate a.tlux --json");
    (outcome.code, outcome.json())
}

/// The number, severity and section of each finding.
fn findings(report: &Value) -> Vec<(u64, String, Option<String>)> {
    let row = |f: &Value| {
        let text = |key: &str| f[key].as_str().map(str::to_owned);
        assert!(!text("name").unwrap().is_empty() && !text("message").unwrap().is_empty());
        (f["number"].as_u64().unwrap(), text("severity").unwrap(), text("section"))
    };
    report["findings"].as_array().unwrap().iter().map(row).collect()
}

/// Validates a changed asset.
fn changed(change: impl FnOnce(&mut AssetFile)) -> (i32, Vec<(u64, String, Option<String>)>) {
    let mut asset = AssetFile::from_bytes(&GOOD, Budget::default()).unwrap();
    change(&mut asset);
    let (code, report) = validate(&asset.to_bytes().unwrap());
    (code, findings(&report))
}

#[test]
fn nothing_is_wrong_with_what_bake_writes() {
    let (code, report) = validate(&GOOD);
    assert_eq!((code, findings(&report)), (0, vec![]), "{report}");
    assert_eq!(report["schema"], "translux.validate.v1");
    assert_eq!((&report["errors"], &report["finding_warnings"]), (&0.into(), &0.into()));
    assert_eq!(report["format_version"], "0.2");
    let folder = Folder::new();
    folder.write("a.tlux", &*GOOD);
    assert!(folder.run("validate a.tlux --strict").ok().text().contains("a.tlux: valid; 0 errors, 0 warnings"));
    folder.run("validate missing.tlux").fails(2, &["missing.tlux"]);
}

/// A change, and the finding that it makes: number, severity, section.
type Case = (fn(&mut AssetFile), u64, &'static str, &'static str);

#[test]
fn every_finding_of_the_catalogue() {
    let cases: [Case; 20] = [
        (|a| a.provenance.method = "crystal_ball".into(), 100, "error", "meta.src"),
        (|a| set(a, "max-rms", "a lot"), 102, "error", "meta.src"),
        (|a| add_far_field(a, 2, 3), 103, "error", "far.stp"),
        (|a| a.samples = translux_format::Samples::none(1), 104, "error", "samp.prt"),
        (|a| a.samples.facets[7][1] <<= 1, 105, "error", "samp.prt"),
        (|a| add_rows(a, a.samples.patch_count(), 0.0), 106, "error", "rows.fun"),
        (|a| a.parts.parts[0].opaque = true, 110, "warning", "samp.prt"),
        (add_empty_triangle, 111, "warning", "samp.off"),
        (add_empty_triangle, 112, "warning", "mesh.tri"),
        (|a| add_vertex(a), 113, "warning", "mesh.pos"),
        (|a| a.mesh.materials.push("spare".into()), 114, "warning", "mesh.mtn"),
        (
            |a| a.parts.media.push(MediumRecord { eta_inside_over_outside: 1.3, ..Default::default() }),
            115,
            "warning",
            "part.med",
        ),
        (|a| a.mesh.triangles[0].swap(1, 2), 116, "warning", "mesh.tri"),
        (|a| set(a, "charm", "7"), 120, "warning", "meta.src"),
        (|a| set(a, "samples", "501"), 121, "warning", "meta.src"),
        (|a| a.ledger[0].relative_rms = 0.006, 123, "warning", "meta.err"),
        (|a| a.ledger.push(of_stage("environment rows", 0.006)), 123, "warning", "meta.err"),
        (|a| a.provenance.notes.push("plan: missed: 2 % RMS, more than 1 %".into()), 123, "warning", "meta.err"),
        (|a| a.provenance.notes.insert(0, "fault: too coarse".into()), 124, "warning", "meta.src"),
        (|a| a.provenance.algorithm_revision = u32::MAX, 131, "warning", "meta.src"),
    ];
    for (change, number, severity, section) in cases {
        let (code, found) = changed(change);
        let expected = (number, severity.to_owned(), Some(section.to_owned()));
        assert!(found.contains(&expected), "{number}: {found:?}");
        let errors = found.iter().any(|(_, severity, _)| severity == "error");
        assert_eq!(code, if errors { 3 } else { 0 }, "{number}: {found:?}");
        assert!(severity == "error" || !errors || number == 110, "{number}: {found:?}");
    }
}

fn of_stage(stage: &str, relative_rms: f64) -> LedgerEntry {
    LedgerEntry { stage: stage.into(), relative_rms, ..Default::default() }
}

/// What a plan has measured from end to end counts, and stages that stand together for the ones before them do.
#[test]
fn errors_are_summed_as_they_are_promised() {
    let planned = |a: &mut AssetFile| a.provenance.notes.push("plan: measured: 0.3 % RMS".into());
    let above = |a: &mut AssetFile| a.ledger.push(of_stage("coding", 0.006));
    assert_eq!(changed(|a| above(a)).1.len(), 1);
    assert_eq!(changed(|a| (above(a), planned(a)).1).1, vec![]);
    assert_eq!(changed(|a| (above(a), a.ledger.push(of_stage("together", 0.004))).1).1, vec![]);
}

fn set(asset: &mut AssetFile, key: &str, value: &str) {
    let settings = &mut asset.provenance.settings;
    settings.retain(|(k, _)| k != key);
    settings.push((key.into(), value.into()));
    settings.sort();
}

fn add_vertex(asset: &mut AssetFile) {
    asset.mesh.positions_mm.push([0.0; 3]);
    asset.mesh.weld.push(asset.mesh.weld.len() as u32);
}

fn add_empty_triangle(asset: &mut AssetFile) {
    let triangle = asset.mesh.triangles.len() as u32;
    asset.mesh.triangles.push([0, 1, 1]);
    asset.mesh.triangle_material.push(0);
    asset.parts.triangle_part.push(0);
    if let Some(normals) = &mut asset.mesh.normals {
        normals.corners.push([0; 3]);
    }
    if let Some(uvs) = &mut asset.mesh.uvs {
        uvs.corners.push([0; 3]);
    }
    asset.samples.facets.push([triangle, 1]);
    asset.samples.patch_offsets.push(asset.samples.facets.len() as u32);
    asset.samples.part_offsets[1] += 1;
}

/// A far field without receivers and a basis, of these numbers of functions.
fn add_far_field(asset: &mut AssetFile, terms: usize, basis_terms: usize) {
    let vertices = asset.mesh.positions_mm.len();
    let field = FarField {
        terms,
        receiver_of_vertex: vec![NO_RECEIVER; vertices],
        steps: vec![1.0; terms],
        ..Default::default()
    };
    let functions = vec![1.0; basis_terms];
    let basis = ProfileBasis { split_mm: 1.0, nodes_mm: vec![1.0], weights_mm4: vec![1.0], functions, totals: None };
    asset.extra.extend(field.to_sections(&Shape::new(vertices, &asset.samples)).unwrap());
    asset.extra.extend(basis.to_sections().unwrap());
}

/// Irradiance rows without details for this many patches, of the function `scale mu`.
fn add_rows(asset: &mut AssetFile, patches: usize, scale: f64) {
    let mut function = [0.0; 9];
    function[0] = scale;
    let rows = IrradianceRows {
        side: 32,
        terms: 1,
        offsets: vec![0; patches + 1],
        steps: vec![1.0; patches],
        scaling: vec![1; 6 * patches],
        scaling_steps: vec![1.0; patches],
        functions: vec![function],
        ..Default::default()
    };
    asset.extra.extend(rows.to_sections().unwrap());
}

#[test]
fn irradiance_rows_are_decoded_and_fit_the_samples() {
    let (code, found) = changed(|a| add_rows(a, a.samples.patch_count(), 1.0));
    assert_eq!((code, found), (0, vec![]));
    let error = |number, tag: &str| (3, vec![(number, "error".to_owned(), Some(tag.to_owned()))]);
    for change in [-1, 1] {
        let found = changed(|a| add_rows(a, a.samples.patch_count().wrapping_add_signed(change), 1.0));
        assert_eq!(found, error(21, "rows.cnt"));
    }
    for tag in translux_format::rows::tags::ALL {
        let found = changed(|a| {
            add_rows(a, a.samples.patch_count(), 1.0);
            a.extra.retain(|section| section.tag != tag);
        });
        assert_eq!(found, error(18, tag.as_str()));
    }
    let found = changed(|a| {
        add_rows(a, a.samples.patch_count(), 1.0);
        let steps = a.extra.iter_mut().find(|section| section.tag.as_str() == "rows.stp").unwrap();
        steps.bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    assert_eq!(found, error(21, "rows.stp"));
    let unknown = Tag::new("rows.new").unwrap();
    let (code, found) =
        changed(|a| a.extra.push(RawSection::from_rows(unknown, Kind::Environment, Codec::Raw, &[1u8])));
    assert_eq!((code, found), (0, vec![(130, "warning".into(), Some("rows.new".into()))]));
}

#[test]
fn sections_and_versions_that_are_unknown() {
    let tag = Tag::new("new.data").unwrap();
    let (code, found) = changed(|a| a.extra.push(RawSection::from_rows(tag, Kind::Method, Codec::Raw, &[1u8])));
    assert_eq!((code, found), (0, vec![(130, "warning".into(), Some("new.data".into()))]));
    let (code, found) = changed(|a| add_far_field(a, 2, 2));
    assert_eq!((code, found), (0, vec![]));
    let mut bytes = GOOD.clone();
    bytes[10] = 200;
    seal(&mut bytes);
    let (code, report) = validate(&bytes);
    assert_eq!((code, findings(&report)), (0, vec![(132, "warning".into(), None)]));
}

/// Settings out of range and forms that are not there are only found when the asset is opened.
#[test]
fn a_method_that_refuses_the_asset() {
    let record = |tag: &str, content: &str| {
        let content = content.to_owned();
        let tag = Tag::new(tag).unwrap();
        move |a: &mut AssetFile| {
            let section = a.extra.iter_mut().find(|section| section.tag == tag).unwrap();
            *section = RawSection::from_record(tag, Kind::Metadata, Codec::Zstd, &content).unwrap();
        }
    };
    for change in [record("form.nam", "telepathy"), record("form.set", "higgledy-piggledy")] {
        assert_eq!(changed(change), (3, vec![(101, "error".into(), None)]));
    }
    // The text is for people: nothing is evaluated by it.
    let (code, found) = changed(|a| set(a, "bound", "higgledy-piggledy"));
    assert_eq!((code, found), (0, vec![(120, "warning".into(), Some("meta.src".into()))]));
}

#[test]
fn sections_of_a_method_that_do_not_decode() {
    let drop_section = |tag: &'static str| {
        move |a: &mut AssetFile| {
            add_far_field(a, 2, 2);
            a.extra.retain(|section| section.tag.as_str() != tag);
        }
    };
    let error = |number, tag: &str| vec![(number, "error".to_owned(), Some(tag.to_owned()))];
    assert_eq!(changed(drop_section("far.grp")), (3, error(18, "far.grp")));
    assert_eq!(changed(drop_section("bas.wgt")), (3, error(18, "bas.wgt")));
    let (code, found) = changed(|a| {
        add_far_field(a, 2, 2);
        let steps = a.extra.iter_mut().find(|section| section.tag.as_str() == "far.stp").unwrap();
        steps.bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    assert_eq!((code, found), (3, error(21, "far.stp")));
}

#[test]
fn strictness_turns_warnings_into_a_failure() {
    let without_ledger = |bytes: &[u8]| {
        let mut asset = AssetFile::from_bytes(bytes, Budget::default()).unwrap();
        asset.ledger.clear();
        asset.to_bytes().unwrap()
    };
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(10.0, 2));
    let bake =
        "bake ball.obj --unit mm --material marble --samples 500 --method quantized_lights --set lights=60 -o a.tlux";
    folder.run(bake).ok();
    folder.write("a.tlux", without_ledger(&folder.read("a.tlux")));
    let outcome = folder.run("validate a.tlux").ok();
    assert!(outcome.text().contains("warning 122 NoLedger: the ledger is empty"), "{}", outcome.text());
    folder.run("validate a.tlux --strict").fails(6, &[]);
    // What holds no transport has lost nothing before it is evaluated.
    folder.write("a.tlux", without_ledger(&GOOD));
    folder.run("validate a.tlux --strict").ok();
}

/// Damage in several places is found in all of them.
#[test]
fn damage_does_not_hide_damage() {
    let mut bytes = GOOD.clone();
    let reader = Reader::parse(&GOOD, Budget::default()).unwrap();
    for tag in ["mesh.pos", "samp.prt", "meta.err"] {
        let section = reader.section(Tag::new(tag).unwrap()).unwrap();
        bytes[(section.offset + section.stored_bytes) as usize - 1] ^= 1;
    }
    let (code, report) = validate(&bytes);
    let found = findings(&report);
    let sections: Vec<&str> = found.iter().map(|(_, _, section)| section.as_deref().unwrap()).collect();
    assert_eq!((code, sections), (3, vec!["meta.err", "mesh.pos", "samp.prt"]));
    assert!(found.iter().all(|(number, severity, _)| *number == 16 && severity == "error"));

    for (bytes, number) in [(&b"not an asset at all, but text"[..], 1), (&GOOD[..20], 2), (&GOOD[..GOOD.len() - 1], 4)]
    {
        let (code, report) = validate(bytes);
        assert_eq!(code, 3);
        assert_eq!(findings(&report)[0].0, number);
    }
    let (code, report) = validate(&[]);
    assert!(code == 3 && findings(&report).len() == 1);
}

/// Assets that are evaluated without samples are as good as others.
#[test]
fn every_method_writes_what_is_valid() {
    let folder = Folder::new();
    folder.obj("a.obj", &shapes::bumpy_head(1.0, 1));
    for method in translux::methods::built_in().methods().iter().map(|m| m.name()) {
        let settings: &[&str] = match method {
            "all_frequency" => &["", "--set basis=haar"],
            "filtered_normals" => &["", "--set filter=geometric"],
            _ => &[""],
        };
        for set in settings {
            let options = format!("--method {method} --samples 800 {set}");
            folder.run(&format!("bake a.obj --size-mm 20 --material marble -q -o a.tlux {options}")).ok();
            let text = folder.run("validate a.tlux").ok().text();
            assert!(text.contains("valid; 0 errors") && !text.contains("UnknownSection"), "{method} {set}: {text}");
        }
    }
}

#[test]
fn help_lists_the_catalogue() {
    let folder = Folder::new();
    let text = folder.run("validate --help").ok().text();
    for line in ["100", "UnknownMethod", "SPEC.md", "NewerVersion"] {
        assert!(text.contains(line), "{line}: {text}");
    }
}

/// Makes the checksum of header and directory right again.
fn seal(bytes: &mut [u8]) {
    let count = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    bytes[24..28].fill(0);
    let mut crc = !0u32;
    for byte in &bytes[..32 + 48 * count] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    bytes[24..28].copy_from_slice(&(!crc).to_le_bytes());
}
