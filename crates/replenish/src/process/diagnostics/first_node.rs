//! The node whose publishers the diagnostics are: the first of its context.

use std::string::String;
use std::sync::OnceLock;

/// The full name of the first node of a context.
#[derive(Default)]
pub(crate) struct FirstNode(OnceLock<String>);

impl FirstNode {
    /// A node was made.
    pub(crate) fn note(&self, name: &str) {
        self.0.get_or_init(|| name.into());
    }

    pub(super) fn name(&self) -> Option<&str> {
        self.0.get().map(String::as_str)
    }
}
