//! Errors in a file, with their place.

use std::fmt;
use std::ops::Range;

/// An error in a deployment file: file, line, column, field, and what is allowed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileError {
    /// The file, as it was named.
    pub file: String,
    /// The line, from 1; 0 if the file could not be read at all.
    pub line: usize,
    /// The column in characters, from 1.
    pub column: usize,
    /// The field, where it is about one: `worker.guarantee.budget`.
    pub field: String,
    /// The error, with the allowed values.
    pub message: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if self.line > 0 {
            write!(f, ":{}:{}", self.line, self.column)?;
        }
        f.write_str(": ")?;
        if !self.field.is_empty() {
            write!(f, "{}: ", self.field)?;
        }
        f.write_str(&self.message)
    }
}

impl std::error::Error for FileError {}

/// A text with its name, for errors.
#[derive(Debug, Clone)]
pub(super) struct Source {
    pub(super) file: String,
    pub(super) text: String,
}

impl Source {
    pub(super) fn error(&self, at: &Range<usize>, message: impl Into<String>) -> FileError {
        let before = self.text.get(..at.start).unwrap_or(&self.text);
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        FileError {
            file: self.file.clone(),
            line: before.matches('\n').count() + 1,
            column: before.get(line_start..).map_or(0, |s| s.chars().count()) + 1,
            field: self.field(at.start),
            message: message.into(),
        }
    }

    pub(super) fn wrong_toml(&self, error: &toml::de::Error) -> FileError {
        let at = error.span().unwrap_or(0..0);
        self.error(&at, error.message().replace('\n', ", "))
    }

    /// The field whose value, or whose name, begins at `at`: the headings and keys before it.
    fn field(&self, at: usize) -> String {
        let before = self.text.get(..at).unwrap_or("");
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let heading = before
            .lines()
            .rev()
            .map(str::trim)
            .find(|l| l.starts_with('[') && l.ends_with(']'));
        let heading = heading.map(|h| h.trim_matches(['[', ']']).trim().to_owned());
        let line = before.get(line_start..).unwrap_or("");
        let mut path: Vec<String> = heading
            .filter(|h| !h.contains(['"', ',']))
            .into_iter()
            .collect();
        let mut key = String::new();
        let mut pending: Option<String> = None;
        let (mut depth, mut quoted) = (0, false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                _ if quoted => {}
                '[' => depth += 1,
                ']' => depth -= 1,
                '=' => pending = Some(core::mem::take(&mut key).trim().to_owned()),
                '{' => path.extend(pending.take()),
                '}' | ',' if depth == 0 => {
                    pending = None;
                    key.clear();
                }
                c => key.push(c),
            }
        }
        path.extend(pending);
        let rest = self.text.get(at..).unwrap_or("");
        let name: String = rest
            .chars()
            .take_while(|c| c.is_ascii_alphanumeric() || *c == '_' || *c == '-')
            .collect();
        let next = rest.get(name.len()..).unwrap_or("").trim_start();
        let in_heading = matches!(line.trim(), "[" | "[[") && next.starts_with(']');
        let is_key = in_heading || next.starts_with('=');
        if is_key && !name.is_empty() {
            path.push(name);
        }
        path.join(".")
    }
}
