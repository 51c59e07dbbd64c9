//! The outcome of a task, and the JSON files that tasks write.

use serde_json::Value;
use std::path::Path;

/// A task succeeds, or fails with one text.
pub(crate) type Outcome<T = ()> = Result<T, String>;

/// Writes JSON if a path was given.
pub(crate) fn write(path: Option<&Path>, value: &Value) -> Outcome {
    let Some(path) = path else { return Ok(()) };
    std::fs::write(path, format!("{value:#}\n")).map_err(|e| format!("{}: {e}", path.display()))
}

/// Fails early if a file cannot be written. A missing file is created; an existing one keeps its
/// content.
pub(crate) fn writable(path: Option<&Path>) -> Outcome {
    let Some(path) = path else { return Ok(()) };
    let opened = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(path);
    opened
        .map(drop)
        .map_err(|e| format!("cannot write {}: {e}", path.display()))
}
