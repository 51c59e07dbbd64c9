//! A package's directory: `NAME/{msg,srv,action}/TYPE.{msg,srv,action}`.

use crate::error::Error;
use crate::model::{Interface, TypeName};
use crate::{names, parse};
use std::fs;
use std::path::{Path, PathBuf};

const KINDS: [&str; 3] = ["msg", "srv", "action"];

/// All interfaces of the package in `dir`, sorted by name.
pub(crate) fn read(dir: &Path) -> Result<Vec<Interface>, Error> {
    let name = dir.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    if !names::is_package(name) {
        let message = format!("`{name}` is no name of a package: {}", names::PACKAGE);
        return Err(Error::whole(dir, message));
    }
    let mut interfaces = Vec::new();
    for kind in KINDS {
        for file in files(&dir.join(kind), kind)? {
            let stem = file
                .file_stem()
                .and_then(|n| n.to_str())
                .unwrap_or_default();
            if !names::is_type(stem) {
                let message = format!("`{stem}` is no name of an interface: {}", names::TYPE);
                return Err(Error::whole(&file, message));
            }
            let text = fs::read_to_string(&file).map_err(|e| Error::whole(&file, e.to_string()))?;
            let name = TypeName::new(name, kind, stem);
            interfaces.push(parse::interface(&file, &name, &text)?);
        }
    }
    if interfaces.is_empty() {
        let message = "no .msg, .srv or .action files in its directories msg, srv and action";
        return Err(Error::whole(dir, message));
    }
    Ok(interfaces)
}

/// The files of this kind, sorted; none if there is no such directory.
fn files(dir: &Path, kind: &str) -> Result<Vec<PathBuf>, Error> {
    if !dir.is_dir() {
        return Ok(Vec::new());
    }
    let wrong = |e: std::io::Error| Error::whole(dir, e.to_string());
    let mut files = Vec::new();
    for entry in fs::read_dir(dir).map_err(wrong)? {
        let path = entry.map_err(wrong)?.path();
        if path.extension().is_some_and(|e| e == kind) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Parses one interface's text without generating anything; its kind is `file`'s extension, its
/// package the name of the directory above `file`'s.
///
/// # Errors
/// The first error in the text, with its place.
pub fn check_text(file: &Path, text: &str) -> Result<(), Error> {
    let extension = file.extension().and_then(|e| e.to_str());
    let Some(kind) = KINDS.into_iter().find(|k| Some(*k) == extension) else {
        let message = "the extension is none of .msg, .srv and .action";
        return Err(Error::whole(file, message));
    };
    let part = |path: Option<&Path>| path.and_then(|p| p.file_name()?.to_str().map(String::from));
    let package = part(file.parent().and_then(Path::parent)).unwrap_or_default();
    let stem = file
        .file_stem()
        .and_then(|n| n.to_str())
        .unwrap_or_default();
    parse::interface(file, &TypeName::new(&package, kind, stem), text).map(|_| ())
}
