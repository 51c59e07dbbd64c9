//! The names that ROS 2 allows, and their form in Rust.

/// The rule for a package's name.
pub(crate) const PACKAGE: &str = "lower-case letters, digits and single underscores, beginning with a letter, \
     not ending with an underscore";
/// The rule for a field's name.
pub(crate) const FIELD: &str = PACKAGE;
/// The rule for an interface's name.
pub(crate) const TYPE: &str = "letters and digits, beginning with an upper-case letter";
/// The rule for a constant's name.
pub(crate) const CONSTANT: &str = "upper-case letters, digits and single underscores, beginning with a letter, \
     not ending with an underscore";

fn snake(name: &str, letter: fn(&char) -> bool) -> bool {
    name.chars().next().is_some_and(|c| letter(&c))
        && name
            .chars()
            .all(|c| letter(&c) || c.is_ascii_digit() || c == '_')
        && !name.contains("__")
        && !name.ends_with('_')
}

pub(crate) fn is_package(name: &str) -> bool {
    snake(name, char::is_ascii_lowercase)
}

pub(crate) fn is_field(name: &str) -> bool {
    snake(name, char::is_ascii_lowercase)
}

pub(crate) fn is_constant(name: &str) -> bool {
    snake(name, char::is_ascii_uppercase)
}

pub(crate) fn is_type(name: &str) -> bool {
    name.chars().next().is_some_and(|c| c.is_ascii_uppercase())
        && name.chars().all(|c| c.is_ascii_alphanumeric())
}

/// `MultiArrayDimension` as a file name: `multi_array_dimension`.
pub(crate) fn file_name(name: &str) -> String {
    let mut file = String::new();
    let mut last = '_';
    for c in name.chars() {
        if c.is_ascii_uppercase() && (last.is_ascii_lowercase() || last.is_ascii_digit()) {
            file.push('_');
        }
        file.push(c.to_ascii_lowercase());
        last = c;
    }
    file
}

/// A field's name in Rust: keywords are raw identifiers.
pub(crate) fn rust_field(name: &str) -> String {
    const KEYWORDS: &str = " as async await break const continue dyn else enum extern false fn for \
         if impl in let loop match mod move mut pub ref return static struct trait true type \
         unsafe use where while abstract become box do final gen macro override priv try typeof \
         unsized virtual yield ";
    match name {
        "self" | "super" | "crate" => format!("{name}_"),
        _ if KEYWORDS.contains(&format!(" {name} ")) => format!("r#{name}"),
        _ => name.into(),
    }
}
