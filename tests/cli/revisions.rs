//! What is kept under `fixtures/`: what this program makes is what is kept, assets of every revision open, and what differs is named.

use std::path::{Path, PathBuf};

use serde_json::Value;
use translux::asset::ALGORITHM_REVISION;

use crate::common::Folder;

/// Set to 1 where there is time.
const LONG: &str = "TRANSLUX_LONG";

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

#[test]
fn fixtures_are_what_is_made_and_assets_of_every_revision_open() {
    let folder = Folder::new();
    let quick = if std::env::var(LONG).is_ok_and(|value| value == "1") { "" } else { "--quick" };
    let report = folder.run(&format!("fixtures --check {quick} --folder {} --json", fixtures().display())).ok().json();
    let fixtures = report["fixtures"].as_array().unwrap();
    let count = |state: &str| fixtures.iter().filter(|fixture| fixture["state"] == state).count();
    let made = count("same") + count("rounded");
    assert!(made >= 12 && count("opens") >= 9, "{report:#}");
    let revision = format!("assets/revision_{ALGORITHM_REVISION}/");
    assert!(fixtures.iter().any(|fixture| fixture["name"].as_str().unwrap().starts_with(&revision)), "{report:#}");
}

/// A damaged asset, one that gives something else, one that nobody knows, a picture that is not there.
#[test]
fn fixtures_that_differ_are_named() {
    let folder = Folder::new();
    let revision = format!("assets/revision_{ALGORITHM_REVISION}");
    for place in [revision.as_str(), "golden"] {
        std::fs::create_dir_all(folder.path("kept").join(place)).unwrap();
        for entry in std::fs::read_dir(fixtures().join(place)).unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, folder.path("kept").join(place).join(path.file_name().unwrap())).unwrap();
        }
    }
    let kept = |name: &str| folder.path("kept").join(&revision).join(name);
    let mut damaged = std::fs::read(kept("factored.tlux")).unwrap();
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(kept("factored.tlux"), damaged).unwrap();
    std::fs::copy(kept("samples.tlux"), kept("stranger.tlux")).unwrap();
    let given: Value = serde_json::from_slice(&std::fs::read(kept("given.json")).unwrap()).unwrap();
    let text = serde_json::to_string(&given).unwrap();
    let mean = given["samples"]["mean_radiosity"][1].to_string();
    std::fs::write(kept("given.json"), text.replace(&mean, "0.5")).unwrap();
    std::fs::remove_file(kept("texture_space.tlux")).unwrap();
    let outcome = folder.run("fixtures assets --check --quick --folder kept");
    assert_eq!(outcome.code, 7, "{}", outcome.text());
    let text = outcome.text();
    for line in [
        "factored.tlux: DIFFERENT",
        "samples.tlux: the same",
        "samples.tlux: DIFFERENT",
        "stranger.tlux: UNKNOWN",
        "texture_space.tlux: MISSING",
    ] {
        assert!(text.contains(&format!("{revision}/{line}\n")), "{line}: {text}");
    }
    folder.run("fixtures --check").fails(2, &["fixtures: no folder of fixtures", "--folder"]);
    folder.run("fixtures --quick").fails(1, &["--check"]);
}

/// Files of the format before assets named their form.
#[test]
fn what_cannot_be_opened_any_more_says_so() {
    let folder = Folder::new();
    for name in ["v0_0_full", "v0_1_full"] {
        let asset = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("formats/tests/data/{name}.tlux"));
        let line = format!("evaluate {} --light constant:radiance=0.5 -o b.ply", asset.display());
        folder.run(&line).fails(3, &["without section form.nam", "bake it again"]);
    }
}
