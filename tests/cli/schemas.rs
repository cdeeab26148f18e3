//! Schemas before a validator that others wrote: Python's `jsonschema`. Whatever reads a report in these tests checks it as well, by
//! `common::schema`.

use std::process::Command;

use serde_json::Value;
use translux::geometry::shapes;

use crate::common::{Folder, schema};

/// Checks each schema (`folder/*.json`) against the language's own, then each document (a line of standard input) against the one that
/// it names.
const SCRIPT: &str = "
import json, pathlib, sys
from jsonschema import Draft202012Validator as Validator
known = {}
for path in sorted(pathlib.Path(sys.argv[1]).glob('*.json')):
    schema = json.loads(path.read_text())
    Validator.check_schema(schema)
    assert schema['title'] == path.name[:-len('.json')], path
    known[schema['title']] = Validator(schema)
documents = [json.loads(line) for line in sys.stdin]
for document in documents:
    known[document['schema']].validate(document)
    try:
        known[document['schema']].validate({**document, 'version': 3})
    except Exception:
        continue
    sys.exit('a version that is a number is let through')
print(len(known), len(documents))
";

fn python() -> Option<&'static str> {
    let has = |program: &&str| {
        let tried = Command::new(program).args(["-c", "from jsonschema import Draft202012Validator"]).output();
        tried.is_ok_and(|output| output.status.success())
    };
    let found = ["python3", "/usr/bin/python3"].into_iter().find(has);
    if found.is_none() {
        println!("SKIPPED: no python3 with jsonschema (Debian: python3-jsonschema)");
    }
    found
}

#[test]
fn schemas_are_of_their_language_and_describe_what_is_written() {
    let Some(python) = python() else { return };
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(1.5, 1));
    let bake = "bake ball.obj --unit mm --material marble --method two_pass --samples 150 -o a.tlux --json";
    let mut documents: Vec<Value> = Vec::new();
    for line in [
        bake,
        &format!("{bake} --dry-run"),
        "bake none.obj -o b.tlux --json",
        "inspect a.tlux --json",
        "validate a.tlux a.tlux none.tlux --json",
        "compare a.tlux a.tlux --json",
        "evaluate a.tlux --light constant:radiance=1 -o a.ply --json",
        "materials --json",
        "methods --all --json",
    ] {
        documents.push(folder.run(line).json());
    }
    let lines: Vec<String> = documents.iter().map(Value::to_string).collect();
    let mut command = assert_cmd::Command::new(python);
    let folder = schema::path("x").parent().unwrap().to_path_buf();
    let outcome = command.args(["-c", SCRIPT]).arg(&folder).write_stdin(lines.join("\n")).output().unwrap();
    let said = String::from_utf8_lossy(&outcome.stderr);
    assert!(outcome.status.success(), "{said}");
    let count = std::fs::read_dir(folder).unwrap().count();
    assert_eq!(String::from_utf8_lossy(&outcome.stdout).trim(), format!("{count} {}", documents.len()));
}

/// A validator that lets everything through finds no fault.
#[test]
fn faults_are_found() {
    let of = |change: fn(&mut Value)| {
        let mut error = serde_json::json!({ "schema": "translux.error.v1", "version": "0", "exit": 2, "kind": "io", "path": null,
            "line": 3, "message": "" });
        change(&mut error);
        std::panic::catch_unwind(|| schema::check(&error)).is_ok()
    };
    assert!(of(|_| ()));
    assert!(!of(|error| error["exit"] = 256.into()) && !of(|error| error["line"] = (-1).into()));
    assert!(!of(|error| error["line"] = "3".into()) && !of(|error| error["more"] = Value::Null));
    assert!(!of(|error| drop(error.as_object_mut().unwrap().remove("kind"))));
}
