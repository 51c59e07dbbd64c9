//! ROS names: nodes and topics, their rules and their expansion.
//!
//! The rules are those that `rmw` enforces (`rmw_validate_full_topic_name`,
//! `rmw_validate_node_name`): tokens of letters, digits and underscores separated by single
//! slashes, none starting with a digit. Substitutions in braces are not supported.

use crate::platform::{StaticText, Text, label};
use alloc::string::String;
use core::fmt;

/// The longest topic name: what is left of DDS's 255 characters after the `rt/` prefix and the
/// like.
const MAX_TOPIC: usize = 247;
/// The longest node name with its namespace.
const MAX_NODE: usize = 255;

/// A name that ROS does not allow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameError {
    /// The kind of name: node, topic, worker.
    pub what: StaticText,
    /// The name as it was given.
    pub name: Text,
    /// The rule that it breaks.
    pub problem: StaticText,
}

impl fmt::Display for NameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?}: {}", self.what, self.name, self.problem)
    }
}

impl core::error::Error for NameError {}

/// The fully qualified name of a node given as `pong`, `robot/pong` or `/robot/pong`.
pub(crate) fn node(name: &str) -> Result<String, NameError> {
    let full = concat(&["/", name.strip_prefix('/').unwrap_or(name)]);
    check(&full, MAX_NODE)
        .map(|()| full)
        .map_err(|problem| error(label("node name"), name, problem))
}

/// The fully qualified name of a topic that node `node` (itself fully qualified) calls `name`:
/// absolute, relative to the node's namespace, or below the node (`~/name`).
pub(crate) fn topic(name: &str, node: &str) -> Result<String, NameError> {
    let fail = |problem| error(label("topic name"), name, problem);
    let (before, rest) = match name.as_bytes() {
        [] => return Err(fail(label("it is empty"))),
        [b'~'] | [b'~', b'/', ..] => (node, name.get(1..).unwrap_or_default()),
        [b'~', ..] => return Err(fail(label("~ must be followed by /"))),
        [b'/', ..] => ("", name),
        _ => (namespace(node), name),
    };
    let full = concat(&[before, rest]);
    check(&full, MAX_TOPIC).map(|()| full).map_err(fail)
}

/// The namespace of a node's name: up to the last slash, and with it.
fn namespace(node: &str) -> &str {
    let last = node.bytes().rposition(|byte| byte == b'/');
    node.get(..last.map_or(0, |at| at + 1)).unwrap_or_default()
}

fn error(what: StaticText, name: &str, problem: StaticText) -> NameError {
    NameError {
        what,
        name: name.into(),
        problem,
    }
}

/// A worker's name: what shows up in reports and as the thread's name.
pub(crate) fn worker(name: &str) -> Result<(), NameError> {
    let problem = if name.is_empty() {
        label("it is empty")
    } else if name.len() > 63 {
        label("it is longer than 63 bytes")
    } else if !is_plain(name) {
        label("control characters and / are not allowed")
    } else {
        return Ok(());
    };
    Err(error(label("worker name"), name, problem))
}

/// Whether there is no slash in it and no control character: by bytes, C0, DEL and C1.
fn is_plain(name: &str) -> bool {
    let mut before = 0;
    name.bytes().all(|byte| {
        let c1 = before == 0xc2 && byte < 0xa0;
        before = byte;
        !(byte < b' ' || byte == 0x7f || byte == b'/' || c1)
    })
}

/// Whether `full`, which begins with a slash, is a name.
fn check(full: &str, longest: usize) -> Result<(), StaticText> {
    let mut before = b'/';
    for &byte in full.as_bytes().get(1..).unwrap_or_default() {
        match (before, byte) {
            (b'/', b'/') => return Err(label("it has two / in a row")),
            (b'/', b'0'..=b'9') => return Err(label("a part of it starts with a digit")),
            (_, b'/' | b'_' | b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z') => before = byte,
            (_, b'{' | b'}') => return Err(label("substitutions in braces are not supported")),
            _ => return Err(label("only letters, digits, _ and / are allowed")),
        }
    }
    if full.len() > longest {
        return Err(label(
            "it is too long (topics 247, nodes 255 characters, fully qualified)",
        ));
    }
    match before {
        b'/' if full.len() == 1 => Err(label("it is empty")),
        b'/' => Err(label("it ends with /")),
        _ => Ok(()),
    }
}

/// The parts, one after another; without the formatting that would bring kilobytes of code.
pub(crate) fn concat(parts: &[&str]) -> String {
    let mut all = String::with_capacity(parts.iter().map(|part| part.len()).sum());
    parts.iter().for_each(|part| all.push_str(part));
    all
}

/// `stem` and a number in decimal.
pub(crate) fn with_number(stem: &str, number: usize) -> String {
    let mut all = concat(&[stem]);
    append_number(&mut all, number);
    all
}

/// Appends a number in decimal. Its digits are parts of a text: a character would bring the code
/// that encodes any.
pub(crate) fn append_number(all: &mut String, number: usize) {
    if number >= 10 {
        append_number(all, number / 10);
    }
    let digit = number % 10;
    all.push_str("0123456789".get(digit..=digit).unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_names_become_fully_qualified() {
        assert_eq!(node("pong").unwrap(), "/pong");
        assert_eq!(node("/robot/pong").unwrap(), "/robot/pong");
        assert_eq!(node("robot/arm_2").unwrap(), "/robot/arm_2");
    }

    #[test]
    fn topic_names_expand_against_the_node() {
        assert_eq!(topic("/scan", "/robot/pong").unwrap(), "/scan");
        assert_eq!(topic("scan", "/robot/pong").unwrap(), "/robot/scan");
        assert_eq!(topic("scan", "/pong").unwrap(), "/scan");
        assert_eq!(topic("~/scan", "/robot/pong").unwrap(), "/robot/pong/scan");
        assert_eq!(topic("~", "/robot/pong").unwrap(), "/robot/pong");
    }

    #[test]
    fn what_ros_forbids_is_refused_with_the_reason() {
        let why = |name: &str| topic(name, "/pong").unwrap_err().problem;
        assert_eq!(why(""), "it is empty");
        assert_eq!(why("/"), "it is empty");
        assert_eq!(why("/a/"), "it ends with /");
        assert_eq!(why("/a//b"), "it has two / in a row");
        assert_eq!(why("/a/2b"), "a part of it starts with a digit");
        assert_eq!(why("a-b"), "only letters, digits, _ and / are allowed");
        assert_eq!(why("hö"), "only letters, digits, _ and / are allowed");
        assert_eq!(why("{node}/a"), "substitutions in braces are not supported");
        assert_eq!(why("~a"), "~ must be followed by /");
        assert!(why(&"a".repeat(247)).starts_with("it is too long"));
        assert!(topic(&"a".repeat(246), "/pong").is_ok());
        assert!(node("").is_err());
        assert!(node("a b").is_err());
        assert!(worker("").is_err());
        assert!(worker(&"w".repeat(64)).is_err());
        assert!(worker("high priority").is_ok());
        assert!(worker("größe\u{a0}").is_ok());
        for c in ['/', '\0', '\u{1f}', '\u{7f}', '\u{80}', '\u{9f}'] {
            assert!(worker(&format!("w{c}")).is_err(), "{c:?}");
        }
    }

    #[test]
    fn numbers_are_decimal() {
        for n in [0, 7, 10, 4096, usize::MAX] {
            assert_eq!(with_number("a#", n), format!("a#{n}"));
        }
        assert_eq!(concat(&["/n", "/sub:", "/t"]), "/n/sub:/t");
    }
}
