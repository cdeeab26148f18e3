//! What the crates depend on: licences and sources by `deny.toml`, and nothing that no code names.

#![allow(clippy::unwrap_used)]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Whether an SPDX expression is met by the allowed licences. A slash is the old spelling of `OR`.
fn licence_is_met(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut at = 0;
    any_of(&words, &mut at, allowed) && at == words.len()
}

fn any_of(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let mut met = all_of(words, at, allowed);
    while words.get(*at) == Some(&"OR") {
        *at += 1;
        met |= all_of(words, at, allowed);
    }
    met
}

fn all_of(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let mut met = one(words, at, allowed);
    while words.get(*at) == Some(&"AND") {
        *at += 1;
        met &= one(words, at, allowed);
    }
    met
}

fn one(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let Some(word) = words.get(*at) else { return false };
    *at += 1;
    if *word == "(" {
        let met = any_of(words, at, allowed);
        *at += 1;
        return met && words.get(*at - 1) == Some(&")");
    }
    let mut name = (*word).to_owned();
    if words.get(*at) == Some(&"WITH") {
        name = format!("{name} WITH {}", words.get(*at + 1).unwrap_or(&""));
        *at += 2;
    }
    allowed.contains(&name)
}

/// Licences that every crate may have, and those that one crate may have beside them.
struct Licences {
    allowed: BTreeSet<String>,
    of_one: BTreeMap<String, BTreeSet<String>>,
}

impl Licences {
    fn read() -> Self {
        let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("deny.toml")).unwrap();
        let table: toml::Table = toml::from_str(&text).unwrap();
        let names =
            |list: &toml::Value| list.as_array().unwrap().iter().map(|l| l.as_str().unwrap().to_owned()).collect();
        let licenses = &table["licenses"];
        let exceptions = licenses["exceptions"].as_array().unwrap().iter();
        let of_one = exceptions.map(|e| (e["crate"].as_str().unwrap().to_owned(), names(&e["allow"]))).collect();
        Self { allowed: names(&licenses["allow"]), of_one }
    }

    fn are_met(&self, package: &str, expression: &str) -> bool {
        match self.of_one.get(package) {
            Some(more) => licence_is_met(expression, &self.allowed.union(more).cloned().collect()),
            None => licence_is_met(expression, &self.allowed),
        }
    }
}

fn metadata() -> serde_json::Value {
    let target = if cfg!(target_arch = "aarch64") { "aarch64" } else { "x86_64" };
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", &format!("{target}-unknown-linux-gnu")])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn expressions_are_read() {
    let allowed: BTreeSet<String> = ["MIT", "Unicode-3.0", "A WITH E"].map(String::from).into();
    for met in ["MIT", "X/MIT", "X OR MIT", "(MIT OR X) AND Unicode-3.0", "A WITH E OR X", "X OR X AND X OR MIT"] {
        assert!(licence_is_met(met, &allowed), "{met}");
    }
    for unmet in ["", "X", "MIT AND X", "(X OR MIT", "MIT)", "A", "A WITH", "MIT AND", "GPL-3.0-only", "MIT X"] {
        assert!(!licence_is_met(unmet, &allowed), "{unmet}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn licences_and_sources_are_allowed() {
    let (metadata, licences) = (metadata(), Licences::read());
    // Optional parts of dependencies that this build leaves out are in `packages`, not in the resolved graph.
    let used: BTreeSet<&str> =
        metadata["resolve"]["nodes"].as_array().unwrap().iter().map(|n| n["id"].as_str().unwrap()).collect();
    let mut problems = Vec::new();
    let mut checked = 0;
    for package in metadata["packages"].as_array().unwrap() {
        if !used.contains(package["id"].as_str().unwrap()) {
            continue;
        }
        checked += 1;
        let name = package["name"].as_str().unwrap();
        let licence = package["license"].as_str().unwrap_or("none");
        if !licences.are_met(name, licence) {
            problems.push(format!("{name}: licence `{licence}` is not allowed by deny.toml"));
        }
        let source = package["source"].as_str();
        let ours = ["translux", "translux-format", "translux-c"].contains(&name);
        if !ours && source != Some("registry+https://github.com/rust-lang/crates.io-index") {
            problems.push(format!("{name}: comes from {source:?}, not from crates.io"));
        }
        if ours {
            for dependency in package["dependencies"].as_array().unwrap() {
                if dependency["req"] == "*" {
                    problems.push(format!("{name}: any version of {} would do", dependency["name"]));
                }
            }
        }
    }
    assert!(checked > 10, "{checked} packages are too few to be all");
    assert!(!licences.are_met("toml", "MPL-2.0"), "what one crate may have is not for all");
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

fn sources(folder: &Path) -> String {
    let mut text = String::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            text += &sources(&path);
        } else if path.extension().is_some_and(|e| e == "rs") {
            text += &std::fs::read_to_string(&path).unwrap();
        }
    }
    text
}

/// Dependencies of a manifest whose name stands nowhere before `::` or in a `use`.
fn unused(manifest: &str, table: &str, text: &str) -> Vec<String> {
    let manifest: toml::Table = toml::from_str(manifest).unwrap();
    let Some(dependencies) = manifest.get(table).and_then(toml::Value::as_table) else { return Vec::new() };
    let named = |name: &str| {
        let name = name.replace('-', "_");
        text.match_indices(&format!("{name}::"))
            .any(|(i, _)| !text[..i].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
            || text.contains(&format!("use {name} as "))
    };
    dependencies.keys().filter(|name| !named(name)).cloned().collect()
}

#[test]
fn every_dependency_is_named() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = [(root.to_path_buf(), "benches"), (root.join("formats"), "tests"), (root.join("formats/c"), "tests")];
    for (folder, more) in folders {
        let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let program = sources(&folder.join("src"));
        let all = format!("{program}{}{}", sources(&folder.join("tests")), sources(&folder.join(more)));
        assert_eq!(unused(&manifest, "dependencies", &program), Vec::<String>::new(), "{}", folder.display());
        assert_eq!(unused(&manifest, "dev-dependencies", &all), Vec::<String>::new(), "{}", folder.display());
    }
    let planted = "[dependencies]\nused-name = \"1\"\nname = \"1\"\n";
    assert_eq!(unused(planted, "dependencies", "use used_name::X;"), ["name"]);
}
