//! From the paths that files name to the files that define the names.

use super::tree::{Module, Tree};
use std::collections::{BTreeMap, BTreeSet};

/// Arrows between files, from the one that names to the one that defines, with the names.
pub(super) type Imports = BTreeMap<(usize, usize), BTreeSet<String>>;

/// The most re-exports that a name may come through.
const DEPTH: usize = 16;

/// The imports between the files of a crate.
pub(super) fn imports(tree: &Tree) -> Imports {
    let mut imports = Imports::new();
    for (index, module) in tree.modules.iter().enumerate() {
        for path in &module.named {
            for (file, name) in find(tree, index, path, DEPTH) {
                if file != module.file {
                    imports.entry((module.file, file)).or_default().insert(name);
                }
            }
        }
    }
    imports
}

/// The files that define what `path` names in module `at`, with the name of the definition. Several
/// files may stand for one module; a path into another crate leads nowhere.
fn find(tree: &Tree, at: usize, path: &[String], depth: usize) -> Vec<(usize, String)> {
    let (Some(first), Some(depth)) = (path.first(), depth.checked_sub(1)) else {
        return Vec::new();
    };
    let Some(module) = tree.modules.get(at) else {
        return Vec::new();
    };
    let rest = path.get(1..).unwrap_or_default();
    match first.as_str() {
        "crate" => return find(tree, 0, rest, depth),
        "self" => return find(tree, at, rest, depth),
        "super" => {
            let parent = module.parent.unwrap_or(at);
            return find(tree, parent, rest, depth);
        }
        "*" if module.defines() => return vec![(module.file, "*".into())],
        _ => {}
    }
    if module.items.contains(first) {
        return vec![(module.file, first.clone())];
    }
    if let Some(children) = module.children.get(first) {
        return children
            .iter()
            .flat_map(|child| find(tree, *child, rest, depth))
            .collect();
    }
    if let Some(full) = alias(module, first) {
        let full: Vec<_> = full.iter().chain(rest).cloned().collect();
        return find(tree, at, &full, depth);
    }
    let globs = module
        .globs
        .iter()
        .filter(|glob| glob.first() != Some(first));
    let through = globs.map(|glob| glob.iter().chain(path).cloned().collect::<Vec<_>>());
    through
        .flat_map(|path| find(tree, at, &path, depth))
        .collect()
}

/// The path behind a name that `use` brings into a module, unless it begins with that name: then it
/// comes from another crate.
fn alias<'m>(module: &'m Module, name: &str) -> Option<&'m [String]> {
    let mut found = module.aliases.iter().filter(|(alias, _)| alias == name);
    let (_, path) = found.find(|(_, path)| path.first().is_some_and(|first| first != name))?;
    Some(path)
}
