//! `inspect` reads header, directory and records; `--deep` the rest. The edits that it tells are those of the evaluator.

use translux::geometry::shapes;
use translux_format::{AssetFile, Budget, Reader, Tag};

use crate::common::Folder;

/// A ball as an asset of each form.
fn assets() -> (Folder, Vec<String>) {
    let folder = Folder::new();
    // Small, so that the walks of what is calibrated leave soon.
    folder.obj("ball.obj", &shapes::icosphere(0.7, 1));
    let mut names = Vec::new();
    for (method, rest) in [
        ("two_pass", ""),
        ("two_pass", "--model calibrated --photons 2048"),
        ("editable", ""),
        ("editable", "--set transport=stored"),
        ("editable", "--for-lights directional"),
        ("quantized_lights", "--set lights=16 --set shells=0"),
        ("all_frequency", "--set coefficients=9"),
        ("all_frequency", "--set coefficients=16 --set basis=haar"),
        ("texture_space", "--set resolution=32"),
        ("filtered_normals", "--set rungs=2"),
    ] {
        let name = format!("{}.tlux", names.len());
        let bake =
            format!("bake ball.obj --unit mm --material skin1 --samples 150 --max-rms 20% --method {method} {rest}");
        folder.run(&format!("{bake} -o {name}")).ok();
        names.push(name);
    }
    (folder, names)
}

#[test]
fn the_directory_tells_what_everything_tells() {
    let (folder, names) = assets();
    for name in &names {
        let quick = folder.run(&format!("inspect {name} --json")).ok().json();
        let deep = folder.run(&format!("inspect {name} --deep --json")).ok().json();
        for key in ["method", "vertices", "triangles", "media", "sizes", "edits", "ledger", "provenance"] {
            assert_eq!(quick[key], deep[key], "{name}: {key}");
        }
        assert!(!quick["edits"].is_null(), "{name}");
        for key in ["diagonal_mm", "cost", "bytes_per_vertex_resident"] {
            assert!(quick[key].is_null() && !deep[key].is_null(), "{name}: {key}");
        }
        let parts = |report: &serde_json::Value| report["parts"].as_array().unwrap().clone();
        for (quick, deep) in parts(&quick).iter().zip(&parts(&deep)) {
            for key in ["name", "medium", "samples"] {
                assert_eq!(quick[key], deep[key], "{name}: {key}");
            }
            assert!(quick["area_mm2"].is_null() && deep["area_mm2"].as_f64().unwrap() > 0.0, "{name}");
        }
    }
}

/// Nothing but the directory and the records is read: damage and length elsewhere are not noticed, and cost nothing.
#[test]
fn only_directory_and_records_are_read() {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(8.0, 1));
    folder.run("bake ball.obj --unit mm --material skin1 --samples 150 --method two_pass -o a.tlux").ok();
    let whole = folder.read("a.tlux");
    let reader = Reader::parse(&whole, Budget::default()).unwrap();
    let place = |tag: &str| reader.find(Tag::new(tag).unwrap()).unwrap().offset as usize;
    for (tag, noticed) in [("mesh.pos", false), ("samp.rul", false), ("meta.src", true), ("part.rec", true)] {
        let mut damaged = whole.clone();
        damaged[place(tag) + 7] ^= 1;
        folder.write("b.tlux", damaged);
        assert_eq!(folder.run("inspect b.tlux").code, if noticed { 3 } else { 0 }, "{tag}");
        folder.run("inspect b.tlux --deep").fails(3, &["b.tlux", tag]);
        folder.run("validate b.tlux").fails(3, &[]);
    }
    for length in [0, 7, 31, 100, whole.len() - 1] {
        folder.write("b.tlux", &whole[..length]);
        folder.run("inspect b.tlux").fails(3, &["b.tlux"]);
    }
    folder.write("b.tlux", [whole.as_slice(), b"x"].concat());
    folder.run("inspect b.tlux").fails(3, &["b.tlux"]);

    // 120 MB more of a section that no form reads: no more time and memory.
    let mut asset = AssetFile::from_bytes(&whole, Budget::default()).unwrap();
    let ballast = vec![7u8; 120 << 20];
    let (kind, codec) = (translux_format::Kind::Method, translux_format::Codec::Raw);
    asset.extra.push(translux_format::RawSection::from_rows(Tag::new("x.large").unwrap(), kind, codec, &ballast));
    folder.write("large.tlux", asset.to_bytes().unwrap());
    let report = folder.run("inspect large.tlux --json").ok().json();
    assert_eq!(report["sizes"]["file"].as_u64().unwrap() >> 20, 120);
    assert!(
        report["timings"]["peak_memory_bytes"].as_u64().unwrap() < 40 << 20,
        "{}",
        report["timings"]["peak_memory_bytes"]
    );
    folder.run("inspect large.tlux --max-memory 40MB").ok();
    folder.run("inspect large.tlux --deep --max-memory 40MB").fails(4, &["large.tlux"]);
}

/// Many files: each is looked at, and the exit code is the largest of theirs.
#[test]
fn many_files_at_once() {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(8.0, 1));
    folder.run("bake ball.obj --unit mm --material skin1 --samples 150 --method two_pass -o a.tlux").ok();
    folder.write("b.tlux", folder.read("a.tlux")).write("c.tlux", "no asset");
    for command in ["inspect", "validate"] {
        let report = folder.run(&format!("{command} a.tlux b.tlux --json")).ok().json();
        let files: Vec<_> = report["files"].as_array().unwrap().iter().map(|f| f["asset"].clone()).collect();
        assert_eq!(files, ["a.tlux", "b.tlux"]);
        let text = folder.run(&format!("{command} a.tlux b.tlux")).ok().text();
        assert!(text.contains("a.tlux: ") && text.contains("\nb.tlux: "), "{text}");
        let outcome = folder.run(&format!("{command} none.tlux c.tlux a.tlux --json")).fails(3, &["none.tlux"]);
        assert!(outcome.json()["files"].as_array().unwrap().iter().any(|f| f["asset"] == "a.tlux"));
        assert_eq!(outcome.json()["failed"][0]["exit"], 2);
    }
}
