//! Values of parameters: the ten types of `rcl_interfaces/msg/ParameterType`.

use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use replenish_interfaces::rcl_interfaces::msg::ParameterValueView;
use replenish_msg::wire::Seq;

/// A value, borrowed from wherever it is. Arrays are made from slices:
///
/// ```
/// use replenish::ParameterValue;
/// let gains = ParameterValue::from(&[0.5, 0.25][..]);
/// assert_eq!(gains.type_name(), "double array");
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub enum ParameterValue<'a> {
    /// No value: an unset parameter of dynamic type.
    #[default]
    NotSet,
    /// `bool`.
    Bool(bool),
    /// `int64`.
    Integer(i64),
    /// `float64`.
    Double(f64),
    /// `string`.
    String(&'a str),
    /// `byte[]`.
    Bytes(&'a [u8]),
    /// `bool[]`.
    Bools(Seq<'a, bool>),
    /// `int64[]`.
    Integers(Seq<'a, i64>),
    /// `float64[]`.
    Doubles(Seq<'a, f64>),
    /// `string[]`.
    Strings(Seq<'a, &'a str>),
}

/// Names of the types, by their numbers in `rcl_interfaces/msg/ParameterType`.
const NAMES: [&str; 10] = [
    "not set",
    "bool",
    "integer",
    "double",
    "string",
    "byte array",
    "bool array",
    "integer array",
    "double array",
    "string array",
];

pub(crate) fn type_name(number: u8) -> &'static str {
    NAMES.get(usize::from(number)).unwrap_or(&"unknown")
}

impl<'a> ParameterValue<'a> {
    /// The type's number in `rcl_interfaces/msg/ParameterType`.
    #[must_use]
    pub fn type_number(&self) -> u8 {
        match self {
            Self::NotSet => 0,
            Self::Bool(_) => 1,
            Self::Integer(_) => 2,
            Self::Double(_) => 3,
            Self::String(_) => 4,
            Self::Bytes(_) => 5,
            Self::Bools(_) => 6,
            Self::Integers(_) => 7,
            Self::Doubles(_) => 8,
            Self::Strings(_) => 9,
        }
    }

    /// The type's name: `double array`.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        type_name(self.type_number())
    }

    /// `None`: a type that there is not.
    pub(crate) fn of_view(view: &ParameterValueView<'a>) -> Option<Self> {
        Some(match view.r#type {
            0 => Self::NotSet,
            1 => Self::Bool(view.bool_value),
            2 => Self::Integer(view.integer_value),
            3 => Self::Double(view.double_value),
            4 => Self::String(view.string_value),
            5 => Self::Bytes(view.byte_array_value),
            6 => Self::Bools(view.bool_array_value.clone()),
            7 => Self::Integers(view.integer_array_value.clone()),
            8 => Self::Doubles(view.double_array_value.clone()),
            9 => Self::Strings(view.string_array_value.clone()),
            _ => return None,
        })
    }

    pub(crate) fn view(&self) -> ParameterValueView<'a> {
        let mut view = ParameterValueView {
            r#type: self.type_number(),
            ..ParameterValueView::default()
        };
        match self {
            Self::NotSet => {}
            Self::Bool(v) => view.bool_value = *v,
            Self::Integer(v) => view.integer_value = *v,
            Self::Double(v) => view.double_value = *v,
            Self::String(v) => view.string_value = v,
            Self::Bytes(v) => view.byte_array_value = v,
            Self::Bools(v) => view.bool_array_value = v.clone(),
            Self::Integers(v) => view.integer_array_value = v.clone(),
            Self::Doubles(v) => view.double_array_value = v.clone(),
            Self::Strings(v) => view.string_array_value = v.clone(),
        }
        view
    }
}

impl fmt::Display for ParameterValue<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotSet => f.write_str("not set"),
            Self::Bool(v) => v.fmt(f),
            Self::Integer(v) => v.fmt(f),
            Self::Double(v) => write!(f, "{v:?}"),
            Self::String(v) => write!(f, "{v:?}"),
            Self::Bytes(v) => write!(f, "{v:?}"),
            Self::Bools(v) => write!(f, "{v:?}"),
            Self::Integers(v) => write!(f, "{v:?}"),
            Self::Doubles(v) => write!(f, "{v:?}"),
            Self::Strings(v) => write!(f, "{v:?}"),
        }
    }
}

macro_rules! from {
    ($($ty:ty => $variant:ident),* $(,)?) => {$(
        impl<'a> From<$ty> for ParameterValue<'a> {
            fn from(value: $ty) -> Self {
                Self::$variant(value.into())
            }
        }
    )*};
}

from! {
    bool => Bool,
    i64 => Integer,
    f64 => Double,
    &'a str => String,
    &'a [u8] => Bytes,
    &'a [bool] => Bools,
    &'a [i64] => Integers,
    &'a [f64] => Doubles,
    &'a [&'a str] => Strings,
}

/// Targets for a copy of a parameter's value: `bool`, `i64`, `f64`, `String`, and `Vec` of `u8`,
/// of those and of `String`. Strings and vectors keep their capacity.
pub trait FromParameter: Default {
    /// The type of parameters that it takes, by its name.
    const TYPE: &'static str;

    /// Takes the value; `false` if it is of another type.
    fn fill(&mut self, value: &ParameterValue<'_>) -> bool;
}

macro_rules! into {
    ($($ty:ty, $number:literal, $variant:ident, |$to:ident, $v:ident| $take:expr;)*) => {$(
        impl FromParameter for $ty {
            const TYPE: &'static str = NAMES[$number];

            fn fill(&mut self, value: &ParameterValue<'_>) -> bool {
                let $to = self;
                match value {
                    ParameterValue::$variant($v) => {
                        $take;
                        true
                    }
                    _ => false,
                }
            }
        }
    )*};
}

into! {
    bool, 1, Bool, |to, v| *to = *v;
    i64, 2, Integer, |to, v| *to = *v;
    f64, 3, Double, |to, v| *to = *v;
    String, 4, String, |to, v| { to.clear(); to.push_str(v) };
    Vec<u8>, 5, Bytes, |to, v| { to.clear(); to.extend_from_slice(v) };
    Vec<bool>, 6, Bools, |to, v| { to.clear(); to.extend(v.iter()) };
    Vec<i64>, 7, Integers, |to, v| { to.clear(); to.extend(v.iter()) };
    Vec<f64>, 8, Doubles, |to, v| { to.clear(); to.extend(v.iter()) };
    Vec<String>, 9, Strings, |to, v| { to.clear(); to.extend(v.iter().map(String::from)) };
}
