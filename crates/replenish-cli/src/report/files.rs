//! Writing results: JSON, CSV and text files, with errors that name the file. A JSON file begins
//! with its document's name and version (docs/json.md); its schema is in docs/schemas.

use crate::outcome::Failure;
use std::path::Path;

/// Writes `text` to `path`.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text)
        .map_err(|e| Failure::refused(format!("cannot write {}: {e}", path.display())))
}

/// The version of all documents. It grows when a name or a meaning changes, not with a new name.
const VERSION: u32 = 1;

/// A result with the two names that every document begins with.
#[derive(serde::Serialize)]
struct Document<'a, T> {
    document: &'a str,
    version: u32,
    #[serde(flatten)]
    value: &'a T,
}

/// Writes `value`, a structure or a map, as indented JSON to `path`, if there is one.
///
/// `document` is the command in one word (`plan`, `bench-load`).
///
/// # Errors
/// The file cannot be written.
pub fn write_json<T: serde::Serialize>(
    path: Option<&Path>,
    document: &str,
    value: &T,
) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    let document = Document {
        document,
        version: VERSION,
        value,
    };
    let text = serde_json::to_string_pretty(&document)
        .map_err(|e| Failure::refused(format!("cannot encode {}: {e}", path.display())))?;
    write(path, &(text + "\n"))
}

/// Replaces the JSON in `path`, if there is one, by `value`.
///
/// A reader at any time finds all of the old text or all of the new: the new one is written to a
/// file beside `path` and renamed. A path that is no ordinary file (`/dev/stdout`) is written to
/// directly.
///
/// # Errors
/// The file cannot be written or renamed.
pub fn replace_json<T: serde::Serialize>(
    path: Option<&Path>,
    document: &str,
    value: &T,
) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    replace(path, |path| write_json(Some(path), document, value))
}

/// Replaces `path` by what `write` writes to the path that it is given: that of a file beside it,
/// which is renamed, or `path` itself where that is no ordinary file.
///
/// # Errors
/// That of `write`, or the file cannot be renamed. The old file is there then.
pub fn replace(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), Failure>,
) -> Result<(), Failure> {
    if !std::fs::symlink_metadata(path).is_ok_and(|file| file.is_file()) {
        return write(path);
    }
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.tmp", std::process::id()));
    let beside = path.with_file_name(name);
    let rename = || {
        std::fs::rename(&beside, path)
            .map_err(|e| Failure::refused(format!("cannot replace {}: {e}", path.display())))
    };
    let replaced = write(&beside).and_then(|()| rename());
    if replaced.is_err() {
        std::fs::remove_file(&beside).ok();
    }
    replaced
}

/// Fails early if `path` cannot be written, so that a long run is not lost at its end.
///
/// Creates the file if it does not exist; does not touch its contents.
///
/// # Errors
/// The file cannot be written.
pub fn check_writable(path: Option<&Path>) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(path)
        .map(drop)
        .map_err(|e| Failure::refused(format!("cannot write {}: {e}", path.display())))
}

/// Rows of cells as CSV (RFC 4180: quoted where needed, lines end in a line feed).
pub fn csv<R, C>(rows: R) -> String
where
    R: IntoIterator,
    R::Item: IntoIterator<Item = C>,
    C: AsRef<str>,
{
    let mut text = String::new();
    for row in rows {
        let cells: Vec<String> = row.into_iter().map(|c| quote(c.as_ref())).collect();
        text.push_str(&cells.join(","));
        text.push('\n');
    }
    text
}

fn quote(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_quotes_what_would_break_it() {
        assert_eq!(
            csv([["a", "b,c"], ["say \"hi\"", ""]]),
            "a,\"b,c\"\n\"say \"\"hi\"\"\",\n"
        );
    }

    #[test]
    fn a_result_takes_the_place_of_the_one_before() {
        let dir = std::env::temp_dir().join(format!("replenish-files-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let path = dir.join("x.json");
        for number in 1..=2 {
            check_writable(Some(&path)).unwrap();
            let value = serde_json::json!({ "number": number });
            replace_json(Some(&path), "count", &value).unwrap();
            assert_eq!(
                std::fs::read_to_string(&path).unwrap(),
                format!(
                    "{{\n  \"document\": \"count\",\n  \"version\": 1,\n  \"number\": {number}\n}}\n"
                )
            );
        }
        assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 1);
        std::fs::remove_dir_all(&dir).unwrap();
    }

    #[test]
    fn an_unwritable_path_is_named() {
        let path = Path::new("/nonexistent/dir/x.json");
        let e = check_writable(Some(path)).unwrap_err();
        assert!(e.to_string().contains("/nonexistent/dir/x.json"), "{e}");
    }
}
