//! The file of one interface.

use super::message;
use super::settings::Emit;
use super::text::type_hash;
use crate::hash;
use crate::model::Interface;

impl Emit<'_> {
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

    /// `impl Service` or `impl Action`, for a type that stands for the interface as a whole, and
    /// its parts in the other spelling.
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
        let (mut body, mut spellings) = (String::new(), String::new());
        for (role, part) in roles.iter().zip(parts) {
            let path = self.path(&part.name);
            body.push_str(&format!("    type {role} = {path};\n"));
            spellings.push_str(&format!(
                "\n/// `{rust}{role}` in the spelling of rclrs and of C.\n{gate}\
                 #[allow(non_camel_case_types)]\npub type {rust}_{role} = {path};\n"
            ));
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
             {gate}impl {runtime}::{implemented} for {rust} {{\n{body}}}\n{spellings}"
        )
    }
}
