//! Names with wildcards: `*` is one token, `**` any number of them, none included.

use crate::name::is_token;

/// Whether each token of `text` is one, or a wildcard as a whole.
pub(crate) fn check(text: &str) -> Result<(), &'static str> {
    let body = text.strip_prefix('/').unwrap_or(text);
    let fits = |token: &str| matches!(token, "*" | "**") || is_token(token);
    if body.split('/').all(fits) {
        return Ok(());
    }
    Err("only letters, digits, _ and /, and * or ** for whole parts, are allowed")
}

/// Matches the fully qualified `name`; the texts that the wildcards stand for, in their order.
///
/// A `**` takes as little as it can. The work is bounded by the product of the lengths for each
/// `**`: positions that failed are not tried again.
pub(crate) fn matches(pattern: &str, name: &str) -> Option<Vec<String>> {
    let tokens = |text: &'_ str| -> Vec<String> {
        let parts = text.split('/').filter(|part| !part.is_empty());
        parts.map(String::from).collect()
    };
    let (pattern, name) = (tokens(pattern), tokens(name));
    let width = name.len() + 1;
    let mut failed = vec![false; (pattern.len() + 1) * width];
    let mut captures = Vec::new();
    let search = Search {
        pattern: &pattern,
        name: &name,
        width,
    };
    let found = search.step(0, 0, &mut failed, &mut captures);
    found.then(|| {
        let text = |(from, to): (usize, usize)| name.get(from..to).unwrap_or_default().join("/");
        captures.into_iter().map(text).collect()
    })
}

struct Search<'a> {
    pattern: &'a [String],
    name: &'a [String],
    width: usize,
}

impl Search<'_> {
    /// Recursion as deep as the pattern has tokens.
    fn step(
        &self,
        at: usize,
        from: usize,
        failed: &mut [bool],
        captures: &mut Vec<(usize, usize)>,
    ) -> bool {
        let Some(token) = self.pattern.get(at) else {
            return from == self.name.len();
        };
        let known = at * self.width + from;
        if failed.get(known).copied().unwrap_or(true) {
            return false;
        }
        let found = match token.as_str() {
            "**" => (from..=self.name.len()).any(|to| {
                captures.push((from, to));
                self.step(at + 1, to, failed, captures) || captures.pop().is_none()
            }),
            "*" if from < self.name.len() => {
                captures.push((from, from + 1));
                self.step(at + 1, from + 1, failed, captures) || captures.pop().is_none()
            }
            plain => {
                self.name.get(from).is_some_and(|n| n == plain)
                    && self.step(at + 1, from + 1, failed, captures)
            }
        };
        if !found && let Some(slot) = failed.get_mut(known) {
            *slot = true;
        }
        found
    }
}

/// `replacement` with `\1`, `\2`, … replaced by the captures. A slash too many goes.
pub(crate) fn fill(replacement: &str, captures: &[String]) -> String {
    let mut out = String::new();
    let mut chars = replacement.chars().peekable();
    while let Some(c) = chars.next() {
        let digit = chars
            .peek()
            .filter(|_| c == '\\')
            .and_then(|d| d.to_digit(10));
        match digit {
            Some(n) => {
                chars.next();
                let which = (n as usize).checked_sub(1).and_then(|n| captures.get(n));
                out += which.map_or("", String::as_str);
            }
            None => out.push(c),
        }
    }
    while out.contains("//") {
        out = out.replace("//", "/");
    }
    if out.len() > 1 && out.ends_with('/') {
        out.pop();
    }
    out
}

/// Number of captures in the pattern.
pub(crate) fn captures(pattern: &str) -> usize {
    pattern
        .split('/')
        .filter(|t| matches!(*t, "*" | "**"))
        .count()
}
