"""Writes the message crates that rclrs finds below AMENT_PREFIX_PATH.

ROS 2's wheels have no Rust code: its generator for Rust is in no package index. rclrs itself needs five
packages of messages, and the example one more. This writes them in that generator's form, without its
actions and without its event messages.

    messages.py SHARE OUT PACKAGE...
"""

import sys
from pathlib import Path

from rosidl_parser import definition as idl
from rosidl_parser.parser import parse_idl_file

NUMBERS = {
    "boolean": "bool", "octet": "u8", "char": "u8", "float": "f32", "double": "f64",
    "int8": "i8", "uint8": "u8", "int16": "i16", "uint16": "u16",
    "int32": "i32", "uint32": "u32", "int64": "i64", "uint64": "u64",
}  # fmt: skip
KEYWORDS = {"type", "move", "match", "ref", "in", "box", "self", "use", "where", "loop", "impl"}
MANIFEST = """[package]
name = "{}"
version = "0.0.0"
edition = "2021"

[package.metadata.ros-env]
include = true
"""


def field(name):
    return name + "_" if name in KEYWORDS else name


def rust(kind, rmw):
    """The type of a field: as C has it (`rmw`), or as Rust programs have it."""
    if isinstance(kind, idl.BasicType):
        return NUMBERS[kind.typename]
    if isinstance(kind, idl.NamespacedType):
        package, folder = kind.namespaces[:2]
        return f"crate::{package}::{folder}::{'rmw::' if rmw else ''}{kind.name}"
    if isinstance(kind, idl.AbstractGenericString):
        wide = "W" if isinstance(kind, idl.AbstractWString) else ""
        if not rmw:
            return "std::string::String"
        if kind.has_maximum_size():
            return f"rosidl_runtime_rs::Bounded{wide}String<{kind.maximum_size}>"
        return f"rosidl_runtime_rs::{wide}String"
    inside = rust(kind.value_type, rmw)
    if isinstance(kind, idl.Array):
        return f"[{inside}; {kind.size}]"
    if isinstance(kind, idl.BoundedSequence):
        bounded = f"rosidl_runtime_rs::BoundedSequence<{inside}, {kind.maximum_size}>"
        return bounded if rmw or plain(kind.value_type) else f"Vec<{inside}>"
    return f"rosidl_runtime_rs::Sequence<{inside}>" if rmw else f"Vec<{inside}>"


def plain(kind):
    return isinstance(kind, idl.BasicType)


def to_c(kind, value):
    if isinstance(kind, idl.BasicType):
        return value
    if isinstance(kind, idl.NamespacedType):
        message = f"<{rust(kind, False)} as rosidl_runtime_rs::Message>"
        return f"{message}::into_rmw_message(std::borrow::Cow::Owned({value})).into_owned()"
    if isinstance(kind, idl.AbstractGenericString):
        if kind.has_maximum_size():
            return f"{value}.as_str().try_into().unwrap()"
        return f"{value}.as_str().into()"
    each = to_c(kind.value_type, "each")
    if isinstance(kind, idl.Array):
        return value if plain(kind.value_type) else f"{value}.map(|each| {each})"
    if isinstance(kind, idl.BoundedSequence):
        if plain(kind.value_type):
            return value
        return f"{value}.into_iter().map(|each| {each}).collect::<Vec<_>>().try_into().unwrap()"
    return f"{value}.into_iter().map(|each| {each}).collect()"


def to_rust(kind, value):
    if isinstance(kind, idl.BasicType):
        return value
    if isinstance(kind, idl.NamespacedType):
        return f"<{rust(kind, False)} as rosidl_runtime_rs::Message>::from_rmw_message({value})"
    if isinstance(kind, idl.AbstractGenericString):
        return f"{value}.to_string()"
    each = to_rust(kind.value_type, "each")
    if isinstance(kind, idl.Array):
        return value if plain(kind.value_type) else f"{value}.map(|each| {each})"
    if isinstance(kind, idl.BoundedSequence) and plain(kind.value_type):
        return value
    return f"{value}.into_iter().map(|each| {each}).collect()"


def constants(message):
    if not message.constants:
        return ""
    lines = []
    for constant in message.constants:
        if plain(constant.type):
            value = str(constant.value).lower()
            lines.append(f"    pub const {constant.name}: {rust(constant.type, True)} = {value};")
    return f"impl {message.structure.namespaced_type.name} {{\n" + "\n".join(lines) + "\n}\n"


def struct(message, rmw):
    name = message.structure.namespaced_type.name
    fields = "".join(
        f"    pub {field(member.name)}: {rust(member.type, rmw)},\n"
        for member in message.structure.members
    )
    form = "#[repr(C)]\n#[derive(Clone, Debug, PartialEq, PartialOrd)]\n"
    if not rmw:
        form = "#[derive(Clone, Debug, PartialEq, PartialOrd)]\n"
    return f"{form}pub struct {name} {{\n{fields}}}\n{constants(message)}"


def message_in_c(message, package, folder):
    name = message.structure.namespaced_type.name
    c = f"{package}__{folder}__{name}"
    support = f"rosidl_typesupport_c__get_message_type_support_handle__{c}"
    sequence = f"rosidl_runtime_rs::Sequence<{name}>"
    return f"""{struct(message, True)}
#[link(name = "{package}__rosidl_typesupport_c")]
extern "C" {{
    fn {support}() -> *const std::ffi::c_void;
}}
#[link(name = "{package}__rosidl_generator_c")]
extern "C" {{
    fn {c}__init(message: *mut {name}) -> bool;
    fn {c}__Sequence__init(all: *mut {sequence}, size: usize) -> bool;
    fn {c}__Sequence__fini(all: *mut {sequence});
    fn {c}__Sequence__copy(from: *const {sequence}, to: *mut {sequence}) -> bool;
}}
impl Default for {name} {{
    fn default() -> Self {{
        // SAFETY: zeroed memory is valid for `init`, as in C.
        unsafe {{
            let mut message = std::mem::zeroed();
            assert!({c}__init(&mut message), "no memory for a {name}");
            message
        }}
    }}
}}
impl rosidl_runtime_rs::SequenceAlloc for {name} {{
    fn sequence_init(all: &mut {sequence}, size: usize) -> bool {{
        // SAFETY: a zeroed sequence, as in C.
        unsafe {{ {c}__Sequence__init(all, size) }}
    }}
    fn sequence_fini(all: &mut {sequence}) {{
        // SAFETY: a sequence that was initialised.
        unsafe {{ {c}__Sequence__fini(all) }}
    }}
    fn sequence_copy(from: &{sequence}, to: &mut {sequence}) -> bool {{
        // SAFETY: both are initialised.
        unsafe {{ {c}__Sequence__copy(from, to) }}
    }}
}}
impl rosidl_runtime_rs::Message for {name} {{
    type RmwMsg = Self;
    fn into_rmw_message(message: std::borrow::Cow<'_, Self>) -> std::borrow::Cow<'_, Self> {{
        message
    }}
    fn from_rmw_message(message: Self) -> Self {{
        message
    }}
}}
impl rosidl_runtime_rs::RmwMessage for {name} {{
    const TYPE_NAME: &'static str = "{package}/{folder}/{name}";
    fn get_type_support() -> *const std::ffi::c_void {{
        // SAFETY: no preconditions.
        unsafe {{ {support}() }}
    }}
}}
"""


def message_in_rust(message):
    name = message.structure.namespaced_type.name
    members = message.structure.members
    into = "".join(
        f"            {field(m.name)}: {to_c(m.type, 'message.' + field(m.name))},\n"
        for m in members
    )
    back = "".join(
        f"            {field(m.name)}: {to_rust(m.type, 'message.' + field(m.name))},\n"
        for m in members
    )
    return f"""{struct(message, False)}
impl Default for {name} {{
    fn default() -> Self {{
        <Self as rosidl_runtime_rs::Message>::from_rmw_message(rmw::{name}::default())
    }}
}}
impl rosidl_runtime_rs::Message for {name} {{
    type RmwMsg = rmw::{name};
    fn into_rmw_message(message: std::borrow::Cow<'_, Self>) -> std::borrow::Cow<'_, rmw::{name}> {{
        let message = message.into_owned();
        std::borrow::Cow::Owned(rmw::{name} {{
{into}        }})
    }}
    fn from_rmw_message(message: rmw::{name}) -> Self {{
        Self {{
{back}        }}
    }}
}}
"""


def service(name, package, own):
    support = f"rosidl_typesupport_c__get_service_type_support_handle__{package}__srv__{name}"
    extern = f"""#[link(name = "{package}__rosidl_typesupport_c")]
extern "C" {{
    fn {support}() -> *const std::ffi::c_void;
}}
"""
    return f"""{extern}pub struct {name};
impl rosidl_runtime_rs::Service for {name} {{
    type Request = {own}{name}_Request;
    type Response = {own}{name}_Response;
    fn get_type_support() -> *const std::ffi::c_void {{
        // SAFETY: no preconditions.
        unsafe {{ {support}() }}
    }}
}}
"""


def write(share, out, package):
    root = out / package / "rust"
    for folder in ("msg", "srv"):
        in_rust, in_c = [], []
        for path in sorted((share / package / folder).glob("*.idl")):
            locator = idl.IdlLocator(share, path.relative_to(share))
            content = parse_idl_file(locator).content
            messages = list(content.get_elements_of_type(idl.Message)) if folder == "msg" else []
            for each in content.get_elements_of_type(idl.Service):
                messages += [each.request_message, each.response_message]
                in_rust.append(service(each.namespaced_type.name, package, ""))
                in_c.append(service(each.namespaced_type.name, package, ""))
            for each in messages:
                in_rust.append(message_in_rust(each))
                in_c.append(message_in_c(each, package, folder))
        if in_rust:
            (root / "src" / folder).mkdir(parents=True, exist_ok=True)
            (root / "src" / f"{folder}.rs").write_text("\n".join(in_rust))
            (root / "src" / folder / "rmw.rs").write_text("\n".join(in_c))
    (root / "Cargo.toml").write_text(MANIFEST.format(package))


def main():
    share, out, *packages = sys.argv[1:]
    for package in packages:
        write(Path(share).resolve(), Path(out), package)


main()
