//! `/diagnostics` and `/statistics` of an executor: who publishes them, and what they say.

use crate::common::{eventually, executor};
use replenish::{Context, HandleOptions, OnMiss, Qos, RunningExecutor, Topic};
use replenish_interfaces::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus};
use replenish_interfaces::statistics_msgs::msg::MetricsMessage;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const WARN: u8 = 1;
const SAMPLE_COUNT: u8 = 5;

#[derive(Default)]
struct Heard {
    diagnostics: Vec<DiagnosticArray>,
    statistics: Vec<MetricsMessage>,
}

/// An executor of its own that hears both topics.
fn listener(ctx: &Context) -> (RunningExecutor, Arc<Mutex<Heard>>) {
    let heard = Arc::<Mutex<Heard>>::default();
    let (mut exec, _) = executor(ctx);
    let node = ctx.node("listener").unwrap();
    let (first, second) = (Arc::clone(&heard), Arc::clone(&heard));
    let large = Topic::named("/diagnostics").max_size(1 << 20);
    let small = Topic::named("/statistics").max_size(4096);
    exec.worker("listener")
        .subscribe(
            &node,
            large,
            Qos::reliable(),
            move |m: &DiagnosticArray, _| {
                first.lock().unwrap().diagnostics.push(m.clone());
            },
        )
        .unwrap()
        .subscribe(
            &node,
            small,
            Qos::reliable().keep_last(64),
            move |m: &MetricsMessage, _| {
                second.lock().unwrap().statistics.push(m.clone());
            },
        )
        .unwrap();
    (exec.start().unwrap(), heard)
}

fn value<'a>(status: &'a DiagnosticStatus, key: &str) -> &'a str {
    let mut values = status.values.iter();
    &values.find(|pair| pair.key == key).unwrap().value
}

#[test]
fn diagnostics_name_the_late_worker_and_statistics_count_every_callback() {
    let bus = replenish::middleware::InProcessBus::new();
    let [ours, theirs] = [(); 2].map(|()| Context::new(bus.participant()));
    let (listener, heard) = listener(&theirs);
    ours.node("robot/arm").unwrap(); // the first one publishes
    let (mut exec, _) = executor(&ours);
    exec.diagnostics(true);
    exec.worker("late")
        .timer(20 * MS, |_| std::thread::sleep(5 * MS))
        .unwrap()
        .options(HandleOptions::new().deadline(MS, OnMiss::Count));
    exec.worker("well").timer(20 * MS, |_| ()).unwrap();
    exec.worker("fails")
        .timer(20 * MS, |_| -> Result<(), String> { Err("no".into()) })
        .unwrap();
    exec.chain("slow", ["late"], MS)
        .chain("free", ["late/timer:0"], None);
    let long = "ä".repeat(31); // the longest name of a worker has 63 bytes
    exec.worker(&long).timer(20 * MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| heard.lock().unwrap().diagnostics.len() >= 2));
    let report = running.stop();
    drop(listener.stop());

    let heard = heard.lock().unwrap();
    let last = heard.diagnostics.last().unwrap();
    assert!(last.header.stamp.sec > 0);
    let names: Vec<&str> = last.status.iter().map(|s| s.name.as_str()).collect();
    let program = names[0].strip_suffix(": dispatcher").unwrap();
    let of = |worker: &str| {
        let name = format!("{program}: {worker}");
        last.status.iter().find(|s| s.name == name).unwrap()
    };
    assert_eq!(names.len(), 7);
    assert!(names[4].ends_with(&long), "{}", names[4]);
    let late = of("late");
    assert_eq!(late.level, WARN, "{late:?}");
    assert!(late.message.contains("callbacks late"), "{late:?}");
    let misses: u64 = value(late, "late callbacks").parse().unwrap();
    let handle = report.handle("late/timer:0").unwrap();
    assert!((1..=handle.stats.deadline_misses).contains(&misses));
    let fails = of("fails");
    assert!(
        fails.level == WARN && fails.message.contains("failed"),
        "{fails:?}"
    );
    assert_eq!(value(of("well"), "budget (ms)"), "-");
    let slow = of("chain slow");
    assert_eq!(slow.level, WARN, "{slow:?}");
    assert!(slow.message.contains("beyond the limit"), "{slow:?}");
    assert_eq!(value(slow, "limit (ms)"), "1.000");
    let measured = report.chain("slow").unwrap();
    let counts = [
        ("instances", measured.ended),
        ("beyond the limit", measured.exceeded),
    ];
    for (key, most) in counts {
        let count: u64 = value(slow, key).parse().unwrap();
        assert!((1..=most).contains(&count), "{key}: {slow:?}");
    }
    let free = of("chain free");
    assert_eq!((free.level, &*free.message), (0, "ok"));
    assert_eq!(value(free, "limit (ms)"), "-");

    // Windows are disjoint, and each callback is in one of them.
    for source in ["latency", "response"] {
        let windows = heard.statistics.iter();
        let windows = windows
            .filter(|m| m.measurement_source_name == "late/timer:0" && m.metrics_source == source);
        let mut counted = 0.0;
        let mut end = (0, 0);
        for window in windows {
            let point = |kind| {
                let mut points = window.statistics.iter();
                points.find(|p| p.data_type == kind).unwrap().data
            };
            assert_eq!(window.unit, "ms");
            let start = (window.window_start.sec, window.window_start.nanosec);
            assert!(start >= end, "{window:?}");
            end = (window.window_stop.sec, window.window_stop.nanosec);
            let [average, min, max, deviation] = [1, 2, 3, 4].map(point);
            assert!(
                min <= average && average <= max && deviation >= 0.0,
                "{window:?}"
            );
            assert!(source == "latency" || min >= 5.0, "{window:?}");
            counted += point(SAMPLE_COUNT);
        }
        assert!(counted > 0.0 && counted <= handle.stats.executed as f64);
        assert!(handle.stats.worst_latency > 0);
    }
}

#[test]
fn nothing_is_published_unless_asked_for_where_the_context_is_not_of_ros() {
    for asked in [None, Some(false)] {
        let bus = replenish::middleware::InProcessBus::new();
        let [ours, theirs] = [(); 2].map(|()| Context::new(bus.participant()));
        let (listener, heard) = listener(&theirs);
        ours.node("robot").unwrap();
        let (mut exec, _) = executor(&ours);
        asked.map(|publish| exec.diagnostics(publish));
        exec.worker("w").timer(20 * MS, |_| ()).unwrap();
        let running = exec.start().unwrap();
        std::thread::sleep(1500 * MS);
        drop((running.stop(), listener.stop()));
        assert!(heard.lock().unwrap().diagnostics.is_empty());
    }
}

#[test]
fn a_context_without_a_node_says_why_nothing_is_published() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.diagnostics(true);
    exec.worker("w").timer(20 * MS, |_| ()).unwrap();
    let report = exec.start().unwrap().stop();
    let why = "/diagnostics is not published: the context has no node";
    assert!(
        report.fallbacks.iter().any(|f| &**f == why),
        "{:?}",
        report.fallbacks
    );
}
