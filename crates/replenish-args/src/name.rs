//! Names: their tokens, and what stands for what in them.

/// `name` with a slash in front.
pub(crate) fn absolute(name: &str) -> String {
    let slash = if name.starts_with('/') { "" } else { "/" };
    format!("{slash}{name}")
}

/// Whether it is one token: letters, digits and underscores, no digit in front.
pub(crate) fn is_token(text: &str) -> bool {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
    !text.is_empty() && text.bytes().all(plain) && !text.starts_with(|c: char| c.is_ascii_digit())
}

/// Whether `full` is a fully qualified name, or `/` alone.
pub(crate) fn check(full: &str) -> Result<(), &'static str> {
    let Some(rest) = full.strip_prefix('/') else {
        return Err("it must begin with /");
    };
    if rest.is_empty() || rest.split('/').all(is_token) {
        return Ok(());
    }
    Err(match rest {
        _ if rest.ends_with('/') => "it ends with /",
        _ if rest.contains("//") => "it has two / in a row",
        _ if rest
            .split('/')
            .any(|t| t.starts_with(|c: char| c.is_ascii_digit())) =>
        {
            "a part of it starts with a digit"
        }
        _ => "only letters, digits, _ and / are allowed",
    })
}

/// Namespace and last token of a node's name, `/robot/arm` or `/arm`.
pub(crate) fn split(node: &str) -> (&str, &str) {
    match node.rsplit_once('/') {
        Some(("", last)) => ("/", last),
        Some(both) => both,
        None => ("/", node),
    }
}

pub(crate) fn join(namespace: &str, token: &str) -> String {
    format!("{}/{token}", namespace.trim_end_matches('/'))
}

/// Replaces `{node}`, `{ns}` and `{namespace}`; another name in braces is an error.
pub(crate) fn substitute(text: &str, node: &str) -> Result<String, String> {
    let (namespace, last) = split(node);
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('{') {
        let Some((name, behind)) = after.split_once('}') else {
            return Err("a { without its }".into());
        };
        out += before;
        match name {
            "node" => out += last,
            "ns" | "namespace" => {
                // The part has a slash of its own, which may stand before and behind it, too.
                if out.ends_with('/') {
                    out.pop();
                }
                out += namespace;
            }
            _ => {
                return Err(format!(
                    "{{{name}}} is not known: {{node}}, {{ns}} and {{namespace}} are"
                ));
            }
        }
        rest = match behind.strip_prefix('/') {
            Some(after) if out.ends_with('/') => after,
            _ => behind,
        };
    }
    Ok(out + rest)
}

/// `text` against the name of `node`: `/absolute`, `~/private`, or relative to its namespace.
pub(crate) fn expand(text: &str, node: &str) -> Result<String, String> {
    let text = substitute(text, node)?;
    Ok(match text.strip_prefix('~') {
        Some("") => node.into(),
        Some(rest) if rest.starts_with('/') => format!("{node}{rest}"),
        Some(_) => return Err("~ must be followed by /".into()),
        None if text.starts_with('/') => text,
        None => join(split(node).0, &text),
    })
}
