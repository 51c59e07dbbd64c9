//! Topics both ways: reliable, best effort, and transient local to late subscriptions.

use crate::peer::{Foreign, Peer};
use crate::support::{eventually, executor, node};
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::{Budget, Qos};
use std::sync::{Arc, Mutex};
use std::time::Duration;

type Text = BoundedString;

/// 200 numbers from rclpy come back to it through a worker with a budget: reliable, best effort.
pub(crate) fn topics(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let mut exec = executor(&node);
    for (kind, qos) in [
        ("reliable", Qos::reliable().keep_last(500)),
        ("best_effort", Qos::best_effort().keep_last(500)),
    ] {
        let back = node
            .publisher::<Int32>(&format!("{kind}_from_ours"), qos)
            .unwrap();
        exec.worker(kind)
            .budget(Budget::of(Duration::from_millis(20)).every(Duration::from_millis(100)))
            .subscribe(
                &node,
                &format!("{kind}_to_ours"),
                qos,
                move |m: &Int32, _| back.publish(m),
            )
            .unwrap();
    }
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["topics", "200"]);
    assert_eq!(peer.line(), "reliable 200 True");
    assert_eq!(peer.line(), "best_effort 200 True");
    for kind in ["reliable", "best_effort"] {
        let id = format!("/peer/ours/sub:/peer/{kind}_to_ours");
        let stats = || running.stats(&id).unwrap();
        // And those by which both got to know each other.
        assert!(stats().received >= 200, "{kind}: {:?}", stats());
        // The last callback is counted after the peer has its answer.
        let all_executed = || Some(stats()).is_some_and(|s| s.executed == s.received);
        assert!(eventually(all_executed), "{kind}: {:?}", stats());
    }
    drop(running.stop());
}

pub(crate) fn late_joiners(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let latched = Qos::reliable().keep_last(3).transient_local();
    let out = node
        .publisher::<Text>("latched_from_ours", latched)
        .unwrap();
    for text in ["1", "22", "333"] {
        let data = text.try_into().unwrap();
        out.publish(&Text { data }).unwrap();
    }
    let peer = Peer::start(foreign, domain, &["late"]);
    assert_eq!(peer.line(), "ready");
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    let mut exec = executor(&node);
    exec.worker("late")
        .subscribe(&node, "latched_to_ours", latched, move |m: &Text, _| {
            sink.lock().unwrap().push(m.data.to_string());
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert_eq!(peer.line(), "late 1 22 333");
    assert!(eventually(|| heard.lock().unwrap().len() == 3));
    assert_eq!(*heard.lock().unwrap(), ["one", "two", "three"]);
    drop(running.stop());
}
