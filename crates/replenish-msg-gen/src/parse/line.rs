//! One line, with a position and its comment cut off.

use crate::error::{Error, Place};
use std::path::Path;

pub(super) struct Line<'a> {
    file: &'a Path,
    number: usize,
    whole: &'a str,
    /// End of the code, in bytes; blanks and the comment follow.
    end: usize,
    /// Position of the reader, in bytes, on a character's boundary.
    pos: usize,
}

impl<'a> Line<'a> {
    /// Line `number` (from 0) of `file`.
    pub(super) fn new(file: &'a Path, number: usize, whole: &'a str) -> Self {
        let code = whole.get(..comment_start(whole)).unwrap_or_default();
        Self {
            file,
            number,
            whole,
            end: code.trim_end().len(),
            pos: 0,
        }
    }

    /// The rest of the line, without a comment.
    pub(super) fn rest(&self) -> &'a str {
        self.whole.get(self.pos..self.end).unwrap_or_default()
    }

    pub(super) fn at_end(&self) -> bool {
        self.rest().is_empty()
    }

    /// The comment's text, if there is one.
    pub(super) fn comment(&self) -> Option<&'a str> {
        let start = comment_start(self.whole);
        let comment = self.whole.get(start..)?.strip_prefix('#')?;
        Some(comment.trim_start_matches('#').trim())
    }

    pub(super) fn advance(&mut self, bytes: usize) {
        self.pos = self.pos.saturating_add(bytes).min(self.end);
    }

    pub(super) fn skip_blanks(&mut self) {
        let rest = self.rest();
        self.advance(rest.len() - rest.trim_start().len());
    }

    /// Takes `c` if it comes next.
    pub(super) fn take(&mut self, c: char) -> bool {
        let there = self.rest().starts_with(c);
        if there {
            self.advance(c.len_utf8());
        }
        there
    }

    pub(super) fn next(&self) -> Option<char> {
        self.rest().chars().next()
    }

    /// Takes what comes up to a blank or `=`.
    pub(super) fn word(&mut self) -> &'a str {
        self.until(|c| c.is_whitespace() || c == '=')
    }

    /// Takes what comes before the first character that `stop` says yes to.
    pub(super) fn until(&mut self, stop: impl Fn(char) -> bool) -> &'a str {
        let rest = self.rest();
        let len = rest.find(stop).unwrap_or(rest.len());
        self.advance(len);
        rest.get(..len).unwrap_or_default()
    }

    pub(super) fn place(&self) -> Place {
        let before = self.whole.get(..self.pos).unwrap_or_default();
        Place {
            line: self.number + 1,
            column: before.chars().count() + 1,
        }
    }

    pub(super) fn error(&self, place: Place, message: String) -> Error {
        Error::at(self.file, place, message)
    }

    /// An error where reading is.
    pub(super) fn wrong<T>(&self, message: impl Into<String>) -> Result<T, Error> {
        Err(self.error(self.place(), message.into()))
    }
}

/// Begin of the comment: the first `#` that is not within quotes. Quotes begin a string only behind
/// a blank, `=`, `[` or `,`, so that an apostrophe in an unquoted text does not.
fn comment_start(line: &str) -> usize {
    let mut quote = None;
    let mut last = ' ';
    for (at, c) in line.char_indices() {
        match quote {
            Some(open) if c == open && last != '\\' => quote = None,
            Some(_) => {}
            None if c == '#' => return at,
            None if (c == '"' || c == '\'') && " \t=[,".contains(last) => {
                let closed = line.get(at + 1..).is_some_and(|rest| rest.contains(c));
                quote = closed.then_some(c);
            }
            None => {}
        }
        last = if last == '\\' && c == '\\' { ' ' } else { c };
    }
    line.len()
}
