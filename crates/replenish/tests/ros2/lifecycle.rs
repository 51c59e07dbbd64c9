//! Managed nodes: rclpy manages ours, and we manage rclpy's.

use crate::peer::{Foreign, Peer};
use crate::support::{budget, eventually, executor, node};
use replenish::{Outcome, Qos, Transition};
use replenish_interfaces::lifecycle_msgs::msg::{Transition as Asked, TransitionEvent};
use replenish_interfaces::lifecycle_msgs::srv;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Times that a node goes through four transitions.
const ROUNDS: usize = 5;
/// Configure, activate, deactivate, clean up: the transition, and the state that it leads to.
const ROUND: [(u8, u8); 4] = [(1, 2), (3, 3), (4, 2), (2, 1)];

/// rclpy leads a node of ours through its states, and hears of each.
pub(crate) fn managed(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let lifecycle = node.lifecycle().unwrap();
    let configured = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&configured);
    lifecycle.on_transition(Transition::Configure, move |_| {
        count.fetch_add(1, Ordering::SeqCst);
        Outcome::Success
    });
    lifecycle.on_transition(Transition::Shutdown, |_| Outcome::Failure);
    let mut exec = executor(&node);
    exec.worker("lifecycle")
        .budget(budget())
        .lifecycle(&lifecycle)
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["manage", &ROUNDS.to_string()]);
    let changes = ROUNDS * ROUND.len();
    assert_eq!(peer.line(), format!("changed {changes} of {changes}"));
    assert_eq!(peer.line(), format!("events {}", 2 * changes));
    assert_eq!(peer.line(), "refused True");
    assert_eq!(peer.line(), "states 11 transitions 2 graph 25");
    assert_eq!(configured.load(Ordering::SeqCst), ROUNDS);
    drop(running.stop());
}

/// We lead a node of rclpy through its states, and hear of each.
pub(crate) fn manager(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let limit = Duration::from_secs(60);
    let change = node
        .client::<srv::ChangeState>("/peer/camera/change_state", Qos::services(), limit)
        .unwrap();
    let state = node
        .client::<srv::GetState>("/peer/camera/get_state", Qos::services(), limit)
        .unwrap();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let (changed, asked, events) = (Arc::clone(&heard), Arc::clone(&heard), Arc::clone(&heard));
    let mut exec = executor(&node);
    exec.worker("manager")
        .budget(budget())
        .replies(
            &change,
            move |reply: Result<&srv::ChangeStateResponse, _>, _| {
                let text = format!("changed {}", reply.unwrap().success);
                changed.lock().unwrap().push(text);
            },
        )
        .unwrap()
        .replies(
            &state,
            move |reply: Result<&srv::GetStateResponse, _>, _| {
                let text = format!("state {}", reply.unwrap().current_state.id);
                asked.lock().unwrap().push(text);
            },
        )
        .unwrap()
        .subscribe(
            &node,
            "/peer/camera/transition_event",
            Qos::reliable().keep_last(100),
            move |event: &TransitionEvent, _| {
                let text = format!("event {}", event.goal_state.id);
                events.lock().unwrap().push(text);
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["managed"]);
    assert_eq!(peer.line(), "ready");
    assert!(change.wait_for_server(limit).unwrap() && state.wait_for_server(limit).unwrap());
    let count = |kind: &str| {
        let heard = heard.lock().unwrap();
        heard.iter().filter(|text| text.starts_with(kind)).count()
    };
    let last = |kind: &str| {
        let heard = heard.lock().unwrap();
        let last = heard.iter().rfind(|text| text.starts_with(kind));
        last.cloned().unwrap_or_default()
    };
    for (number, (id, to)) in [ROUND; ROUNDS].concat().into_iter().enumerate() {
        let label = String::new();
        let transition = Asked { id, label };
        change
            .call(&srv::ChangeStateRequest { transition })
            .unwrap();
        assert!(eventually(|| count("changed") > number), "{number}");
        assert_eq!(last("changed"), "changed true");
        state.call(&srv::GetStateRequest::default()).unwrap();
        assert!(eventually(|| count("state") > number), "{number}");
        assert_eq!(last("state"), format!("state {to}"));
    }
    // The node publishes one event for each transition that it completes, and one for its begin.
    let changes = ROUNDS * ROUND.len();
    assert!(
        eventually(|| count("event") == 2 * changes),
        "{}",
        count("event")
    );
    drop(running.stop());
}
