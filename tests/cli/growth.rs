//! `translux chart --scale`: what it writes, that it goes on where it was interrupted, its limits, and its page in a browser.
#![allow(clippy::unwrap_used)]

use crate::common::{Folder, browse};
use serde_json::Value;
use translux::io::png::decode_png;

const LINE: &str = "chart --scale --quick --methods two_pass --material skin1 -o out";

fn growth(folder: &Folder) -> Value {
    serde_json::from_slice(&folder.read("out/growth.json")).unwrap()
}

fn points(growth: &Value) -> &Vec<Value> {
    growth["points"].as_array().unwrap()
}

/// Everything that the page, the tables and the charts hold, from one measurement that is then resumed.
#[test]
fn every_size_is_measured_once_and_says_how_to_make_it_again() {
    let folder = Folder::new();
    let report = folder.run(&format!("{LINE} --json --limit-seconds 60")).ok().json();
    let first = growth(&folder);
    crate::common::schema::check(&first);
    assert_eq!((&first["schema"], &report["growth"]), (&Value::from("translux.growth-file.v1"), &first));
    for axis in ["vertices", "samples", "ratio"] {
        let of_axis: Vec<&Value> = points(&first).iter().filter(|p| p["axis"] == axis).collect();
        assert_eq!(of_axis.len(), 3, "{axis}");
        let sizes: Vec<f64> = of_axis.iter().map(|p| p["size"].as_f64().unwrap()).collect();
        assert!(sizes.is_sorted_by(|a, b| a < b), "{sizes:?}");
        for point in of_axis {
            let costs = &point["costs"];
            for key in
                ["samples", "bake_seconds", "peak_memory_bytes", "file_bytes", "bytes", "resident_bytes", "open_ms"]
            {
                assert!(costs[key].as_f64().unwrap() > 0.0, "{key}: {point}");
            }
            assert!(costs["relight_ms"]["median"].as_f64().unwrap() > 0.0 && point["skipped"].is_null(), "{point}");
        }
    }
    // Fits of every cost, and a chart for each.
    let growing = first["growing"].as_array().unwrap();
    assert!(growing.iter().all(|g| g["method"] == "two_pass") && growing.len() >= 15, "{}", growing.len());
    assert!(growing.iter().any(|g| g["law"]["points"] == 3 && g["law"]["standard_error"].as_f64().unwrap() >= 0.0));
    for axis in ["vertices", "samples", "ratio"] {
        for quantity in ["bake", "memory", "bytes", "resident", "relight"] {
            let name = format!("out/{axis}-{quantity}");
            assert!(String::from_utf8(folder.read(&format!("{name}.svg"))).unwrap().contains("<svg"));
            let picture = decode_png(&folder.read(&format!("{name}.png"))).unwrap();
            assert!(picture.rgb.iter().any(|c| *c != picture.rgb[0]), "{name} is blank");
        }
    }
    let table = String::from_utf8(folder.read("out/growth.csv")).unwrap();
    assert_eq!(table.lines().count(), 10, "{table}");
    // A stored command makes its asset again.
    let point = points(&first).iter().find(|p| p["axis"] == "samples").unwrap();
    let command = point["command"].as_str().unwrap().strip_prefix("translux ").unwrap();
    folder.run(&format!("{command} -q -o again.tlux")).ok();
    assert_eq!(folder.read("again.tlux").len() as u64, point["costs"]["file_bytes"].as_u64().unwrap());

    // What is lost is measured again: one bake with its time, and one time alone.
    let names = |suffix: &str| {
        let entries = std::fs::read_dir(folder.path("out/work")).unwrap().map(|e| e.unwrap().path());
        let mut paths: Vec<_> = entries.filter(|p| p.to_string_lossy().ends_with(suffix)).collect();
        paths.sort();
        paths
    };
    std::fs::remove_file(&names(".point.json")[0]).unwrap();
    folder.run(&format!("{LINE} --limit-seconds 60")).ok();
    let second = growth(&folder);
    let changed = |key: &str| {
        points(&first).iter().zip(points(&second)).filter(|(a, b)| a["costs"][key] != b["costs"][key]).count()
    };
    assert_eq!(changed("bake_seconds"), 0);
    assert!(changed("relight_ms") <= 1);
    browsed(&folder);
}

fn browsed(folder: &Folder) {
    let Some((page, picture)) = browse(folder, "out/growth.html") else { return };
    assert_eq!(page.matches("<tr title=").count(), 9, "points");
    assert!(
        page.matches("<svg").count() >= 15 && page.contains("id=\"findings\"") && page.contains("id=\"exponents\"")
    );
    let dark = picture.rgb.iter().filter(|c| c[0] < 0.5).count();
    assert!(dark > 2000 && dark < picture.rgb.len() / 2, "{dark} dark pixels");
}

/// A limit that nothing keeps: bakes are ended, larger ones not started, and all of them are named.
#[test]
fn what_passes_a_limit_is_named_and_not_dropped() {
    let folder = Folder::new();
    folder.run(&format!("{LINE} --limit-seconds 0.001")).ok();
    let growth = growth(&folder);
    assert_eq!(points(&growth).len(), 9);
    let reasons: Vec<&str> = points(&growth).iter().map(|p| p["skipped"]["reason"].as_str().unwrap()).collect();
    assert!(reasons.iter().any(|r| r.starts_with("ended after")), "{reasons:?}");
    assert!(reasons.iter().any(|r| r.contains("predicted")), "{reasons:?}");
    let page = String::from_utf8(folder.read("out/growth.html")).unwrap();
    assert!(page.contains("id=\"skipped\"") && page.contains("ended after"));
    // Nothing is left of the bakes that were ended.
    let left =
        std::fs::read_dir(folder.path("out/work")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let left: Vec<String> = left.filter(|n| n.ends_with(".part") || n.ends_with(".tlux")).collect();
    assert!(left.is_empty(), "{left:?}");

    let folder = Folder::new();
    folder.run(&format!("{LINE} --max-memory 1MB")).ok();
    let growth = self::growth(&folder);
    for point in points(&growth) {
        assert!(point["skipped"]["reason"].as_str().unwrap().contains("of memory estimated"), "{point}");
    }
}

#[test]
fn wrong_lines_are_refused_before_the_work() {
    let folder = Folder::new();
    for (line, code, says) in [
        ("chart head.obj --scale -o out", 1, "--scale"),
        ("chart head.obj --limit-seconds 5 -o out", 1, "--scale"),
        ("chart --scale --limit-seconds 0 -o out", 1, "--limit-seconds"),
        ("chart --scale --limit-seconds -3 -o out", 1, "--limit-seconds"),
        ("chart --scale --limit-seconds nan -o out", 1, "--limit-seconds"),
        ("chart --scale --size-mm 20 -o out", 1, "--scale"),
        ("chart --scale --reference-samples 1000 -o out", 1, "--scale"),
        ("chart --scale --device cpu -o out", 1, "--scale"),
        ("chart --scale --material marble --material skin1 -o out", 1, "--material"),
        ("chart --scale --light sky --light constant:radiance=1 -o out", 1, "--light"),
        ("chart --scale --methods magic -o out", 1, "two_pass"),
        ("chart --scale --material unobtainium -o out", 1, "unobtainium"),
        ("chart --scale", 1, "--output"),
    ] {
        folder.run(line).fails(code, &[says]);
    }
    assert!(folder.names().is_empty(), "{:?}", folder.names());
}
