//! A rule of remapping: `[node:]from:=to`.

use crate::name::{self, is_token};
use crate::pattern;

/// The kind of thing that a name stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A topic: rules for all names, and those with `rostopic://`.
    Topic,
    /// A service: rules for all names, and those with `rosservice://`.
    Service,
    /// An action: rules for all names.
    Action,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Target {
    /// `__node:=new`.
    Node,
    /// `__ns:=/new`.
    Namespace,
    /// Names that match, of this kind alone if it is said.
    Name { pattern: String, kind: Option<Kind> },
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Rule {
    /// Only for nodes of this name.
    pub(crate) node: Option<String>,
    pub(crate) target: Target,
    pub(crate) to: String,
}

impl Rule {
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let Some((from, to)) = text.split_once(":=") else {
            return Err("a rule is from:=to".into());
        };
        if from.is_empty() || to.is_empty() {
            let side = if from.is_empty() { "before" } else { "behind" };
            return Err(format!("there is nothing {side} :="));
        }
        let (node, from) = match from.split_once(':') {
            Some((_, rest)) if rest.starts_with("//") => (None, from),
            Some((node, rest)) if is_token(node) => (Some(node.to_owned()), rest),
            Some((node, _)) => return Err(format!("{node:?} before : is not a node's name")),
            None => (None, from),
        };
        let target = match from {
            "__node" | "__name" => {
                if !is_token(to) {
                    return Err(format!(
                        "{to:?} is not a node's name: allowed are letters, digits and _, no digit in front"
                    ));
                }
                Target::Node
            }
            "__ns" => {
                name::check(to).map_err(|why| format!("{to:?} is not a namespace: {why}"))?;
                Target::Namespace
            }
            _ => Self::name(from, to)?,
        };
        Ok(Self {
            node,
            target,
            to: to.into(),
        })
    }

    fn name(from: &str, to: &str) -> Result<Target, String> {
        let (kind, from) = match from.split_once("://") {
            None => (None, from),
            Some(("rostopic", rest)) => (Some(Kind::Topic), rest),
            Some(("rosservice", rest)) => (Some(Kind::Service), rest),
            Some((other, _)) => {
                return Err(format!(
                    "{other}:// is not known: rostopic:// and rosservice:// are"
                ));
            }
        };
        // The name of the node does not matter for whether it is well-formed.
        let plain = |text: &str| name::expand(text, "/n/n");
        let wrong = |text: &str, why: &str| format!("{text:?} is not a name: {why}");
        let expanded = plain(from).map_err(|why| wrong(from, &why))?;
        pattern::check(&expanded).map_err(|why| wrong(from, why))?;
        let most = pattern::captures(&expanded);
        let mut refers = to.split('\\').skip(1);
        let good = |part: &str| {
            let digit = part.chars().next().and_then(|c| c.to_digit(10));
            digit.is_some_and(|n| (1..=most).contains(&(n as usize)))
        };
        if let Some(bad) = refers.find(|part| !good(part)) {
            let first = bad.chars().next().map(String::from).unwrap_or_default();
            return Err(format!(
                "\\{first} refers to no wildcard: {most} in what is before :="
            ));
        }
        if to.contains("//") {
            return Err(wrong(to, "it has two / in a row"));
        }
        let captured = vec!["x".to_owned(); most];
        let filled = plain(&pattern::fill(to, &captured)).map_err(|why| wrong(to, &why))?;
        name::check(&filled).map_err(|why| wrong(to, why))?;
        Ok(Target::Name {
            pattern: from.into(),
            kind,
        })
    }

    /// Whether it is for this node, by its last token.
    pub(crate) fn concerns(&self, node: &str) -> bool {
        self.node.as_deref().is_none_or(|name| name == node)
    }
}
