//! The five services of a managed node, on one worker: `change_state`, `get_state`,
//! `get_available_states`, `get_available_transitions`, `get_transition_graph`. Nothing allocates.

use super::machine::{self, Arrow, GRAPH, State};
use super::node::{Lifecycle, described, transition};
use crate::error::Error;
use crate::executor::{AddHandles, Target, Topic};
use crate::service::bytes::Unanswered;
use crate::sync::Arc;
use replenish_interfaces::lifecycle_msgs::msg::{StateView, TransitionDescriptionView};
use replenish_interfaces::lifecycle_msgs::srv;
use replenish_msg::wire::Encode;
use replenish_msg::{CdrWriter, View};

impl<T: Target> AddHandles<T> {
    /// Lets others ask for transitions of a managed node, and for what it is: five handles with the
    /// services of ROS 2. The callbacks of transitions that others ask for run on this worker.
    ///
    /// # Errors
    /// As [`serve`](Self::serve).
    pub fn lifecycle(self, lifecycle: &Lifecycle) -> Result<T::AllAdded, Error> {
        Ok(serve(self.together(), lifecycle)?.all_added(4))
    }
}

fn serve<T>(worker: AddHandles<T>, lifecycle: &Lifecycle) -> Result<AddHandles<T>, Error>
where
    T: Target<Added = AddHandles<T>>,
{
    let node = &lifecycle.inner.node.clone();
    let of = || Arc::clone(&lifecycle.inner);
    let (changed, get, available) = (of(), of(), of());
    let unknown = StateView {
        id: 0,
        label: "unknown",
    };
    worker
        .serve_bytes::<srv::ChangeState>(
            node,
            Topic::named("~/change_state"),
            move |request, w| {
                let request = srv::ChangeStateRequestView::from_payload(request)?.transition;
                let outcome = changed.change(request.id, request.label);
                Ok(w.bool(outcome.is_ok())?)
            },
        )?
        .serve_bytes::<srv::GetState>(node, Topic::named("~/get_state"), move |_, w| {
            Ok(described(get.state()).put(w)?)
        })?
        .serve_bytes::<srv::GetAvailableStates>(
            node,
            Topic::named("~/get_available_states"),
            move |_, w| {
                w.sequence(State::ALL.len() + 1)?;
                unknown.put(w)?;
                let mut all = State::ALL.into_iter();
                Ok(all.try_for_each(|state| described(state).put(w))?)
            },
        )?
        .serve_bytes::<srv::GetAvailableTransitions>(
            node,
            Topic::named("~/get_available_transitions"),
            move |_, w| arrows(machine::from(available.state()), w),
        )?
        .serve_bytes::<srv::GetAvailableTransitions>(
            node,
            Topic::named("~/get_transition_graph"),
            |_, w| arrows(GRAPH.iter(), w),
        )
}

fn arrows<'a>(
    arrows: impl Iterator<Item = &'a Arrow> + Clone,
    w: &mut CdrWriter<'_>,
) -> Result<(), Unanswered> {
    w.sequence(arrows.clone().count())?;
    for arrow in arrows {
        let description = TransitionDescriptionView {
            transition: transition(arrow),
            start_state: described(arrow.from),
            goal_state: described(arrow.to),
        };
        description.put(w)?;
    }
    Ok(())
}
