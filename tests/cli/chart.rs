//! `translux chart`: what it writes, that it goes on where it was interrupted, and its page in a browser.
#![allow(clippy::unwrap_used)]

use crate::common::{Folder, browse};
use serde_json::Value;
use translux::geometry::shapes;
use translux::io::png::decode_png;

const LINE: &str = "chart head.obj --size-mm 20 --material skin1 --quick --methods two_pass,editable --reference-samples 6000 \
                    --light directional:from=1,2,3:irradiance=3 --light point:at=0,15,30:intensity=900 -o out";

fn head() -> Folder {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(1.0, 2));
    folder
}

fn chart(folder: &Folder) -> Value {
    serde_json::from_slice(&folder.read("out/chart.json")).unwrap()
}

/// One chart serves three checks, the last of which takes a part of it away.
#[test]
fn a_chart_is_measured_and_shown_and_goes_on_where_it_was_interrupted() {
    let folder = head();
    let report = folder.run(&format!("{LINE} --json")).ok().json();
    every_row_is_measured_and_says_how_to_make_it_again(&folder, &report);
    the_page_shows_its_table_and_pictures_in_a_browser(&folder);
    an_interrupted_chart_goes_on_with_what_is_there(&folder);
}

fn every_row_is_measured_and_says_how_to_make_it_again(folder: &Folder, report: &Value) {
    let chart = chart(folder);
    crate::common::schema::check(&chart);
    assert_eq!(chart["schema"], "translux.chart-file.v1");
    assert_eq!(report["chart"], chart);
    let rows = chart["rows"].as_array().unwrap();
    let names: Vec<(&str, &str)> =
        rows.iter().map(|r| (r["method"].as_str().unwrap(), r["setting"].as_str().unwrap())).collect();
    assert_eq!((names.len(), names[0], names[2]), (4, ("two_pass", ""), ("editable", "")));
    for (index, row) in rows.iter().enumerate() {
        let positive = ["vertices", "samples", "bake_seconds", "peak_memory_bytes", "file_bytes", "bytes_per_vertex"];
        for key in positive.into_iter().chain(["resident_bytes_per_vertex", "open_ms"]) {
            assert!(row[key].as_f64().unwrap() > 0.0, "{key}: {row}");
        }
        for key in ["relight_ms", "edit_ms"] {
            let q = |name: &str| row[key][name].as_f64().unwrap();
            assert!(0.0 < q("p10") && q("p10") <= q("median") && q("median") <= q("p90"), "{row}");
        }
        let error = row["error"]["rms"].as_f64().unwrap();
        assert!(error > 0.0 && error < 0.2, "{row}");
        let lights = row["lights"].as_array().unwrap();
        let of_lights = lights.iter().map(|l| l["error"]["rms"].as_f64().unwrap()).fold(0.0, f64::max);
        assert_eq!((lights.len(), of_lights), (2, error), "the worst light counts");
        // The command that it stores makes the asset again. The second row has settings and the third another method:
        // nothing is new in the fourth, whose bake takes long.
        if index == 3 {
            continue;
        }
        let command = row["command"].as_str().unwrap().strip_prefix("translux ").unwrap();
        folder.run(&format!("{command} -q -o again.tlux")).ok();
        assert_eq!(folder.read("again.tlux").len() as f64, row["file_bytes"].as_f64().unwrap());
    }
    let truth = &chart["truths"][0];
    // What is next to exact is as far from the volume as the model is; nothing is nearer than the two allow.
    let worst =
        |lines: &Value| lines.as_array().unwrap().iter().map(|l| worst_of(&l["error"]["rms"])).fold(0.0, f64::max);
    let model = worst(&truth["model_errors"]);
    for row in rows {
        let [volume, error] = [0, 1].map(|i| row["volume_rms"][i].as_f64().unwrap());
        let own = row["error"]["rms"].as_f64().unwrap();
        assert!((volume - model).abs() < 2.0 * own + 3.0 * error + 1e-3 && volume > 0.0, "{volume} {model} {row}");
    }
    assert!(truth["own_rms"].as_f64().unwrap() > 0.0 && truth["samples"].as_u64().unwrap() >= 6000);
    let models = truth["model_errors"].as_array().unwrap();
    for line in models {
        let of = |key: &str| line["error"][key][0].as_f64().unwrap();
        assert!((0.005..0.6).contains(&of("rms")) && of("rms_error") < 0.1 * of("rms") + 0.02, "{line}");
    }
    assert_eq!(models.len(), 2, "a line for each light");
    let walk = models[0]["command"].as_str().unwrap().strip_prefix("translux ").unwrap();
    let again = folder.run(&format!("{walk} -q --json -o walk.ply")).ok().json();
    assert_eq!(again["photons"], models[0]["photons"]);
    let table = String::from_utf8(folder.read("out/chart.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines.len() == 5 && lines[0].starts_with("model,material,method,setting"), "{table}");
    for name in ["relight", "bytes", "bake", "stages"] {
        assert!(String::from_utf8(folder.read(&format!("out/{name}.svg"))).unwrap().contains("<svg"));
        let picture = decode_png(&folder.read(&format!("out/{name}.png"))).unwrap();
        assert!(picture.rgb.iter().any(|c| *c != picture.rgb[0]), "{name} is blank");
    }
}

fn worst_of(channels: &Value) -> f64 {
    channels.as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).fold(0.0, f64::max)
}

fn an_interrupted_chart_goes_on_with_what_is_there(folder: &Folder) {
    let before = chart(folder);
    let baked = |chart: &Value| -> Vec<Value> {
        chart["rows"].as_array().unwrap().iter().map(|r| r["bake_seconds"].clone()).collect()
    };
    // One bake is lost, one is half: its report is there and its asset is not.
    let work = folder.path("out/work");
    let mut files: Vec<_> = std::fs::read_dir(&work).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    // The smallest assets are baked again the soonest.
    let size = |path: &std::path::PathBuf| std::fs::metadata(path).unwrap().len();
    let mut assets: Vec<_> = files.iter().filter(|p| p.extension().unwrap() == "tlux").collect();
    assets.sort_by_key(|path| size(path));
    std::fs::remove_file(assets[0]).unwrap();
    std::fs::remove_file(assets[1].with_extension("json")).unwrap();
    folder.run(LINE).ok();
    let after = chart(folder);
    let same = baked(&before).iter().zip(baked(&after)).filter(|(a, b)| **a == *b).count();
    assert!(same >= 2, "{:?} {:?}", baked(&before), baked(&after));
    let errors = |chart: &Value| -> Vec<Value> {
        chart["rows"].as_array().unwrap().iter().flat_map(|r| [r["error"].clone(), r["volume_rms"].clone()]).collect()
    };
    assert_eq!(errors(&before), errors(&after));
}

#[test]
fn wrong_charts_are_refused_before_the_work() {
    let folder = head();
    for (line, code, says) in [
        ("chart -o out", 1, "MODEL"),
        ("chart head.obj --size-mm 20 --methods magic -o out", 1, "two_pass"),
        ("chart head.obj --size-mm 20 --reference-samples 0 -o out", 1, "--reference-samples"),
        ("chart none.obj --size-mm 20 --quick -o out", 2, "none.obj"),
        ("chart head.obj --quick -o out", 1, "--size-mm"),
        ("chart head.obj --size-mm 20 --material unobtainium --quick -o out", 1, "unobtainium"),
    ] {
        folder.run(line).fails(code, &[says]);
    }
}

fn the_page_shows_its_table_and_pictures_in_a_browser(folder: &Folder) {
    let Some((page, picture)) = browse(folder, "out/index.html") else { return };
    assert_eq!(page.matches("<tr title=").count(), 4, "rows");
    assert!(page.matches("<svg").count() >= 4 && page.matches("data:image/png;base64,").count() >= 6);
    let dark = picture.rgb.iter().filter(|c| c[0] < 0.5).count();
    assert!(dark > 2000 && dark < picture.rgb.len() / 2, "{dark} dark pixels");
}
