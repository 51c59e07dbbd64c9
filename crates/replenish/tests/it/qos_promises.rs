//! Deadlines, liveliness and lifespans: promises over time, and the events when they are broken. In
//! one process and over RTPS.

use crate::common::agent::TestAgent;
use crate::common::{Gate, eventually, executor};
use crate::heard::Heard;
use replenish::middleware::InProcessBus;
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::Int32;
use replenish::qos::Liveliness;
use replenish::{Context, Publisher, Qos, QosEvent};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);

impl Heard {
    /// The sums of all changes, which are the last totals.
    fn sums(&self) -> Sums {
        let mut sums = Sums::default();
        for event in &self.all() {
            let (count, sum) = match event {
                QosEvent::Matched { current, .. } => (current, &mut sums.matched),
                QosEvent::DeadlineMissed(count) => (count, &mut sums.missed),
                QosEvent::LivelinessLost(count) => (count, &mut sums.lost),
                QosEvent::LivelinessChanged { alive, not_alive } => {
                    sums.not_alive += not_alive.change;
                    assert_eq!(not_alive.total, sums.not_alive.unsigned_abs(), "{event:?}");
                    (alive, &mut sums.alive)
                }
                _ => continue,
            };
            *sum += count.change;
            assert_eq!(count.total, sum.unsigned_abs(), "{event:?}");
        }
        sums
    }
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Sums {
    matched: i64,
    missed: i64,
    lost: i64,
    alive: i64,
    not_alive: i64,
}

fn rtps(domain: u16) -> Context {
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    Context::new(Rtps::open(&config).unwrap())
}

/// Two contexts that hear each other: in one process, over RTPS.
fn pairs() -> [[Context; 2]; 2] {
    let (bus, domain) = (InProcessBus::new(), domain());
    [
        [(); 2].map(|()| Context::new(bus.participant())),
        [(); 2].map(|()| rtps(domain)),
    ]
}

/// A publisher and a subscription of this quality; `body` gets what each has heard.
fn between(
    [here, there]: &[Context; 2],
    qos: Qos,
    body: impl FnOnce(&Publisher<Int32>, &Heard, &Heard),
) {
    let (node, other) = (here.node("here").unwrap(), there.node("there").unwrap());
    let out = node.publisher::<Int32>("t", qos).unwrap();
    let (writes, reads) = (Heard::default(), Heard::default());
    let (mut exec, _) = executor(here);
    exec.worker("w").on_event(&out, writes.sink()).unwrap();
    let (mut peer, _) = executor(there);
    peer.worker("v")
        .subscribe(&other, "t", qos, |_: &Int32, _| ())
        .unwrap()
        .on_event("/there/sub:/t", reads.sink())
        .unwrap();
    let (running, peer) = (exec.start().unwrap(), peer.start().unwrap());
    assert!(eventually(
        || writes.sums().matched == 1 && reads.sums().matched == 1
    ));
    body(&out, &writes, &reads);
    drop((running.stop(), peer.stop()));
}

/// Nothing is missed before the first sample; then every period without one is, at both ends, until
/// there are samples again.
#[test]
fn deadlines_that_are_missed_are_told_at_both_ends() {
    let _dog = watchdog("deadlines", LIMIT);
    for pair in pairs() {
        between(
            &pair,
            Qos::reliable().deadline(40 * MS),
            |out, writes, reads| {
                std::thread::sleep(200 * MS);
                assert_eq!((writes.sums().missed, reads.sums().missed), (0, 0));
                out.publish(&Int32 { data: 1 }).unwrap();
                let many = || writes.sums().missed >= 5 && reads.sums().missed >= 5;
                assert!(eventually(many), "{:?} {:?}", writes.sums(), reads.sums());
            },
        );
    }
}

/// A publisher that has to show that it is alive, and does not: both ends hear it, once. It is back
/// as soon as it says so, or publishes.
#[test]
fn a_silent_publisher_is_not_alive_until_it_says_so() {
    let _dog = watchdog("liveliness", LIMIT);
    let qos = Qos::reliable()
        .liveliness(Liveliness::ManualByTopic)
        .lease(150 * MS);
    for pair in pairs() {
        between(&pair, qos, |out, writes, reads| {
            out.publish(&Int32 { data: 1 }).unwrap();
            for lost in 1..=2 {
                let silent = || {
                    let (w, r) = (writes.sums(), reads.sums());
                    w.lost == lost && (r.alive, r.not_alive) == (0, 1)
                };
                assert!(eventually(silent), "{:?} {:?}", writes.sums(), reads.sums());
                // It may be silent again before the subscription looks.
                let back = || {
                    out.assert_liveliness().unwrap();
                    (reads.sums().alive, reads.sums().not_alive) == (1, 0)
                };
                assert!(eventually(back), "{:?}", reads.sums());
            }
        });
    }
}

/// A publisher whose liveliness is automatic publishes nothing for many leases, and stays alive; a
/// subscription that asks for a sign more often does not match.
#[test]
fn a_quiet_publisher_stays_alive_as_long_as_its_program() {
    let _dog = watchdog("automatic", LIMIT);
    for pair in pairs() {
        between(
            &pair,
            Qos::reliable().lease(400 * MS),
            |_, writes, reads| {
                std::thread::sleep(1600 * MS);
                let (w, r) = (writes.sums(), reads.sums());
                assert_eq!(
                    (w.lost, r.alive, r.not_alive),
                    (0, 1, 0),
                    "{:?}",
                    reads.all()
                );
            },
        );
    }
}

#[test]
fn a_lease_that_is_too_long_does_not_match() {
    let _dog = watchdog("a long lease", LIMIT);
    for [here, there] in pairs() {
        let (node, other) = (here.node("here").unwrap(), there.node("there").unwrap());
        let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
        let clash = Arc::new(Mutex::new(Vec::new()));
        let sink = Arc::clone(&clash);
        let (mut exec, log) = executor(&here);
        exec.worker("w")
            .on_event(&out, move |event, _| {
                if let QosEvent::IncompatibleQos { policy, .. } = event {
                    sink.lock().unwrap().push(*policy);
                }
            })
            .unwrap();
        let (mut peer, _) = executor(&there);
        peer.worker("v")
            .subscribe(&other, "t", Qos::reliable().lease(MS), |_: &Int32, _| ())
            .unwrap();
        let (_running, _peer) = (exec.start().unwrap(), peer.start().unwrap());
        assert!(eventually(|| *clash.lock().unwrap() == ["liveliness"]));
        assert!(eventually(|| log.has("liveliness")), "{:?}", log.lines());
        assert_eq!(out.subscriptions(), Some(0));
    }
}

/// A sample that waits for longer than its lifespan is not delivered, wherever it waits.
#[test]
fn what_is_too_old_is_not_delivered() {
    let _dog = watchdog("lifespan", LIMIT);
    for [here, there] in pairs() {
        let (node, other) = (here.node("here").unwrap(), there.node("there").unwrap());
        let qos = Qos::reliable().lifespan(300 * MS);
        let out = node.publisher::<Int32>("t", qos).unwrap();
        let (gate, heard) = (Gate::closed(), Arc::new(Mutex::new(Vec::new())));
        let (held, sink) = (gate.clone(), Arc::clone(&heard));
        let (mut peer, _) = executor(&there);
        peer.worker("v")
            .subscribe(&other, "t", qos.keep_last(4), move |m: &Int32, _| {
                sink.lock().unwrap().push(m.data);
                held.pass();
            })
            .unwrap();
        let running = peer.start().unwrap();
        let (idle, _) = executor(&here);
        let mut idle = idle;
        idle.worker("idle").capacity(1);
        let _spins = idle.start().unwrap();
        assert!(out.wait_for_subscription(LIMIT).unwrap());
        // Each end knows the other by now, or soon.
        assert!(eventually(|| {
            out.publish(&Int32 { data: 0 }).unwrap();
            !heard.lock().unwrap().is_empty()
        }));
        gate.arrived();
        for data in 1..=3 {
            out.publish(&Int32 { data }).unwrap();
        }
        std::thread::sleep(600 * MS);
        gate.open();
        // Before newer ones displace them.
        let discarded = || running.stats("/there/sub:/t").unwrap().discarded;
        assert!(eventually(|| discarded() >= 3), "{}", discarded());
        assert!(eventually(|| {
            out.publish(&Int32 { data: 4 }).unwrap();
            heard.lock().unwrap().contains(&4)
        }));
        let heard = heard.lock().unwrap();
        let old = heard.iter().filter(|data| (1..=3).contains(*data));
        assert_eq!(old.count(), 0, "{heard:?}");
    }
}

#[test]
fn promises_that_cannot_be_kept_are_refused_by_name() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let short = [
        (Qos::reliable().deadline(MS / 2), "qos.deadline"),
        (Qos::reliable().lease(MS / 2), "qos.lease"),
    ];
    for (qos, field) in short {
        let refused = node.publisher::<Int32>("t", qos).unwrap_err().to_string();
        assert!(refused.contains(field), "{refused}");
        assert!(refused.contains("1 ms and more"), "{refused}");
    }
    let zero = Qos::reliable()
        .deadline(Duration::ZERO)
        .lease(Duration::ZERO);
    assert_eq!(Qos::reliable().check_offers(zero), Ok(()));

    let agent = TestAgent::start("127.0.0.1:0");
    let node = agent.context().node("n").unwrap();
    let refused = node.publisher::<Int32>("t", Qos::reliable().lease(MS));
    let refused = refused.unwrap_err().to_string();
    assert!(
        refused.contains("liveliness, which no agent tells"),
        "{refused}"
    );
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    assert!(out.assert_liveliness().is_err());
}
