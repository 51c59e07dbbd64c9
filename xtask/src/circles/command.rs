//! Finds the crates, prints their circles.

use super::{graph, resolve, tree};
use crate::output::Outcome;
use std::path::{Path, PathBuf};

/// The folders that hold crates, and crates that stand alone.
const CRATES: [&str; 5] = ["crates", "xtask", "firmware", "tools", "examples"];

/// Prints the circles of `crates`, or of every crate of the repository.
///
/// # Errors
/// The number of circles if there are any; a file that cannot be read or parsed.
pub(crate) fn run(crates: &[PathBuf]) -> Outcome {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    let repository = repository.parent().unwrap_or(repository);
    let mut roots = Vec::new();
    for folder in CRATES.iter().map(|folder| repository.join(folder)) {
        find_roots(&folder, 2, &mut roots);
    }
    if !crates.is_empty() {
        roots.clear();
        crates
            .iter()
            .for_each(|folder| find_roots(folder, 2, &mut roots));
    }
    if roots.is_empty() {
        return Err("there is no src/lib.rs or src/main.rs below these folders".into());
    }
    let (mut files, mut circles) = (0, 0);
    for root in &roots {
        let tree = tree::read(root)?;
        files += tree.files.len();
        let imports = resolve::imports(&tree);
        for circle in graph::circles(tree.files.len(), imports.keys().copied()) {
            circles += 1;
            let first = root.parent().unwrap_or(root);
            let name = |file: usize| tree.files.get(file).map(|path| shorten(path, first));
            println!("circle of {} files in {}:", circle.len(), first.display());
            for ((from, to), names) in &imports {
                if circle.contains(from) && circle.contains(to) {
                    let names: Vec<_> = names.iter().map(String::as_str).collect();
                    let (from, to) = (name(*from), name(*to));
                    let (from, to) = (from.unwrap_or_default(), to.unwrap_or_default());
                    println!("  {from} -> {to}: {}", names.join(", "));
                }
            }
        }
    }
    println!("{circles} circles in {} crates, {files} files", roots.len());
    match circles {
        0 => Ok(()),
        _ => Err("files import each other: move what both need to a file below them".into()),
    }
}

fn shorten(path: &Path, root: &Path) -> String {
    path.strip_prefix(root)
        .unwrap_or(path)
        .display()
        .to_string()
}

/// Adds the root files of the crates in `folder`, at most `depth` folders down.
fn find_roots(folder: &Path, depth: usize, roots: &mut Vec<PathBuf>) {
    for root in ["src/lib.rs", "src/main.rs"] {
        roots.extend(Some(folder.join(root)).filter(|path| path.is_file()));
    }
    let Some(depth) = depth.checked_sub(1) else {
        return;
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<_> = entries.map(|entry| entry.path()).collect();
    folders.sort();
    for folder in folders
        .iter()
        .filter(|path| path.join("Cargo.toml").is_file())
    {
        find_roots(folder, depth, roots);
    }
}
