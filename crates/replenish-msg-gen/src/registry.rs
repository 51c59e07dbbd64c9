//! All definitions by name, checked against each other: every type that is used exists, none
//! contains itself, and how each is to be represented.

use crate::error::Error;
use crate::model::{Base, Definition, Field, Interface, Shape, TypeName};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Bytes that a bounded string, or all elements of a bounded sequence, may take inside a struct.
/// Larger ones are on the heap (owned) or where they were (view), and their bound is checked.
const INLINE: usize = 1024;

/// Bytes that a message with unbounded fields may take beyond those that it always takes, unless
/// one says otherwise.
const ROOM: usize = 4096;

/// Bounds for what has none, as the user asks.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Bounds {
    pub(crate) text: Option<usize>,
    pub(crate) sequence: Option<usize>,
}

/// Representation of a field's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Held {
    /// In the struct: a primitive, a bounded text, a message without heap.
    Inline,
    /// Owned on the heap, borrowed in a view.
    Heap,
}

/// The properties of a definition that follow once all definitions are known.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facts {
    /// No field is on the heap: one type serves as owned value and as view.
    pub(crate) inline: bool,
    /// No field is without bound.
    pub(crate) bounded: bool,
    /// There are floats in it.
    pub(crate) float: bool,
    /// Every field is a primitive or an array.
    pub(crate) plain: bool,
}

#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) definition: Definition,
    file: PathBuf,
    /// Path of the Rust type if it is not generated here.
    pub(crate) elsewhere: Option<String>,
}

/// All definitions by name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Registry {
    entries: BTreeMap<TypeName, Entry>,
    bounds: Bounds,
}

impl Registry {
    pub(crate) fn new(bounds: Bounds) -> Self {
        Self {
            entries: BTreeMap::new(),
            bounds,
        }
    }

    /// Adds the parts of an interface; one that is there already stays.
    pub(crate) fn add(&mut self, interface: &Interface, elsewhere: Option<&str>) {
        for part in &interface.parts {
            self.entries
                .entry(part.name.clone())
                .or_insert_with(|| Entry {
                    definition: part.clone(),
                    file: interface.file.clone(),
                    elsewhere: elsewhere.map(Into::into),
                });
        }
    }

    pub(crate) fn get(&self, name: &TypeName) -> Option<&Entry> {
        self.entries.get(name)
    }

    /// Checks a definition and all that it contains.
    pub(crate) fn check(&self, name: &TypeName) -> Result<(), Error> {
        self.check_below(name, &mut Vec::new())
    }

    fn check_below(&self, name: &TypeName, above: &mut Vec<TypeName>) -> Result<(), Error> {
        let Some(entry) = self.entries.get(name) else {
            return Ok(()); // said where it is used
        };
        above.push(name.clone());
        for field in &entry.definition.fields {
            let Base::Message(inner) = &field.base else {
                continue;
            };
            let wrong = |message: String| Err(Error::at(&entry.file, field.place, message));
            if !self.entries.contains_key(inner) {
                return wrong(self.unknown(inner));
            }
            if above.contains(inner) {
                return wrong(format!(
                    "{inner} contains itself, through field `{}`",
                    field.name
                ));
            }
            self.check_below(inner, above)?;
        }
        above.pop();
        Ok(())
    }

    fn unknown(&self, name: &TypeName) -> String {
        let known: Vec<_> = self
            .entries
            .keys()
            .filter(|k| k.package == name.package && k.kind == "msg")
            .map(|k| k.name.as_str())
            .collect();
        if known.is_empty() {
            return format!(
                "there is no {name}: package {} was not given; `package_dir` or \
                 `dependency_dir` gives it",
                name.package
            );
        }
        let mut list = known.join(", ");
        if list.len() > 300 {
            let end = list
                .char_indices()
                .map(|(i, _)| i)
                .take_while(|i| *i <= 300)
                .last();
            list.truncate(end.unwrap_or(0));
            list.push_str(", ...");
        }
        format!("there is no {name}; package {} has {list}", name.package)
    }

    /// The bound that a text of this definition's struct has.
    pub(crate) fn text_bound(&self, bound: Option<usize>) -> Option<usize> {
        bound.or(self.bounds.text)
    }

    /// The bound that a sequence has.
    pub(crate) fn sequence_bound(&self, bound: Option<usize>) -> Option<usize> {
        bound.or(self.bounds.sequence)
    }

    /// Representation of one element of a field.
    pub(crate) fn element(&self, field: &Field) -> Held {
        match &field.base {
            Base::Primitive(_) => Held::Inline,
            Base::Text(bound) | Base::Wide(bound) => {
                match (self.bounds.text, self.text_bound(*bound)) {
                    (Some(_), _) => Held::Inline,
                    (None, Some(bound)) if bound <= INLINE => Held::Inline,
                    _ => Held::Heap,
                }
            }
            Base::Message(name) => {
                if self.facts(name).inline {
                    Held::Inline
                } else {
                    Held::Heap
                }
            }
        }
    }

    /// Representation of the field as a whole.
    pub(crate) fn field(&self, field: &Field) -> Held {
        let element = self.element(field);
        match field.shape {
            Shape::Sequence(bound) => {
                let Some(bound) = self.sequence_bound(bound) else {
                    return Held::Heap;
                };
                let size = bound.saturating_mul(self.element_end(0, field));
                if element == Held::Inline && (size <= INLINE || self.bounds.sequence.is_some()) {
                    Held::Inline
                } else {
                    Held::Heap
                }
            }
            _ => element,
        }
    }

    pub(crate) fn facts(&self, name: &TypeName) -> Facts {
        let mut facts = Facts {
            inline: true,
            bounded: true,
            float: false,
            plain: true,
        };
        let Some(entry) = self.entries.get(name) else {
            return facts;
        };
        for field in &entry.definition.fields {
            facts.inline &= self.field(field) == Held::Inline;
            if let Shape::Sequence(bound) = field.shape {
                facts.bounded &= self.sequence_bound(bound).is_some();
                facts.plain = false;
            }
            match &field.base {
                Base::Primitive(p) => facts.float |= p.is_float(),
                Base::Text(bound) | Base::Wide(bound) => {
                    facts.bounded &= self.text_bound(*bound).is_some();
                    facts.plain = false;
                }
                Base::Message(inner) => {
                    let inner = self.facts(inner);
                    facts.bounded &= inner.bounded;
                    facts.float |= inner.float;
                    facts.plain &= inner.plain;
                }
            }
        }
        facts
    }

    /// The size that buffers get: the largest if there is one, else with room for what has no
    /// bound.
    pub(crate) fn max_size(&self, name: &TypeName) -> usize {
        let end = self.end(0, name);
        if self.facts(name).bounded {
            end
        } else {
            end.saturating_add(ROOM)
        }
    }

    /// The largest end of a value that begins at `pos`. A part without a bound counts as empty.
    ///
    /// Ends never come earlier for a later begin or a longer part, so that the longest parts give
    /// the largest end.
    fn end(&self, pos: usize, name: &TypeName) -> usize {
        let Some(entry) = self.entries.get(name) else {
            return pos;
        };
        let fields = &entry.definition.fields;
        if fields.is_empty() {
            return pos + 1;
        }
        fields.iter().fold(pos, |pos, field| match field.shape {
            Shape::One => self.element_end(pos, field),
            Shape::Array(count) => self.elements_end(pos, field, count),
            Shape::Sequence(bound) => {
                let count = self.sequence_bound(bound).unwrap_or(0);
                self.elements_end(aligned(pos, 4).saturating_add(4), field, count)
            }
        })
    }

    /// Alignment is to 8 at most, so that after 8 elements the growth repeats.
    fn elements_end(&self, pos: usize, field: &Field, count: usize) -> usize {
        let period = |pos| (0..8).fold(pos, |pos, _| self.element_end(pos, field));
        if count < 16 {
            return (0..count).fold(pos, |pos, _| self.element_end(pos, field));
        }
        let first = period(aligned(pos, 8));
        let growth = aligned(period(aligned(first, 8)), 8).saturating_sub(aligned(first, 8));
        aligned(first, 8).saturating_add(growth.saturating_mul(count.div_ceil(8) - 1))
    }

    fn element_end(&self, pos: usize, field: &Field) -> usize {
        match &field.base {
            Base::Primitive(p) => aligned(pos, p.size()).saturating_add(p.size()),
            Base::Text(bound) => {
                let bound = self.text_bound(*bound).unwrap_or(0);
                aligned(pos, 4).saturating_add(5).saturating_add(bound)
            }
            Base::Wide(bound) => {
                let bound = self.text_bound(*bound).unwrap_or(0);
                aligned(pos, 4)
                    .saturating_add(4)
                    .saturating_add(bound.saturating_mul(2))
            }
            Base::Message(name) => self.end(pos, name),
        }
    }
}

fn aligned(pos: usize, align: usize) -> usize {
    pos.saturating_add(pos.wrapping_neg() & (align - 1))
}
