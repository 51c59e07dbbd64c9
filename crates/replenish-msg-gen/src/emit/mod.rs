//! Rust text: a file per interface, and one that includes them all.

mod fields;
mod message;

use crate::hash;
use crate::model::{Interface, TypeName};
use crate::names;
use crate::registry::Registry;
use std::collections::BTreeMap;
use std::fmt::Write;

/// When owned values on the heap are generated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Owned {
    Always,
    /// With this feature of the crate that includes the code.
    Feature(String),
    Never,
}

/// What all files have in common.
pub(crate) struct Emit<'a> {
    pub(crate) registry: &'a Registry,
    /// The path of `replenish-msg`.
    pub(crate) runtime: &'a str,
    pub(crate) owned: &'a Owned,
}

impl Emit<'_> {
    /// The path of a type, from inside a module of a package.
    fn path(&self, name: &TypeName) -> String {
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

    /// What stands before an item that needs the heap; None if there is to be no such item.
    fn gate(&self) -> Option<String> {
        match self.owned {
            Owned::Always => Some(String::new()),
            Owned::Feature(name) => Some(format!("#[cfg(feature = {name:?})]\n")),
            Owned::Never => None,
        }
    }

    /// The file of an interface.
    pub(crate) fn interface(&self, interface: &Interface) -> String {
        let mut text = String::new();
        for part in &interface.parts {
            match self
                .registry
                .get(&part.name)
                .and_then(|e| e.elsewhere.as_ref())
            {
                Some(path) => text.push_str(&format!("pub use {path};\n")),
                None => text.push_str(&message::emit(self, part)),
            }
        }
        if interface.name.kind != "msg" {
            text.push_str(&self.whole(interface));
        }
        text
    }

    /// `impl Service` or `impl Action`, for a type that stands for the interface as a whole.
    fn whole(&self, interface: &Interface) -> String {
        let parts = &interface.parts;
        let inline = parts.iter().all(|p| self.registry.facts(&p.name).inline);
        let gate = match (inline, self.gate()) {
            (true, _) => String::new(),
            (false, Some(gate)) => gate,
            (false, None) => return String::new(),
        };
        let (name, kind, runtime) = (&interface.name, interface.name.kind, self.runtime);
        let rust = name.rust();
        let (implemented, roles): (_, &[&str]) = match kind {
            "srv" => ("Service", &["Request", "Response"]),
            _ => ("Action", &["Goal", "Result", "Feedback"]),
        };
        let mut body = String::new();
        for (role, part) in roles.iter().zip(parts) {
            body.push_str(&format!("    type {role} = {};\n", self.path(&part.name)));
        }
        body.push_str(&format!(
            "    const TYPE_NAME: &'static str = \"{name}\";\n"
        ));
        if kind == "action" {
            let dds = format!("{}::action::dds_::{}_", name.package, name.name);
            body.push_str(&format!(
                "    const DDS_TYPE_NAME: &'static str = \"{dds}\";\n"
            ));
        }
        let hash = hash::interface(self.registry, interface);
        body.push_str(&type_hash("TYPE_HASH", hash.as_deref()));
        format!(
            "\n/// `{name}`\n{gate}#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]\n\
             pub struct {rust};\n\n\
             {gate}impl {runtime}::{implemented} for {rust} {{\n{body}}}\n"
        )
    }
}

/// The hash as an associated constant.
fn type_hash(name: &str, hash: Option<&str>) -> String {
    format!(
        "    const {name}: ::core::option::Option<&'static str> = {};\n",
        match hash {
            Some(hash) => format!("::core::option::Option::Some(\"{hash}\")"),
            None => "::core::option::Option::None".into(),
        }
    )
}

/// Comments as documentation: what Markdown would take for its own is escaped, and no line is
/// indented, so that nothing becomes code.
fn docs(lines: &[String], indent: &str) -> String {
    let mut text = String::new();
    for line in lines {
        let mut escaped = String::new();
        for c in line.trim().chars() {
            if "\\[]<>*_`#|~&".contains(c) {
                escaped.push('\\');
            }
            escaped.push(c);
        }
        let dashed = escaped.chars().all(|c| "-=+ ".contains(c));
        match escaped.is_empty() || dashed {
            true => text.push_str(&format!("{indent}///\n")),
            false => text.push_str(&format!("{indent}/// {escaped}\n")),
        }
    }
    text
}

/// Where the file of an interface is, relative to the one that includes all.
pub(crate) fn file(name: &TypeName) -> String {
    format!(
        "{}/{}/{}.rs",
        name.package,
        name.kind,
        names::file_name(&name.name)
    )
}

/// The file that includes all: `package::kind::Type`.
pub(crate) fn root(interfaces: &[&Interface]) -> String {
    let mut packages: BTreeMap<&str, BTreeMap<&str, Vec<&TypeName>>> = BTreeMap::new();
    for interface in interfaces {
        let kinds = packages.entry(&interface.name.package).or_default();
        kinds
            .entry(interface.name.kind)
            .or_default()
            .push(&interface.name);
    }
    let mut text = String::from("// Generated by replenish-msg-gen.\n");
    for (package, kinds) in packages {
        text.push_str(&format!(
            "\n/// The `{package}` package.\n\
             #[rustfmt::skip]\n\
             #[allow(clippy::all, clippy::pedantic, clippy::indexing_slicing, missing_docs, \
             rustdoc::all, unused_imports, reason = \"generated from other people's text\")]\n\
             pub mod {} {{\n",
            names::rust_field(package)
        ));
        for (kind, names) in kinds {
            let what = match kind {
                "msg" => "Messages.",
                "srv" => "Services, their requests and responses.",
                _ => "Actions, their goals, results and feedback.",
            };
            text.push_str(&format!("    /// {what}\n    pub mod {kind} {{\n"));
            for name in names {
                writeln!(text, "        include!(\"{}\");", file(name)).unwrap_or_default();
            }
            text.push_str("    }\n");
        }
        text.push_str("}\n");
    }
    text
}
