//! The content of a parsed interface file.

use crate::error::Place;
use std::fmt;
use std::path::PathBuf;

/// The full name of a message: `geometry_msgs/msg/Pose`, `std_srvs/srv/SetBool_Request`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct TypeName {
    pub(crate) package: String,
    /// `msg`, `srv` or `action`.
    pub(crate) kind: &'static str,
    pub(crate) name: String,
}

impl TypeName {
    pub(crate) fn new(package: &str, kind: &'static str, name: impl Into<String>) -> Self {
        Self {
            package: package.into(),
            kind,
            name: name.into(),
        }
    }

    /// The same with something behind: `AddTwoInts` and `_Request`.
    pub(crate) fn with(&self, suffix: &str) -> Self {
        Self::new(&self.package, self.kind, format!("{}{suffix}", self.name))
    }

    /// The name in DDS: `std_msgs::msg::dds_::Int32_`.
    pub(crate) fn dds(&self) -> String {
        format!("{}::{}::dds_::{}_", self.package, self.kind, self.name)
    }

    /// The struct's name: ROS's, without underscores.
    pub(crate) fn rust(&self) -> String {
        self.name.replace('_', "")
    }
}

impl fmt::Display for TypeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.package, self.kind, self.name)
    }
}

/// A primitive type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Primitive {
    Bool,
    Byte,
    Char,
    Float32,
    Float64,
    Int8,
    UInt8,
    Int16,
    UInt16,
    Int32,
    UInt32,
    Int64,
    UInt64,
}

impl Primitive {
    /// Bytes on the wire.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::Bool | Self::Byte | Self::Char | Self::Int8 | Self::UInt8 => 1,
            Self::Int16 | Self::UInt16 => 2,
            Self::Float32 | Self::Int32 | Self::UInt32 => 4,
            Self::Float64 | Self::Int64 | Self::UInt64 => 8,
        }
    }

    /// The Rust type.
    pub(crate) fn rust(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::Byte | Self::Char | Self::UInt8 => "u8",
            Self::Float32 => "f32",
            Self::Float64 => "f64",
            Self::Int8 => "i8",
            Self::Int16 => "i16",
            Self::UInt16 => "u16",
            Self::Int32 => "i32",
            Self::UInt32 => "u32",
            Self::Int64 => "i64",
            Self::UInt64 => "u64",
        }
    }

    pub(crate) fn is_float(self) -> bool {
        matches!(self, Self::Float32 | Self::Float64)
    }
}

/// The type of one value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Base {
    Primitive(Primitive),
    /// With the bound in bytes.
    Text(Option<usize>),
    /// With the bound in UTF-16 units.
    Wide(Option<usize>),
    Message(TypeName),
}

/// Number of values in a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shape {
    One,
    Array(usize),
    /// With the bound, if there is one.
    Sequence(Option<usize>),
}

/// A literal.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Bool(bool),
    Integer(i128),
    /// As written, a finite number that Rust reads, or `NAN`, `INFINITY`, `NEG_INFINITY`.
    Float(String),
    Text(String),
    List(Vec<Value>),
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) base: Base,
    pub(crate) shape: Shape,
    pub(crate) default: Option<Value>,
    pub(crate) docs: Vec<String>,
    pub(crate) place: Place,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Constant {
    pub(crate) name: String,
    pub(crate) base: Base,
    pub(crate) value: Value,
    pub(crate) docs: Vec<String>,
}

/// One struct: a message, or a part of a service or action.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Definition {
    pub(crate) name: TypeName,
    pub(crate) docs: Vec<String>,
    pub(crate) fields: Vec<Field>,
    pub(crate) constants: Vec<Constant>,
}

/// One file: a message, or the two parts of a service, or the three of an action.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Interface {
    /// Without a part's suffix.
    pub(crate) name: TypeName,
    pub(crate) file: PathBuf,
    pub(crate) parts: Vec<Definition>,
}
