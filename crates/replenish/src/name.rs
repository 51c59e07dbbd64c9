//! ROS names: nodes and topics, their rules and their expansion.
//!
//! The rules are those that `rmw` enforces (`rmw_validate_full_topic_name`,
//! `rmw_validate_node_name`): tokens of letters, digits and underscores separated by single
//! slashes, none starting with a digit. Substitutions in braces are not supported.

use crate::text::{Words, joined};
use alloc::string::String;
use core::fmt;

/// The longest topic name: what is left of DDS's 255 characters after the `rt/` prefix and the like.
const MAX_TOPIC: usize = 247;
/// The longest node name with its namespace.
const MAX_NODE: usize = 255;

/// A name that ROS does not allow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameError {
    /// What the name was for.
    pub what: &'static str,
    /// The name as it was given.
    pub name: Words,
    /// What is wrong with it.
    pub problem: &'static str,
}

impl fmt::Display for NameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?}: {}", self.what, self.name, self.problem)
    }
}

impl core::error::Error for NameError {}

/// The fully qualified name of a node given as `pong`, `robot/pong` or `/robot/pong`.
pub(crate) fn node(name: &str) -> Result<String, NameError> {
    let full = joined(&["/", name.strip_prefix('/').unwrap_or(name)]);
    check(&full, MAX_NODE)
        .map(|()| full)
        .map_err(|problem| NameError {
            what: "node name",
            name: name.into(),
            problem,
        })
}

/// The fully qualified name of a topic that node `node` (itself fully qualified) calls `name`:
/// absolute, relative to the node's namespace, or below the node (`~/name`).
pub(crate) fn topic(name: &str, node: &str) -> Result<String, NameError> {
    let fail = |problem| NameError {
        what: "topic name",
        name: name.into(),
        problem,
    };
    let namespace = node.rsplit_once('/').map_or("", |(namespace, _)| namespace);
    let full = match name.strip_prefix('~') {
        Some(rest) if rest.is_empty() || rest.starts_with('/') => joined(&[node, rest]),
        Some(_) => return Err(fail("~ must be followed by /")),
        None if name.is_empty() => return Err(fail("it is empty")),
        None if name.starts_with('/') => name.into(),
        None => joined(&[namespace, "/", name]),
    };
    check(&full, MAX_TOPIC).map(|()| full).map_err(fail)
}

/// A worker's name: what shows up in reports and as the thread's name.
pub(crate) fn worker(name: &str) -> Result<(), NameError> {
    let problem = if name.is_empty() {
        "it is empty"
    } else if name.len() > 63 {
        "it is longer than 63 bytes"
    } else if name.contains(|c: char| c.is_control() || c == '/') {
        "control characters and / are not allowed"
    } else {
        return Ok(());
    };
    Err(NameError {
        what: "worker name",
        name: name.into(),
        problem,
    })
}

fn check(full: &str, longest: usize) -> Result<(), &'static str> {
    if full.len() > longest {
        return Err("it is too long (topics 247, nodes 255 characters, fully qualified)");
    }
    if full == "/" {
        return Err("it is empty");
    }
    if full.ends_with('/') {
        return Err("it ends with /");
    }
    for token in full.split('/').skip(1) {
        match token.chars().next() {
            None => return Err("it has two / in a row"),
            Some(c) if c.is_ascii_digit() => return Err("a part of it starts with a digit"),
            Some(_) => {}
        }
        if token.contains(['{', '}']) {
            return Err("substitutions in braces are not supported");
        }
        if !token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
            return Err("only letters, digits, _ and / are allowed");
        }
    }
    Ok(())
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
    }
}
