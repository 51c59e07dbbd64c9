//! Pieces of text that several kinds of items need.

/// The hash as an associated constant.
pub(super) fn type_hash(name: &str, hash: Option<&str>) -> String {
    format!(
        "    const {name}: ::core::option::Option<&'static str> = {};\n",
        match hash {
            Some(hash) => format!("::core::option::Option::Some(\"{hash}\")"),
            None => "::core::option::Option::None".into(),
        }
    )
}

/// Comments as documentation: what Markdown would take for its own is escaped, and no line is
/// indented, so that nothing becomes code.
pub(super) fn docs(lines: &[String], indent: &str) -> String {
    let mut text = String::new();
    for line in lines {
        let mut escaped = String::new();
        for c in line.trim().chars() {
            if "\\[]<>*_`#|~&".contains(c) {
                escaped.push('\\');
            }
            escaped.push(c);
        }
        let dashed = escaped.chars().all(|c| "-=+ ".contains(c));
        if escaped.is_empty() || dashed {
            text.push_str(&format!("{indent}///\n"));
        } else {
            text.push_str(&format!("{indent}/// {escaped}\n"));
        }
    }
    text
}
