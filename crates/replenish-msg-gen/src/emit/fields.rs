//! One field: its types, default, and how it is written, read, checked and converted.

use super::settings::Emit;
use crate::model::{Base, Definition, Field, Shape, Value};
use crate::names;
use crate::registry::Held;

/// A field with everything that is asked of it.
pub(super) struct Code<'a> {
    emit: &'a Emit<'a>,
    field: &'a Field,
    element: Held,
    whole: Held,
    pub(super) name: String,
}

impl<'a> Code<'a> {
    pub(super) fn of(emit: &'a Emit<'a>, field: &'a Field) -> Self {
        Self {
            emit,
            field,
            element: emit.registry.element(field),
            whole: emit.registry.field(field),
            name: names::rust_field(&field.name),
        }
    }

    pub(super) fn all(emit: &'a Emit<'a>, definition: &'a Definition) -> Vec<Self> {
        definition
            .fields
            .iter()
            .map(|f| Self::of(emit, f))
            .collect()
    }

    fn runtime(&self) -> &str {
        self.emit.runtime
    }

    fn heap(&self) -> bool {
        self.element == Held::Heap
    }

    fn sequence_bound(&self) -> Option<usize> {
        match self.field.shape {
            Shape::Sequence(bound) => self.emit.registry.sequence_bound(bound),
            _ => None,
        }
    }

    fn text_bound(&self) -> Option<usize> {
        match self.field.base {
            Base::Text(bound) | Base::Wide(bound) => self.emit.registry.text_bound(bound),
            _ => None,
        }
    }

    /// The type of one element; in a view or owned.
    fn element_type(&self, view: bool) -> String {
        let rt = self.runtime();
        match (&self.field.base, self.element, view) {
            (Base::Primitive(p), ..) => p.rust().into(),
            (Base::Text(_), Held::Inline, _) => {
                let bound = self.text_bound().unwrap_or_default();
                format!("{rt}::heapless::String<{bound}>")
            }
            (Base::Text(_), Held::Heap, false) => format!("{rt}::owned::String"),
            (Base::Text(_), Held::Heap, true) => "&'a str".into(),
            (Base::Wide(_), Held::Inline, _) => {
                let bytes = self.text_bound().unwrap_or_default() * 3; // of UTF-8 for each unit
                format!("{rt}::wire::WideString<{bytes}>")
            }
            (Base::Wide(_), _, false) => format!("{rt}::wire::WString"),
            (Base::Wide(_), _, true) => format!("{rt}::wire::WStr<'a>"),
            (Base::Message(name), Held::Heap, true) => {
                format!("{}View<'a>", self.emit.path(name))
            }
            (Base::Message(name), ..) => self.emit.path(name),
        }
    }

    /// Bytes, which a view borrows as a slice.
    fn is_bytes(&self) -> bool {
        matches!(&self.field.base, Base::Primitive(p) if p.rust() == "u8")
    }

    /// The type of the field; in a view or owned.
    pub(super) fn whole_type(&self, view: bool) -> String {
        let (rt, element) = (self.runtime(), self.element_type(view));
        match (self.field.shape, self.whole, view) {
            (Shape::One, ..) => element,
            (Shape::Array(size), ..) => format!("[{element}; {size}]"),
            (Shape::Sequence(_), Held::Inline, _) => {
                let bound = self.sequence_bound().unwrap_or_default();
                format!("{rt}::heapless::Vec<{element}, {bound}>")
            }
            (Shape::Sequence(_), Held::Heap, false) => format!("{rt}::owned::Vec<{element}>"),
            (Shape::Sequence(_), Held::Heap, true) if self.is_bytes() => "&'a [u8]".into(),
            (Shape::Sequence(_), Held::Heap, true) => format!("{rt}::wire::Seq<'a, {element}>"),
        }
    }

    /// The default, as an expression; in a view or owned.
    pub(super) fn default(&self, view: bool) -> String {
        const NONE: &str = "::core::default::Default::default()";
        match (&self.field.default, self.field.shape) {
            (Some(Value::List(values)), shape) => {
                let values: Vec<_> = values.iter().map(|v| self.value(v, view)).collect();
                let (rt, list) = (self.runtime(), format!("[{}]", values.join(", ")));
                match (shape, self.whole, view) {
                    (Shape::Array(_), ..) => list,
                    (_, Held::Inline, _) => format!("{list}.into_iter().collect()"),
                    (_, Held::Heap, false) => format!("{rt}::owned::Vec::from({list})"),
                    // A view can borrow constants alone.
                    _ if values.is_empty() || !self.constant() => NONE.into(),
                    _ if self.is_bytes() => format!("&const {{ {list} }}"),
                    _ => format!("{rt}::wire::Seq::from(&const {{ {list} }})"),
                }
            }
            (Some(value), _) => self.value(value, view),
            (None, Shape::Array(count)) => match self.field.base {
                Base::Primitive(p) => format!("[<{}>::default(); {count}]", p.rust()),
                _ => format!("::core::array::from_fn(|_| {NONE})"),
            },
            (None, _) => NONE.into(),
        }
    }

    /// Whether a literal of the element's type is a constant expression in a view.
    fn constant(&self) -> bool {
        match self.field.base {
            Base::Primitive(_) => true,
            Base::Text(_) => self.heap(),
            _ => false,
        }
    }

    /// One literal as an element.
    fn value(&self, value: &Value, view: bool) -> String {
        match (value, &self.field.base) {
            (Value::Text(text), _) if self.element == Held::Inline => {
                format!("{text:?}.try_into().unwrap_or_default()")
            }
            (Value::Text(text), Base::Text(_)) if view => format!("{text:?}"),
            (Value::Text(text), _) => format!("{text:?}.into()"),
            (value, base) => literal(value, base),
        }
    }

    /// Statements that check what the types do not: bounds of what is on the heap.
    ///
    /// `texts`: of strings alone, as sequences were checked already.
    pub(super) fn checks(&self, texts: bool) -> String {
        let (rt, name) = (self.runtime(), &self.name);
        let mut code = String::new();
        if let (Some(bound), Held::Heap, false) = (self.sequence_bound(), self.whole, texts) {
            code.push_str(&format!(
                "        {rt}::wire::at_most(self.{name}.len(), {bound})?;\n"
            ));
        }
        let wide = matches!(self.field.base, Base::Wide(_));
        if let (Some(bound), true) = (self.text_bound(), self.heap() || wide) {
            let len = match self.field.base {
                Base::Wide(_) => "wide_len",
                _ => "len",
            };
            code.push_str(&match self.field.shape {
                Shape::One => {
                    format!("        {rt}::wire::at_most(self.{name}.{len}(), {bound})?;\n")
                }
                _ => format!(
                    "        self.{name}.iter().try_for_each(|text| \
                     {rt}::wire::at_most(text.{len}(), {bound}))?;\n"
                ),
            });
        }
        code
    }

    /// A check of the sequence that comes next.
    pub(super) fn checks_next(&self) -> String {
        match (self.sequence_bound(), self.whole) {
            (Some(bound), Held::Heap) => {
                format!(
                    "        {}::wire::next_at_most(r, {bound})?;\n",
                    self.runtime()
                )
            }
            _ => String::new(),
        }
    }

    /// From a view's field to an owned one: an expression of `view`.
    pub(super) fn to_owned(&self) -> String {
        let from = format!("view.{}", self.name);
        match (self.field.shape, self.whole, self.heap()) {
            (_, Held::Inline, _) => from,
            (Shape::One, ..) => format!("{from}.into()"),
            (Shape::Array(_), ..) => format!("{from}.map(::core::convert::Into::into)"),
            (Shape::Sequence(_), ..) if self.is_bytes() => format!("{from}.to_vec()"),
            (Shape::Sequence(_), _, true) => {
                format!("{from}.iter().map(::core::convert::Into::into).collect()")
            }
            (Shape::Sequence(_), _, false) => format!("{from}.iter().collect()"),
        }
    }

    /// The row of the structure's table.
    pub(super) fn row(&self) -> String {
        let rt = self.runtime();
        let bound = |bound: Option<usize>| bound.map_or("usize::MAX".into(), |b| b.to_string());
        let shape = match self.field.shape {
            Shape::One => "One".into(),
            Shape::Array(size) => format!("Array({size})"),
            Shape::Sequence(_) => format!("Sequence({})", bound(self.sequence_bound())),
        };
        let kind = match &self.field.base {
            Base::Primitive(p) if p.rust() == "bool" => "Bool".into(),
            Base::Primitive(p) => format!("Number({})", p.size()),
            Base::Text(_) => format!("Text({})", bound(self.text_bound())),
            Base::Wide(_) => format!("WideText({})", bound(self.text_bound())),
            Base::Message(name) => {
                let (path, inline) = (self.emit.path(name), !self.heap());
                let view = if inline { "" } else { "View" };
                format!("Nested(<{path}{view} as {rt}::View>::FIELDS)")
            }
        };
        format!(
            "            {rt}::structure::Field::new({:?}, {rt}::structure::Shape::{shape}, \
             {rt}::structure::Kind::{kind}),\n",
            self.field.name
        )
    }
}

/// A literal of a primitive type or a constant text.
pub(super) fn literal(value: &Value, base: &Base) -> String {
    match (value, base) {
        (Value::Bool(value), _) => value.to_string(),
        (Value::Integer(value), _) => value.to_string(),
        (Value::Text(text), _) => format!("{text:?}"),
        (Value::Float(text), Base::Primitive(p)) => {
            if text.starts_with(['N', 'I']) {
                format!("{}::{text}", p.rust())
            } else {
                text.clone()
            }
        }
        _ => String::new(),
    }
}
