//! The command line of `editable`: one bake for every material, its keys, its reports, its sections.
#![allow(clippy::unwrap_used, missing_docs)]

use std::collections::BTreeSet;

use crate::common::{Folder, relative_difference};
use serde_json::Value;
use translux::geometry::shapes;

const BAKE: &str = "bake head.obj --unit mm --samples 2000 --method editable --set transport=stored";
/// Without rows for environments, where no test looks at them.
const SUNS: &str = "--for-lights directional,point";
const SUN: &str = "--light directional:from=1,2,3:irradiance=2";
const LAMP: &str = "--light point:at=-20,30,15:intensity=900";

fn head() -> Folder {
    head_of(3)
}

fn head_of(subdivisions: u32) -> Folder {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(8.0, subdivisions));
    folder
}

/// The bake with another number of samples.
fn bake_with(samples: usize) -> String {
    BAKE.replace("--samples 2000", &format!("--samples {samples}"))
}

fn stages(report: &Value, key: &str) -> BTreeSet<String> {
    let entries = report[key].as_array().unwrap();
    entries.iter().map(|e| e["stage"].as_str().unwrap().to_owned()).collect()
}

/// Every stage names its seconds, and the whole its memory.
#[track_caller]
fn assert_measured(report: &Value) {
    let stages = report["timings"]["stages"].as_array().unwrap();
    assert!(!stages.is_empty() && stages.iter().all(|s| s["seconds"].as_f64().unwrap() >= 0.0));
    assert!(report["timings"]["peak_memory_bytes"].as_u64().unwrap() > 1 << 20);
}

#[test]
fn the_material_is_chosen_when_the_asset_is_evaluated() {
    let folder = head();
    folder.run(&format!("{BAKE} {SUNS} --material marble -o a.tlux")).ok();
    for material in ["skin1", "ketchup", "wholemilk"] {
        let peer = format!("bake head.obj --unit mm --samples 2000 --method two_pass --material {material} -o b.tlux");
        folder.run(&peer).ok();
        for light in [SUN, LAMP] {
            folder.run(&format!("evaluate a.tlux --material {material} {light} -o a.ply")).ok();
            folder.run(&format!("evaluate b.tlux {light} -o b.ply")).ok();
            // 1 % and 0.5 % were asked for; both have the same samples.
            folder.run("compare a.ply b.ply --fail-above 1.5%").ok();
        }
    }
    folder.run(&format!("evaluate a.tlux {SUN} -o marble.ply")).ok();
    folder.run(&format!("evaluate a.tlux {SUN} --material skin1 -o skin.ply")).ok();
    assert!(relative_difference(&folder.radiosity("skin.ply"), &folder.radiosity("marble.ply")) > 0.05);
    // Coefficients may be edited one by one, and back.
    folder.run(&format!("evaluate a.tlux {SUN} --sigma-a 0.5 -o dark.ply")).ok();
    let mean = |name: &str| folder.radiosity(name).iter().sum::<glam::DVec3>();
    assert!(mean("dark.ply").cmplt(mean("marble.ply")).all());
    folder.run(&format!("evaluate a.tlux {SUN} --material marble -o again.ply")).ok();
    assert!(folder.read("again.ply") == folder.read("marble.ply"));
}

#[test]
fn keys_change_the_bake_or_are_refused() {
    let folder = head_of(2);
    let bake = format!(
        "bake head.obj --unit mm --material marble --method editable --set transport=stored --samples 600 {SUNS}"
    );
    folder.run(&format!("{bake} -o default.tlux")).ok();
    let split = |name: &str| folder.run(&format!("inspect {name} --json")).ok().json()["sizes"]["file"].clone();
    for set in ["terms=5", "basis=plain", "split=9", "truncation=3%"] {
        folder.run(&format!("{bake} --set {set} -o a.tlux")).ok();
        let (key, value) = set.split_once('=').unwrap();
        let report = folder.run("inspect a.tlux --json").ok().json();
        assert_eq!(report["provenance"]["settings"][key], value);
        assert_ne!(split("a.tlux"), split("default.tlux"), "{set}");
        folder.run(&format!("evaluate a.tlux {SUN} -o a.ply")).ok();
        folder.run("compare a.tlux default.tlux --fail-above 8%").ok();
    }
    for (set, fragments) in [
        ("transport=none", &["--set transport", "given twice"][..]),
        ("terms=0", &["terms", "1", "16"]),
        ("terms=17", &["terms", "16"]),
        ("terms=few", &["terms=few"]),
        ("basis=best", &["basis=best", "transported", "plain"]),
        ("split=3", &["split=3", "4"]),
        ("split=inf", &["split=inf"]),
        ("truncation=0", &["truncation", "0.01"]),
        ("truncation=200%", &["truncation", "200%"]),
        ("cube=48", &["cube=48", "32", "64"]),
        ("coefficients=1", &["coefficients=1", "8"]),
        ("points=3", &["points=3", "power of two"]),
        ("bound=kernel", &["bound", "`editable` has no such key", "terms", "split"]),
        ("terms", &["terms", "key=value"]),
    ] {
        folder.run(&format!("{bake} --set {set} -o refused.tlux")).fails(1, fragments);
    }
    let half = bake.replace("transport=stored", "transport=half");
    folder.run(&format!("{half} -o refused.tlux")).fails(1, &["transport=half", "stored", "none"]);
    assert!(!folder.names().contains(&"refused.tlux".to_owned()));
}

#[test]
fn kinds_of_light_are_chosen_or_refused() {
    let folder = head_of(2);
    let bake = "bake head.obj --unit mm --material marble --method editable --samples 200";
    for kinds in ["directional,point", "all", " environment"] {
        let words = bake.split(' ').chain(["--for-lights", kinds, "-o", "a.tlux"]);
        folder.run_words(words).ok();
        let report = folder.run("inspect a.tlux --json").ok().json();
        let stored = report["provenance"]["settings"]["for-lights"].as_str().unwrap().to_owned();
        let expected = if kinds == "all" { "constant,directional,point,area,environment" } else { kinds.trim() };
        assert_eq!(stored, expected);
        // A kind that it was not made for still works, or says what to do.
        let outcome = folder.run("evaluate a.tlux --light sky -o a.ply");
        assert!([0, 5].contains(&outcome.code), "`{}`: {}", outcome.line, outcome.stderr);
        assert!(outcome.code == 0 || !expected.contains("environment"), "{}", outcome.stderr);
    }
    for kinds in ["", "sun", "directional,", "point;area", "all,point"] {
        let words = bake.split(' ').chain(["--for-lights", kinds, "-o", "refused.tlux"]);
        folder.run_words(words).fails(1, &["--for-lights", "directional", "environment", "all"]);
    }
}

#[test]
fn reports_tell_stages_memory_and_errors() {
    let folder = head();
    let bake = folder.run(&format!("{} --material marble --json -o a.tlux", bake_with(3000))).ok().json();
    assert_measured(&bake);
    assert_eq!((&bake["method"], &bake["samples"]), (&"editable".into(), &3000.into()));
    for stage in ["import", "samples", "basis", "transport", "ledger", "write"] {
        assert!(stages(&bake["timings"], "stages").contains(stage), "{stage}");
    }
    let names = stages(&bake["ledger"], "entries");
    for stage in ["sampling", "hierarchy", "basis", "truncation", "quantiser"] {
        assert!(names.contains(stage), "{stage}: {names:?}");
    }
    for entry in bake["ledger"]["entries"].as_array().unwrap() {
        let error = &entry["error"];
        let [rms, worst] = ["rms", "worst"].map(|f| error[f].as_f64().unwrap());
        assert!((0.0..0.02).contains(&rms) && worst >= rms && worst < 0.2, "{entry}");
        assert!(!entry["note"].as_str().unwrap().is_empty());
    }
    let vertices = bake["vertices"].as_f64().unwrap();
    let per_vertex = bake["bytes_without_mesh"].as_f64().unwrap() / vertices;
    assert!((bake["bytes_per_vertex"].as_f64().unwrap() / per_vertex - 1.0).abs() < 1e-9);

    let line = format!("evaluate a.tlux {SUN} --material cream --measure --json -o a.ply");
    let evaluation = folder.run(&line).ok().json();
    assert_measured(&evaluation);
    for stage in ["open", "prepare", "irradiance", "far field", "near field", "write"] {
        assert!(stages(&evaluation["timings"], "stages").contains(stage), "{stage}");
    }
    assert!(stages(&evaluation["measured"], "entries").is_superset(&["sampling".into(), "transport".into()].into()));
    assert_eq!(evaluation["asked_rms"], 0.01);
    assert_eq!(evaluation["cost"]["samples"], 3000);
}

#[test]
fn the_far_field_is_interpolated_from_fewer_points() {
    let folder = head_of(4);
    let finer = bake_with(3000);
    let bake = |spacing: &str, to: &str| {
        let line =
            format!("{finer} --material marble --for-lights directional --set far-spacing={spacing} --json -o {to}");
        folder.run(&line).ok().json()
    };
    let (every, some) = (bake("0", "every.tlux"), bake("2.5", "some.tlux"));
    let bytes = |report: &Value| report["bytes_without_mesh"].as_f64().unwrap();
    assert!(bytes(&some) < 0.75 * bytes(&every), "{} {}", bytes(&some), bytes(&every));
    let interpolation = |report: &Value| {
        let entries = report["ledger"]["entries"].as_array().unwrap();
        entries.iter().find(|e| e["stage"] == "interpolation").map(|e| e["error"]["rms"].as_f64().unwrap())
    };
    assert_eq!(interpolation(&every), None, "every vertex is a point");
    let stated = interpolation(&some).unwrap();
    assert!(stated > 1e-5 && stated < 0.02, "{stated}");
    for material in ["marble", "ketchup"] {
        for asset in ["every", "some"] {
            folder.run(&format!("evaluate {asset}.tlux {SUN} --material {material} -o {asset}.ply")).ok();
        }
        let rms = relative_difference(&folder.radiosity("some.ply"), &folder.radiosity("every.ply"));
        assert!(rms > 0.0 && rms < 0.02, "{material}: {rms}");
    }
    folder.run(&format!("{BAKE} --material marble --set far-spacing=0.2 -o x.tlux")).fails(1, &["far-spacing"]);
}

#[test]
fn methods_are_listed_with_their_errors() {
    let folder = Folder::new();
    let text = folder.run("methods editable").ok().text();
    for fragment in ["editable: ", "--max-rms", "1.00 %", "--set terms=", "auto"] {
        assert!(text.contains(fragment), "{fragment}: {text}");
    }
    assert!(
        !text.contains("--set basis=") && text.contains("more for experts: translux methods editable --all"),
        "{text}"
    );
    let text = folder.run("methods editable --all").ok().text();
    assert!(
        text.contains("--set basis=") && text.contains("transported") && !text.contains("more for experts"),
        "{text}"
    );
    let report = folder.run("methods --json").ok().json();
    let methods = report["methods"].as_array().unwrap();
    let error = |name: &str| methods.iter().find(|m| m["name"] == name).unwrap()["default_max_rms"].clone();
    assert_eq!((error("editable"), error("two_pass")), (0.01.into(), 0.005.into()));
}

#[test]
fn assets_are_inspected_validated_and_compared() {
    let folder = head();
    let bake = bake_with(1000);
    folder.run(&format!("{bake} {SUNS} --material marble -o a.tlux")).ok();
    folder.run(&format!("{bake} {SUNS} --material marble -o b.tlux")).ok();
    assert!(folder.read("a.tlux") == folder.read("b.tlux"));
    assert!(folder.run("compare a.tlux b.tlux").ok().text().starts_with("equal: "));

    let report = folder.run("inspect a.tlux --json").ok().json();
    assert_eq!((&report["method"], &report["edits"]["material"]), (&"editable".into(), &"any".into()));
    let sections = report["sizes"]["sections"].as_array().unwrap();
    let tags: Vec<&str> = sections.iter().map(|s| s["tag"].as_str().unwrap()).collect();
    for start in ["far.", "bas."] {
        let found = sections.iter().filter(|s| s["tag"].as_str().unwrap().starts_with(start));
        assert!(found.clone().count() >= 3, "{tags:?}");
        assert!(found.clone().all(|s| s["kind"] == "method" && s["stored_bytes"].as_u64().unwrap() > 0));
    }
    let text = folder.run("inspect a.tlux").ok().text();
    assert!(text.contains("far.cod") && text.contains("bas.fun"), "{text}");
    let outcome = folder.run("validate a.tlux").ok();
    assert!(outcome.text().contains(" 0 errors"), "{}", outcome.text());

    folder.run("bake head.obj --unit mm --samples 1000 --method two_pass --material marble -o peer.tlux").ok();
    let outcome = folder.run("compare a.tlux peer.tlux --json");
    assert_eq!(outcome.code, 7);
    let pairs = outcome.json()["assets"]["sections"].clone();
    let only = pairs.as_array().unwrap().iter().filter(|s| s["status"] == "only-in-a");
    let only: Vec<&str> = only.map(|s| s["tag"].as_str().unwrap()).collect();
    assert!(only.contains(&"far.cod") && only.contains(&"bas.fun"), "{only:?}");
    folder.run("compare a.tlux peer.tlux --fail-above 1.5%").ok();
}

#[test]
fn the_asset_alone_is_sufficient() {
    let folder = head();
    folder.run(&format!("{} --material marble -o a.tlux", bake_with(500))).ok();
    let elsewhere = Folder::new();
    elsewhere.write("moved.tlux", folder.read("a.tlux"));
    for (light, material) in
        [(SUN, ""), (LAMP, " --material skin1"), ("--light sky", ""), ("--light sky", " --eta 1.4")]
    {
        folder.run(&format!("evaluate a.tlux {light}{material} -o here.ply")).ok();
        elsewhere.run(&format!("evaluate moved.tlux {light}{material} -o there.ply")).ok();
        assert!(folder.read("here.ply") == elsewhere.read("there.ply"), "{light}{material}");
    }
    assert_eq!(elsewhere.names(), ["moved.tlux", "there.ply"]);
}

/// Samples and no transport: far fewer bytes, the same answers in any material and under any light, its own entries and checks.
#[test]
fn nothing_stored_gives_what_stored_transport_gives() {
    let folder = head();
    let bake = bake_with(1000);
    let none = format!("{} --material marble", bake.replace("transport=stored", "transport=none"));
    folder.run(&format!("{bake} --material marble -o stored.tlux")).ok();
    let report = folder.run(&format!("{none} --json -o none.tlux")).ok().json();
    assert!(stages(&report["ledger"], "entries").is_superset(&["sampling".into(), "multilevel".into()].into()));
    assert!(stages(&report["timings"], "stages").contains("resolution"));
    let inspected = |name: &str| folder.run(&format!("inspect {name} --json")).ok().json();
    let bytes = |report: &Value, start: &str| -> u64 {
        let sections = report["sizes"]["sections"].as_array().unwrap().iter();
        let own = sections.filter(|s| s["tag"].as_str().unwrap().starts_with(start));
        own.map(|s| s["stored_bytes"].as_u64().unwrap()).sum()
    };
    let (stored, own) = (inspected("stored.tlux"), inspected("none.tlux"));
    assert_eq!((bytes(&own, "far."), bytes(&own, "bas.")), (0, 0));
    assert!(bytes(&own, "mls.") < 100 && bytes(&stored, "far.") > 35_000, "{own}");
    assert!(folder.run("validate none.tlux").ok().text().contains(" 0 errors"));
    for (material, lights) in [
        ("marble", &[SUN, LAMP, "--light sky"][..]),
        ("ketchup", &[LAMP, "--light sky"]),
        ("spectralon", &[SUN, "--light sky"]),
    ] {
        for light in lights {
            for name in ["stored", "none"] {
                folder.run(&format!("evaluate {name}.tlux --material {material} {light} -o {name}.ply")).ok();
            }
            folder.run("compare none.ply stored.ply --fail-above 1.5%").ok();
        }
    }
    for set in ["terms=5", "basis=plain", "split=9", "truncation=3%"] {
        folder.run(&format!("{none} --set {set} -o refused.tlux")).fails(1, &[set, "transport=stored"]);
    }
}
