//! The fields of a type, as data: one table a type, in read-only memory.

/// A type's name and fields.
#[derive(Debug, PartialEq, Eq)]
pub struct Structure {
    /// The ROS name, `geometry_msgs/msg/Pose`; empty for [`UNKNOWN`](Self::UNKNOWN).
    pub name: &'static str,
    /// The fields in their order on the wire.
    pub fields: &'static [Field],
}

impl Structure {
    /// The structure of a type that does not describe itself.
    pub const UNKNOWN: Self = Self {
        name: "",
        fields: &[],
    };
}

/// A field's name and type.
#[derive(Debug, PartialEq, Eq)]
pub struct Field {
    /// The name as in the `.msg` file.
    pub name: &'static str,
    /// Number of values.
    pub shape: Shape,
    /// Kind of each value.
    pub kind: Kind,
}

impl Field {
    /// A field.
    #[must_use]
    pub const fn new(name: &'static str, shape: Shape, kind: Kind) -> Self {
        Self { name, shape, kind }
    }
}

/// The structure of a type written by hand: its hash and its fields, as the generator writes them.
macro_rules! known {
    ($hash:literal, $name:expr $(, $($fields:tt)*)?) => {
        const TYPE_HASH: Option<&'static str> = Some(concat!("RIHS01_", $hash));
        $crate::structure::fields!($name $(, $($fields)*)?);
    };
}
pub(crate) use known;

/// The fields alone.
macro_rules! fields {
    ($name:expr $(, $field:literal: $shape:ident $(($count:expr))?, $kind:ident $(($of:expr))?)*) => {
        const STRUCTURE: &'static $crate::Structure = &$crate::Structure {
            name: $name,
            fields: &[$($crate::structure::Field::new(
                $field,
                $crate::structure::Shape::$shape $(($count))?,
                $crate::structure::Kind::$kind $(($of))?,
            )),*],
        };
    };
}
pub(crate) use fields;

/// Number of values in a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// One.
    One,
    /// This many values, always: `T[N]`.
    Array(usize),
    /// Up to as many, with their number in front: `T[<=N]`; `T[]` is up to `usize::MAX`.
    Sequence(usize),
}

/// The type of a field's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `bool`.
    Bool,
    /// A number of as many bytes: 1, 2, 4 or 8.
    Number(usize),
    /// `string<=N`; `string` is up to `usize::MAX` bytes.
    Text(usize),
    /// `wstring<=N`; `wstring` is up to `usize::MAX` UTF-16 units.
    WideText(usize),
    /// Another message.
    Nested(&'static Structure),
}
