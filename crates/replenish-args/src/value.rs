//! Values of parameters as YAML writes them.

use crate::yaml::{Content, Node};
use std::fmt;

/// A value that was given from outside.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// `true`, `yes`, `on`, and their opposites.
    Bool(bool),
    /// `12`, `0x1f`, `017`.
    Integer(i64),
    /// `0.5`, `1e3`, `.inf`.
    Double(f64),
    /// Everything else, and what stands in quotes.
    String(String),
    /// A list of one type throughout.
    Bools(Vec<bool>),
    /// A list of one type throughout.
    Integers(Vec<i64>),
    /// A list of one type throughout.
    Doubles(Vec<f64>),
    /// A list of one type throughout.
    Strings(Vec<String>),
    /// `[]`: of whichever array type the parameter has.
    Empty,
}

impl Value {
    /// The type's name, as `ros2 param` has it.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Bool(_) => "bool",
            Self::Integer(_) => "integer",
            Self::Double(_) => "double",
            Self::String(_) => "string",
            Self::Bools(_) => "bool array",
            Self::Integers(_) => "integer array",
            Self::Doubles(_) => "double array",
            Self::Strings(_) => "string array",
            Self::Empty => "empty array",
        }
    }

    /// The value of a scalar or a list of scalars; the error with the node it is about.
    pub(crate) fn of(node: &Node) -> Result<Self, (&Node, String)> {
        match &node.content {
            Content::Scalar { text, plain, tag } => {
                Self::scalar(text, *plain, tag.as_deref()).map_err(|why| (node, why))
            }
            Content::List(items) => Self::list(items),
            Content::Map(_) => Err((node, "a value is expected here, not a mapping".into())),
        }
    }

    fn list(items: &[Node]) -> Result<Self, (&Node, String)> {
        let mut all = Self::Empty;
        for item in items {
            if !matches!(item.content, Content::Scalar { .. }) {
                return Err((
                    item,
                    "an array holds values alone: no arrays, no mappings".into(),
                ));
            }
            match (&mut all, Self::of(item)?) {
                (Self::Bools(all), Self::Bool(v)) => all.push(v),
                (Self::Integers(all), Self::Integer(v)) => all.push(v),
                (Self::Doubles(all), Self::Double(v)) => all.push(v),
                (Self::Strings(all), Self::String(v)) => all.push(v),
                (empty @ Self::Empty, first) => {
                    *empty = match first {
                        Self::Bool(v) => Self::Bools(vec![v]),
                        Self::Integer(v) => Self::Integers(vec![v]),
                        Self::Double(v) => Self::Doubles(vec![v]),
                        Self::String(v) => Self::Strings(vec![v]),
                        other => other,
                    };
                }
                (all, other) => {
                    let why = format!(
                        "an array has one type: {} in {}",
                        other.type_name(),
                        all.type_name()
                    );
                    return Err((item, why));
                }
            }
        }
        Ok(all)
    }

    fn scalar(text: &str, plain: bool, tag: Option<&str>) -> Result<Self, String> {
        let said = match tag {
            None if plain => return Self::plain(text),
            None | Some("str" | "!str") => return Ok(Self::String(text.into())),
            Some(tag) => tag,
        };
        let value = Self::plain(text)?;
        match (said, value) {
            ("float", Self::Integer(v)) => Ok(Self::Double(v as f64)),
            ("float", value @ Self::Double(_))
            | ("int", value @ Self::Integer(_))
            | ("bool", value @ Self::Bool(_)) => Ok(value),
            (tag, value) => Err(format!("a {} cannot be tagged !!{tag}", value.type_name())),
        }
    }

    fn plain(text: &str) -> Result<Self, String> {
        if matches!(text, "" | "~" | "null" | "Null" | "NULL") {
            return Err("there is no value".into());
        }
        Ok(match text {
            "y" | "Y" | "yes" | "Yes" | "YES" | "true" | "True" | "TRUE" | "on" | "On" | "ON" => {
                Self::Bool(true)
            }
            "n" | "N" | "no" | "No" | "NO" | "false" | "False" | "FALSE" | "off" | "Off"
            | "OFF" => Self::Bool(false),
            _ => integer(text)
                .map(Self::Integer)
                .or_else(|| double(text).map(Self::Double))
                .unwrap_or_else(|| Self::String(text.into())),
        })
    }
}

/// As C's `strtol` with base 0 reads it: `0x` hexadecimal, a leading 0 octal.
fn integer(text: &str) -> Option<i64> {
    let (negative, digits) = match text.strip_prefix('-') {
        Some(digits) => (true, digits),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (radix, digits) = match digits.strip_prefix("0x").or(digits.strip_prefix("0X")) {
        Some(hex) => (16, hex),
        None if digits.len() > 1 && digits.starts_with('0') => (8, digits),
        None => (10, digits),
    };
    if !digits.starts_with(|c: char| c.is_ascii_alphanumeric()) {
        return None;
    }
    let value = i128::from_str_radix(digits, radix).ok()?;
    i64::try_from(if negative { -value } else { value }).ok()
}

fn double(text: &str) -> Option<f64> {
    match text {
        ".nan" | ".NaN" | ".NAN" => return Some(f64::NAN),
        ".inf" | ".Inf" | ".INF" | "+.inf" | "+.Inf" | "+.INF" => return Some(f64::INFINITY),
        "-.inf" | "-.Inf" | "-.INF" => return Some(f64::NEG_INFINITY),
        _ => {}
    }
    let number = |b: u8| b.is_ascii_digit() || matches!(b, b'.' | b'e' | b'E' | b'+' | b'-');
    let plain = text.bytes().all(number) && text.bytes().any(|b| b.is_ascii_digit());
    plain.then(|| text.parse().ok()).flatten()
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bool(v) => v.fmt(f),
            Self::Integer(v) => v.fmt(f),
            Self::Double(v) => write!(f, "{v:?}"),
            Self::String(v) => write!(f, "{v:?}"),
            Self::Bools(v) => write!(f, "{v:?}"),
            Self::Integers(v) => write!(f, "{v:?}"),
            Self::Doubles(v) => write!(f, "{v:?}"),
            Self::Strings(v) => write!(f, "{v:?}"),
            Self::Empty => f.write_str("[]"),
        }
    }
}
