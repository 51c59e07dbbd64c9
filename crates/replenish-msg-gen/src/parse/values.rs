//! Literals: the values of constants, and defaults.

use super::line::Line;
use crate::error::{Error, Place};
use crate::model::{Base, Primitive, Shape, Value};

/// Takes the rest of the line, which is a value of this type.
pub(super) fn parse(line: &mut Line<'_>, base: &Base, shape: Shape) -> Result<Value, Error> {
    if shape == Shape::One {
        let place = line.place();
        let text = line.rest();
        let quoted = text.starts_with(['"', '\'']);
        if matches!(base, Base::Text(_) | Base::Wide(_)) && !quoted {
            line.advance(text.len());
            return one(line, place, base, text, false);
        }
        let value = element(line, base)?;
        line.skip_blanks();
        return if line.at_end() {
            Ok(value)
        } else {
            line.wrong(format!("`{}` behind the value", line.rest()))
        };
    }
    let start = line.place();
    if !line.take('[') {
        return line.wrong("a default of several values is a list: `[1, 2, 3]`");
    }
    let mut values = Vec::new();
    line.skip_blanks();
    while !line.take(']') {
        values.push(element(line, base)?);
        line.skip_blanks();
        if !line.take(',') && line.next() != Some(']') {
            return line.wrong("`,` or `]` is missing in a list of values");
        }
        line.skip_blanks();
    }
    line.skip_blanks();
    if !line.at_end() {
        return line.wrong(format!("`{}` behind the list", line.rest()));
    }
    let allowed = match shape {
        Shape::Array(size) if values.len() != size => format!("exactly {size}"),
        Shape::Sequence(Some(bound)) if values.len() > bound => format!("at most {bound}"),
        _ => return Ok(Value::List(values)),
    };
    let message = format!("{} values where the type has {allowed}", values.len());
    Err(line.error(start, message))
}

/// One value, quoted or up to a blank, `,` or `]`.
fn element(line: &mut Line<'_>, base: &Base) -> Result<Value, Error> {
    let place = line.place();
    match line.next() {
        Some(quote @ ('"' | '\'')) => {
            let text = quoted(line, quote)?;
            one(line, place, base, &text, true)
        }
        _ => {
            let text = line.until(|c| c.is_whitespace() || c == ',' || c == ']');
            one(line, place, base, text, false)
        }
    }
}

/// A text in quotes, in which a backslash takes the next character's meaning.
fn quoted(line: &mut Line<'_>, quote: char) -> Result<String, Error> {
    let start = line.place();
    line.take(quote);
    let mut text = String::new();
    while let Some(c) = line.next() {
        line.advance(c.len_utf8());
        match c {
            c if c == quote => return Ok(text),
            '\\' => {
                let Some(escaped) = line.next() else { break };
                line.advance(escaped.len_utf8());
                match escaped {
                    'n' => text.push('\n'),
                    't' => text.push('\t'),
                    'r' => text.push('\r'),
                    '\\' | '"' | '\'' => text.push(escaped),
                    other => text.extend(['\\', other]),
                }
            }
            c => text.push(c),
        }
    }
    Err(line.error(start, format!("the closing `{quote}` is missing")))
}

fn one(
    line: &Line<'_>,
    place: Place,
    base: &Base,
    text: &str,
    quoted: bool,
) -> Result<Value, Error> {
    let wrong = |message: String| Err(line.error(place, message));
    match base {
        Base::Text(bound) => match bound {
            Some(bound) if text.len() > *bound => {
                wrong(format!("{} bytes, above the bound of {bound}", text.len()))
            }
            _ => Ok(Value::Text(text.into())),
        },
        Base::Wide(bound) => {
            let units = text.encode_utf16().count();
            match bound {
                Some(bound) if units > *bound => {
                    wrong(format!("{units} UTF-16 units, above the bound of {bound}"))
                }
                _ => Ok(Value::Text(text.into())),
            }
        }
        Base::Primitive(_) if quoted => wrong(format!(
            "a text where a value of type {} is meant",
            name(base)
        )),
        Base::Primitive(Primitive::Bool) => match text.to_ascii_lowercase().as_str() {
            "true" | "1" => Ok(Value::Bool(true)),
            "false" | "0" => Ok(Value::Bool(false)),
            _ => wrong(format!("`{text}` is no bool: true, false, 1 or 0")),
        },
        Base::Primitive(p) if p.is_float() => match text.parse::<f64>() {
            Ok(number) if number.is_nan() => Ok(Value::Float("NAN".into())),
            Ok(number) if number == f64::INFINITY => Ok(Value::Float("INFINITY".into())),
            Ok(number) if number == f64::NEG_INFINITY => Ok(Value::Float("NEG_INFINITY".into())),
            Ok(number) if *p == Primitive::Float32 && number.abs() > f64::from(f32::MAX) => wrong(
                format!("`{text}` is above the largest float32, {:e}", f32::MAX),
            ),
            Ok(number) => Ok(Value::Float(format!("{number:?}"))),
            Err(_) => wrong(format!("`{text}` is no number of type {}", name(base))),
        },
        Base::Primitive(p) => {
            let (low, high) = range(*p);
            match integer(text) {
                Some(number) if (low..=high).contains(&number) => Ok(Value::Integer(number)),
                _ => wrong(format!(
                    "`{text}` is no {}: a whole number in {low}..={high}",
                    name(base)
                )),
            }
        }
        Base::Message(_) => wrong("a field of a message type has no default value".into()),
    }
}

/// Decimal, or with `0x`, `0o`, `0b` in front.
fn integer(text: &str) -> Option<i128> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(digits) => (-1, digits),
        None => (1, text.strip_prefix('+').unwrap_or(text)),
    };
    let lower = digits.to_ascii_lowercase();
    let (radix, digits) = [("0x", 16), ("0o", 8), ("0b", 2)]
        .iter()
        .find_map(|(prefix, radix)| Some((*radix, lower.strip_prefix(prefix)?)))
        .unwrap_or((10, &lower));
    if digits.starts_with(['+', '-']) {
        return None;
    }
    i128::from_str_radix(digits, radix).ok().map(|n| n * sign)
}

fn range(primitive: Primitive) -> (i128, i128) {
    use Primitive as P;
    match primitive {
        P::Int8 => (i8::MIN.into(), i8::MAX.into()),
        P::Int16 => (i16::MIN.into(), i16::MAX.into()),
        P::Int32 => (i32::MIN.into(), i32::MAX.into()),
        P::Int64 => (i64::MIN.into(), i64::MAX.into()),
        P::UInt16 => (0, u16::MAX.into()),
        P::UInt32 => (0, u32::MAX.into()),
        P::UInt64 => (0, u64::MAX.into()),
        _ => (0, u8::MAX.into()),
    }
}

fn name(base: &Base) -> &'static str {
    match base {
        Base::Primitive(Primitive::Float32) => "float32",
        Base::Primitive(Primitive::Float64) => "float64",
        Base::Primitive(Primitive::Bool) => "bool",
        Base::Primitive(Primitive::Byte) => "byte",
        Base::Primitive(Primitive::Char) => "char",
        Base::Primitive(Primitive::Int8) => "int8",
        Base::Primitive(Primitive::Int16) => "int16",
        Base::Primitive(Primitive::Int32) => "int32",
        Base::Primitive(Primitive::Int64) => "int64",
        Base::Primitive(Primitive::UInt8) => "uint8",
        Base::Primitive(Primitive::UInt16) => "uint16",
        Base::Primitive(Primitive::UInt32) => "uint32",
        Base::Primitive(Primitive::UInt64) => "uint64",
        Base::Text(_) => "string",
        Base::Wide(_) => "wstring",
        Base::Message(_) => "message",
    }
}
