//! QoS events: a callback on a worker hears what becomes of a publisher or subscription. In one
//! process, over RTPS, and refused where the middleware does not report it.

use crate::common::agent::TestAgent;
use crate::common::{Gate, eventually, executor};
use crate::heard::Heard;
use replenish::middleware::InProcessBus;
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{CallbackContext, Context, Error, Qos, QosEvent, Removal};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);

impl Heard {
    /// Peers at this moment and so far; each change leads from one event to the next.
    fn matched(&self) -> (u64, u64) {
        let (mut current, mut total) = (0, 0);
        for event in self.all() {
            if let QosEvent::Matched {
                total: t,
                current: c,
            } = event
            {
                current += c.change;
                total += t.change;
                assert_eq!(c.total, u64::try_from(current).unwrap(), "{event:?}");
                assert_eq!(t.total, u64::try_from(total).unwrap(), "{event:?}");
            }
        }
        (current.unsigned_abs(), total.unsigned_abs())
    }

    /// Number of peers that did not fit, and the policies by which they did not.
    fn incompatible(&self) -> (u64, Vec<&'static str>) {
        let all = self.all();
        let clashes = all.iter().filter_map(|event| match event {
            QosEvent::IncompatibleQos { count, policy } => Some((count.total, *policy)),
            _ => None,
        });
        let last = clashes.clone().next_back().map_or(0, |(total, _)| total);
        (last, clashes.map(|(_, policy)| policy).collect())
    }

    fn lost(&self) -> u64 {
        let all = self.all();
        let lost = all.iter().filter_map(|event| match event {
            QosEvent::MessageLost(count) => Some(count.change.unsigned_abs()),
            _ => None,
        });
        lost.sum()
    }
}

fn ignore(_: &Int32, _: &CallbackContext<'_>) {}

fn rtps(domain: u16) -> Context {
    let config = RtpsConfig {
        domain,
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    };
    Context::new(Rtps::open(&config).unwrap())
}

/// A subscription comes and goes, twice, and one comes that asks for too much; the publisher hears
/// of each. A publisher comes and goes; so does the subscription.
fn peers_come_and_go(here: &Context, there: impl Fn() -> Context) {
    let _dog = watchdog("peers come and go", LIMIT);
    let node = here.node("here").unwrap();
    let out = node.publisher::<Int32>("out", Qos::best_effort()).unwrap();
    let (of_out, of_sub) = (Heard::default(), Heard::default());
    let (mut exec, _) = executor(here);
    exec.worker("w")
        .subscribe(&node, "in", Qos::reliable(), ignore)
        .unwrap()
        .on_event(&out, of_out.sink())
        .unwrap();
    exec.worker("other")
        .on_event("/here/sub:/in", of_sub.sink())
        .unwrap();
    let running = exec.start().unwrap();
    for round in 1..=2 {
        let ctx = there();
        let node = ctx.node("there").unwrap();
        let good = node.publisher::<Int32>("in", Qos::reliable()).unwrap();
        let bad = node.publisher::<Int32>("in", Qos::best_effort()).unwrap();
        let (mut exec, _) = executor(&ctx);
        exec.worker("v")
            .subscribe(&node, "out", Qos::best_effort(), ignore)
            .unwrap()
            .subscribe(&node, "out", Qos::latched(), ignore)
            .unwrap();
        let peer = exec.start().unwrap();
        let found = || of_out.matched() == (1, round) && of_sub.matched() == (1, round);
        assert!(eventually(found), "{:?} {:?}", of_out.all(), of_sub.all());
        let clashed = || of_out.incompatible().0 == round && of_sub.incompatible().0 == round;
        assert!(eventually(clashed), "{:?} {:?}", of_out.all(), of_sub.all());
        drop((peer.stop(), good, bad, node, ctx));
        let gone = || of_out.matched() == (0, round) && of_sub.matched() == (0, round);
        assert!(eventually(gone), "{:?} {:?}", of_out.all(), of_sub.all());
    }
    for heard in [&of_out, &of_sub] {
        let policies = heard.incompatible().1;
        assert_eq!(policies, ["reliability"; 2], "{:?}", heard.all());
    }
    let stats = running.stats("other/events:/here/sub:/in").unwrap();
    assert!(stats.executed >= 4, "{stats:?}");
    drop(running.stop());
}

#[test]
fn peers_that_come_and_go_are_told_in_one_process() {
    let bus = InProcessBus::new();
    let here = Context::new(bus.participant());
    peers_come_and_go(&here, || Context::new(bus.participant()));
}

#[test]
fn peers_that_come_and_go_are_told_over_rtps() {
    let domain = domain();
    peers_come_and_go(&rtps(domain), || rtps(domain));
}

/// Both ends in one context: those that are there before the start are the first event, later ones
/// are reported by a running executor.
fn ends_of_one_context(ctx: &Context) {
    let _dog = watchdog("one context", LIMIT);
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (early, late) = (Heard::default(), Heard::default());
    let (mut exec, _) = executor(ctx);
    exec.worker("w")
        .capacity(8)
        .subscribe(&node, "t", Qos::reliable(), ignore)
        .unwrap()
        .on_event(&out, early.sink())
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| early.matched() == (1, 1)));
    let handle = running.handle();
    let worker = || handle.worker("w").unwrap();
    let second = worker()
        .subscribe(&node, "t", Qos::reliable(), ignore)
        .unwrap();
    assert!(eventually(|| early.matched() == (2, 2)));
    let id = worker().on_event(&second, late.sink()).unwrap();
    assert_eq!(id, format!("w/events:{second}"));
    assert!(eventually(|| late.matched() == (1, 1)));
    let again = worker().on_event(&second, late.sink()).unwrap_err();
    let only = "callbacks for the events of one endpoint: the limit is 1";
    assert!(again.to_string().contains(only), "{again}");
    // One that was removed makes room for another, and so does its endpoint for another.
    let wait = Removal::Wait(LIMIT);
    running.handle().remove(&id, wait).unwrap();
    let after = Heard::default();
    let id = worker().on_event(&second, after.sink()).unwrap();
    assert!(eventually(|| after.matched() == (1, 1)));
    running.handle().remove(&second, wait).unwrap();
    assert!(eventually(|| early.matched() == (1, 2)));
    running.handle().remove(&id, wait).unwrap();
    drop(running.stop());
}

#[test]
fn ends_of_one_context_are_told_of_each_other() {
    ends_of_one_context(&Context::in_process());
    ends_of_one_context(&rtps(domain()));
}

/// A subscription whose callback does not end loses what finds no room, and hears how much.
#[test]
fn lost_messages_are_told() {
    let _dog = watchdog("lost", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (gate, heard) = (Gate::closed(), Heard::default());
    let held = gate.clone();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .subscribe(
            &node,
            "t",
            Qos::best_effort().keep_all(2),
            move |_: &Int32, _| {
                held.pass();
            },
        )
        .unwrap();
    exec.worker("events")
        .on_event("/n/sub:/t", heard.sink())
        .unwrap();
    let running = exec.start().unwrap();
    for data in 0..50 {
        out.publish(&Int32 { data }).unwrap();
    }
    let lost = || running.stats("/n/sub:/t").unwrap().lost;
    assert!(eventually(|| lost() > 0 && heard.lost() == lost()));
    gate.open();
    let all = || running.stats("/n/sub:/t").unwrap();
    assert!(
        eventually(|| all().executed + all().lost == 50),
        "{:?}",
        all()
    );
    assert!(eventually(|| heard.lost() == lost()));
    drop(running.stop());
}

#[test]
fn events_of_nothing_and_of_agents_are_refused_by_name() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let unknown = exec.worker("w").on_event("/n/sub:/nothing", |_, _| ());
    let unknown = unknown.err().unwrap().to_string();
    assert!(unknown.contains("/n/sub:/nothing"), "{unknown}");
    assert!(unknown.contains("a publisher, or the id of"), "{unknown}");
    let other = Context::in_process().node("o").unwrap();
    let foreign = other.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let refused = exec.worker("v").on_event(&foreign, |_, _| ()).err();
    assert!(
        matches!(refused, Some(Error::ForeignNode(_))),
        "{refused:?}"
    );
    drop(node);

    let agent = TestAgent::start("127.0.0.1:0");
    let ctx = agent.context();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let refused = exec.worker("w").on_event(&out, |_, _| ()).err().unwrap();
    assert_eq!(
        refused.to_string(),
        "events of /t: not supported by this middleware: events of endpoints, which no agent tells"
    );
}
