//! `compare` of two assets: bytes without a threshold, radiosity under probe lights with one. `inspect` by kind.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::Folder;
use translux::geometry::shapes;
use translux_format::{AssetFile, Budget, Codec, Kind, RawSection, Tag};

const BAKE: &str = "--unit mm --method two_pass --set directions=64";

fn folder() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(10.0, 2)).obj("other.obj", &shapes::icosphere(9.0, 2));
    folder.run(&format!("bake ball.obj {BAKE} --material marble --samples 2000 -o a.tlux")).ok();
    folder
}

#[test]
fn equal_bytes_are_equal() {
    let folder = folder();
    folder.write("copy.tlux", folder.read("a.tlux"));
    let outcome = folder.run("compare a.tlux copy.tlux").ok();
    assert!(outcome.text().starts_with("equal: ") && outcome.text().contains("all of the same content"));
    let report = folder.run("compare a.tlux copy.tlux --json").ok().json();
    assert_eq!((&report["equal"], &report["value"]), (&true.into(), &serde_json::Value::Null));
    assert!(report["assets"]["sections"].as_array().unwrap().iter().all(|s| s["status"] == "equal"));
    for metric in ["rms", "p999", "worst"] {
        let report =
            folder.run(&format!("compare a.tlux copy.tlux --metric {metric} --fail-above 0 --json")).ok().json();
        assert_eq!(report["value"], 0.0);
        assert!(report["assets"]["probes"].as_array().unwrap().len() >= 4);
    }
    assert_eq!(folder.run("compare a.tlux copy.tlux -q").ok().text(), "");
}

#[test]
fn differences_are_named() {
    let folder = folder();
    folder.run(&format!("bake ball.obj {BAKE} --material marble --samples 1500 -o b.tlux")).ok();
    let outcome = folder.run("compare a.tlux b.tlux");
    assert_eq!(outcome.code, 7);
    let text = outcome.text();
    for part in ["different: ", "samp.rul", "setting samples: 2000 | 1500"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(!text.contains("mesh.pos"), "{text}");
    let report = folder.run("compare a.tlux b.tlux --json").json();
    let status = |tag: &str| {
        let sections = report["assets"]["sections"].as_array().unwrap();
        sections.iter().find(|s| s["tag"] == tag).unwrap()["status"].as_str().unwrap().to_owned()
    };
    assert_eq!((status("mesh.pos"), status("samp.rul")), ("equal".into(), "different".into()));
    assert_eq!(report["assets"]["settings"][0]["key"], "samples");
    // They say nearly the same about light all the same.
    let near = folder.run("compare a.tlux b.tlux --fail-above 3%").ok();
    assert!(near.text().contains("under a point light: RMS"), "{}", near.text());
    folder.run("compare a.tlux b.tlux --fail-above 1e-9").fails(7, &[]);
}

#[test]
fn another_material_is_another_radiosity() {
    let folder = folder();
    folder.run(&format!("bake ball.obj {BAKE} --material skin1 --samples 2000 -o skin.tlux")).ok();
    let outcome = folder.run("compare a.tlux skin.tlux --fail-above 3% --json");
    assert_eq!(outcome.code, 7);
    let report = outcome.json();
    assert!(report["value"].as_f64().unwrap() > 0.03);
    assert!(report["vertices"]["worst"].as_f64().unwrap() >= report["vertices"]["rms"].as_f64().unwrap());
}

#[test]
fn sections_of_one_side_only() {
    let folder = folder();
    let mut asset = AssetFile::from_bytes(&folder.read("a.tlux"), Budget::default()).unwrap();
    asset.extra.push(RawSection::from_rows(Tag::new("x.one").unwrap(), Kind::Method, Codec::Raw, &[1u8; 5]));
    asset.provenance.notes.push("handmade".into());
    folder.write("more.tlux", asset.to_bytes().unwrap());
    let report = folder.run("compare a.tlux more.tlux --json").json();
    let sections = report["assets"]["sections"].as_array().unwrap();
    let section = sections.iter().find(|s| s["tag"] == "x.one").unwrap();
    assert_eq!((&section["status"], &section["decoded_bytes_b"]), (&"only-in-b".into(), &5.into()));
    assert_eq!(report["assets"]["provenance"][0]["key"], "notes");
    let report = folder.run("compare more.tlux a.tlux --json").json();
    let sections = report["assets"]["sections"].as_array().unwrap();
    assert!(sections.iter().any(|s| s["tag"] == "x.one" && s["status"] == "only-in-a"));
    folder.run("compare a.tlux more.tlux --fail-above 0").ok();
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = folder();
    folder.run(&format!("bake other.obj {BAKE} --material marble --samples 2000 -o other.tlux")).ok();
    folder.run("compare a.tlux other.tlux --fail-above 1%").fails(3, &["not of one mesh", "--fail-above"]);
    folder.run("compare a.tlux other.tlux").fails(7, &[]);
    folder.run("compare a.tlux a.tlux --metric mean").fails(1, &["mean", "rms, p999, worst"]);
    folder.run("compare a.tlux ball.obj").fails(1, &[".tlux"]);
    folder.write("broken.tlux", &folder.read("a.tlux")[..100]);
    folder.run("compare a.tlux broken.tlux").fails(3, &["broken.tlux"]);
    folder.run("compare a.tlux missing.tlux").fails(2, &["missing.tlux"]);
}

/// Bytes by kind; those for environments are apart.
#[test]
fn inspect_counts_bytes_by_kind() {
    let folder = folder();
    let before = folder.run("inspect a.tlux --json").ok().json();
    let mut asset = AssetFile::from_bytes(&folder.read("a.tlux"), Budget::default()).unwrap();
    asset.extra.push(RawSection::from_rows(Tag::new("x.env").unwrap(), Kind::Environment, Codec::Raw, &[7u8; 16_200]));
    folder.write("env.tlux", asset.to_bytes().unwrap());
    let after = folder.run("inspect env.tlux --json").ok().json();
    assert_eq!(before["bytes_per_vertex_on_disk"], after["bytes_per_vertex_on_disk"]);
    let vertices = after["vertices"].as_f64().unwrap();
    assert_eq!(after["environment_bytes_per_vertex_on_disk"], 16_200.0 / vertices);
    assert_eq!(after["environment_bytes_per_vertex_resident"], 16_200.0 / vertices);
    assert_eq!(
        (&before["sizes"]["stored_environment"], &after["sizes"]["stored_environment"]),
        (&0.into(), &16_200.into())
    );
    let kinds = after["sizes"]["kinds"].as_array().unwrap();
    let stored = |kind: &str| kinds.iter().find(|k| k["kind"] == kind).unwrap()["stored_bytes"].as_u64().unwrap();
    let sections = after["sizes"]["sections"].as_array().unwrap();
    let all: u64 = sections.iter().map(|s| s["stored_bytes"].as_u64().unwrap()).sum();
    assert_eq!(kinds.iter().map(|k| k["stored_bytes"].as_u64().unwrap()).sum::<u64>(), all);
    let without = stored("samples") + stored("method") + stored("metadata");
    assert_eq!(after["sizes"]["stored_without_mesh"], without);
    let text = folder.run("inspect env.tlux").ok().text();
    assert!(text.contains("bytes/vertex for environments: 100.0 on disk") && text.contains("\nkind "), "{text}");
}
