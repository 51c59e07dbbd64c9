//! A YAML document as a tree that knows its places. No aliases: a short file cannot become long.

use crate::error::ArgsError;
use saphyr_parser::{Event, Marker, Parser, ScalarStyle, Tag};
use std::borrow::Cow;

/// Mappings and lists inside each other.
const DEPTH: usize = 32;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Node {
    /// Line and column, from 1.
    pub(crate) place: (usize, usize),
    pub(crate) content: Content,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Content {
    Scalar {
        text: String,
        plain: bool,
        tag: Option<String>,
    },
    List(Vec<Node>),
    Map(Vec<(Node, Node)>),
}

/// A text with the name by which errors call it.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub(crate) name: &'a str,
    pub(crate) text: &'a str,
}

impl Source<'_> {
    pub(crate) fn error(
        &self,
        (line, column): (usize, usize),
        why: impl Into<String>,
    ) -> ArgsError {
        ArgsError::new(format!("{}:{line}:{column}", self.name), "", why)
    }

    /// The first document; `None` where there is none.
    pub(crate) fn parse(&self) -> Result<Option<Node>, ArgsError> {
        let mut open: Vec<Open> = Vec::new();
        for event in Parser::new_from_str(self.text) {
            let (event, span) = event.map_err(|e| self.error(place(e.marker()), e.info()))?;
            let at = place(&span.start);
            let done = match event {
                Event::Alias(_) => return Err(self.error(at, "aliases are not supported")),
                Event::Scalar(text, style, _, tag) => Node {
                    place: at,
                    content: Content::Scalar {
                        text: text.into_owned(),
                        plain: style == ScalarStyle::Plain,
                        tag: tag.map(name_of),
                    },
                },
                Event::SequenceStart(..) | Event::MappingStart(..) if open.len() >= DEPTH => {
                    let why = format!("nested too deep: {DEPTH} levels are allowed");
                    return Err(self.error(at, why));
                }
                Event::SequenceStart(..) => {
                    open.push(Open::new(at, false));
                    continue;
                }
                Event::MappingStart(..) => {
                    open.push(Open::new(at, true));
                    continue;
                }
                Event::SequenceEnd | Event::MappingEnd => match open.pop() {
                    Some(complete) => complete.close(),
                    None => continue,
                },
                _ => continue,
            };
            match open.last_mut() {
                Some(parent) => parent.items.push(done),
                None => return Ok(Some(done)),
            }
        }
        Ok(None)
    }
}

struct Open {
    place: (usize, usize),
    map: bool,
    /// Keys and values of a mapping by turns.
    items: Vec<Node>,
}

impl Open {
    fn new(place: (usize, usize), map: bool) -> Self {
        Self {
            place,
            map,
            items: Vec::new(),
        }
    }

    fn close(self) -> Node {
        let content = if self.map {
            let mut items = self.items.into_iter();
            let pairs = core::iter::from_fn(|| Some((items.next()?, items.next()?)));
            Content::Map(pairs.collect())
        } else {
            Content::List(self.items)
        };
        Node {
            place: self.place,
            content,
        }
    }
}

fn place(marker: &Marker) -> (usize, usize) {
    (marker.line(), marker.col() + 1)
}

fn name_of(tag: Cow<'_, Tag>) -> String {
    tag.into_owned().suffix
}
