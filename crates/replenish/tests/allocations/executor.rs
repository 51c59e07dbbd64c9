//! After the start nothing allocates: not the dispatcher, not the workers, not the enforcer, over
//! 10 000 messages of 4 kB and as many small ones, with timers running.

use crate::ALLOC;
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::msg::wire::Encode;
use replenish::msg::{CdrError, CdrReader, CdrWriter, Message, Service};
use replenish::{
    Budget, Context, Descriptor, Executor, Outcome, ParameterOptions, ParameterValue, Policy, Qos,
    SpinEnd, Transition,
};
use replenish_interfaces::lifecycle_msgs::srv::GetState;
use replenish_interfaces::rcl_interfaces::msg::{ParameterValueView, ParameterView};
use replenish_interfaces::rcl_interfaces::srv::SetParameters;
use replenish_testkit::alloc::exempt_this_thread;
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const MESSAGES: u64 = 10_000;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("nothing_allocates_in_time_sharing", || {
            allocations(false);
        }),
        trial("nothing_allocates_without_threads", without_threads),
        trial("nothing_allocates_for_parameters", parameters),
        trial("nothing_allocates_for_managed_nodes", managed),
        rt_trial("nothing_allocates_under_budgets", || allocations(true)),
    ]
}

/// Ping-pong: a small message and a large one there, the small one back.
#[allow(clippy::unwrap_used, reason = "a test may panic")]
fn allocations(budgets: bool) {
    let _dog = watchdog("allocations", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_all(4);
    let small = node.publisher::<Int32>("small", qos).unwrap();
    let large = node.publisher::<UInt8MultiArray>("large", qos).unwrap();
    let back = node.publisher::<Int32>("back", qos).unwrap();
    let answers = Arc::new(AtomicU64::new(0));
    let bytes = Arc::new(AtomicU64::new(0));
    let ms = Duration::from_millis;

    let mut exec = Executor::new(&ctx);
    exec.no_ledger();
    let (count, sum) = (Arc::clone(&answers), Arc::clone(&bytes));
    let mut high = exec.worker("high");
    if budgets {
        high = high.budget(Budget::of(ms(2)).every(ms(10))).cpu(1);
    }
    high.subscribe(&node, "small", qos, move |m: &Int32, _| back.publish(m))
        .unwrap()
        .timer(ms(1), |_| ())
        .unwrap();
    let mut low = exec.worker("low");
    if budgets {
        low = low.policy(Policy::fifo(5).unwrap()).cpu(1);
    }
    low.subscribe(&node, "large", qos, move |m: &UInt8MultiArray, _| {
        sum.fetch_add(m.data.len() as u64, Ordering::Relaxed);
    })
    .unwrap();
    exec.worker("back")
        .subscribe(&node, "back", qos, move |_: &Int32, _| {
            count.fetch_add(1, Ordering::Relaxed);
        })
        .unwrap();
    let running = exec.start().unwrap();

    exempt_this_thread();
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(4096, 7).unwrap();
    let patience = Duration::from_micros(50);
    // Once there and back, so that every thread has begun.
    small.publish(&Int32::default()).unwrap();
    large.publish(&payload).unwrap();
    let begun = || answers.load(Ordering::Relaxed) == 1 && bytes.load(Ordering::Relaxed) > 0;
    while !begun() {
        std::thread::sleep(patience);
    }
    answers.store(0, Ordering::Relaxed);
    bytes.store(0, Ordering::Relaxed);
    ALLOC.arm();
    for n in 0..MESSAGES {
        // No more under way than every queue holds, so that every message gets its answer.
        while n >= answers.load(Ordering::Relaxed) + 4 {
            std::thread::sleep(patience);
        }
        let data = i32::try_from(n).unwrap();
        small.publish(&Int32 { data }).unwrap();
        while large.publish(&payload).is_err() {
            std::thread::sleep(patience);
        }
    }
    while answers.load(Ordering::Relaxed) < MESSAGES
        || bytes.load(Ordering::Relaxed) < MESSAGES * 4096
    {
        std::thread::sleep(patience);
    }
    let counted = ALLOC.disarm();
    let report = running.stop();
    assert_eq!(counted, 0, "{report}");
    assert!(report.thread("high").unwrap().usage.cpu_high > 0);
}

/// Every way to spin on the caller's thread.
#[allow(clippy::unwrap_used, reason = "a test may panic")]
fn without_threads() {
    let _dog = watchdog("allocations", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable();
    let publisher = node.publisher::<Int32>("t", qos).unwrap();
    let mut exec = Executor::new(&ctx);
    exec.worker("w")
        .subscribe(&node, "t", qos, |_: &Int32, _| ())
        .unwrap()
        .timer(Duration::from_micros(300), |_| ())
        .unwrap();
    let mut local = exec.local().unwrap();
    ALLOC.arm();
    let mut callbacks = 0;
    for data in 0..200 {
        publisher.publish(&Int32 { data }).unwrap();
        callbacks += local.spin_some(Duration::from_millis(1)).callbacks;
        callbacks += local.spin_for(Duration::from_micros(200)).callbacks;
        callbacks += local.spin_one_period(Duration::from_micros(400)).callbacks;
    }
    assert_eq!(ALLOC.disarm(), 0);
    assert!(callbacks > 200);
    assert_eq!(local.stats("/n/sub:/t").unwrap().executed, 200);
}

/// Parameters are read and set, by the program and over the wire.
#[allow(clippy::unwrap_used, reason = "a test may panic")]
fn parameters() {
    let _dog = watchdog("allocations", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    let declare = |name, value: ParameterValue<'_>| {
        parameters.declare(name, value, Descriptor::new()).unwrap();
    };
    declare("gain", 0.5.into());
    declare("text", "".into());
    declare("list", (&[0.5; 4][..]).into());
    parameters.veto(|change| match change.new {
        ParameterValue::Double(v) if v < 0.0 => Err("negative"),
        _ => Ok(()),
    });
    let client = node
        .client::<Raw>("/n/set_parameters", Qos::services(), Duration::from_secs(9))
        .unwrap();
    let mut exec = Executor::new(&ctx);
    exec.worker("p").parameters(&parameters).unwrap();
    exec.worker("c").replies(&client, |_, _| ()).unwrap();
    let mut local = exec.local().unwrap();
    ALLOC.arm();
    for n in 0..100_u32 {
        let value = f64::from(n) - 50.0;
        assert_eq!(parameters.set("gain", value).is_ok(), value >= 0.0);
        parameters.set("text", "a longer text than before").unwrap();
        parameters.set("list", &[value; 9][..]).unwrap();
        let gain: f64 = parameters.get("gain").unwrap();
        assert!(gain >= 0.0);
        client.call(&Raw).unwrap();
        local.spin_for(Duration::from_micros(300));
    }
    while local.spin_some(Duration::from_millis(10)).end == SpinEnd::Worked {}
    assert_eq!(ALLOC.disarm(), 0);
    let served = local.stats("/n/srv:/n/set_parameters").unwrap();
    assert_eq!((served.executed, served.errors), (100, 0));
    assert_eq!(
        local.stats("/n/cli:/n/set_parameters").unwrap().executed,
        100
    );
}

/// A node goes through its states, by the program and over the wire, with callbacks, events and a
/// publisher that is silent unless it is active.
#[allow(clippy::unwrap_used, reason = "a test may panic")]
fn managed() {
    let _dog = watchdog("allocations", Duration::from_secs(120));
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let steps = [Transition::Activate, Transition::Deactivate];
    for step in [steps[0], steps[1], Transition::Configure] {
        lifecycle.on_transition(step, |_| Outcome::Success);
    }
    let out = lifecycle.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let client = node
        .client::<GetStateRaw>("/n/get_state", Qos::services(), Duration::from_secs(9))
        .unwrap();
    let mut exec = Executor::new(&ctx);
    exec.worker("l").lifecycle(&lifecycle).unwrap();
    exec.worker("c")
        .replies(&client, |_, _| ())
        .unwrap()
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let mut local = exec.local().unwrap();
    lifecycle.change(Transition::Configure).unwrap();
    ALLOC.arm();
    for n in 0..100 {
        lifecycle.change(steps[n % 2]).unwrap();
        assert!(lifecycle.change(Transition::Configure).is_err());
        let sent = out.publish(&Int32 { data: 1 }).unwrap();
        assert_eq!(sent, n % 2 == 0);
        client.call(&GetStateRaw).unwrap();
        local.spin_for(Duration::from_micros(300));
    }
    while local.spin_some(Duration::from_millis(10)).end == SpinEnd::Worked {}
    assert_eq!(ALLOC.disarm(), 0);
    assert_eq!(local.stats("/n/sub:/t").unwrap().executed, 50);
    let served = local.stats("/n/srv:/n/get_state").unwrap();
    assert_eq!((served.executed, served.errors), (100, 0));
}

/// A question for the state, which has no fields; the answer is not looked at.
#[derive(Default)]
struct GetStateRaw;

impl Message for GetStateRaw {
    const TYPE_NAME: &'static str = "any";
    const DDS_TYPE_NAME: &'static str = "any";
    const MAX_SIZE: usize = 4100;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bytes(&[0])
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        r.bytes(r.remaining()).map(drop)
    }
}

impl Service for GetStateRaw {
    type Request = Self;
    type Response = Self;
    const TYPE_NAME: &'static str = GetState::TYPE_NAME;
}

/// A request to set `text`, as bytes; the response is not looked at.
#[derive(Default)]
struct Raw;

impl Message for Raw {
    const TYPE_NAME: &'static str = "any";
    const DDS_TYPE_NAME: &'static str = "any";
    const MAX_SIZE: usize = 4100;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(1)?;
        let value = ParameterValueView {
            r#type: 4,
            string_value: "and a text of quite another length",
            ..ParameterValueView::default()
        };
        let name = "text";
        ParameterView { name, value }.put(w)
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        r.bytes(r.remaining()).map(drop)
    }
}

impl Service for Raw {
    type Request = Self;
    type Response = Self;
    const TYPE_NAME: &'static str = SetParameters::TYPE_NAME;
}
