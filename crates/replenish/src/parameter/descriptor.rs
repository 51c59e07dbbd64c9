//! The allowed values of a parameter: `rcl_interfaces/msg/ParameterDescriptor`.

use super::error::{ParameterError, ParameterErrorKind};
use super::value::{ParameterValue, type_name};
use alloc::string::String;
use replenish_interfaces::rcl_interfaces::msg::{
    FloatingPointRange, IntegerRange, ParameterDescriptorView,
};
use replenish_msg::heapless;

/// Describes a parameter and bounds it.
///
/// ```
/// use replenish::Descriptor;
/// let gain = Descriptor::new()
///     .description("of the inner loop")
///     .double_range(0.0, 10.0, 0.5);
/// # let _ = gain;
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Descriptor {
    description: String,
    constraints: String,
    pub(crate) read_only: bool,
    pub(crate) dynamic: bool,
    integers: Option<(i64, i64, u64)>,
    doubles: Option<(f64, f64, f64)>,
}

impl Descriptor {
    /// A descriptor without description; the type is that of the first value, and every value of it
    /// is allowed.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets a description for people.
    #[must_use]
    pub fn description(self, text: &str) -> Self {
        Self {
            description: text.into(),
            ..self
        }
    }

    /// Sets constraints for people that only a callback can check.
    #[must_use]
    pub fn constraints(self, text: &str) -> Self {
        Self {
            constraints: text.into(),
            ..self
        }
    }

    /// Makes it read-only: only its own node sets it, with
    /// [`Parameters::set_own`](crate::Parameters::set_own).
    #[must_use]
    pub fn read_only(self) -> Self {
        Self {
            read_only: true,
            ..self
        }
    }

    /// Lets the parameter be set to values of any type, and to none.
    #[must_use]
    pub fn dynamic_typing(self) -> Self {
        Self {
            dynamic: true,
            ..self
        }
    }

    /// Integers, and elements of integer arrays, are `from`, `from + step`, … up to `to`, or `to`.
    /// A step of 0 allows all between. Not for parameters of another type.
    #[must_use]
    pub fn integer_range(self, from: i64, to: i64, step: u64) -> Self {
        Self {
            integers: Some((from, to, step)),
            ..self
        }
    }

    /// Doubles, and elements of double arrays, likewise; to within rounding, and never NaN. Not for
    /// parameters of another type.
    #[must_use]
    pub fn double_range(self, from: f64, to: f64, step: f64) -> Self {
        Self {
            doubles: Some((from, to, step)),
            ..self
        }
    }

    /// The first contradiction within the descriptor itself, or to a parameter of type `known`.
    pub(crate) fn check(&self, name: &str, known: u8) -> Result<(), ParameterError> {
        let ranges = [
            ("integer_range", self.integers.is_some(), [2, 7]),
            ("double_range", self.doubles.is_some(), [3, 8]),
        ];
        for (range, given, types) in ranges {
            if given && !self.dynamic && known != 0 && !types.contains(&known) {
                let (is, [one, many]) = (type_name(known), types.map(type_name));
                let allowed = format_args!("for types {one} and {many}");
                let text = format_args!("{name}: it is of type {is}, {range} is {allowed}");
                return Err(ParameterError::new(ParameterErrorKind::Type, text));
            }
        }
        let wrong = |text| Err(ParameterError::new(ParameterErrorKind::Range, text));
        if let Some((from, to, _)) = self.integers
            && from > to
        {
            return wrong(format_args!("{name}: integer_range from {from} to {to}"));
        }
        if let Some((from, to, step)) = self.doubles
            && !(from <= to && step >= 0.0)
        {
            let range = format_args!("{name}: double_range from {from} to {to}, step {step}");
            return wrong(range);
        }
        Ok(())
    }

    /// Whether `value` is in the range.
    pub(crate) fn admit(
        &self,
        name: &str,
        value: &ParameterValue<'_>,
    ) -> Result<(), ParameterError> {
        match value {
            ParameterValue::Integer(v) => self.integer(name, *v),
            ParameterValue::Double(v) => self.double(name, *v),
            ParameterValue::Integers(all) => all.iter().try_for_each(|v| self.integer(name, v)),
            ParameterValue::Doubles(all) => all.iter().try_for_each(|v| self.double(name, v)),
            _ => Ok(()),
        }
    }

    fn integer(&self, name: &str, value: i64) -> Result<(), ParameterError> {
        let Some((from, to, step)) = self.integers else {
            return Ok(());
        };
        let on_grid = step == 0 || value == to || value.abs_diff(from).is_multiple_of(step);
        if (from..=to).contains(&value) && on_grid {
            return Ok(());
        }
        let text = format_args!("{name} = {value}: allowed are {from}..={to} in steps of {step}");
        Err(ParameterError::new(ParameterErrorKind::Range, text))
    }

    fn double(&self, name: &str, value: f64) -> Result<(), ParameterError> {
        let Some((from, to, step)) = self.doubles else {
            return Ok(());
        };
        let near = step == 0.0 || {
            let way = libm_round((value - from) / step) * step;
            // As rclcpp: within rounding of the numbers added, however many steps there are.
            let size = value.abs().max(from.abs()).max(way.abs());
            (value - (from + way)).abs() <= 100.0 * f64::EPSILON * size
        };
        if value >= from && value <= to && (near || value == to) {
            return Ok(());
        }
        let text = format_args!("{name} = {value}: allowed are {from}..={to} in steps of {step}");
        Err(ParameterError::new(ParameterErrorKind::Range, text))
    }

    /// The descriptor as the services send it.
    pub(crate) fn view<'a>(&'a self, name: &'a str, kind: u8) -> ParameterDescriptorView<'a> {
        let doubles = self
            .doubles
            .map(|(from_value, to_value, step)| FloatingPointRange {
                from_value,
                to_value,
                step,
            });
        let integers = self
            .integers
            .map(|(from_value, to_value, step)| IntegerRange {
                from_value,
                to_value,
                step,
            });
        ParameterDescriptorView {
            name,
            r#type: kind,
            description: &self.description,
            additional_constraints: &self.constraints,
            read_only: self.read_only,
            dynamic_typing: self.dynamic,
            floating_point_range: heapless::Vec::from_iter(doubles),
            integer_range: heapless::Vec::from_iter(integers),
        }
    }

    /// Whether a parameter of type `known` may be set to `value`.
    pub(crate) fn admits_type(
        &self,
        name: &str,
        known: u8,
        value: &ParameterValue<'_>,
    ) -> Result<(), ParameterError> {
        if self.dynamic || known == value.type_number() || known == 0 {
            return Ok(());
        }
        let (is, expected) = (value.type_name(), type_name(known));
        let text = format_args!("{name}: the value is of type {is}, allowed is {expected}");
        Err(ParameterError::new(ParameterErrorKind::Type, text))
    }
}

/// `f64::round`, which `core` has not; exact where the fraction matters, below 2^52.
fn libm_round(x: f64) -> f64 {
    const INTEGERS: f64 = 4_503_599_627_370_496.0;
    if x.abs() >= INTEGERS {
        return x;
    }
    // Adding and taking away 2^52 leaves the nearest integer.
    if x >= 0.0 {
        (x + INTEGERS) - INTEGERS
    } else {
        (x - INTEGERS) + INTEGERS
    }
}
