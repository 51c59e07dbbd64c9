//! The settings that all generated files share.

use crate::model::TypeName;
use crate::registry::Registry;

/// The types for which owned values on the heap are generated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Owned {
    Always,
    /// With this feature of the crate that includes the code.
    Feature(String),
    Never,
}

/// The settings that all files have in common.
pub(crate) struct Emit<'a> {
    pub(crate) registry: &'a Registry,
    /// The path of `replenish-msg`.
    pub(crate) runtime: &'a str,
    pub(crate) owned: &'a Owned,
}

impl Emit<'_> {
    /// The path of a type, from inside a module of a package.
    pub(super) fn path(&self, name: &TypeName) -> String {
        match self.registry.get(name).and_then(|e| e.elsewhere.clone()) {
            Some(path) => path,
            None => format!(
                "super::super::{}::{}::{}",
                name.package,
                name.kind,
                name.rust()
            ),
        }
    }

    /// The attribute before an item that needs the heap; `None` if there is to be no such item.
    pub(super) fn gate(&self) -> Option<String> {
        match self.owned {
            Owned::Always => Some(String::new()),
            Owned::Feature(name) => Some(format!("#[cfg(feature = {name:?})]\n")),
            Owned::Never => None,
        }
    }
}
