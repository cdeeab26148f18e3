//! JSON against the schemas under `docs/schemas`: what these use of JSON Schema, and stricter than it, since a field that no schema
//! tells of is an error. `tests/cli/schemas.rs` asks a validator of others.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// The schema of a name.
pub fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schemas").join(format!("{name}.json"))
}

/// Checks a document against the schema that it names.
#[track_caller]
pub fn check(document: &Value) {
    let name = document["schema"].as_str().unwrap_or_else(|| panic!("no schema: {document}"));
    let text = std::fs::read_to_string(path(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    let root: Value = serde_json::from_str(&text).unwrap();
    let faults = Checker { root: &root }.faults(document, &root, "");
    assert!(faults.is_empty(), "{name}: {}", faults.join("; "));
}

struct Checker<'a> {
    root: &'a Value,
}

impl Checker<'_> {
    /// What is wrong with a value, each with its place.
    fn faults(&self, value: &Value, schema: &Value, place: &str) -> Vec<String> {
        let Value::Object(keywords) = schema else {
            return if schema == &Value::Bool(true) {
                Vec::new()
            } else {
                vec![format!("{place}: nothing may be here")]
            };
        };
        let mut faults = Vec::new();
        for (keyword, rule) in keywords {
            match keyword.as_str() {
                "$schema"
                | "$defs"
                | "title"
                | "description"
                | "format"
                | "required"
                | "additionalProperties"
                | "default" => {}
                "$ref" => {
                    let pointer = rule.as_str().unwrap().strip_prefix('#').unwrap();
                    faults.extend(self.faults(value, self.root.pointer(pointer).unwrap(), place));
                }
                "type" => {
                    let is_of = |kind: &Value| match kind.as_str().unwrap() {
                        "null" => value.is_null(),
                        "boolean" => value.is_boolean(),
                        "integer" => value.is_i64() || value.is_u64(),
                        "number" => value.is_number(),
                        "string" => value.is_string(),
                        "array" => value.is_array(),
                        "object" => value.is_object(),
                        other => panic!("type {other}"),
                    };
                    if !rule.as_array().map_or_else(|| is_of(rule), |kinds| kinds.iter().any(is_of)) {
                        faults.push(format!("{place}: {value} is not {rule}"));
                    }
                }
                "const" if value == rule => {}
                "enum" if rule.as_array().unwrap().contains(value) => {}
                "const" | "enum" => faults.push(format!("{place}: {value} is not {rule}")),
                "anyOf" | "oneOf" => {
                    let tried: Vec<_> = rule.as_array().unwrap().iter().map(|s| self.faults(value, s, place)).collect();
                    if tried.iter().all(|faults| !faults.is_empty()) {
                        let nearest = tried.into_iter().min_by_key(Vec::len).unwrap_or_default();
                        faults
                            .push(format!("{place}: none of those that may be here; nearest: {}", nearest.join("; ")));
                    }
                }
                "minimum" | "maximum" => {
                    let (value, bound) = (value.as_f64().unwrap_or(0.0), rule.as_f64().unwrap());
                    if if keyword == "minimum" { value < bound } else { value > bound } {
                        faults.push(format!("{place}: {value} is beyond {bound}"));
                    }
                }
                "minItems" | "maxItems" => {
                    let (count, bound) = (value.as_array().map_or(0, Vec::len) as u64, rule.as_u64().unwrap());
                    if value.is_array() && if keyword == "minItems" { count < bound } else { count > bound } {
                        faults.push(format!("{place}: {count} items, beyond {bound}"));
                    }
                }
                "items" | "prefixItems" => {
                    for (index, item) in value.as_array().into_iter().flatten().enumerate() {
                        let of_item = rule.as_array().map_or(Some(rule), |rules| rules.get(index));
                        let place = format!("{place}[{index}]");
                        faults.extend(of_item.into_iter().flat_map(|rule| self.faults(item, rule, &place)));
                    }
                }
                "uniqueItems" => {
                    let items = value.as_array().map_or(&[][..], Vec::as_slice);
                    if (1..items.len()).any(|i| items[..i].contains(&items[i])) {
                        faults.push(format!("{place}: an item is there twice"));
                    }
                }
                "properties" => faults.extend(self.of_object(value, keywords, place)),
                other => panic!("the schema's keyword {other} is unknown here"),
            }
        }
        if !keywords.contains_key("properties") && keywords.contains_key("additionalProperties") {
            faults.extend(self.of_object(value, keywords, place));
        }
        faults
    }

    fn of_object(&self, value: &Value, keywords: &serde_json::Map<String, Value>, place: &str) -> Vec<String> {
        let Some(object) = value.as_object() else { return Vec::new() };
        let known = keywords.get("properties").and_then(Value::as_object);
        let required: BTreeSet<&str> = keywords
            .get("required")
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        let missing = required.into_iter().filter(|key| !object.contains_key(*key));
        let mut faults: Vec<String> = missing.map(|key| format!("{place}: no {key}")).collect();
        for (key, value) in object {
            let place = format!("{place}.{key}");
            match known.and_then(|known| known.get(key)).or(keywords.get("additionalProperties")) {
                Some(rule) => faults.extend(self.faults(value, rule, &place)),
                None => faults.push(format!("{place}: no schema tells of it")),
            }
        }
        faults
    }
}
