//! The modules of a crate: what each defines, re-exports and names.

use proc_macro2::{TokenStream, TokenTree};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syn::visit::{self, Visit};
use syn::{Attribute, Expr, Item, Lit, Meta, UseTree, Visibility};

/// A path in the source, segment by segment.
pub(super) type Segments = Vec<String>;

/// A crate as a tree of modules; indices into its vectors.
#[derive(Default)]
pub(super) struct Tree {
    pub(super) files: Vec<PathBuf>,
    pub(super) modules: Vec<Module>,
}

/// A module, or one of the files that stand for it under different features.
#[derive(Default)]
pub(super) struct Module {
    pub(super) file: usize,
    pub(super) parent: Option<usize>,
    /// Modules in it by name; several files may stand for one name.
    pub(super) children: BTreeMap<String, Vec<usize>>,
    /// Names of the items that it defines.
    pub(super) items: Vec<String>,
    /// Names that `use` brings into it, with the paths they stand for.
    pub(super) aliases: Vec<(String, Segments)>,
    /// Modules whose names it has through `use …::*`.
    pub(super) globs: Vec<Segments>,
    /// Paths that it names: arrows, as soon as they are resolved.
    pub(super) named: Vec<Segments>,
}

/// Reads the crate with this root file.
///
/// # Errors
/// A file that cannot be read or parsed.
pub(super) fn read(root: &Path) -> Result<Tree, String> {
    let mut tree = Tree::default();
    let folder = root.parent().unwrap_or(root);
    tree.add_file(root, folder, None)?;
    Ok(tree)
}

impl Tree {
    /// Adds the module in the file `path`, whose children stand in `folder`.
    fn add_file(
        &mut self,
        path: &Path,
        folder: &Path,
        parent: Option<usize>,
    ) -> Result<usize, String> {
        let text = std::fs::read_to_string(path);
        let text = text.map_err(|e| format!("{}: {e}", path.display()))?;
        let source = syn::parse_file(&text).map_err(|e| format!("{}: {e}", path.display()))?;
        self.files.push(path.to_path_buf());
        self.add_module(&source.items, folder, self.files.len() - 1, parent)
    }

    fn add_module(
        &mut self,
        items: &[Item],
        folder: &Path,
        file: usize,
        parent: Option<usize>,
    ) -> Result<usize, String> {
        let index = self.modules.len();
        self.modules.push(Module {
            file,
            parent,
            ..Module::default()
        });
        let mut module = Module {
            file,
            parent,
            ..Module::default()
        };
        for item in items.iter().filter(|item| !is_test(attributes(item))) {
            match item {
                Item::Mod(child) => {
                    let name = child.ident.to_string();
                    let inside = folder.join(&name);
                    let found = match &child.content {
                        Some((_, items)) => {
                            vec![self.add_module(items, &inside, file, Some(index))?]
                        }
                        None => self.add_children(&child.attrs, &name, folder, file, index)?,
                    };
                    module.children.entry(name).or_default().extend(found);
                }
                Item::Use(import) => {
                    let exported = !matches!(import.vis, Visibility::Inherited);
                    module.import(&import.tree, &mut Vec::new(), exported);
                }
                _ => {
                    module.items.extend(defined(item));
                    module.visit_item(item);
                }
            }
        }
        self.modules[index] = module;
        Ok(index)
    }

    /// Adds the file or files of `mod name;`: those of its `path` attributes, and the usual one.
    fn add_children(
        &mut self,
        attributes: &[Attribute],
        name: &str,
        folder: &Path,
        file: usize,
        parent: usize,
    ) -> Result<Vec<usize>, String> {
        let beside = self.files[file].parent().unwrap_or(folder).to_path_buf();
        let mut candidates: Vec<_> = paths(attributes)
            .iter()
            .map(|p| (beside.join(p), beside.clone()))
            .collect();
        candidates.push((folder.join(format!("{name}.rs")), folder.join(name)));
        candidates.push((folder.join(name).join("mod.rs"), folder.join(name)));
        candidates.retain(|(path, _)| path.is_file());
        candidates.dedup();
        let add = |(path, inside): (PathBuf, PathBuf)| self.add_file(&path, &inside, Some(parent));
        candidates.into_iter().map(add).collect()
    }
}

impl Module {
    /// Whether it defines anything.
    pub(super) fn defines(&self) -> bool {
        !self.items.is_empty()
    }

    /// Takes a `use` apart. A re-export is an arrow only if its name is used here as well.
    fn import(&mut self, tree: &UseTree, before: &mut Segments, exported: bool) {
        let mut full = before.clone();
        let alias = match tree {
            UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.import(&path.tree, before, exported);
                before.pop();
                return;
            }
            UseTree::Group(group) => {
                return group
                    .items
                    .iter()
                    .for_each(|tree| self.import(tree, before, exported));
            }
            UseTree::Glob(_) => {
                if !exported {
                    full.push("*".into());
                    self.named.push(full);
                }
                return self.globs.push(before.clone());
            }
            UseTree::Name(name) if name.ident == "self" => full.last().cloned().unwrap_or_default(),
            UseTree::Name(name) => {
                full.push(name.ident.to_string());
                name.ident.to_string()
            }
            UseTree::Rename(name) => {
                full.extend(Some(name.ident.to_string()).filter(|ident| ident != "self"));
                name.rename.to_string()
            }
        };
        if !exported {
            self.named.push(full.clone());
        }
        self.aliases.push((alias, full));
    }

    /// Paths among the tokens of a macro.
    fn scan(&mut self, tokens: TokenStream) {
        let (mut path, mut colons) = (Segments::new(), 0);
        for token in tokens {
            match token {
                TokenTree::Punct(punct) if punct.as_char() == ':' && !path.is_empty() => {
                    colons += 1;
                }
                TokenTree::Ident(ident) => {
                    if colons != 2 {
                        self.named.push(core::mem::take(&mut path));
                    }
                    path.push(ident.to_string());
                    colons = 0;
                }
                other => {
                    self.named.push(core::mem::take(&mut path));
                    colons = 0;
                    if let TokenTree::Group(group) = other {
                        self.scan(group.stream());
                    }
                }
            }
        }
        self.named.push(path);
    }
}

impl<'ast> Visit<'ast> for Module {
    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() {
            let segments = path
                .segments
                .iter()
                .map(|segment| segment.ident.to_string());
            self.named.push(segments.collect());
        }
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.visit_path(&call.path);
        self.scan(call.tokens.clone());
    }

    fn visit_item_use(&mut self, import: &'ast syn::ItemUse) {
        self.import(&import.tree, &mut Vec::new(), false); // inside a function
    }

    // Documentation is no import.
    fn visit_attribute(&mut self, _: &'ast Attribute) {}
}

/// The name that an item defines in its module.
fn defined(item: &Item) -> Option<String> {
    let ident = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Macro(item) => item.ident.as_ref()?,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::TraitAlias(item) => &item.ident,
        Item::Type(item) => &item.ident,
        Item::Union(item) => &item.ident,
        _ => return None,
    };
    Some(ident.to_string())
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// Whether an item is there for tests, models or documentation alone.
fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let Meta::List(list) = &attribute.meta else {
            return false;
        };
        let condition = list.tokens.to_string();
        let test = ["test", "loom", "doctest", "all (test"];
        list.path.is_ident("cfg") && test.iter().any(|word| condition.starts_with(word))
    })
}

/// The files that `path` attributes name, also behind `cfg_attr`.
fn paths(attributes: &[Attribute]) -> Vec<String> {
    let mut found = Vec::new();
    for attribute in attributes {
        match &attribute.meta {
            Meta::NameValue(pair) if pair.path.is_ident("path") => {
                if let Expr::Lit(literal) = &pair.value
                    && let Lit::Str(path) = &literal.lit
                {
                    found.push(path.value());
                }
            }
            Meta::List(list) if list.path.is_ident("cfg_attr") => {
                let text = list.tokens.to_string();
                let path = text
                    .split("path = \"")
                    .nth(1)
                    .and_then(|rest| rest.split('"').next());
                found.extend(path.map(str::to_owned));
            }
            _ => {}
        }
    }
    found
}
