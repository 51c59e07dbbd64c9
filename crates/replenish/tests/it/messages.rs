//! The sentences that a `main` shows: each as a user provokes it, however it is printed.

use crate::common::{Echo, executor};
use replenish::msg::std_msgs::Int32;
use replenish::planning::Machine;
use replenish::{
    Budget, Context, Error, Guarantee, Policy, PublishError, Qos, Topic, Transition, WorkerBuilder,
};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

fn ms(n: u32) -> Duration {
    n * MS
}

/// The text that `main` prints, and a report of errors with their sources.
fn shown(error: impl Into<Error>) -> String {
    let error: Error = error.into();
    let sentence = error.to_string();
    assert_eq!(format!("{error:?}"), sentence);
    assert_eq!(format!("{error:#?}"), sentence);
    assert!(std::error::Error::source(&error).is_none(), "{sentence}");
    sentence
}

/// The refusal of one worker with one timer, on a machine of one CPU.
fn refused(rules: impl Fn(WorkerBuilder<'_>) -> WorkerBuilder<'_>) -> String {
    let (mut exec, _) = executor(&Context::in_process());
    exec.machine(Machine::on_cpus(vec![0]));
    rules(exec.worker("control")).timer(MS, |_| ()).unwrap();
    shown(exec.start().err().unwrap())
}

#[test]
fn a_guarantee_is_refused_in_the_words_it_was_said() {
    let rate = |hertz| refused(|w| w.guarantee(Guarantee::at(hertz).taking(ms(20))));
    for (guarantee, sentence) in [
        (
            Guarantee::at(100.0).taking(ms(20)),
            "taking = 20 ms is longer than the period, 10 ms (100 Hz)",
        ),
        (
            Guarantee::at(33.3).taking(ms(31)),
            "taking = 31 ms is longer than the period, 30.03003 ms (33.3 Hz)",
        ),
        (
            Guarantee::at(100.0).taking(Duration::ZERO),
            "taking = 0 is no time: allowed is 1 ns or more",
        ),
        (
            Guarantee::of(ms(30)).every(ms(10)),
            "of = 30 ms is longer than the period, 10 ms",
        ),
        (
            Guarantee::of(ms(3)).every(Duration::ZERO),
            "every = 0 is no time: allowed is 1 ns to a day",
        ),
        (
            Guarantee::of(ms(3)).every(Duration::from_secs(100_000)),
            "every = 100000 s is longer than a day, 86400 s",
        ),
        (
            Guarantee::of(ms(3)).every(ms(10)).deadline(ms(20)),
            "deadline = 20 ms is longer than the period, 10 ms",
        ),
        (
            Guarantee::of(ms(3)).every(ms(10)).deadline(ms(2)),
            "of = 3 ms is longer than the deadline, 2 ms",
        ),
        (
            Guarantee::of(ms(3)).every(ms(10)).at_least(ms(4)),
            "at_least = 4 ms is more than of = 3 ms",
        ),
        (
            Guarantee::at(50.0).taking(ms(3)).up_to(ms(2)),
            "up_to = 2 ms is less than taking = 3 ms",
        ),
        (
            Guarantee::at(50.0).taking(ms(3)).up_to(ms(30)),
            "up_to = 30 ms is longer than the period, 20 ms (50 Hz)",
        ),
    ] {
        assert_eq!(
            refused(|w| w.guarantee(guarantee)),
            format!("worker \"control\": {sentence}")
        );
        assert_eq!(shown(guarantee.check().unwrap_err()), sentence);
    }
    for (hertz, said) in [
        (0.0, "0 Hz"),
        (-5.0, "-5 Hz"),
        (2e9, "2000000000 Hz"),
        (f64::INFINITY, "inf Hz"),
    ] {
        assert_eq!(
            rate(hertz),
            format!(
                "worker \"control\": at = {said} is not a rate: allowed is above 0 Hz to 1 GHz"
            )
        );
    }
    assert_eq!(
        rate(0.000_01),
        "worker \"control\": at = 0.00001 Hz is slower than once a day"
    );
    assert_eq!(
        refused(|w| w.budget(Budget::of(ms(20)).every(ms(10)))),
        "worker \"control\": budget = 20 ms every 10 ms is not allowed: \
         of = 20 ms is longer than the period, 10 ms"
    );
}

#[test]
fn a_refusal_says_once_who_does_not_fit_and_what_would() {
    let sentence = refused(|w| w.guarantee(Guarantee::of(ms(99)).every(ms(100))));
    assert_eq!(
        sentence,
        "worker \"control\" does not fit: on CPU 0 99.1 % would be reserved, 95 % are allowed; \
         94.9 ms every 100 ms would fit, or a period of 105 ms"
    );
}

#[test]
fn descriptions_that_cannot_be_are_refused() {
    let ctx = Context::in_process();
    let node = ctx.node("robot").unwrap();
    assert_eq!(
        shown(ctx.node("my robot").unwrap_err()),
        "node name \"my robot\": only letters, digits, _ and / are allowed"
    );
    assert_eq!(
        shown(node.publisher::<Int32>("a b", Qos::reliable()).unwrap_err()),
        "topic name \"a b\": only letters, digits, _ and / are allowed"
    );
    let none = Qos {
        depth: 0,
        ..Qos::reliable()
    };
    assert_eq!(
        shown(node.publisher::<Int32>("scan", none).unwrap_err()),
        "topic /scan: qos.depth = 0 is not allowed: 1..=4096"
    );
    assert_eq!(
        shown(Policy::fifo(0).unwrap_err()),
        "priority 0 is out of range: allowed 1 to 99"
    );
    let (mut exec, _) = executor(&ctx);
    exec.worker("idle").cpu(0);
    assert_eq!(
        shown(exec.start().err().unwrap()),
        "worker \"idle\" has no handle and no capacity for any"
    );
    let other = Context::in_process();
    let (mut exec, _) = executor(&other);
    let added = exec
        .worker("w")
        .subscribe(&node, "scan", Qos::reliable(), |_: &Int32, _| ());
    assert_eq!(
        shown(added.err().unwrap()),
        "node /robot belongs to another context than the executor"
    );
    let same = Topic::named("scan");
    let (mut exec, _) = executor(&ctx);
    let added =
        exec.worker("w")
            .subscribe(&node, same.max_size(0), Qos::reliable(), |_: &Int32, _| ());
    assert_eq!(
        shown(added.err().unwrap()),
        "topic /scan: max_size = 0 is not allowed: 1..=4 bytes"
    );
}

#[test]
fn errors_of_operations_become_the_error_of_main() {
    let ctx = Context::in_process();
    let node = ctx.node("robot").unwrap();
    assert_eq!(
        shown(Context::xrce_udp("no port").unwrap_err()),
        "the agent's address no port cannot be used: invalid socket address: allowed is an IP \
         address or a host, and a port, as 192.168.7.1:8888"
    );
    assert_eq!(
        shown(Context::xrce_serial("/nowhere", 115_200).unwrap_err()),
        "the agent's address /nowhere cannot be used: No such file or directory (os error 2)"
    );
    assert_eq!(shown(PublishError::Full), "the output queue is full");
    let client = node.client::<Echo>("echo", Qos::services(), MS).unwrap();
    assert_eq!(
        shown(client.call(&Default::default()).unwrap_err()),
        "the client has no callback for replies"
    );
    let lifecycle = node.lifecycle().unwrap();
    assert_eq!(
        shown(lifecycle.change(Transition::Activate).unwrap_err()),
        "not allowed in state unconfigured; allowed are: configure shutdown"
    );
    let parameters = node.parameters(Default::default()).unwrap();
    assert_eq!(
        shown(parameters.get::<f64>("speed").unwrap_err()),
        "speed: no such parameter"
    );
}
