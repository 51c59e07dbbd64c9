//! The six services of a node's parameters, on one worker: `get_parameters`, `get_parameter_types`,
//! `set_parameters`, `set_parameters_atomically`, `describe_parameters`, `list_parameters`.
//!
//! Requests and responses stay where they are, as bytes: nothing allocates.

use super::error::{ParameterError, ParameterErrorKind};
use super::server::{Inner, Parameters};
use super::store::{Setter, Slot};
use super::value::ParameterValue;
use crate::error::Error;
use crate::executor::{AddHandles, Target, Topic};
use crate::service::bytes::Unanswered;
use crate::sync::Arc;
use replenish_interfaces::rcl_interfaces::msg::{
    ParameterDescriptorView, ParameterValueView, ParameterView, SetParametersResultView,
};
use replenish_interfaces::rcl_interfaces::srv;
use replenish_msg::wire::Encode;
use replenish_msg::{CdrError, CdrWriter, View};

impl<T: Target> AddHandles<T> {
    /// Serves a node's parameters to others: six handles with the services of ROS 2. Requests and
    /// responses take up to
    /// [`ParameterOptions::max_size`](crate::ParameterOptions::max_size) each; a response
    /// that does not fit is an error of its handle, a request an
    /// [`Event::Oversize`](crate::Event::Oversize).
    ///
    /// # Errors
    /// As [`serve`](Self::serve).
    pub fn parameters(self, parameters: &Parameters) -> Result<T::AllAdded, Error> {
        Ok(serve(self.together(), parameters)?.all_added(5))
    }
}

fn serve<T>(worker: AddHandles<T>, parameters: &Parameters) -> Result<AddHandles<T>, Error>
where
    T: Target<Added = AddHandles<T>>,
{
    let node = &parameters.inner.node.clone();
    let of_size = |name| Topic::named(name).max_size(parameters.inner.message);
    let of = || Arc::clone(&parameters.inner);
    let (get, types, describe, list) = (of(), of(), of(), of());
    let (each, atomic) = (parameters.clone(), parameters.clone());
    worker
        .serve_bytes::<srv::GetParameters>(node, of_size("~/get_parameters"), move |request, w| {
            values(&get, request, w)
        })?
        .serve_bytes::<srv::GetParameterTypes>(
            node,
            of_size("~/get_parameter_types"),
            move |request, w| kinds(&types, request, w),
        )?
        .serve_bytes::<srv::SetParameters>(node, of_size("~/set_parameters"), move |request, w| {
            set(&each, request, w)
        })?
        .serve_bytes::<srv::SetParametersAtomically>(
            node,
            of_size("~/set_parameters_atomically"),
            move |request, w| set_atomically(&atomic, request, w),
        )?
        .serve_bytes::<srv::DescribeParameters>(
            node,
            of_size("~/describe_parameters"),
            move |request, w| descriptors(&describe, request, w),
        )?
        .serve_bytes::<srv::ListParameters>(
            node,
            of_size("~/list_parameters"),
            move |request, w| names(&list, request, w),
        )
}

fn values(of: &Inner, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::GetParametersRequestView::from_payload(request)?;
    w.sequence(request.names.len())?;
    let table = of.table.lock();
    for name in request.names.iter() {
        match table.find(name) {
            Ok(slot) => slot.now.view().put(w)?,
            Err(_) => ParameterValueView::default().put(w)?,
        }
    }
    Ok(())
}

fn kinds(of: &Inner, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::GetParameterTypesRequestView::from_payload(request)?;
    w.sequence(request.names.len())?;
    let table = of.table.lock();
    for name in request.names.iter() {
        let kind = table.find(name).map_or(0, |slot| slot.now.view().r#type);
        w.bytes(&[kind])?;
    }
    Ok(())
}

fn descriptors(of: &Inner, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::DescribeParametersRequestView::from_payload(request)?;
    w.sequence(request.names.len())?;
    let table = of.table.lock();
    for name in request.names.iter() {
        match table.find(name) {
            Ok(slot) => slot.descriptor.view(name, slot.kind).put(w)?,
            Err(_) => {
                let unknown = ParameterDescriptorView {
                    name,
                    ..ParameterDescriptorView::default()
                };
                unknown.put(w)?;
            }
        }
    }
    Ok(())
}

fn result(outcome: Result<(), ParameterError>, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
    let reason = outcome.as_ref().err().map_or("", ParameterError::reason);
    let successful = outcome.is_ok();
    SetParametersResultView { successful, reason }.put(w)
}

fn known(parameter: &ParameterView<'_>) -> Result<(), ParameterError> {
    let (name, number) = (parameter.name, parameter.value.r#type);
    if number <= 9 {
        return Ok(());
    }
    let text = format_args!("{name}: the value is of type {number}, allowed are 0..=9");
    Err(ParameterError::new(ParameterErrorKind::Type, text))
}

/// Name and value.
fn wish<'a>(parameter: &ParameterView<'a>) -> (&'a str, ParameterValue<'a>) {
    let value = ParameterValue::of_view(&parameter.value);
    (parameter.name, value.unwrap_or_default())
}

fn set(of: &Parameters, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::SetParametersRequestView::from_payload(request)?;
    w.sequence(request.parameters.len())?;
    for parameter in request.parameters.iter() {
        let outcome = known(&parameter);
        let outcome =
            outcome.and_then(|()| of.set_all(Setter::Others, core::iter::once(wish(&parameter))));
        result(outcome, w)?;
    }
    Ok(())
}

fn set_atomically(
    of: &Parameters,
    request: &[u8],
    w: &mut CdrWriter<'_>,
) -> Result<(), Unanswered> {
    let request = srv::SetParametersAtomicallyRequestView::from_payload(request)?;
    let wishes = request.parameters.iter();
    let outcome = wishes.clone().try_for_each(|p| known(&p));
    let outcome = outcome.and_then(|()| of.set_all(Setter::Others, wishes.map(|p| wish(&p))));
    Ok(result(outcome, w)?)
}

fn names(of: &Inner, request: &[u8], w: &mut CdrWriter<'_>) -> Result<(), Unanswered> {
    let request = srv::ListParametersRequestView::from_payload(request)?;
    let table = of.table.lock();
    let listed = |slot: &&Slot| {
        let deep = |rest: &str| {
            let dots = rest.bytes().filter(|b| *b == b'.').count() as u64;
            request.depth == 0 || dots < request.depth
        };
        let below = |prefix: &str| match slot.name.strip_prefix(prefix) {
            Some("") => true,
            Some(rest) => rest.strip_prefix('.').is_some_and(deep),
            None => false,
        };
        (request.prefixes.is_empty() && deep(&slot.name)) || request.prefixes.iter().any(below)
    };
    let all = table.all().filter(listed);
    w.sequence(all.clone().count())?;
    for slot in all.clone() {
        w.string(&slot.name)?;
    }
    // The prefixes of those listed, each once.
    let prefix = |slot: &'_ Slot| slot.name.rfind('.');
    let first = |(at, slot): &(usize, &Slot)| {
        let Some(end) = prefix(slot) else {
            return false;
        };
        let own = slot.name.get(..end);
        let mut earlier = all.clone().take(*at);
        !earlier.any(|other| prefix(other).is_some_and(|end| other.name.get(..end) == own))
    };
    let prefixes = all.clone().enumerate().filter(first);
    w.sequence(prefixes.clone().count())?;
    for (_, slot) in prefixes {
        let end = prefix(slot).unwrap_or(0);
        w.string(slot.name.get(..end).unwrap_or_default())?;
    }
    Ok(())
}
