//! The type of a field: `int32`, `string<=10[]`, `geometry_msgs/Pose[<=4]`.

use super::line::Line;
use crate::error::{Error, Place};
use crate::model::{Base, Primitive, Shape, TypeName};
use crate::names;

/// The largest array or bound: what a length on the wire can say.
const LARGEST: usize = u32::MAX as usize;

pub(super) fn parse(line: &mut Line<'_>, package: &str) -> Result<(Base, Shape), Error> {
    let place = line.place();
    let name = line.until(|c| c.is_whitespace() || "[]<>=#\"',".contains(c));
    let bound = if line.rest().starts_with("<=") {
        line.advance(2);
        Some(number(line, "the bound of a string")?)
    } else {
        None
    };
    let base = base(line, place, name, package)?;
    let base = match (base, bound) {
        (base, None) => base,
        (Base::Text(_), bound) => Base::Text(bound),
        (Base::Wide(_), bound) => Base::Wide(bound),
        _ => {
            let message = format!("`{name}` has no bound; `string<=N` and `wstring<=N` have");
            return Err(line.error(place, message));
        }
    };
    let shape = shape(line)?;
    match line.next() {
        Some(c) if !c.is_whitespace() => line.wrong(format!(
            "`{c}` behind a type; allowed are `[]`, `[N]`, `[<=N]`, and `<=N` behind `string`"
        )),
        _ => Ok((base, shape)),
    }
}

fn shape(line: &mut Line<'_>) -> Result<Shape, Error> {
    if !line.take('[') {
        return Ok(Shape::One);
    }
    let shape = if line.rest().starts_with(']') {
        Shape::Sequence(None)
    } else if line.rest().starts_with("<=") {
        line.advance(2);
        Shape::Sequence(Some(number(line, "the bound of a sequence")?))
    } else {
        Shape::Array(number(line, "the size of an array")?)
    };
    if line.take(']') {
        Ok(shape)
    } else {
        line.wrong("`]` is missing; allowed are `[]`, `[N]` and `[<=N]`")
    }
}

fn number(line: &mut Line<'_>, what: &str) -> Result<usize, Error> {
    let place = line.place();
    let digits = line.until(|c| !c.is_alphanumeric() && c != '-' && c != '_');
    match digits.parse() {
        Ok(number) if (1..=LARGEST).contains(&number) => Ok(number),
        _ => Err(line.error(
            place,
            format!("`{digits}` is not {what}: a whole number in 1..={LARGEST}"),
        )),
    }
}

fn base(line: &Line<'_>, place: Place, name: &str, package: &str) -> Result<Base, Error> {
    use Primitive as P;
    let wrong = |message: String| Err(line.error(place, message));
    let primitive = match name {
        "bool" => P::Bool,
        "byte" => P::Byte,
        "char" => P::Char,
        "float32" => P::Float32,
        "float64" => P::Float64,
        "int8" => P::Int8,
        "uint8" => P::UInt8,
        "int16" => P::Int16,
        "uint16" => P::UInt16,
        "int32" => P::Int32,
        "uint32" => P::UInt32,
        "int64" => P::Int64,
        "uint64" => P::UInt64,
        "string" => return Ok(Base::Text(None)),
        "wstring" => return Ok(Base::Wide(None)),
        "time" | "duration" => {
            let new = if name == "time" { "Time" } else { "Duration" };
            return wrong(format!(
                "`{name}` is a type of ROS 1; in ROS 2 it is `builtin_interfaces/{new}`"
            ));
        }
        "Header" if package != "std_msgs" => {
            return wrong("`Header` alone is of ROS 1; in ROS 2 it is `std_msgs/Header`".into());
        }
        "" => return wrong("a type is missing".into()),
        _ => return message(name, package).map_or_else(wrong, |name| Ok(Base::Message(name))),
    };
    Ok(Base::Primitive(primitive))
}

/// `Name`, `package/Name` or `package/msg/Name`.
fn message(text: &str, own: &str) -> Result<TypeName, String> {
    let (package, name) = match text.split('/').collect::<Vec<_>>()[..] {
        [name] => (own, name),
        [package, name] | [package, "msg", name] => (package, name),
        _ => {
            return Err(format!(
                "`{text}` is no type; messages are `Name`, `package/Name` or `package/msg/Name`"
            ));
        }
    };
    if !names::is_package(package) {
        return Err(format!(
            "`{package}` is no name of a package: {}",
            names::PACKAGE
        ));
    }
    if !names::is_type(name) {
        let what = if name == text && name.starts_with(|c: char| c.is_ascii_lowercase()) {
            "primitive type (bool, byte, char, float32, float64, int8, uint8, int16, uint16, \
                 int32, uint32, int64, uint64, string, wstring), and none of a message"
                .into()
        } else {
            format!("name of a message: {}", names::TYPE)
        };
        return Err(format!("`{name}` is no {what}"));
    }
    Ok(TypeName::new(package, "msg", name))
}
