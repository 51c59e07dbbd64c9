//! [`QosEvent`]: a change at an endpoint, as ROS 2's QoS events have it.

use crate::middleware::EndStatus;

/// A number that has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Count {
    /// The number now.
    pub total: u64,
    /// Change since the last event.
    pub change: i64,
}

/// A change at a publisher or subscription: [`on_event`](crate::AddHandles::on_event).
///
/// Several changes between two callbacks are one event. The name in `rclcpp` stands in brackets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum QosEvent {
    /// Peers have come or gone (`matched`).
    Matched {
        /// Peers so far, each counted anew when it comes again.
        total: Count,
        /// Peers at this moment.
        current: Count,
    },
    /// A peer of the topic offers or asks for a quality of service that does not fit
    /// (`incompatible_qos`): the two do not talk.
    IncompatibleQos {
        /// Number of such peers.
        count: Count,
        /// The policy by which the last one did not fit: `"reliability"`.
        policy: &'static str,
    },
    /// A peer of the topic has another type (`incompatible_type`): the two do not talk.
    IncompatibleType(Count),
    /// A [deadline](crate::Qos::deadline) passed without a sample: one that a publisher has
    /// promised (`offered_deadline_missed`), or one that a subscription has asked for
    /// (`requested_deadline_missed`). Each period counts, from the first sample on.
    DeadlineMissed(Count),
    /// A publisher was silent for longer than its [lease](crate::Qos::lease)
    /// (`liveliness_lost`).
    LivelinessLost(Count),
    /// Publishers of a subscription have come, gone, fallen silent or are back
    /// (`liveliness_changed`).
    LivelinessChanged {
        /// Publishers that are alive.
        alive: Count,
        /// Publishers that were silent for longer than their lease.
        not_alive: Count,
    },
    /// Samples of a subscription were lost on the way to it (`message_lost`).
    MessageLost(Count),
}

/// The events that lead from the last reported status to the present one.
pub(super) fn between(last: EndStatus, now: EndStatus) -> impl Iterator<Item = QosEvent> {
    let count = |total: u64, last: u64| Count {
        total,
        change: total.wrapping_sub(last).cast_signed(),
    };
    let only =
        |count: Count, event: fn(Count) -> QosEvent| (count.change != 0).then(|| event(count));
    let total = count(now.matched_total, last.matched_total);
    let current = count(now.matched, last.matched);
    let incompatible = count(now.incompatible, last.incompatible);
    let policy = now.policy;
    let matched = QosEvent::Matched { total, current };
    let clash = QosEvent::IncompatibleQos {
        count: incompatible,
        policy,
    };
    let alive = count(now.alive, last.alive);
    let not_alive = count(now.not_alive, last.not_alive);
    let life = QosEvent::LivelinessChanged { alive, not_alive };
    let events = [
        (total.change != 0 || current.change != 0).then_some(matched),
        (incompatible.change != 0).then_some(clash),
        (alive.change != 0 || not_alive.change != 0).then_some(life),
        only(
            count(now.liveliness_lost, last.liveliness_lost),
            QosEvent::LivelinessLost,
        ),
        only(
            count(now.deadline_missed, last.deadline_missed),
            QosEvent::DeadlineMissed,
        ),
        only(
            count(now.wrong_type, last.wrong_type),
            QosEvent::IncompatibleType,
        ),
        only(count(now.lost, last.lost), QosEvent::MessageLost),
    ];
    events.into_iter().flatten()
}
