//! The program's arguments where they change names and values.

use super::clock::SimClock;
use crate::error::Error;
use crate::name;
use crate::parameter::{ParameterError, ParameterErrorKind, ParameterValue};
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use replenish_args::{ArgsError, Kind, RosArgs, Value};

/// ROS arguments; none by default: then everything stays as the program has it.
#[derive(Debug, Default)]
pub(crate) struct Args(pub(super) RosArgs);

/// Whether a node goes by the time of a simulation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeTime(pub(super) bool);

impl From<ArgsError> for Error {
    fn from(e: ArgsError) -> Self {
        Self::Arguments {
            reason: e.to_string(),
        }
    }
}

impl Args {
    /// The name of a node that the program calls `given`, which is `full` without arguments.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "without arguments it is the result"
    )]
    pub(crate) fn node(&self, given: &str, full: String) -> Result<String, Error> {
        let new = self.0.node(&full, given.contains('/'))?;
        Ok(name::node(&new)?)
    }

    /// The time that the node of this name goes by. `clock` notes a node on simulated time.
    pub(crate) fn time(&self, node: &str, clock: &SimClock) -> NodeTime {
        let given = self.0.parameter(node, "use_sim_time");
        let simulated = given.is_some_and(|given| given.value == Value::Bool(true));
        if simulated {
            clock.follow(node);
        }
        NodeTime(simulated)
    }

    /// The name of a topic or service that `node` calls `given`.
    pub(crate) fn name(&self, kind: Kind, given: &str, node: &str) -> Result<String, Error> {
        let plain = RosArgs::substitute(given, node)?;
        let full = name::topic(&plain, node)?;
        let new = self.0.name(kind, &full, node)?;
        Ok(name::topic(&new, node)?)
    }

    /// Hands on the value from outside, or `value` if there is none.
    pub(crate) fn declared<R>(
        &self,
        node: &str,
        name: &str,
        (value, dynamic): (ParameterValue<'_>, bool),
        then: impl FnOnce(ParameterValue<'_>) -> Result<R, ParameterError>,
    ) -> Result<R, ParameterError> {
        let Some(given) = self.0.parameter(node, name) else {
            return then(value);
        };
        let texts: Vec<&str> = match &given.value {
            Value::Strings(all) => all.iter().map(String::as_str).collect(),
            _ => Vec::new(),
        };
        let new = match &given.value {
            Value::Bool(v) => (*v).into(),
            Value::Integer(v) => (*v).into(),
            Value::Double(v) => (*v).into(),
            Value::String(v) => v.as_str().into(),
            Value::Bools(v) => v.as_slice().into(),
            Value::Integers(v) => v.as_slice().into(),
            Value::Doubles(v) => v.as_slice().into(),
            Value::Strings(_) => texts.as_slice().into(),
            _ => empty(&value),
        };
        let known = value.type_number();
        if dynamic || known == 0 || known == new.type_number() {
            return then(new);
        }
        let (place, kind) = (&given.place, given.value.type_name());
        Err(ParameterError::new(
            ParameterErrorKind::Type,
            format_args!(
                "{name}: {place} says {kind}, its type is {}",
                value.type_name()
            ),
        ))
    }
}

/// A value without elements, of the type of `value` if that is an array.
fn empty(value: &ParameterValue<'_>) -> ParameterValue<'static> {
    match value {
        ParameterValue::Bytes(_) => ParameterValue::Bytes(&[]),
        ParameterValue::Bools(_) => (&[] as &[bool]).into(),
        ParameterValue::Integers(_) => (&[] as &[i64]).into(),
        ParameterValue::Doubles(_) => (&[] as &[f64]).into(),
        ParameterValue::Strings(_) => (&[] as &[&str]).into(),
        _ => ParameterValue::NotSet,
    }
}
