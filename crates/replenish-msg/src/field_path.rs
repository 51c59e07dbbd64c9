//! Names the field that cannot be decoded: `poses[3].pose.orientation.w: needs 8 bytes, 3 left`.
//!
//! Decoding itself keeps no track of names, so that it costs nothing. Only when it has failed the
//! bytes are walked a second time, along the type's [`Structure`].

use crate::structure::{Field, Kind, Shape, Structure};
use crate::wire::{Item, WStr, at_most, next_text_at_most};
use crate::{CdrError, CdrReader, Message};
use core::fmt;

/// Names that a path holds; deeper ones are left out (no ROS type comes near).
const DEEPEST: usize = 8;

/// Reason and field for which bytes are not a message of the type that was asked for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct DecodeError {
    /// The error at that field.
    pub error: CdrError,
    root: &'static Structure,
    path: [Step; DEEPEST],
    depth: usize,
}

/// The number of a field in its structure, and of the element where there are several.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
struct Step {
    field: u16,
    /// 1 for the first; 0 where it is the field itself.
    element: u32,
}

impl DecodeError {
    /// An error in the bytes as a whole.
    const fn whole(error: CdrError, root: &'static Structure) -> Self {
        let path = [Step {
            field: 0,
            element: 0,
        }; DEEPEST];
        Self {
            error,
            root,
            path,
            depth: 0,
        }
    }

    /// Finds the field of `root` that `reader` fails at; `error` is what decoding said.
    #[cold]
    pub(crate) fn find(root: &'static Structure, reader: CdrReader<'_>, error: CdrError) -> Self {
        let mut walk = Walk {
            reader,
            found: Self::whole(error, root),
        };
        match walk.structure(root, 0) {
            Err(Stop::At(error, depth)) => {
                let depth = depth.min(DEEPEST);
                Self {
                    error,
                    depth,
                    ..walk.found
                }
            }
            Ok(()) | Err(Stop::Unknown) => Self::whole(error, root),
        }
    }

    /// The ROS name of the type.
    #[must_use]
    pub const fn type_name(&self) -> &'static str {
        self.root.name
    }

    /// The path of the field, such as `poses[3].pose.orientation.w`. Shows nothing if the type's
    /// structure is not known or the bytes have no payload at all.
    #[must_use]
    pub const fn path(&self) -> Path<'_> {
        Path(self)
    }
}

/// The path of a field. Made by [`DecodeError::path`].
#[derive(Clone, Copy)]
pub struct Path<'a>(&'a DecodeError);

impl fmt::Display for Path<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DecodeError {
            root, path, depth, ..
        } = self.0;
        let mut structure = *root;
        for (number, step) in path.iter().take(*depth).enumerate() {
            let Some(field) = structure.fields.get(usize::from(step.field)) else {
                break;
            };
            let dot = if number == 0 { "" } else { "." };
            write!(f, "{dot}{}", field.name)?;
            if let Some(element) = step.element.checked_sub(1) {
                write!(f, "[{element}]")?;
            }
            if let Kind::Nested(nested) = field.kind {
                structure = nested;
            }
        }
        Ok(())
    }
}

impl fmt::Debug for Path<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl fmt::Display for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.depth > 0 {
            write!(f, "{}: ", self.path())?;
        }
        match self.error {
            CdrError::EndOfBuffer {
                needed, available, ..
            } => write!(f, "needs {needed} bytes, {available} left"),
            error => write!(f, "{error}"),
        }
    }
}

impl fmt::Debug for DecodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DecodeError")
            .field("type_name", &self.type_name())
            .field("path", &self.path())
            .field("error", &self.error)
            .finish()
    }
}

impl core::error::Error for DecodeError {}

struct Walk<'a> {
    reader: CdrReader<'a>,
    found: DecodeError,
}

enum Stop {
    /// The error, and how many steps lead to it.
    At(CdrError, usize),
    /// A structure that does not tell its fields: nothing behind it can be found.
    Unknown,
}

impl Walk<'_> {
    fn structure(&mut self, structure: &'static Structure, depth: usize) -> Result<(), Stop> {
        if structure.name.is_empty() {
            return Err(Stop::Unknown);
        }
        if structure.fields.is_empty() {
            self.reader.u8().map_err(|e| Stop::At(e, depth))?; // the hidden byte
        }
        for (number, field) in structure.fields.iter().enumerate() {
            let field_number = u16::try_from(number).unwrap_or(u16::MAX);
            self.field(field, field_number, depth)?;
        }
        Ok(())
    }

    fn field(&mut self, field: &Field, number: u16, depth: usize) -> Result<(), Stop> {
        self.step(depth, number, 0);
        let count = match field.shape {
            Shape::One => return self.value(field.kind, depth + 1),
            Shape::Array(count) => count,
            Shape::Sequence(limit) => self
                .reader
                .sequence(limit)
                .map_err(|e| Stop::At(e, depth + 1))?,
        };
        for element in 0..count {
            let element = u32::try_from(element).unwrap_or(u32::MAX);
            self.step(depth, number, element.saturating_add(1));
            self.value(field.kind, depth + 1)?;
        }
        Ok(())
    }

    fn step(&mut self, depth: usize, field: u16, element: u32) {
        if let Some(step) = self.found.path.get_mut(depth) {
            *step = Step { field, element };
        }
    }

    fn value(&mut self, kind: Kind, depth: usize) -> Result<(), Stop> {
        let r = &mut self.reader;
        let result = match kind {
            Kind::Bool => r.bool().map(|_| ()),
            Kind::Number(size) => r.primitives(size, 1).map(|_| ()),
            Kind::Text(limit) => {
                next_text_at_most(r, limit).and_then(|()| r.string(limit).map(|_| ()))
            }
            Kind::WideText(limit) => WStr::take(r).and_then(|text| at_most(text.wide_len(), limit)),
            Kind::Nested(structure) => return self.structure(structure, depth),
        };
        result.map_err(|e| Stop::At(e, depth))
    }
}

/// The name of the field at which `written` ends, the beginning of a message of this structure: of
/// the outermost one, where it is in another. Empty if the structure is not known, or nothing is
/// missing.
///
/// For encoders that had no room for it: what they have written so far says where they were.
#[cold]
#[must_use]
pub fn unwritten(structure: &'static Structure, written: &[u8]) -> &'static str {
    let missing = CdrError::EndOfBuffer {
        at: written.len(),
        needed: 0,
        available: 0,
    };
    let found = DecodeError::find(structure, CdrReader::new(written), missing);
    let first = found.path.first().filter(|_| found.depth > 0);
    let field = first.and_then(|step| structure.fields.get(usize::from(step.field)));
    field.map_or("", |field| field.name)
}

/// Decodes what `reader` has into `msg`.
///
/// # Errors
/// The field that cannot be decoded, and the reason. `msg` is then valid but unspecified.
pub fn decode_with_path<M: Message>(
    msg: &mut M,
    reader: &CdrReader<'_>,
) -> Result<(), DecodeError> {
    msg.decode(&mut reader.clone())
        .map_err(|error| DecodeError::find(M::STRUCTURE, reader.clone(), error))
}

/// As [`decode_with_path`], without looking for the field: for builds that have no room for that.
///
/// # Errors
/// The errors of the message as a whole.
pub fn decode_whole<M: Message>(msg: &mut M, reader: &CdrReader<'_>) -> Result<(), DecodeError> {
    msg.decode(&mut reader.clone())
        .map_err(|error| DecodeError::whole(error, M::STRUCTURE))
}

/// Decodes a payload with its 4-byte encapsulation header, of either byte order, into `msg`.
///
/// # Errors
/// As [`decode_with_path`]; [`CdrError::Encapsulation`] for an encoding other than XCDR1.
pub fn decode_encapsulated<M: Message>(msg: &mut M, bytes: &[u8]) -> Result<(), DecodeError> {
    let reader =
        CdrReader::encapsulated(bytes).map_err(|error| DecodeError::whole(error, M::STRUCTURE))?;
    decode_with_path(msg, &reader)
}

/// As [`decode_encapsulated`], for whatever has that structure.
pub(crate) fn encapsulated<'a>(
    bytes: &'a [u8],
    root: &'static Structure,
) -> Result<CdrReader<'a>, DecodeError> {
    CdrReader::encapsulated(bytes).map_err(|error| DecodeError::whole(error, root))
}
