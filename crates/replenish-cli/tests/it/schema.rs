//! The JSON of the commands, held to the schemas in `docs/schemas`: no name is missing and none is
//! unknown. Every test that reads a document checks it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a helper of tests")]

use serde_json::Value;
use std::path::Path;

/// The directory of the schemas.
const SCHEMAS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/schemas");

/// A JSON file of a command, checked.
pub(crate) fn read(path: &Path) -> Value {
    let document: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    check(&document);
    document
}

/// Panics, with the place, where `document` is not as its schema says. Documents of the laboratory
/// have a name and a version, and no schema.
pub(crate) fn check(document: &Value) {
    let name = document["document"].as_str().unwrap();
    assert_eq!(document["version"], 1, "{name}");
    let laboratory = ["bench-", "experiment-", "demo", "ping", "pong"];
    let path = Path::new(SCHEMAS).join(name).with_extension("json");
    match std::fs::read_to_string(&path) {
        Ok(schema) => conforms(document, &serde_json::from_str(&schema).unwrap(), name),
        Err(e) => assert!(
            laboratory.iter().any(|prefix| name.starts_with(prefix)),
            "{}: {e}",
            path.display()
        ),
    }
}

/// The part of JSON Schema that our schemas use. A word that is not known here is refused, so that
/// none is without effect.
fn conforms(value: &Value, schema: &Value, place: &str) {
    for (word, rule) in schema.as_object().unwrap() {
        match &**word {
            "$schema" | "title" | "description" => {}
            "const" => assert_eq!(value, rule, "{place}"),
            "enum" => {
                let rule = rule.as_array().unwrap();
                assert!(rule.contains(value), "{place}: {value} is none of {rule:?}");
            }
            "type" => assert!(has_type(value, rule), "{place}: {value} is no {rule}"),
            "minimum" => assert!(
                value.as_i64().is_none_or(|n| n >= rule.as_i64().unwrap()),
                "{place}: {value} is below {rule}"
            ),
            "required" => {
                for name in rule.as_array().unwrap().iter().filter_map(Value::as_str) {
                    assert!(
                        value.is_null() || value.get(name).is_some(),
                        "{place}.{name} is missing"
                    );
                }
            }
            "properties" | "additionalProperties" => {}
            "items" => {
                for (n, item) in value.as_array().into_iter().flatten().enumerate() {
                    conforms(item, rule, &format!("{place}[{n}]"));
                }
            }
            _ => panic!("{place}: the schema says {word}, which this test does not check"),
        }
    }
    for (name, value) in value.as_object().into_iter().flatten() {
        let place = format!("{place}.{name}");
        let known = schema.get("properties").and_then(|known| known.get(name));
        match known.or_else(|| schema.get("additionalProperties")) {
            Some(Value::Bool(false)) | None => panic!("{place} is in no schema"),
            Some(rule) => conforms(value, rule, &place),
        }
    }
}

fn has_type(value: &Value, rule: &Value) -> bool {
    let is = |name: &str| match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_u64() || value.is_i64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        _ => panic!("{name} is no type"),
    };
    match rule {
        Value::Array(names) => names.iter().filter_map(Value::as_str).any(is),
        name => is(name.as_str().unwrap()),
    }
}
