//! Where an asset is wrong: `evaluate --trust`, `blame`.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::Folder;
use translux::geometry::shapes;
use translux::io::exr::decode_planes;
use translux::io::ply::parse_ply;

const SUN: &str = "--light directional:from=1,2,3:irradiance=2";

fn baked(options: &str) -> Folder {
    baked_of(2, options)
}

/// Every error is measured at every vertex: few of them where their number is not what is looked at.
fn baked_of(subdivisions: u32, options: &str) -> Folder {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(8.0, subdivisions));
    let bake = "bake head.obj --unit mm --material marble --for-lights directional,point -o a.tlux";
    folder.run(&format!("{bake} {options}")).ok();
    folder
}

#[test]
fn a_map_lies_beside_the_radiosity_and_is_the_same_on_any_number_of_threads() {
    let folder = baked_of(1, "--method editable --samples 400 --max-rms 2%");
    let report = folder.run(&format!("evaluate a.tlux {SUN} --trust --threads 1 --json -o a.ply")).ok().json();
    folder.run(&format!("evaluate a.tlux {SUN} --trust --threads 3 -o b.ply")).ok();
    folder.run(&format!("evaluate a.tlux {SUN} -o plain.ply")).ok();
    assert!(folder.read("a.ply") == folder.read("b.ply"));
    assert_eq!(folder.radiosity("a.ply"), folder.radiosity("plain.ply"));
    let table = parse_ply(&folder.read("a.ply"), "a.ply").unwrap();
    let trust = &report["trust"];
    let columns = trust["columns"].as_array().unwrap();
    assert!(columns.len() == 14 && trust["stages_apart"] == true && trust["lights"].as_array().unwrap().len() == 38);
    for column in columns {
        assert_eq!(table.column(column.as_str().unwrap()).unwrap().len(), table.vertex_count, "{column}");
    }
    let of = |name: &str| table.column(name).unwrap();
    assert!(of("trust_worst").iter().zip(of("trust_r")).all(|(worst, mean)| *worst > 0.0 && *mean <= *worst));
    assert!(of("trust_thickness").iter().all(|depth| *depth > 0.0));
    assert!(table.comments.iter().any(|line| line.starts_with("trust light 0 directional:from=")));
    assert!(parse_ply(&folder.read("plain.ply"), "plain.ply").unwrap().column("trust_r").is_none());
    // What an option cannot do is told.
    folder.run(&format!("evaluate a.tlux {SUN} --trust --on head.obj -o c.ply")).fails(1, &["--trust", "--on"]);
    folder.run(&format!("evaluate a.tlux {SUN} --trust --max-memory 3MB -o c.ply")).fails(4, &["--max-memory"]);
    assert!(!folder.names().contains(&"c.ply".to_owned()));
}

#[test]
fn blame_tells_stages_at_a_vertex_and_what_mends_them() {
    let folder = baked("--method editable --samples 60 --max-rms 0.5%");
    let line = format!("blame a.tlux {SUN} --vertex 5");
    let report = folder.run(&format!("{line} --json")).ok().json();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let stages = report["stages"].as_array().unwrap();
    assert_eq!(stages.iter().map(|stage| &stage["stage"]).collect::<Vec<_>>(), ["sampling", "transport"]);
    for channel in 0..3 {
        let sum: f64 = stages.iter().map(|stage| number(&stage["error"][channel])).sum();
        assert!((sum - number(&report["error"][channel])).abs() < 1e-9);
    }
    assert_eq!(report["dominant"], "sampling");
    assert!(report["mend"].as_str().unwrap().contains("--method editable --samples "), "{report}");
    let text = folder.run(&line).ok().text();
    for fragment in ["vertex 5", "sampling", "dominant", "--samples", "--model calibrated", "mean free paths"] {
        assert!(text.contains(fragment), "{fragment}: {text}");
    }
    // What was typed to mend it does.
    let words = report["mend"].as_str().unwrap().split("--samples ").nth(1).unwrap().to_owned();
    let finer = baked(&format!("--method editable --samples {words} --max-rms 0.5%"));
    let after = finer.run(&format!("{line} --json")).ok().json();
    let largest = |report: &serde_json::Value| (0..3).map(|c| number(&report["error"][c]).abs()).fold(0.0, f64::max);
    assert!(largest(&after) < 0.6 * largest(&report), "{} and {}", largest(&after), largest(&report));
}

#[test]
fn places_that_are_not_there_are_refused() {
    let folder = baked("--method two_pass --samples 200");
    for (place, fragments) in [
        ("--vertex 162", &["--vertex 162", "0 to 161"][..]),
        ("", &["--vertex"]),
        ("--vertex 1 --pixel 3,4", &["--pixel"]),
        ("--pixel 3", &["two whole numbers"]),
        ("--pixel 0,0 --resolution 64x64", &["--pixel 0,0", "does not see"]),
        ("--pixel 64,0 --resolution 64x64", &["64x64 pixels"]),
        ("--vertex 1 --view top --camera at=0,0,50", &["--view"]),
    ] {
        folder.run(&format!("blame a.tlux {SUN} {place}")).fails(1, fragments);
    }
    folder.run("blame a.tlux --light directional:from=0,1,0:irradiance=0 --vertex 1").fails(1, &["no light arrives"]);
    folder.run("blame nothing.tlux --vertex 1").fails(2, &["nothing.tlux"]);
}

#[test]
fn blame_looks_where_the_picture_does() {
    let folder = baked_of(1, "--method quantized_lights --samples 300");
    let camera = "--camera at=0,0,60 --resolution 64x48";
    let report = folder.run(&format!("blame a.tlux {SUN} --pixel 31,23 {camera} --json")).ok().json();
    let at: Vec<f64> = report["at_mm"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    // The middle of the picture is on the side of the camera.
    assert!(at[0].abs() < 1.0 && at[1].abs() < 1.0 && at[2] > 4.0, "{at:?}");
    let stages = report["stages"].as_array().unwrap();
    assert_eq!(stages[2]["stage"], "between vertices");
    assert_eq!(report["pixel"], serde_json::json!([31, 23]));
}

#[test]
fn pictures_show_where_an_asset_is_wrong() {
    let folder = baked_of(1, "--method editable --samples 200 --max-rms 2%");
    let line = format!("render a.tlux {SUN} --resolution 200x120 --samples-per-pixel 1 -o a.exr -o a.png");
    let report = folder.run(&format!("{line} --aov trust --json")).ok().json();
    assert!(report["trust"]["total"]["rms"].as_f64().unwrap() > 0.0);
    let planes = decode_planes(&folder.read("a.exr")).unwrap();
    let plane = |name: &str| &planes.iter().find(|plane| plane.name == name).unwrap().samples;
    let covered = plane("coverage.A").iter().filter(|a| **a == 1.0).count();
    let wrong = plane("trust.error").iter().filter(|e| **e > 0.0).count();
    assert!(covered > 500 && wrong >= covered, "{covered} and {wrong}");
    assert!(plane("trust.worst").iter().zip(plane("trust.error")).all(|(worst, error)| worst >= error));
    // The legend is below, as wide as the picture.
    let png = folder.png("a.png");
    assert!(png.width == 200 && png.height > 160, "{}x{}", png.width, png.height);
    folder.run(&line).ok();
    assert!(decode_planes(&folder.read("a.exr")).unwrap().iter().all(|plane| !plane.name.starts_with("trust")));
    assert_eq!(folder.png("a.png").height, 120);
}
