//! `compare --metric flip`: HDR-FLIP of two OpenEXR pictures.
#![allow(clippy::unwrap_used, missing_docs)]

use crate::common::Folder;
use serde_json::Value;
use translux::geometry::shapes;
use translux::io::exr_write::{ExrChannel, ExrImage, ExrLayer, SampleKind};
use translux::measure::flip::{Picture, Settings, hdr};

const WIDTH: usize = 24;
const HEIGHT: usize = 20;

type Pixels = Vec<[f32; 3]>;

fn layer(name: &str, channels: [&str; 3], pixels: &[[f32; 3]]) -> ExrLayer {
    let channel = |(c, name): (usize, &str)| ExrChannel {
        name: name.into(),
        kind: SampleKind::Float,
        samples: pixels.iter().map(|p| p[c]).collect(),
    };
    ExrLayer { name: name.into(), channels: channels.into_iter().enumerate().map(channel).collect() }
}

fn coverage(covered: impl Fn(usize) -> bool) -> ExrLayer {
    let samples = (0..WIDTH * HEIGHT).map(|i| f32::from(u8::from(covered(i)))).collect();
    let channel = ExrChannel { name: "A".into(), kind: SampleKind::Float, samples };
    ExrLayer { name: "coverage".into(), channels: vec![channel] }
}

fn write(folder: &Folder, name: &str, layers: Vec<ExrLayer>) {
    let image = ExrImage { width: WIDTH, height: HEIGHT, layers, attributes: Vec::new() };
    folder.write(name, image.encode().unwrap());
}

fn rgb(name: &str, pixels: &[[f32; 3]]) -> ExrLayer {
    layer(name, ["R", "G", "B"], pixels)
}

/// A slope of light, `by` times as bright in the left half.
fn slope(by: f32) -> Pixels {
    let at = |i: usize| {
        let (x, y) = ((i % WIDTH) as f32, (i / WIDTH) as f32);
        let v = 0.2 + 0.03 * x + 0.01 * y;
        let by = if i % WIDTH < WIDTH / 2 { by } else { 1.0 };
        [v * by, 0.8 * v * by, 0.5 * v]
    };
    (0..WIDTH * HEIGHT).map(at).collect()
}

fn expected(test: &Pixels, reference: &Pixels) -> translux::measure::flip::HdrFlip {
    let [test, reference] = [test, reference].map(|rgb| Picture { width: WIDTH, height: HEIGHT, rgb });
    hdr(&reference, &test, &Settings::default()).unwrap()
}

/// Numbers read from JSON may be off by their last bit.
#[track_caller]
fn assert_is(found: &Value, expected: f64) {
    let found = found.as_f64().unwrap();
    assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
}

#[test]
fn the_figure_is_the_mean_over_the_picture_with_b_as_the_reference() {
    let folder = Folder::new();
    let (a, b) = (slope(3.0), slope(1.0));
    write(&folder, "a.exr", vec![rgb("", &a)]);
    write(&folder, "b.exr", vec![rgb("", &b)]);
    let report = folder.run("compare a.exr b.exr --metric flip --fail-above 100% --json").ok().json();
    let found = expected(&a, &b);
    assert!(found.mean > 0.05);
    assert_eq!(report["metric"], "flip");
    assert_is(&report["value"], found.mean);
    assert_is(&report["flip"]["mean"], found.mean);
    assert_is(&report["flip"]["mean_covered"], found.mean);
    assert!((report["flip"]["pixels_per_degree"].as_f64().unwrap() - 67.02).abs() < 0.01);
    let exposures = &report["flip"]["exposures"];
    assert_eq!(
        (&exposures["start"], &exposures["stop"]),
        (&found.exposures.start.into(), &found.exposures.stop.into())
    );
    assert_eq!((&exposures["count"], &exposures["from"]), (&2.into(), &"reference".into()));
    // The other figures are there, too, and this one is not where nobody asked for it.
    assert!(report["image"]["rms"].as_f64().unwrap() > 0.0);
    assert!(folder.run("compare a.exr b.exr --fail-above 100% --json").ok().json()["flip"].is_null());
    // The brighter picture as the reference has other exposures.
    let turned = folder.run("compare b.exr a.exr --metric flip --fail-above 100% --json").ok().json();
    assert_ne!(turned["flip"]["exposures"]["start"], *exposures.get("start").unwrap());
}

#[test]
fn thresholds_and_equality_decide_the_exit_code() {
    let folder = Folder::new();
    write(&folder, "a.exr", vec![rgb("", &slope(1.1))]);
    write(&folder, "b.exr", vec![rgb("", &slope(1.0))]);
    let mean = expected(&slope(1.1), &slope(1.0)).mean;
    folder.run(&format!("compare a.exr b.exr --metric flip --fail-above {}", mean * 1.001)).ok();
    folder.run(&format!("compare a.exr b.exr --metric flip --fail-above {}", mean * 0.999)).fails(7, &[]);
    folder.run("compare a.exr b.exr --metric flip").fails(7, &[]);
    let text = folder.run("compare b.exr b.exr --metric flip --fail-above 0").ok().text();
    assert!(text.starts_with("equal: HDR-FLIP 0.0000 (0.0000 over covered pixels) at 2 exposures from +"), "{text}");
    let text = folder.run("compare a.exr b.exr --metric flip --fail-above 100%").ok().text();
    assert!(text.starts_with(&format!("different: HDR-FLIP {mean:.4} ")), "{text}");
}

#[test]
fn the_diffuse_layer_counts_where_both_have_it() {
    let folder = Folder::new();
    let (bright, dim) = (slope(2.0), slope(1.0));
    write(&folder, "a.exr", vec![rgb("", &bright), rgb("diffuse", &dim)]);
    write(&folder, "b.exr", vec![rgb("", &dim), rgb("diffuse", &dim)]);
    write(&folder, "plain.exr", vec![rgb("", &dim)]);
    let value = |files: &str| {
        folder.run(&format!("compare {files} --metric flip --fail-above 1 --json")).ok().json()["value"].clone()
    };
    assert_eq!(value("a.exr b.exr"), 0.0);
    assert_is(&value("a.exr plain.exr"), expected(&bright, &dim).mean);
}

#[test]
fn single_scattering_is_added_to_the_diffuse_layer_where_both_have_it() {
    let folder = Folder::new();
    let dim = slope(1.0);
    let bright: Pixels = dim.iter().map(|p| p.map(|c| 2.0 * c)).collect();
    let black = vec![[0.0; 3]; WIDTH * HEIGHT];
    write(&folder, "a.exr", vec![rgb("", &bright), rgb("diffuse", &dim), rgb("single", &dim)]);
    write(&folder, "b.exr", vec![rgb("", &bright), rgb("diffuse", &bright), rgb("single", &black)]);
    write(&folder, "without.exr", vec![rgb("", &bright), rgb("diffuse", &dim)]);
    let run = |files: &str| folder.run(&format!("compare {files} --metric rms --fail-above 1 --json")).ok();
    let value = |files: &str| run(files).json()["value"].as_f64().unwrap();
    assert_eq!(value("a.exr b.exr"), 0.0);
    assert_eq!(value("a.exr without.exr"), 0.0);
    assert!(value("b.exr without.exr") > 0.1);
    let text = folder.run("compare a.exr without.exr --fail-above 1").ok().stderr;
    assert!(text.contains("a.exr alone has single scattering"), "{text}");
}

#[test]
fn covered_pixels_have_a_mean_of_their_own() {
    let folder = Folder::new();
    let (a, b) = (slope(2.0), slope(1.0));
    let (top, left) = (|i: usize| i < 5 * WIDTH, |i: usize| i % WIDTH < 6);
    write(&folder, "a.exr", vec![rgb("", &a), coverage(top)]);
    write(&folder, "b.exr", vec![rgb("", &b), coverage(left)]);
    let report = folder.run("compare a.exr b.exr --metric flip --fail-above 1 --json").ok().json();
    let found = expected(&a, &b);
    let either: Vec<bool> = (0..WIDTH * HEIGHT).map(|i| top(i) || left(i)).collect();
    assert_is(&report["value"], found.mean);
    assert_is(&report["flip"]["mean_covered"], found.mean_over(&either).unwrap());
    assert_ne!(report["flip"]["mean_covered"], report["value"]);
    // Nothing is covered.
    let black = vec![[0.0; 3]; WIDTH * HEIGHT];
    write(&folder, "none.exr", vec![rgb("", &black), coverage(|_| false)]);
    let report = folder.run("compare none.exr none.exr --metric flip --json").ok().json();
    assert_eq!((&report["value"], &report["flip"]["exposures"]["from"]), (&0.0.into(), &"neither".into()));
    assert!(report["flip"]["mean_covered"].is_null());
    let text = folder.run("compare none.exr none.exr --metric flip").ok().text();
    assert!(text.starts_with("equal: HDR-FLIP 0.0000 at 1 exposure,"), "{text}");
}

#[test]
fn a_black_reference_has_a_figure() {
    let folder = Folder::new();
    write(&folder, "lit.exr", vec![rgb("", &slope(1.0))]);
    write(&folder, "black.exr", vec![rgb("", &vec![[0.0; 3]; WIDTH * HEIGHT])]);
    let report = folder.run("compare lit.exr black.exr --metric flip --fail-above 1 --json").ok().json();
    assert_eq!(report["flip"]["exposures"]["from"], "test");
    let value = report["value"].as_f64().unwrap();
    assert!(value > 0.5 && value <= 1.0, "{value}");
}

#[test]
fn what_is_not_finite_is_an_error_that_names_file_and_pixel() {
    let folder = Folder::new();
    let mut broken = slope(1.0);
    broken[WIDTH + 3] = [0.0, f32::INFINITY, 0.0];
    write(&folder, "broken.exr", vec![rgb("", &broken)]);
    write(&folder, "b.exr", vec![rgb("", &slope(1.0))]);
    let parts = ["broken.exr against the reference b.exr: the test picture is not finite at column 3, row 1"];
    folder.run("compare broken.exr b.exr --metric flip").fails(3, &parts);
    folder.run("compare b.exr broken.exr --metric flip").fails(3, &["the reference is not finite"]);
}

#[test]
fn pictures_of_different_sizes_are_different() {
    let folder = Folder::new();
    write(&folder, "a.exr", vec![rgb("", &slope(1.0))]);
    let image = ExrImage { width: HEIGHT, height: WIDTH, layers: vec![rgb("", &slope(1.0))], attributes: Vec::new() };
    folder.write("turned.exr", image.encode().unwrap());
    folder.run("compare a.exr turned.exr --metric flip --fail-above 1").fails(7, &["different sizes"]);
    write(&folder, "data.exr", vec![coverage(|_| true)]);
    folder.run("compare a.exr data.exr --metric flip").fails(3, &["data.exr: no channel R"]);
}

#[test]
fn only_pictures_have_it() {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(10.0, 1));
    folder.run("bake ball.obj --unit mm --method two_pass --material marble --samples 500 -o a.tlux -q").ok();
    folder.run("evaluate a.tlux --light constant:radiance=1 -o a.ply -q").ok();
    for file in ["a.tlux", "a.ply"] {
        for more in ["", " --fail-above 1%"] {
            let run = folder.run(&format!("compare {file} {file} --metric flip{more}"));
            run.fails(1, &["--metric flip compares pictures", ".exr", file]);
        }
    }
    // Before any file is read.
    folder.run("compare none.ply none.ply --metric flip").fails(1, &["--metric flip compares pictures"]);
}
