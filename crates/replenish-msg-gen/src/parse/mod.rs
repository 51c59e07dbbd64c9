//! `.msg`, `.srv` and `.action` files, line by line.
//!
//! A line is empty, a comment, a separator `---`, a field `TYPE NAME [DEFAULT]`, or a constant
//! `TYPE NAME=VALUE`. Comments go to the field or constant behind them, or on whose line they are;
//! those before the first empty line, to the interface.

mod line;
mod types;
mod values;

use crate::error::{Error, Place};
use crate::model::{Base, Constant, Definition, Field, Interface, Shape, TypeName, Value};
use crate::names;
use line::Line;
use std::path::Path;

/// Parses the text of `file`, which is interface `name`; the name says which kind.
///
/// # Errors
/// With the place, and what is allowed there.
pub(crate) fn interface(file: &Path, name: &TypeName, text: &str) -> Result<Interface, Error> {
    let suffixes: &[&str] = match name.kind {
        "srv" => &["_Request", "_Response"],
        "action" => &["_Goal", "_Result", "_Feedback"],
        _ => &[""],
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut parts: Vec<Part<'_>> = Vec::new();
    let mut part = Part::new(file, name);
    let mut last = 0;
    for (number, text) in text.lines().enumerate() {
        last = number + 1;
        if text.trim() == "---" {
            if parts.len() + 1 == suffixes.len() {
                let message = match name.kind {
                    "msg" => "a message has no `---`; services and actions have".into(),
                    kind => format!(
                        "one `---` too many: a .{kind} file has {} parts",
                        suffixes.len()
                    ),
                };
                return Err(Error::at(
                    file,
                    Place {
                        line: last,
                        column: 1,
                    },
                    message,
                ));
            }
            parts.push(std::mem::replace(&mut part, Part::new(file, name)));
        } else {
            part.line(Line::new(file, number, text))?;
        }
    }
    parts.push(part);
    if parts.len() < suffixes.len() {
        let place = Place {
            line: last + 1,
            column: 1,
        };
        let message = format!(
            "`---` is missing: a .{} file has {} parts with `---` between, this file has {}",
            name.kind,
            suffixes.len(),
            parts.len()
        );
        return Err(Error::at(file, place, message));
    }
    let named = parts.into_iter().zip(suffixes);
    Ok(Interface {
        name: name.clone(),
        file: file.into(),
        parts: named.map(|(p, suffix)| p.done(name.with(suffix))).collect(),
    })
}

/// A part of a file in the making.
struct Part<'a> {
    file: &'a Path,
    package: &'a str,
    docs: Vec<String>,
    fields: Vec<Field>,
    constants: Vec<Constant>,
    /// Comments that belong to what comes next.
    pending: Vec<String>,
    /// The file has only comments so far.
    head: bool,
}

impl<'a> Part<'a> {
    fn new(file: &'a Path, name: &'a TypeName) -> Self {
        Self {
            file,
            package: &name.package,
            docs: Vec::new(),
            fields: Vec::new(),
            constants: Vec::new(),
            pending: Vec::new(),
            head: true,
        }
    }

    fn done(self, name: TypeName) -> Definition {
        Definition {
            name,
            docs: self.docs,
            fields: self.fields,
            constants: self.constants,
        }
    }

    /// The comments of whatever was read last.
    fn last_docs(&mut self, field: bool) -> Option<&mut Vec<String>> {
        if field {
            self.fields.last_mut().map(|f| &mut f.docs)
        } else {
            self.constants.last_mut().map(|c| &mut c.docs)
        }
    }

    fn line(&mut self, mut line: Line<'_>) -> Result<(), Error> {
        line.skip_blanks();
        if line.at_end() {
            match line.comment() {
                None => {
                    if self.head {
                        self.docs.append(&mut self.pending);
                    }
                    self.head &= self.docs.is_empty();
                    self.pending.clear();
                }
                Some(comment) => self.pending.push(comment.into()),
            }
            return Ok(());
        }
        if self.head && self.fields.is_empty() && self.constants.is_empty() {
            self.head = false;
        }
        let start = line.place();
        let (base, shape) = types::parse(&mut line, self.package)?;
        line.skip_blanks();
        let name_at = line.place();
        let name = line.word();
        if name.is_empty() {
            return Err(line.error(name_at, "a name is missing behind the type".into()));
        }
        line.skip_blanks();
        let constant = line.take('=');
        line.skip_blanks();
        self.check_name(&line, name_at, name, constant)?;
        let name = name.to_owned();
        if constant {
            if matches!(base, Base::Message(_)) || shape != Shape::One {
                let message =
                    "a constant is of a primitive type, `string` or `wstring`, and no array";
                return Err(line.error(start, message.into()));
            }
            let value = values::parse(&mut line, &base, shape);
            let value = value.map_err(|e| e.about("constant", &name))?;
            let docs = std::mem::take(&mut self.pending);
            self.constants.push(Constant {
                name,
                base,
                value,
                docs,
            });
        } else {
            let default = self.default(&mut line, &base, shape);
            let default = default.map_err(|e| e.about("field", &name))?;
            let docs = std::mem::take(&mut self.pending);
            let place = start;
            self.fields.push(Field {
                name,
                base,
                shape,
                default,
                docs,
                place,
            });
        }
        if let Some(comment) = line.comment() {
            let comment = comment.to_owned();
            if let Some(docs) = self.last_docs(!constant) {
                docs.push(comment);
            }
        }
        Ok(())
    }

    fn default(
        &self,
        line: &mut Line<'_>,
        base: &Base,
        shape: Shape,
    ) -> Result<Option<Value>, Error> {
        if line.at_end() {
            return Ok(None);
        }
        if let Base::Message(_) = base {
            let message = "a field of a message type has no default value".into();
            return Err(line.error(line.place(), message));
        }
        values::parse(line, base, shape).map(Some)
    }

    fn check_name(
        &self,
        line: &Line<'_>,
        place: Place,
        name: &str,
        constant: bool,
    ) -> Result<(), Error> {
        let (ok, what, allowed) = if constant {
            (names::is_constant(name), "constant", names::CONSTANT)
        } else {
            (names::is_field(name), "field", names::FIELD)
        };
        if !ok {
            let message = format!("`{name}` is no name of a {what}: {allowed}");
            return Err(line.error(place, message));
        }
        let taken = if constant {
            self.constants.iter().any(|c| c.name == name)
        } else {
            self.fields.iter().any(|f| f.name == name)
        };
        if taken {
            let message = format!("there is a {what} `{name}` already");
            return Err(Error::at(self.file, place, message));
        }
        Ok(())
    }
}
