//! QoS events between rclpy and us, both ways: deadlines that are missed, publishers that are
//! silent, and quiet ones that are alive all the same.

use crate::peer::{Foreign, Peer};
use crate::support::{eventually, executor, node};
use replenish::msg::std_msgs::Int32;
use replenish::{Executor, Liveliness, Node, Publisher, Qos, QosEvent};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The last value of each number of an endpoint.
#[derive(Clone, Copy, Debug, Default)]
struct Last {
    matched: u64,
    missed: u64,
    lost: u64,
    alive: u64,
    not_alive: u64,
    /// The largest number of silent publishers.
    most_silent: u64,
}

#[derive(Clone, Default)]
struct Heard(Arc<Mutex<Last>>);

impl Heard {
    fn last(&self) -> Last {
        *self.0.lock().unwrap()
    }

    fn keep(&self, event: &QosEvent) {
        let mut last = self.0.lock().unwrap();
        match event {
            QosEvent::Matched { current, .. } => last.matched = current.total,
            QosEvent::DeadlineMissed(count) => last.missed = count.total,
            QosEvent::LivelinessLost(count) => last.lost = count.total,
            QosEvent::LivelinessChanged { alive, not_alive } => {
                (last.alive, last.not_alive) = (alive.total, not_alive.total);
                last.most_silent = last.most_silent.max(not_alive.total);
            }
            _ => {}
        }
    }
}

fn offers(node: &Node, exec: &mut Executor, topic: &str, qos: Qos) -> (Publisher<Int32>, Heard) {
    let out = node.publisher::<Int32>(topic, qos).unwrap();
    let heard = Heard::default();
    let sink = heard.clone();
    exec.worker(topic)
        .on_event(&out, move |event, _| sink.keep(event))
        .unwrap();
    (out, heard)
}

fn asks(node: &Node, exec: &mut Executor, topic: &str, qos: Qos) -> Heard {
    let heard = Heard::default();
    let sink = heard.clone();
    exec.worker(topic)
        .subscribe(node, topic, qos, |_: &Int32, _| ())
        .unwrap()
        .on_event(&format!("/peer/ours/sub:/peer/{topic}"), move |event, _| {
            sink.keep(event);
        })
        .unwrap();
    heard
}

pub(crate) fn events(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let ms = Duration::from_millis;
    let deadline = Qos::reliable().deadline(ms(200));
    let automatic = Qos::reliable().lease(ms(3000));
    let manual = Qos::reliable()
        .lease(ms(1000))
        .liveliness(Liveliness::ManualByTopic);
    let mut exec = executor(&node);
    let (out, late) = offers(&node, &mut exec, "deadline_from_ours", deadline);
    let (by_hand, silent) = offers(&node, &mut exec, "manual_from_ours", manual);
    let (_quiet, quiet) = offers(&node, &mut exec, "automatic_from_ours", automatic);
    let theirs_late = asks(&node, &mut exec, "deadline_to_ours", deadline);
    let theirs_silent = asks(&node, &mut exec, "manual_to_ours", manual);
    let theirs_quiet = asks(&node, &mut exec, "automatic_to_ours", automatic);
    let running = exec.start().unwrap();

    let peer = Peer::start(foreign, domain, &["events"]);
    let ours = [&late, &silent, &quiet];
    assert!(eventually(|| ours
        .iter()
        .all(|heard| heard.last().matched == 1)));
    for publisher in [&out, &by_hand] {
        publisher.publish(&Int32 { data: 1 }).unwrap();
    }
    assert_eq!(peer.line(), "deadline missed");
    assert!(eventually(|| late.last().missed >= 3), "{:?}", late.last());
    assert_eq!(peer.line(), "silent 0");
    assert!(
        eventually(|| silent.last().lost == 1),
        "{:?}",
        silent.last()
    );
    // It may be silent again before a busy peer looks.
    let back = (0..600).find_map(|_| {
        by_hand.assert_liveliness().unwrap();
        peer.line_within(ms(100))
    });
    assert_eq!(back.as_deref(), Some("back 0"));
    assert_eq!(peer.line(), "quiet 1 0");
    assert_eq!(quiet.last().lost, 0);

    assert_eq!(peer.line(), "lost");
    let gone = || theirs_silent.last().not_alive == 1 && theirs_silent.last().alive == 0;
    assert!(eventually(gone), "{:?}", theirs_silent.last());
    assert_eq!(peer.line(), "missed");
    assert!(
        eventually(|| theirs_late.last().missed >= 3),
        "{:?}",
        theirs_late.last()
    );
    // It has been quiet for more than two leases.
    let quiet = theirs_quiet.last();
    assert_eq!((quiet.alive, quiet.most_silent), (1, 0), "{quiet:?}");
    drop(running.stop());
}
