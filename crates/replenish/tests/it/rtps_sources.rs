//! Workers that receive from their own sockets: best-effort subscriptions over RTPS, past the
//! dispatcher.

use crate::common::{Gate, eventually, executor, settles};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{
    CallbackContext, Context, HandleOptions, Node, Publisher, Qos, Removal, RunningExecutor,
    Trigger, WorkerBuilder,
};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::{Watchdog, watchdog};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: u64 = 1_000_000;

/// Numbers in the order in which callbacks saw them.
#[derive(Clone, Default)]
struct Heard(Arc<Mutex<Vec<i32>>>);

impl Heard {
    fn push(&self, number: i32) {
        self.0.lock().unwrap().push(number);
    }

    /// Without those from before the test began.
    fn all(&self) -> Vec<i32> {
        let all = self.0.lock().unwrap();
        all.iter().copied().filter(|number| *number >= 0).collect()
    }

    fn any(&self) -> bool {
        !self.0.lock().unwrap().is_empty()
    }
}

/// A participant that publishes, and one that subscribes; nobody else is in their domain.
struct Pair {
    from: Node,
    to: Node,
    _dog: Watchdog,
}

impl Pair {
    fn new(test: &'static str) -> Self {
        let dog = watchdog(test, Duration::from_secs(60));
        let config = RtpsConfig {
            domain: domain(),
            range: DiscoveryRange::Localhost,
            interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
            ..RtpsConfig::default()
        };
        let [from, to] = [(); 2].map(|()| Context::new(Rtps::open(&config).unwrap()));
        Self {
            from: from.node("from").unwrap(),
            to: to.node("to").unwrap(),
            _dog: dog,
        }
    }

    fn publisher(&self, topic: &str) -> Publisher<Int32> {
        self.from.publisher(topic, Qos::best_effort()).unwrap()
    }

    /// Runs both; `describe` gives the only worker its handles.
    fn start(
        &self,
        describe: impl FnOnce(WorkerBuilder<'_>),
    ) -> (RunningExecutor, RunningExecutor) {
        let (mut exec, _) = executor(self.to.context());
        describe(exec.worker("w"));
        let to = exec.start().unwrap();
        let (mut exec, _) = executor(self.from.context());
        exec.worker("idle")
            .timer(Duration::from_secs(60), |_| ())
            .unwrap();
        (to, exec.start().unwrap())
    }
}

fn send(to: &Publisher<Int32>, data: i32) {
    to.publish(&Int32 { data }).unwrap();
}

/// Publishes numbers below zero until one is heard.
fn meet(publisher: &Publisher<Int32>, heard: &Heard) {
    assert!(eventually(|| {
        send(publisher, -1);
        std::thread::sleep(Duration::from_millis(10));
        heard.any()
    }));
}

/// The dispatcher has taken no sample, and none is lost.
#[test]
fn a_worker_takes_its_samples_in_order_past_the_dispatcher() {
    let pair = Pair::new("own samples");
    let (out, heard) = (pair.publisher("t"), Heard::default());
    let sink = heard.clone();
    let qos = Qos::best_effort().keep_last(300);
    let running = pair.start(|worker| {
        let called = move |m: &Int32, _: &CallbackContext<'_>| sink.push(m.data);
        worker.subscribe(&pair.to, "t", qos, called).unwrap();
    });
    meet(&out, &heard);
    for number in 0..200 {
        send(&out, number);
    }
    assert!(eventually(|| heard.all().len() == 200), "{:?}", heard.all());
    assert_eq!(heard.all(), (0..200).collect::<Vec<_>>());
    let report = running.0.stop();
    assert_eq!(report.dispatcher.samples, 0, "{report}");
    let stats = &report.handles[0].stats;
    assert_eq!((stats.lost, stats.dropped), (0, 0), "{report}");
    assert_eq!(stats.received, stats.executed, "{report}");
}

/// Of more samples than the subscription keeps the last ones stay, also while its worker is busy.
/// A sample's latency counts from when the kernel had it.
#[test]
fn the_newest_samples_stay_and_bear_their_arrival() {
    let pair = Pair::new("newest");
    let (out, heard, gate) = (pair.publisher("t"), Heard::default(), Gate::closed());
    let (sink, inside) = (heard.clone(), gate.clone());
    let running = pair.start(|worker| {
        let called = move |m: &Int32, _: &CallbackContext<'_>| {
            sink.push(m.data);
            if m.data == 0 {
                inside.pass();
            }
        };
        let qos = Qos::best_effort().keep_last(5);
        worker.subscribe(&pair.to, "t", qos, called).unwrap();
    });
    meet(&out, &heard);
    send(&out, 0);
    gate.arrived();
    for number in 1..=50 {
        send(&out, number);
    }
    std::thread::sleep(Duration::from_millis(60));
    gate.open();
    assert!(eventually(|| heard.all().last() == Some(&50)));
    assert_eq!(heard.all(), [0, 46, 47, 48, 49, 50]);
    let stats = running.0.stop().handles[0].stats;
    assert_eq!((stats.dropped, stats.lost), (45, 0));
    assert!(stats.worst_latency >= 50 * MS, "{}", stats.worst_latency);
}

/// A sample for the handle with the higher priority runs before samples that waited longer.
#[test]
fn the_handle_with_the_higher_priority_has_its_turn_first() {
    let pair = Pair::new("priority");
    let [low, high] = ["low", "high"].map(|topic| pair.publisher(topic));
    let (heard, gate) = ([Heard::default(), Heard::default()], Gate::closed());
    let all = Heard::default();
    let running = pair.start(|worker| {
        let qos = Qos::best_effort().keep_last(20);
        let (sink, order, inside) = (heard[0].clone(), all.clone(), gate.clone());
        let called = move |m: &Int32, _: &CallbackContext<'_>| {
            sink.push(m.data);
            order.push(m.data);
            if m.data == 0 {
                inside.pass();
            }
        };
        let worker = worker.subscribe(&pair.to, "low", qos, called).unwrap();
        let (sink, order) = (heard[1].clone(), all.clone());
        let called = move |m: &Int32, _: &CallbackContext<'_>| {
            sink.push(m.data);
            order.push(m.data);
        };
        worker
            .subscribe(&pair.to, "high", qos, called)
            .unwrap()
            .options(HandleOptions::new().priority(9));
    });
    meet(&low, &heard[0]);
    meet(&high, &heard[1]);
    send(&low, 0);
    gate.arrived();
    for number in 1..=3 {
        send(&low, number);
    }
    send(&high, 100);
    gate.open();
    assert!(eventually(|| all.all().len() == 5), "{:?}", all.all());
    assert_eq!(all.all(), [0, 100, 1, 2, 3]);
    drop(running);
}

/// Both subscriptions of one topic hear each sample once, on two workers.
#[test]
fn two_workers_hear_one_topic() {
    let pair = Pair::new("two workers");
    let (out, heard) = (pair.publisher("t"), [Heard::default(), Heard::default()]);
    let (mut exec, _) = executor(pair.to.context());
    for (name, heard) in ["a", "b"].into_iter().zip(&heard) {
        let sink = heard.clone();
        let qos = Qos::best_effort().keep_last(200);
        exec.worker(name)
            .subscribe(&pair.to, "t", qos, move |m: &Int32, _| sink.push(m.data))
            .unwrap();
    }
    let to = exec.start().unwrap();
    let (mut exec, _) = executor(pair.from.context());
    exec.worker("idle")
        .timer(Duration::from_secs(60), |_| ())
        .unwrap();
    let _from = exec.start().unwrap();
    heard.iter().for_each(|heard| meet(&out, heard));
    for number in 0..100 {
        send(&out, number);
    }
    for heard in &heard {
        assert!(eventually(|| heard.all().len() == 100));
        assert_eq!(heard.all(), (0..100).collect::<Vec<_>>());
    }
    assert_eq!(to.stop().dispatcher.samples, 0);
}

/// A trigger sees what has come, and rounds by the clock take it when they begin.
#[test]
fn triggers_and_clocked_rounds_see_samples() {
    let pair = Pair::new("trigger");
    let [a, b] = ["a", "b"].map(|topic| pair.publisher(topic));
    let heard = [Heard::default(), Heard::default()];
    let running = pair.start(|worker| {
        let mut worker = worker.trigger(Trigger::All);
        for (topic, heard) in ["a", "b"].into_iter().zip(&heard) {
            let sink = heard.clone();
            let called = move |m: &Int32, _: &CallbackContext<'_>| sink.push(m.data);
            let qos = Qos::best_effort().keep_last(1);
            worker = worker.subscribe(&pair.to, topic, qos, called).unwrap();
        }
    });
    assert!(eventually(|| {
        send(&a, -1);
        send(&b, -1);
        std::thread::sleep(Duration::from_millis(10));
        heard.iter().all(Heard::any)
    }));
    let count = || heard[0].0.lock().unwrap().len();
    assert!(settles(count));
    send(&a, 0);
    send(&a, 1);
    std::thread::sleep(Duration::from_millis(50));
    assert!(heard[0].all().is_empty(), "the other one has nothing");
    send(&b, 2);
    assert!(eventually(|| heard[1].all() == [2]));
    assert_eq!(heard[0].all(), [1], "the newest");
    drop(running);

    let pair = Pair::new("clocked");
    let (out, heard) = (pair.publisher("t"), Heard::default());
    let sink = heard.clone();
    let running = pair.start(|worker| {
        let qos = Qos::best_effort().keep_last(100);
        let called = move |m: &Int32, _: &CallbackContext<'_>| sink.push(m.data);
        worker
            .every(Duration::from_millis(20))
            .messages_per_round(100)
            .subscribe(&pair.to, "t", qos, called)
            .unwrap();
    });
    meet(&out, &heard);
    for number in 0..50 {
        send(&out, number);
    }
    assert!(eventually(|| heard.all().len() == 50));
    assert_eq!(heard.all(), (0..50).collect::<Vec<_>>());
    let report = running.0.stop();
    assert_eq!(report.dispatcher.samples, 0, "{report}");
}

/// Handles come and go while their worker sleeps on their sockets, and a stop ends the sleep.
#[test]
fn handles_come_and_go_while_the_worker_waits_for_them() {
    let pair = Pair::new("come and go");
    let outs = ["a", "b"].map(|topic| pair.publisher(topic));
    let heard = [Heard::default(), Heard::default()];
    let (to, _from) = pair.start(|worker| {
        worker.capacity(2);
    });
    let qos = Qos::best_effort().keep_last(50);
    let handle = to.handle();
    for _ in 0..3 {
        let ids = ["a", "b"].map(|topic| {
            let sink = heard[usize::from(topic == "b")].clone();
            let worker = handle.worker("w").unwrap();
            let called = move |m: &Int32, _: &CallbackContext<'_>| sink.push(m.data);
            worker.subscribe(&pair.to, topic, qos, called).unwrap()
        });
        for (out, heard) in outs.iter().zip(&heard) {
            heard.0.lock().unwrap().clear();
            meet(out, heard);
            for number in 0..20 {
                send(out, number);
            }
            assert!(eventually(|| heard.all().len() == 20));
            assert_eq!(heard.all(), (0..20).collect::<Vec<_>>());
        }
        for id in ids {
            let stats = handle.remove(&id, Removal::Wait(Duration::from_secs(10)));
            assert_eq!(stats.unwrap().lost, 0);
        }
        let before = heard[0].all().len();
        send(&outs[0], 99);
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(heard[0].all().len(), before, "it was removed");
    }
    assert_eq!(to.stop().dispatcher.samples, 0);
}

/// A deadline is watched by the dispatcher, which takes the samples of such a subscription, and
/// those of a reliable one.
#[test]
fn the_dispatcher_takes_what_is_answered_in_time() {
    let pair = Pair::new("answered");
    let time = Duration::from_secs(60);
    let promised = Qos::best_effort().deadline(time);
    let outs = [
        pair.from.publisher("deadline", promised).unwrap(),
        pair.from.publisher("reliable", Qos::reliable()).unwrap(),
    ];
    let heard = [Heard::default(), Heard::default()];
    let running = pair.start(|worker| {
        let ends = [("deadline", promised), ("reliable", Qos::reliable())];
        let mut worker = worker;
        for ((topic, qos), heard) in ends.into_iter().zip(&heard) {
            let sink = heard.clone();
            let called = move |m: &Int32, _: &CallbackContext<'_>| sink.push(m.data);
            worker = worker.subscribe(&pair.to, topic, qos, called).unwrap();
        }
    });
    for (out, heard) in outs.iter().zip(&heard) {
        meet(out, heard);
    }
    let report = running.0.stop();
    let received: u64 = report.handles.iter().map(|h| h.stats.received).sum();
    assert_eq!(report.dispatcher.samples, received, "{report}");
}
