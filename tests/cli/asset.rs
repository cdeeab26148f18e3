//! The asset holds all that an evaluation needs, the same bytes whatever the threads, and the vertex order of its source.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::{Folder, called, relative_difference};
use glam::DVec3;
use translux::geometry::shapes;

const FIVE_LIGHTS: &str = "--light directional:from=1,2,3:irradiance=3,2,1 --light point:at=0,10,30:intensity=900 \
                           --light area:at=0,40,0:normal=0,-1,0:size=20,20:radiance=5 --light constant:radiance=0.1 \
                           --light sky:rotate=40";

/// Two parts of unlike media that shadow each other.
fn heads() -> Folder {
    let folder = Folder::new();
    let (first, second) = (called(shapes::bumpy_head(12.0, 3), "wax"), called(shapes::icosphere(6.0, 2), "soap"));
    folder.obj("heads.obj", &shapes::compose(&[(first, DVec3::ZERO), (second, DVec3::new(22.0, 22.0, 2.0))]));
    folder
}

const HEADS: &str =
    "heads.obj --unit mm --material wax=marble --material soap=skin1 --samples 1000 --set directions=64";

#[test]
fn an_asset_alone_is_sufficient() {
    let folder = heads();
    for method in ["two_pass", "reference"] {
        folder.run(&format!("bake {HEADS} --method {method} -o a.tlux")).ok();
        folder.run(&format!("evaluate a.tlux {FIVE_LIGHTS} -o here.ply")).ok();
        let elsewhere = Folder::new();
        elsewhere.write("moved.tlux", folder.read("a.tlux"));
        elsewhere.run(&format!("evaluate moved.tlux {FIVE_LIGHTS} -o there.ply")).ok();
        assert_eq!(elsewhere.names(), ["moved.tlux", "there.ply"]);
        assert!(folder.read("here.ply") == elsewhere.read("there.ply"), "{method} needs more than its asset");
        folder.run(&format!("reference {HEADS} --method {method} {FIVE_LIGHTS} -o memory.ply")).ok();
        assert!(folder.read("here.ply") == folder.read("memory.ply"), "{method} in memory differs");
    }
}

#[test]
fn the_place_of_the_model_leaves_no_trace() {
    let (folder, other) = (heads(), heads());
    folder.run(&format!("bake {HEADS} --method editable --for-lights directional -o a.tlux")).ok();
    // In another folder, by a path that is absolute.
    let absolute = other.path("heads.obj");
    let words = HEADS.split(' ').map(|w| if w == "heads.obj" { absolute.to_str().unwrap() } else { w });
    other
        .run_words(
            ["bake"].into_iter().chain(words).chain("--method editable --for-lights directional -o b.tlux".split(' ')),
        )
        .ok();
    assert!(folder.read("a.tlux") == other.read("b.tlux"), "the folder or the path is in the asset");
}

/// The same bytes for any number of threads, one light of each kind at a time.
#[test]
fn threads_do_not_change_a_byte() {
    let folder = heads();
    let lights: Vec<&str> = FIVE_LIGHTS.split("--light ").map(str::trim).filter(|l| !l.is_empty()).collect();
    assert_eq!(lights.len(), 5);
    for method in ["two_pass", "reference"] {
        let mut first: Option<Vec<Vec<u8>>> = None;
        for threads in [1, 2, 8] {
            folder.run(&format!("bake {HEADS} --method {method} --threads {threads} -o a.tlux")).ok();
            let mut files = vec![folder.read("a.tlux")];
            for light in &lights {
                folder.run(&format!("evaluate a.tlux --light {light} --threads {threads} -o b.ply")).ok();
                files.push(folder.read("b.ply"));
            }
            let first = first.get_or_insert_with(|| files.clone());
            for (file, (a, b)) in files.iter().zip(first).enumerate() {
                assert!(a == b, "{method}: file {file} with {threads} threads");
            }
        }
    }
}

#[test]
fn threads_come_from_the_environment_too() {
    let folder = heads();
    let run = |value: &str| {
        let mut program = assert_cmd::Command::new(env!("CARGO_BIN_EXE_translux"));
        program.current_dir(folder.path("")).env("TRANSLUX_THREADS", value);
        program.args(["materials", "--json"]).output().unwrap()
    };
    let report: serde_json::Value = serde_json::from_slice(&run("3").stdout).unwrap();
    assert_eq!(report["timings"]["threads"], 3);
    assert_eq!(run("many").status.code(), Some(1));
    assert_eq!(run("0").status.code(), Some(1));
}

/// Vertex i of the PLY is the i-th `v` line: unused and doubled vertices, polygons and reversed order included.
#[test]
fn vertices_keep_the_order_of_the_file() {
    let folder = Folder::new();
    let model = shapes::cuboid(DVec3::new(8.0, 10.0, 12.0), 4);
    let count = model.positions.len();
    // Every vertex twice, the second half backwards; the later triangles use the doubles, with seams between.
    // One vertex that nothing uses comes first.
    let mut seamed = model.clone();
    seamed.positions = [DVec3::new(3.0, 2.0, 1.0)]
        .into_iter()
        .chain(model.positions.iter().copied())
        .chain(model.positions.iter().rev().copied())
        .collect();
    let double = |v: u32| (2 * count) as u32 - v;
    let half = seamed.triangles.len() / 2;
    for (index, triangle) in seamed.triangles.iter_mut().enumerate() {
        *triangle = triangle.map(|v| if index > half { double(v) } else { v + 1 });
    }
    let used: std::collections::HashSet<u32> = seamed.triangles.iter().flatten().copied().collect();
    folder.obj("plain.obj", &model).obj("seamed.obj", &seamed);
    let rest = "--unit cm --material marble --samples 2000 --light directional:from=1,2,3:irradiance=2";
    folder.run(&format!("reference plain.obj {rest} -o plain.ply")).ok();
    let outcome = folder.run(&format!("reference seamed.obj {rest} -o seamed.ply --json")).ok();
    let unused = seamed.positions.len() - used.len();
    assert!(unused > 1 && used.len() > count);
    assert_eq!(outcome.json()["vertices_without_area"], unused);
    assert_eq!(outcome.json()["vertices"], seamed.positions.len());

    let positions = folder.positions("seamed.ply");
    assert_eq!(positions.len(), seamed.positions.len());
    for (found, expected) in positions.iter().zip(&seamed.positions) {
        assert!(found.distance(*expected * 10.0) < 1e-4, "{found} is not {expected} cm");
    }
    let (plain, seams) = (folder.radiosity("plain.ply"), folder.radiosity("seamed.ply"));
    assert_eq!(seams[0], DVec3::ZERO);
    for (v, value) in plain.iter().enumerate() {
        assert!(value.min_element() > 0.0);
        let (first, second) = (v + 1, double(v as u32) as usize);
        let both: Vec<usize> = [first, second].into_iter().filter(|v| used.contains(&(*v as u32))).collect();
        assert!(!both.is_empty());
        // The triangles are those of the plain model in the same order, so even the samples are the same.
        both.iter().for_each(|&v| assert_eq!(seams[v], *value, "vertex {v}"));
        for v in [first, second].into_iter().filter(|v| !used.contains(&(*v as u32))) {
            assert_eq!(seams[v], DVec3::ZERO, "vertex {v} belongs to no triangle");
        }
    }
}

/// Quads, relative indices and texture coordinates in between: the order of the `v` lines stays.
#[test]
fn polygons_and_relative_indices_keep_the_order() {
    let folder = Folder::new();
    let text = "v 0 0 4\nvt 0 0\nv 4 0 4\nvn 0 0 1\nv 4 4 4\nv 0 4 4\nf 1/1/1 2/1/1 3/1/1 4/1/1\n\
                v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf -1 -2 -3 -4\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";
    folder.write("quads.obj", text);
    folder.run("reference quads.obj --unit mm --material marble --samples 500 -o b.ply").ok();
    let expected = [[0, 0, 4], [4, 0, 4], [4, 4, 4], [0, 4, 4], [0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]];
    let expected: Vec<DVec3> = expected.map(|p| DVec3::from_array(p.map(f64::from))).to_vec();
    assert_eq!(folder.positions("b.ply"), expected);
}

#[test]
fn a_material_edit_equals_a_bake_of_that_material() {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(12.0, 3));
    let bake = "bake head.obj --method editable --unit mm --samples 4000 --max-rms 0.5% --for-lights directional";
    let light = "--light directional:from=1,2,3:irradiance=2";
    for (name, material) in
        [("marble", "--material marble"), ("skin", "--material skin1"), ("thick", "--material skin1 --eta 1.1")]
    {
        folder.run(&format!("{bake} {material} -o {name}.tlux")).ok();
        folder.run(&format!("evaluate {name}.tlux {light} -o {name}.ply")).ok();
    }
    folder.run(&format!("evaluate marble.tlux {light} --material skin1 -o skin_edit.ply")).ok();
    folder.run(&format!("evaluate marble.tlux {light} --material skin1 --eta 1.1 -o thick_edit.ply")).ok();
    for name in ["skin", "thick"] {
        folder.run(&format!("compare {name}_edit.ply {name}.ply --fail-above 0.5%")).ok();
        assert!(relative_difference(&folder.radiosity("marble.ply"), &folder.radiosity(&format!("{name}.ply"))) > 0.05);
    }
    assert!(relative_difference(&folder.radiosity("skin.ply"), &folder.radiosity("thick.ply")) > 0.01);
}

/// An edit of one part leaves the other alone; parts of one medium are edited together or not at all.
#[test]
fn edits_by_name_stay_where_they_belong() {
    let folder = heads();
    let light = "--light constant:radiance=1";
    folder.run(&format!("bake {HEADS} --method editable --for-lights constant -o a.tlux")).ok();
    folder.run(&format!("evaluate a.tlux {light} -o before.ply")).ok();
    folder.run(&format!("evaluate a.tlux {light} --material soap=cream -o after.ply")).ok();
    let (before, after) = (folder.radiosity("before.ply"), folder.radiosity("after.ply"));
    let wax = shapes::bumpy_head(12.0, 3).positions.len();
    assert!(relative_difference(&after[wax..], &before[wax..]) > 0.05);
    assert!(relative_difference(&after[..wax], &before[..wax]) < 0.005);

    let bake = "bake heads.obj --method editable --unit mm --material marble --parts separate --samples 1000";
    folder.run(&format!("{bake} --for-lights constant -o same.tlux")).ok();
    let refused = folder.run("evaluate same.tlux --material soap=cream -o c.ply");
    refused.fails(1, &["soap and wax are one medium", "--material marble="]);
    folder.run(&format!("evaluate same.tlux {light} --material marble=cream -o c.ply")).ok();
    let c = folder.radiosity("c.ply");
    assert!(relative_difference(&c[..wax], &before[..wax]) > 0.05);
}

/// What `inspect` says of an asset is what was baked.
#[test]
fn inspect_tells_what_was_baked() {
    let folder = heads();
    let baked = folder.run(&format!("bake {HEADS} --method two_pass -o a.tlux --json")).ok().json();
    let report = folder.run("inspect a.tlux --deep --json").ok().json();
    let bytes = folder.read("a.tlux").len();
    assert_eq!(report["sizes"]["file"], bytes);
    assert_eq!(baked["bytes"], bytes);
    assert_eq!(report["method"], "two_pass");
    assert_eq!(report["edits"]["material"], "any");
    assert_eq!(report["provenance"]["settings"]["samples"], "1000");
    assert_eq!(report["provenance"]["settings"]["directions"], "64");
    for key in ["vertices", "triangles", "diagonal_mm", "media"] {
        assert_eq!(report[key], baked[key], "{key}");
    }
    let parts = report["parts"].as_array().unwrap();
    let names: Vec<_> = parts.iter().map(|p| (p["name"].as_str().unwrap(), p["medium"].as_str().unwrap())).collect();
    assert_eq!(names, [("wax", "marble"), ("soap", "skin1")]);
    assert_eq!(parts.iter().map(|p| p["samples"].as_u64().unwrap()).sum::<u64>(), 1000);
    let sections = report["sizes"]["sections"].as_array().unwrap();
    let stored: u64 = sections.iter().map(|s| s["stored_bytes"].as_u64().unwrap()).sum();
    assert!(stored < bytes as u64);
    assert!(sections.iter().any(|s| s["kind"] == "mesh") && sections.iter().any(|s| s["kind"] == "samples"));
    let hash = report["provenance"]["inputs"][0]["blake3"].as_str().unwrap();
    assert_eq!(hash, blake3::hash(&folder.read("heads.obj")).to_hex().as_str());
}

#[test]
fn samples_are_stored_where_that_is_asked_for() {
    let folder = heads();
    for method in ["two_pass", "editable --for-lights directional"] {
        let bake = format!("bake {HEADS} --method {method} --if-changed --json");
        let made = folder.run(&format!("{bake} -o made.tlux")).ok().json();
        folder.write("stored.tlux", folder.read("made.tlux"));
        // What was asked for is not the same.
        let stored = folder.run(&format!("{bake} --store samples -o stored.tlux")).ok().json();
        let more = stored["bytes"].as_u64().unwrap() - made["bytes"].as_u64().unwrap();
        assert!((1500..4500).contains(&more), "{method}: {more} bytes for 1,000 samples");
        let report = |name: &str| folder.run(&format!("inspect {name} --json")).ok().json();
        let (of_made, of_stored) = (report("made.tlux"), report("stored.tlux"));
        assert_eq!(of_made["parts"], of_stored["parts"], "{method}");
        assert_eq!(of_made["provenance"]["settings"]["store"], serde_json::Value::Null, "{method}");
        assert_eq!(of_stored["provenance"]["settings"]["store"], "samples", "{method}");
        for name in ["made", "stored"] {
            let light = "--light directional:from=0.3,0.8,0.5:irradiance=3";
            folder.run(&format!("evaluate {name}.tlux {light} -o {name}.ply -q")).ok();
        }
        assert!(folder.read("made.ply") == folder.read("stored.ply"), "{method}");
    }
    folder.run(&format!("bake {HEADS} --method two_pass --store rays -o a.tlux")).fails(1, &["rays", "samples"]);
}
