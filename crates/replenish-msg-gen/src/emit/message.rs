//! One message: an owned struct and, where there is something to borrow, a view.

use super::fields::{Code, literal};
use super::settings::Emit;
use super::text::{docs, type_hash};
use crate::model::{Base, Definition};

pub(super) fn emit(emit: &Emit<'_>, definition: &Definition) -> String {
    let message = Message {
        emit,
        definition,
        fields: Code::all(emit, definition),
        rust: definition.name.rust(),
    };
    let facts = emit.registry.facts(&definition.name);
    let mut text = String::new();
    if facts.inline {
        text.push_str(&message.owned(""));
        return text;
    }
    text.push_str(&message.view());
    if let Some(gate) = emit.gate() {
        text.push_str(&message.owned(&gate));
        text.push_str(&message.conversion(&gate));
    }
    text
}

struct Message<'a> {
    emit: &'a Emit<'a>,
    definition: &'a Definition,
    fields: Vec<Code<'a>>,
    rust: String,
}

impl Message<'_> {
    fn collect(&self, each: impl Fn(&Code<'_>) -> String) -> String {
        self.fields.iter().map(each).collect()
    }

    /// The struct's declaration.
    fn declaration(&self, view: bool) -> String {
        let mut text = String::new();
        for (field, code) in self.definition.fields.iter().zip(&self.fields) {
            text.push_str(&docs(&field.docs, "    "));
            text.push_str(&format!(
                "    pub {}: {},\n",
                code.name,
                code.whole_type(view)
            ));
        }
        text
    }

    /// The constants of the `.msg` file, of this type.
    fn constants(&self, head: &str) -> String {
        if self.definition.constants.is_empty() {
            return String::new();
        }
        let mut text = format!("\n{head} {{\n");
        for constant in &self.definition.constants {
            let ty = match &constant.base {
                Base::Primitive(p) => p.rust(),
                _ => "&'static str",
            };
            let value = literal(&constant.value, &constant.base);
            text.push_str(&docs(&constant.docs, "    "));
            text.push_str(&format!(
                "    pub const {}: {ty} = {value};\n",
                constant.name
            ));
        }
        text.push_str("}\n");
        text
    }

    fn default(&self, view: bool) -> String {
        let fields = self.collect(|f| format!("            {}: {},\n", f.name, f.default(view)));
        format!("    fn default() -> Self {{\n        Self {{\n{fields}        }}\n    }}\n")
    }

    /// The names; those of `View` are called `NAME` and so on.
    fn names(&self, view: bool) -> String {
        let name = &self.definition.name;
        let infix = if view { "" } else { "TYPE_" };
        format!(
            "    const {infix}NAME: &'static str = \"{name}\";\n    \
             const DDS_{infix}NAME: &'static str = \"{}\";\n",
            name.dds()
        )
    }

    /// The hash and the table of fields, as associated constants.
    fn tables(&self, view: bool) -> String {
        let (rt, name) = (self.emit.runtime, &self.definition.name);
        let rows = self.fields.iter().map(Code::row).collect::<String>();
        let (hash, structure) = if view {
            ("HASH", "FIELDS")
        } else {
            ("TYPE_HASH", "STRUCTURE")
        };
        let mut text = type_hash(
            hash,
            crate::hash::message(self.emit.registry, name).as_deref(),
        );
        text.push_str(&format!(
            "    const {structure}: &'static {rt}::Structure = &{rt}::Structure {{\n        \
             name: \"{name}\",\n        fields: &[\n{rows}        ],\n    }};\n"
        ));
        text
    }

    fn put(&self) -> String {
        let rt = self.emit.runtime;
        if self.fields.is_empty() {
            return "        w.u8(0)\n".into(); // ROS 2 gives an empty message one hidden byte
        }
        let code = self.collect(|f| {
            let put = format!("        {rt}::wire::Encode::put(&self.{}, w)?;\n", f.name);
            f.checks(false) + &put
        });
        code + "        ::core::result::Result::Ok(())\n"
    }

    /// The struct that owns its fields, and its `Message`.
    fn owned(&self, gate: &str) -> String {
        let (rt, name, rust) = (self.emit.runtime, &self.definition.name, &self.rust);
        let facts = self.emit.registry.facts(name);
        let mut derives = String::from("Clone, Debug, PartialEq");
        if facts.plain {
            derives.push_str(", Copy");
        }
        if !facts.float {
            derives.push_str(", Eq, Hash");
        }
        let own_docs = docs(&self.definition.docs, "");
        let decode = if self.fields.is_empty() {
            "        r.u8().map(|_| ())\n".into()
        } else {
            let code = self.collect(|f| {
                let refill = format!(
                    "        {rt}::wire::DecodeInPlace::decode_in_place(&mut self.{}, r)?;\n",
                    f.name
                );
                f.checks_next() + &refill + &f.checks(true)
            });
            code + "        ::core::result::Result::Ok(())\n"
        };
        let tables = if facts.inline {
            self.tables(false)
        } else {
            format!(
                "    const TYPE_HASH: ::core::option::Option<&'static str> = \
             <{rust}View as {rt}::View>::HASH;\n    \
             const STRUCTURE: &'static {rt}::Structure = \
             <{rust}View as {rt}::View>::FIELDS;\n"
            )
        };
        let constants = self.constants(&format!("{gate}impl {rust}"));
        let viewed = if facts.inline {
            "Self".into()
        } else {
            format!("{rust}View<'a>")
        };
        format!(
            "\n/// `{name}`\n///\n{own_docs}{gate}#[derive({derives})]\npub struct {rust} {{\n{}}}\n\
             {constants}\n\
             {gate}impl ::core::default::Default for {rust} {{\n{}}}\n\n\
             {gate}impl {rt}::Message for {rust} {{\n{}    const MAX_SIZE: usize = {};\n    \
             const BOUNDED: bool = {};\n{tables}\n    \
             fn encode(&self, w: &mut {rt}::CdrWriter<'_>) \
             -> ::core::result::Result<(), {rt}::CdrError> {{\n{}    }}\n\n    \
             fn decode(&mut self, r: &mut {rt}::CdrReader<'_>) \
             -> ::core::result::Result<(), {rt}::CdrError> {{\n{decode}    }}\n}}\n\n\
             {gate}impl {rt}::Viewed for {rust} {{\n    type View<'a> = {viewed};\n}}\n",
            self.declaration(false),
            self.default(false),
            self.names(false),
            self.emit.registry.max_size(name),
            facts.bounded,
            self.put(),
        )
    }

    /// The struct that borrows, and its `View`.
    fn view(&self) -> String {
        let (rt, name, rust) = (self.emit.runtime, &self.definition.name, &self.rust);
        let own_docs = docs(&self.definition.docs, "");
        let take = self.collect(|f| {
            let take = format!("        view.{} = {rt}::wire::Item::take(r)?;\n", f.name);
            let check = f.checks(true).replace("self.", "view.");
            f.checks_next() + &take + &check
        });
        let constants = self.constants(&format!("impl {rust}View<'_>"));
        format!(
            "\n/// A view of `{name}`: nothing is allocated.\n///\n{own_docs}\
             #[derive(Clone, Debug, PartialEq)]\npub struct {rust}View<'a> {{\n{}}}\n\
             {constants}\n\
             impl ::core::default::Default for {rust}View<'_> {{\n{}}}\n\n\
             impl {rt}::wire::Encode for {rust}View<'_> {{\n    \
             fn put(&self, w: &mut {rt}::CdrWriter<'_>) \
             -> ::core::result::Result<(), {rt}::CdrError> {{\n{}    }}\n}}\n\n\
             impl<'a> {rt}::wire::Item<'a> for {rust}View<'a> {{\n    \
             fn take(r: &mut {rt}::CdrReader<'a>) \
             -> ::core::result::Result<Self, {rt}::CdrError> {{\n        \
             let mut view = Self::default();\n{take}        \
             ::core::result::Result::Ok(view)\n    }}\n}}\n\n\
             impl<'a> {rt}::View<'a> for {rust}View<'a> {{\n{}{}}}\n",
            self.declaration(true),
            self.default(true),
            self.put(),
            self.names(true),
            self.tables(true),
        )
    }

    /// From the view to the owned struct.
    fn conversion(&self, gate: &str) -> String {
        let rust = &self.rust;
        let fields = self.collect(|f| format!("            {}: {},\n", f.name, f.to_owned()));
        format!(
            "\n{gate}impl ::core::convert::From<{rust}View<'_>> for {rust} {{\n    \
             fn from(view: {rust}View<'_>) -> Self {{\n        Self {{\n{fields}        }}\n    \
             }}\n}}\n"
        )
    }
}
