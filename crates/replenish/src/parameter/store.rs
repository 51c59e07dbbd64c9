//! The table of a node's parameters: staged first, then committed or not. Pure, no locks.
//!
//! ```text
//!   free ── declare ──► set ── stage ──► staged ── commit ──► set
//!                        ▲                  │
//!                        └──── unstage ─────┘       (one that was not there before: free again)
//! ```
//!
//! A value is kept as the bytes of its message: of fixed capacity, and ready to be sent.

use super::descriptor::Descriptor;
use super::error::{ParameterError, ParameterErrorKind as Kind};
use super::value::ParameterValue;
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_interfaces::rcl_interfaces::msg::ParameterValueView;
use replenish_msg::View;

/// Bytes that a value takes beside its contents: type, scalars and empty sequences.
const FRAME: usize = 64;

/// A value as bytes.
pub(crate) struct Buffer {
    bytes: Box<[u8]>,
    len: usize,
}

impl Buffer {
    pub(crate) fn new(size: usize) -> Self {
        Self {
            bytes: alloc::vec![0; size + FRAME].into(),
            len: 0,
        }
    }

    pub(crate) fn view(&self) -> ParameterValueView<'_> {
        let bytes = self.bytes.get(..self.len).unwrap_or_default();
        ParameterValueView::from_payload(bytes).unwrap_or_default()
    }

    pub(crate) fn value(&self) -> ParameterValue<'_> {
        ParameterValue::of_view(&self.view()).unwrap_or_default()
    }

    /// `false` if it does not fit.
    pub(crate) fn keep(&mut self, value: &ParameterValue<'_>) -> bool {
        let len = value.view().encode_to(&mut self.bytes);
        self.len = len.unwrap_or(0);
        len.is_ok()
    }
}

/// The change of a parameter that a commit makes; in the order of a parameter event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mark {
    New,
    Changed,
    Deleted,
}

pub(crate) struct Slot {
    pub(crate) name: String,
    used: bool,
    /// The type it was declared with, by its number.
    pub(crate) kind: u8,
    /// The parameter was set without a declaration.
    undeclared: bool,
    pub(crate) descriptor: Descriptor,
    pub(crate) now: Buffer,
    pub(crate) next: Buffer,
    pub(crate) mark: Option<Mark>,
}

/// The side that sets a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Setter {
    /// The node, by the rules that hold for others, too.
    Node,
    /// The node, its read-only parameters included.
    Owner,
    /// Another node, through the services.
    Others,
}

/// Bounds of the table.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) parameters: usize,
    pub(crate) name: usize,
    pub(crate) value: usize,
    pub(crate) undeclared: bool,
    /// Others undeclare a parameter by setting it to nothing.
    pub(crate) removable: bool,
}

pub(crate) struct Table {
    slots: Vec<Slot>,
    bounds: Bounds,
}

impl Table {
    pub(crate) fn new(bounds: Bounds) -> Self {
        let slot = || Slot {
            name: String::with_capacity(bounds.name),
            used: false,
            kind: 0,
            undeclared: false,
            descriptor: Descriptor::new(),
            now: Buffer::new(bounds.value),
            next: Buffer::new(bounds.value),
            mark: None,
        };
        Self {
            slots: (0..bounds.parameters).map(|_| slot()).collect(),
            bounds,
        }
    }

    /// All parameters, in the order they were declared as long as none was deleted.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Slot> + Clone {
        let known = |s: &&Slot| s.used && s.mark != Some(Mark::New);
        self.slots.iter().filter(known)
    }

    /// The parameters with a staged change of the kind `mark`.
    pub(crate) fn marked(&self, mark: Mark) -> impl Iterator<Item = &Slot> + Clone {
        self.slots.iter().filter(move |s| s.mark == Some(mark))
    }

    pub(crate) fn find(&self, name: &str) -> Result<&Slot, ParameterError> {
        let slot = self.all().find(|s| s.name == name);
        slot.ok_or_else(|| ParameterError::unknown(name))
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.slots.iter().position(|s| s.used && s.name == name)
    }

    /// Stages a new parameter.
    pub(crate) fn declare(
        &mut self,
        name: &str,
        value: &ParameterValue<'_>,
        descriptor: Descriptor,
    ) -> Result<(), ParameterError> {
        descriptor.check(name, value.type_number())?;
        descriptor.admit(name, value)?;
        if self.position(name).is_some() {
            let text = format_args!("{name}: there is such a parameter already");
            return Err(ParameterError::new(Kind::Exists, text));
        }
        self.create(name, value, descriptor, false)
    }

    fn create(
        &mut self,
        name: &str,
        value: &ParameterValue<'_>,
        descriptor: Descriptor,
        undeclared: bool,
    ) -> Result<(), ParameterError> {
        let Bounds {
            parameters,
            name: longest,
            value: bytes,
            ..
        } = self.bounds;
        if name.is_empty() || name.len() > longest {
            let (len, text) = (name.len(), "bytes allowed in a parameter's name");
            let text = format_args!("name of {len} bytes: 1..={longest} {text}");
            return Err(ParameterError::new(Kind::Name, text));
        }
        let Some(slot) = self.slots.iter_mut().find(|s| !s.used) else {
            let text = format_args!("{name}: there may be {parameters} parameters and no more");
            return Err(ParameterError::new(Kind::TooMany, text));
        };
        if !slot.next.keep(value) {
            return Err(too_large(name, bytes));
        }
        slot.used = true;
        slot.name.clear();
        slot.name.push_str(name);
        slot.kind = value.type_number();
        slot.undeclared = undeclared;
        slot.descriptor = descriptor;
        slot.now.keep(&ParameterValue::NotSet);
        slot.mark = Some(Mark::New);
        Ok(())
    }

    /// Replaces the descriptor of a parameter, which must allow the value. Returns the old one.
    pub(crate) fn describe(
        &mut self,
        name: &str,
        descriptor: Descriptor,
    ) -> Result<Descriptor, ParameterError> {
        let at = self.position(name);
        let slot = at.and_then(|at| self.slots.get_mut(at));
        let slot = slot.ok_or_else(|| ParameterError::unknown(name))?;
        descriptor.check(name, slot.kind)?;
        descriptor.admit(name, &slot.now.value())?;
        Ok(core::mem::replace(&mut slot.descriptor, descriptor))
    }

    /// Stages another value.
    pub(crate) fn stage(
        &mut self,
        name: &str,
        value: &ParameterValue<'_>,
        setter: Setter,
    ) -> Result<(), ParameterError> {
        let Some(at) = self.position(name) else {
            if self.bounds.undeclared && *value != ParameterValue::NotSet {
                let descriptor = Descriptor::new().dynamic_typing();
                return self.create(name, value, descriptor, true);
            }
            return Err(ParameterError::unknown(name));
        };
        let Bounds {
            value: bytes,
            removable,
            ..
        } = self.bounds;
        let slot = self.slots.get_mut(at);
        let slot = slot.ok_or_else(|| ParameterError::unknown(name))?;
        if slot.descriptor.read_only && setter != Setter::Owner {
            return Err(read_only(name));
        }
        if removable && setter == Setter::Others && *value == ParameterValue::NotSet {
            return self.undeclare(name);
        }
        slot.descriptor.admits_type(name, slot.kind, value)?;
        slot.descriptor.admit(name, value)?;
        if !slot.next.keep(value) {
            return Err(too_large(name, bytes));
        }
        slot.mark = Some(match (slot.mark, value) {
            (Some(Mark::New), _) => Mark::New,
            (_, ParameterValue::NotSet) if slot.undeclared => Mark::Deleted,
            _ => Mark::Changed,
        });
        Ok(())
    }

    /// Stages that it goes.
    pub(crate) fn undeclare(&mut self, name: &str) -> Result<(), ParameterError> {
        let at = self.position(name);
        let slot = at.and_then(|at| self.slots.get_mut(at));
        let slot = slot.ok_or_else(|| ParameterError::unknown(name))?;
        if slot.descriptor.read_only {
            return Err(read_only(name));
        }
        slot.next.keep(&ParameterValue::NotSet);
        slot.mark = Some(Mark::Deleted);
        Ok(())
    }

    /// Forgets what is staged.
    pub(crate) fn unstage(&mut self) {
        for slot in &mut self.slots {
            slot.used &= slot.mark != Some(Mark::New);
            slot.mark = None;
        }
    }

    /// Puts the staged values in force; the old ones are then in `next`.
    pub(crate) fn commit(&mut self) {
        for slot in self.slots.iter_mut().filter(|s| s.mark.is_some()) {
            core::mem::swap(&mut slot.now, &mut slot.next);
            if slot.kind == 0 || slot.descriptor.dynamic {
                slot.kind = slot.now.value().type_number();
            }
            slot.used = slot.mark != Some(Mark::Deleted);
            slot.mark = None;
        }
    }
}

fn read_only(name: &str) -> ParameterError {
    ParameterError::new(Kind::ReadOnly, format_args!("{name}: it is read-only"))
}

fn too_large(name: &str, bytes: usize) -> ParameterError {
    let text = format_args!("{name}: a value may take up to {bytes} bytes");
    ParameterError::new(Kind::TooLarge, text)
}
