//! Parameters from outside: `-p` and files.

use crate::error::ArgsError;
use crate::name::is_token;
use crate::pattern;
use crate::value::Value;
use crate::yaml::{Content, Node, Source};

/// A value for a parameter of nodes that match.
#[derive(Debug, Clone, PartialEq)]
pub struct Override {
    /// The nodes: a fully qualified name with wildcards.
    pub node: String,
    /// The parameter, `gains.p`.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// Place of the text: `argument 4`, `robot.yaml:3:5`.
    pub place: String,
}

const PARAMETERS: &str = "ros__parameters";

/// `[node:]name:=value`.
pub(crate) fn assignment(text: &str, place: &str) -> Result<Override, String> {
    let Some((left, value)) = text.split_once(":=") else {
        return Err("a parameter is name:=value".into());
    };
    let (node, name) = match left.split_once(':') {
        Some((node, name)) => (pattern_of(node)?, name),
        None => ("/**".into(), left),
    };
    check_name(name)?;
    let source = Source {
        name: place,
        text: value,
    };
    let tree = source.parse().map_err(|e| e.problem)?;
    let tree = tree.ok_or("there is no value behind :=")?;
    let value = Value::of(&tree).map_err(|(_, why)| why)?;
    Ok(Override {
        node,
        name: name.into(),
        value,
        place: place.into(),
    })
}

/// A file: nodes, and in each `ros__parameters`.
pub(crate) fn file(source: Source<'_>, all: &mut Vec<Override>) -> Result<(), ArgsError> {
    let Some(tree) = source.parse()? else {
        return Ok(()); // nothing but comments
    };
    Reader { source, all }.nodes(&tree, "")
}

fn check_name(name: &str) -> Result<(), String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '/');
    let token = |t: &str| !t.is_empty() && t.chars().all(plain);
    if name.split('.').all(token) {
        return Ok(());
    }
    Err(format!(
        "{name:?} is not a parameter's name: allowed are letters, digits, _, - and / in parts with dots between"
    ))
}

/// The pattern of a node that a user wrote, with a slash in front.
fn pattern_of(node: &str) -> Result<String, String> {
    let full = crate::name::absolute(node);
    let why = |why| format!("{node:?} is not a node's name: {why}");
    pattern::check(&full).map_err(why)?;
    Ok(full)
}

struct Reader<'a> {
    source: Source<'a>,
    all: &'a mut Vec<Override>,
}

impl Reader<'_> {
    fn pairs<'n>(&self, node: &'n Node, of: &str) -> Result<&'n [(Node, Node)], ArgsError> {
        match &node.content {
            Content::Map(pairs) => Ok(pairs),
            _ => Err(self
                .source
                .error(node.place, format!("{of} must be a mapping"))),
        }
    }

    fn key<'n>(&self, key: &'n Node) -> Result<&'n str, ArgsError> {
        match &key.content {
            Content::Scalar { text, .. } => Ok(text),
            _ => Err(self.source.error(key.place, "a key must be a name")),
        }
    }

    /// Namespaces and nodes inside each other, as deep as the tree may be.
    fn nodes(&mut self, tree: &Node, above: &str) -> Result<(), ArgsError> {
        let what = match above {
            "" => "the file",
            name => name,
        };
        for (key, value) in self.pairs(tree, what)? {
            let name = self.key(key)?;
            if name == PARAMETERS {
                if above.is_empty() {
                    let why = format!("{PARAMETERS} stands below a node's name, or below /**");
                    return Err(self.source.error(key.place, why));
                }
                self.values(value, above, "")?;
                continue;
            }
            let full = format!("{above}/{}", name.trim_start_matches('/'));
            pattern_of(&full).map_err(|why| self.source.error(key.place, why))?;
            if !matches!(value.content, Content::Map(_)) {
                let why = format!("{full} must be a mapping with {PARAMETERS} in it");
                return Err(self.source.error(value.place, why));
            }
            self.nodes(value, &full)?;
        }
        Ok(())
    }

    fn values(&mut self, tree: &Node, node: &str, above: &str) -> Result<(), ArgsError> {
        for (key, value) in self.pairs(tree, PARAMETERS)? {
            let name = self.key(key)?;
            let full = if above.is_empty() {
                name.to_owned()
            } else {
                format!("{above}.{name}")
            };
            if let Content::Map(_) = value.content {
                self.values(value, node, &full)?;
                continue;
            }
            check_name(&full).map_err(|why| self.source.error(key.place, why))?;
            let parsed = Value::of(value);
            let parsed = parsed
                .map_err(|(at, why)| self.source.error(at.place, format!("{full}: {why}")))?;
            let (line, column) = value.place;
            self.all.push(Override {
                node: node.into(),
                name: full,
                value: parsed,
                place: format!("{}:{line}:{column}", self.source.name),
            });
        }
        Ok(())
    }
}

/// Whether it is for this node, a fully qualified name.
pub(crate) fn concerns(given: &Override, node: &str) -> bool {
    let bare = given.node.strip_prefix('/').filter(|name| is_token(name));
    bare.is_some_and(|_| given.node == node) || pattern::matches(&given.node, node).is_some()
}
