//! Chains at run time: an instance is counted where it ends, and its latency is the sum of the
//! parts that the recording shows.

use crate::common::{Gate, eventually, executor};
use crate::recorder::{Directory, Read};
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::{Int32, UInt64};
use replenish::{
    ChainReport, Context, Dump, Error, Event as Told, Executor, Guarantee, GuardCondition, Node,
    Publisher, Qos, Report,
};
use replenish_recorder::{Event, Kind, NameKind};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
const HOUR: Duration = Duration::from_secs(3600);

fn roomy() -> Qos {
    Qos::reliable().keep_last(1000)
}

fn publisher(node: &Node, topic: &str) -> Publisher<Int32> {
    node.publisher::<Int32>(topic, roomy()).unwrap()
}

/// A worker that hands on what it hears.
fn stage(exec: &mut Executor, node: &Node, name: &str, from: &str, to: &str) {
    let out = publisher(node, to);
    exec.worker(name)
        .subscribe(node, from, roomy(), move |m: &Int32, _| out.publish(m))
        .unwrap();
}

/// A worker that publishes each millisecond.
fn source(exec: &mut Executor, node: &Node, to: &str) {
    let (out, mut n) = (publisher(node, to), 0);
    exec.worker("source")
        .timer(MS, move |_| {
            n += 1;
            out.publish(&Int32 { data: n })
        })
        .unwrap();
}

fn sink(exec: &mut Executor, node: &Node, name: &str, from: &str) {
    exec.worker(name)
        .subscribe(node, from, roomy(), |_: &Int32, _| ())
        .unwrap();
}

fn chain<'r>(report: &'r Report, name: &str) -> &'r ChainReport {
    let chain = report.chain(name).unwrap();
    assert_eq!(chain.latency.count(), chain.ended);
    assert_eq!(chain.worst.is_some(), chain.ended > 0);
    chain
}

fn executed(report: &Report, id: &str) -> u64 {
    report.handle(id).unwrap().stats.executed
}

/// Source, filter and sink, run until the chain has ended so often.
fn three(ctx: &Context, dump: Option<&Directory>) -> Report {
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(ctx);
    if let Some(directory) = dump {
        exec.ledger(&directory.0)
            .dump(Dump::to(&directory.0).on_stop());
    }
    source(&mut exec, &node, "raw");
    stage(&mut exec, &node, "filter", "raw", "fine");
    sink(&mut exec, &node, "sink", "fine");
    exec.chain("all", ["source/timer:0", "filter", "/n/sub:/fine"], HOUR);
    exec.chain("half", ["/n/sub:/raw", "sink"], None);
    let running = exec.start().unwrap();
    let enough = || running.report().chain("all").unwrap().ended >= 50;
    assert!(eventually(enough), "{}", running.report());
    running.stop()
}

#[test]
fn a_chain_of_three_workers_ends_as_often_as_its_sink_runs() {
    let _dog = watchdog("three stages", LIMIT);
    let report = three(&Context::in_process(), None);
    let all = chain(&report, "all");
    assert_eq!(all.stages, ["source/timer:0", "filter", "/n/sub:/fine"]);
    assert_eq!(all.limit, Some(3_600_000_000_000));
    assert_eq!((all.bound, all.exceeded), (None, 0));
    assert_eq!(all.begun, executed(&report, "source/timer:0"));
    assert_eq!(all.ended, executed(&report, "/n/sub:/fine"));
    // A chain may begin in the middle of another one.
    let half = chain(&report, "half");
    assert_eq!(half.begun, executed(&report, "/n/sub:/raw"));
    assert_eq!((half.ended, half.limit), (all.ended, None));
    let worst = |chain: &ChainReport| chain.worst.unwrap().latency;
    assert!(worst(half) <= worst(all));
}

/// From the origin to the end: waiting for the CPU, and the way to the next stage's release, stage
/// by stage, and the last callback.
#[test]
fn a_latency_is_the_sum_of_the_recordings_parts() {
    let _dog = watchdog("parts", LIMIT);
    let directory = Directory::new("chain-parts");
    let report = three(&Context::in_process(), Some(&directory));
    let [dump] = directory.files("dump").try_into().unwrap();
    let read = Read::of(&dump);
    let id = read.id(NameKind::Chain, "all");
    let workers = ["source", "filter", "sink"].map(|name| read.events(name));
    let ends: Vec<&Event> = of(&workers[2], Kind::ChainEnd, id);
    assert_eq!(ends.len() as u64, chain(&report, "all").ended);
    // The figures beside the events are those of the report.
    for (seen, said) in read.view.chains.iter().zip(&report.chains) {
        assert_eq!((&seen.name, seen.limit), (&said.name, said.limit));
        let counts = (seen.begun, seen.ended, seen.exceeded);
        assert_eq!(counts, (said.begun, said.ended, said.exceeded));
        let worst = said.worst.map(|worst| (worst.origin, worst.latency));
        assert_eq!(seen.worst, worst);
        assert_eq!(seen.histogram.iter().sum::<u64>(), said.ended);
        assert_eq!(seen.percentile(99), said.latency.percentile(99));
    }
    assert_eq!(read.view.chains.len(), 2);
    for end in &ends {
        let mut parts = Vec::new();
        let mut release = end.a;
        for (number, events) in workers.iter().enumerate() {
            let stages = of(events, Kind::ChainStage, id);
            let instance = (end.a, number as u64);
            let stage = stages.iter().find(|s| (s.a, s.b) == instance).unwrap();
            let begun = |e: &&Event| (e.kind, e.time) == (Kind::Begin, stage.time);
            let begin = events.iter().find(begun).unwrap();
            parts.push(begin.a.checked_sub(release).unwrap());
            parts.push(begin.time - begin.a);
            release = begin.time;
        }
        let is_end = |e: &&Event| (e.kind, e.time) == (Kind::End, end.time);
        assert!(workers[2].iter().any(|e| is_end(&e)));
        parts.push(end.time - release);
        assert_eq!(parts.iter().sum::<u64>(), end.b, "{parts:?}");
    }
    let worst = chain(&report, "all").worst.unwrap();
    let longest = ends.iter().map(|end| end.b).max();
    assert_eq!(longest, Some(worst.latency));
    assert!(
        ends.iter()
            .any(|e| (e.a, e.b) == (worst.origin, worst.latency))
    );
}

fn of(events: &[Event], kind: Kind, name: u32) -> Vec<&Event> {
    let those = events.iter().filter(|e| (e.kind, e.name) == (kind, name));
    those.collect()
}

#[test]
fn a_fork_is_two_chains_and_a_short_cut_is_none() {
    let _dog = watchdog("fork", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(&ctx);
    source(&mut exec, &node, "raw");
    stage(&mut exec, &node, "left", "raw", "l");
    stage(&mut exec, &node, "right", "raw", "r");
    sink(&mut exec, &node, "l_sink", "l");
    sink(&mut exec, &node, "r_sink", "r");
    sink(&mut exec, &node, "direct", "raw");
    exec.chain("left", ["source", "left", "l_sink"], None)
        .chain("right", ["source", "right", "r_sink"], None)
        .chain("direct", ["source", "direct"], None)
        .chain("nowhere", ["source", "left", "direct"], None);
    let running = exec.start().unwrap();
    let ended = |name: &str| running.report().chain(name).unwrap().ended;
    let enough = || {
        ["left", "right", "direct"]
            .iter()
            .all(|name| ended(name) >= 30)
    };
    assert!(eventually(enough));
    let report = running.stop();
    for (name, sink) in [("left", 0), ("right", 1), ("direct", 2)] {
        let sink = ["/n/sub:/l", "/n/sub:/r", "/n/sub:/raw#3"][sink];
        assert_eq!(
            chain(&report, name).ended,
            executed(&report, sink),
            "{name}"
        );
    }
    let nowhere = chain(&report, "nowhere");
    assert!(nowhere.begun >= 30);
    assert_eq!(
        nowhere.ended, 0,
        "nothing came to it through its second stage"
    );
}

#[test]
fn a_sample_that_is_dropped_in_between_does_not_end_a_chain() {
    let _dog = watchdog("drop", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(&ctx);
    source(&mut exec, &node, "raw");
    let (gate, out) = (Gate::closed(), publisher(&node, "fine"));
    let held = gate.clone();
    let newest = Qos::reliable().keep_last(1);
    exec.worker("filter")
        .subscribe(&node, "raw", newest, move |m: &Int32, _| {
            held.pass();
            out.publish(m)
        })
        .unwrap();
    sink(&mut exec, &node, "sink", "fine");
    exec.chain("all", ["source", "filter", "sink"], None);
    let running = exec.start().unwrap();
    let dropped = || running.stats("/n/sub:/raw").unwrap().dropped;
    assert!(eventually(|| dropped() >= 10));
    assert_eq!(running.report().chain("all").unwrap().ended, 0);
    gate.open();
    assert!(eventually(
        || running.report().chain("all").unwrap().ended >= 10
    ));
    let report = running.stop();
    let all = chain(&report, "all");
    assert_eq!(all.ended, executed(&report, "/n/sub:/fine"));
    let filter = report.handle("/n/sub:/raw").unwrap().stats;
    assert!(all.ended <= filter.executed);
    assert_eq!(all.begun, executed(&report, "source/timer:0"));
    assert!(all.begun >= filter.executed + filter.dropped);
}

#[test]
fn an_instance_beyond_the_limit_is_counted_and_reported() {
    let _dog = watchdog("limit", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let seen = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&seen);
    exec.on_event(move |event: &Told<'_>| {
        if let Told::ChainExceeded {
            chain,
            latency,
            limit,
            count,
        } = event
        {
            let line = (chain.to_string(), *latency > *limit, *limit, *count);
            note.lock().unwrap().push((line, event.to_string()));
        }
    });
    source(&mut exec, &node, "raw");
    exec.worker("sink")
        .subscribe(&node, "raw", Qos::reliable(), |_: &Int32, _| {
            std::thread::sleep(5 * MS);
        })
        .unwrap();
    exec.chain("slow", ["source", "sink"], 4 * MS);
    let running = exec.start().unwrap();
    assert!(eventually(
        || running.report().chain("slow").unwrap().ended >= 4
    ));
    let report = running.stop();
    let slow = chain(&report, "slow");
    assert_eq!(slow.exceeded, slow.ended);
    let seen = seen.lock().unwrap();
    // The first time, and whenever the count has doubled.
    let counts: Vec<u64> = seen.iter().map(|((.., count), _)| *count).collect();
    let doubled = (0..=slow.exceeded.ilog2()).map(|power| 1 << power);
    assert_eq!(counts, doubled.collect::<Vec<u64>>());
    let ((name, longer, limit, _), text) = &seen[0];
    assert_eq!((&**name, *longer, *limit), ("slow", true, 4_000_000));
    assert!(text.contains("its limit is 4000 us"), "{text}");
}

/// A stage without samples takes up each instance of the stage before once.
#[test]
fn a_timer_takes_up_the_newest_instance_once() {
    let _dog = watchdog("sampled", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    let go = GuardCondition::new();
    exec.worker("first").guard(&go, |_| ()).unwrap();
    exec.worker("second").timer(MS, |_| ()).unwrap();
    exec.chain("sampled", ["first", "second/timer:0"], None);
    let running = exec.start().unwrap();
    let ended = || running.report().chain("sampled").unwrap().ended;
    for n in 1..=3 {
        go.trigger();
        assert!(eventually(|| ended() == n));
    }
    let more = running.stats("second/timer:0").unwrap().executed + 10;
    let later = || running.stats("second/timer:0").unwrap().executed > more;
    assert!(eventually(later));
    let report = running.stop();
    let sampled = chain(&report, "sampled");
    assert_eq!((sampled.begun, sampled.ended), (3, 3));
}

/// Publications behind the output barrier keep their chain until the round ends.
#[test]
fn the_output_barrier_takes_the_chain_along() {
    let _dog = watchdog("barrier", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(&ctx);
    let (a, b) = (publisher(&node, "a"), publisher(&node, "b"));
    let (go, too) = (GuardCondition::new(), GuardCondition::new());
    exec.worker("source")
        .output_barrier(4, 4)
        .guard(&go, move |cx| cx.publish(&a, &Int32 { data: 1 }))
        .unwrap()
        .guard(&too, move |cx| cx.publish(&b, &Int32 { data: 2 }))
        .unwrap();
    sink(&mut exec, &node, "a_sink", "a");
    sink(&mut exec, &node, "b_sink", "b");
    exec.chain("a", ["source/guard:0", "a_sink"], None);
    exec.chain("crossed", ["source/guard:0", "b_sink"], None);
    let running = exec.start().unwrap();
    for n in 1..=3 {
        go.trigger();
        too.trigger();
        let came = |id: &str| running.stats(id).unwrap().executed >= n;
        assert!(eventually(|| came("/n/sub:/a") && came("/n/sub:/b")));
    }
    let report = running.stop();
    let a = chain(&report, "a");
    assert_eq!(a.ended, executed(&report, "/n/sub:/a"));
    assert_eq!(chain(&report, "crossed").ended, 0);
}

fn participant(config: &RtpsConfig) -> Context {
    Context::new(Rtps::open(config).unwrap())
}

fn config() -> RtpsConfig {
    RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        ..RtpsConfig::default()
    }
}

#[test]
fn rtps_takes_chains_along_within_the_participant() {
    let _dog = watchdog("chain over rtps", LIMIT);
    let report = three(&participant(&config()), None);
    let all = chain(&report, "all");
    assert_eq!(all.ended, executed(&report, "/n/sub:/fine"));
    assert!(all.ended >= 50);
}

/// The sample waits at its publisher before the executor that takes it is there at all.
#[test]
fn a_foreign_publishers_stamp_is_the_origin() {
    const AGE: Duration = Duration::from_millis(300);
    let _dog = watchdog("foreign", LIMIT);
    let config = config();
    let (there, here) = (participant(&config), participant(&config));
    let qos = roomy().transient_local();
    let foreign = there.node("foreign").unwrap();
    let out = foreign.publisher::<Int32>("scan", qos).unwrap();
    let (mut exec, _log) = executor(&there);
    exec.worker("idle").timer(HOUR, |_| ()).unwrap();
    let publishing = exec.start().unwrap();
    out.publish(&Int32 { data: 1 }).unwrap();
    std::thread::sleep(AGE);

    let node = here.node("n").unwrap();
    let (mut exec, _log) = executor(&here);
    let on = publisher(&node, "on");
    let dues = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&dues);
    exec.worker("first")
        .subscribe(&node, "scan", qos, move |m: &Int32, cx| {
            note.lock().unwrap().push((cx.due(), cx.source_timestamp()));
            on.publish(m)
        })
        .unwrap();
    sink(&mut exec, &node, "second", "on");
    exec.chain("all", ["first", "second"], None);
    let running = exec.start().unwrap();
    assert!(eventually(
        || running.report().chain("all").unwrap().ended == 1
    ));
    let report = running.stop();
    drop(publishing);
    let worst = chain(&report, "all").worst.unwrap();
    let (due, stamp) = dues.lock().unwrap()[0];
    assert!(stamp.is_some());
    let age = u64::try_from(AGE.as_nanos()).unwrap();
    assert!(due - worst.origin >= age, "{due} {worst:?}");
    assert!(worst.latency >= age);
}

const BEFORE: &str = "REPLENISH_CHAINS_DOMAIN";
/// Between the release of its timer and its publication.
const THOUGHT: Duration = Duration::from_millis(100);

/// The program before another one: it publishes the time of its release, later.
#[test]
#[ignore = "the program that `a_chain_goes_on_in_the_next_process` starts"]
fn the_program_before() {
    let Some(domain) = std::env::var(BEFORE).ok().and_then(|d| d.parse().ok()) else {
        return;
    };
    let ctx = participant(&RtpsConfig { domain, ..config() });
    let node = ctx.node("before").unwrap();
    let out = node.publisher::<UInt64>("boxes", roomy()).unwrap();
    let (mut exec, _log) = executor(&ctx);
    exec.worker("camera")
        .timer(2 * THOUGHT, move |cx| {
            let data = cx.due();
            std::thread::sleep(THOUGHT);
            out.publish(&UInt64 { data })
        })
        .unwrap();
    exec.chain("brake", ["camera"], None);
    exec.spin().unwrap();
}

#[test]
fn a_chain_goes_on_in_the_next_process() {
    let _dog = watchdog("two processes", LIMIT);
    let config = config();
    let ctx = participant(&config);
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(&ctx);
    let dues = Arc::new(Mutex::new(Vec::new()));
    let (note, on) = (Arc::clone(&dues), publisher(&node, "on"));
    exec.worker("boxes")
        .subscribe(&node, "boxes", roomy(), move |m: &UInt64, _| {
            note.lock().unwrap().push(m.data);
            on.publish(&Int32 { data: 1 })
        })
        .unwrap();
    sink(&mut exec, &node, "brakes", "on");
    exec.chain("brake", ["boxes", "brakes"], None);
    exec.chain("another name", ["boxes", "brakes"], None);
    let running = exec.start().unwrap();
    let mut before = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "chains::the_program_before", "--ignored"])
        .env(BEFORE, config.domain.to_string())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let came = eventually(|| running.report().chain("brake").unwrap().ended >= 3);
    let report = running.stop();
    before.kill().unwrap();
    before.wait().unwrap();
    assert!(came, "{report}");
    let [brake, other] = ["brake", "another name"].map(|name| chain(&report, name));
    assert_eq!((brake.begun, brake.ended), (other.begun, other.ended));
    let near = |instant: u64| {
        let dues = dues.lock().unwrap();
        dues.iter().map(|due| due.abs_diff(instant)).min().unwrap()
    };
    // The clocks of one host are read at both ends, one after the other.
    let thought = u64::try_from(THOUGHT.as_nanos()).unwrap();
    let [worst, stamped] = [brake, other].map(|chain| chain.worst.unwrap());
    assert!(near(worst.origin) < thought / 2, "{worst:?}");
    assert!(near(stamped.origin) >= thought / 2, "{stamped:?}");
    assert!(worst.latency >= thought);
}

#[test]
fn a_chain_that_cannot_be_is_refused_by_name() {
    let many = vec!["a/timer:0"; 17];
    let cases: [(&[&str], Option<Duration>, &str); 7] = [
        (&[], None, "chain \"c\": stages = 0 is not allowed: 1..=16"),
        (&many, None, "stages = 17 is not allowed: 1..=16"),
        (
            &["a", "b"],
            None,
            "stages = \"b\" is not allowed: a handle's id, or the name of a worker",
        ),
        (&["a", "b"], None, "the handles are a/timer:0"),
        (
            &["a/timer:0", "a"],
            None,
            "stages = a/timer:0 is not allowed: each handle once",
        ),
        (
            &["a"],
            Some(Duration::ZERO),
            "limit = 0 ns is not allowed: more than 0",
        ),
        (&["x"], Some(MS), "chain \"c\""),
    ];
    for (stages, limit, text) in cases {
        let ctx = Context::in_process();
        let (mut exec, _) = executor(&ctx);
        exec.worker("a").timer(HOUR, |_| ()).unwrap();
        exec.chain("c", stages.iter().copied(), limit);
        let error = exec.start().unwrap_err();
        assert!(matches!(error, Error::Parameter { .. }), "{error}");
        assert!(error.to_string().contains(text), "{error}");
    }
}

#[test]
fn a_handle_is_in_four_chains_at_most() {
    for count in [4, 5] {
        let ctx = Context::in_process();
        let (mut exec, _) = executor(&ctx);
        exec.worker("a").timer(HOUR, |_| ()).unwrap();
        for n in 0..count {
            exec.chain(format!("c{n}"), ["a"], None);
        }
        let error = exec.start().map(|running| drop(running.stop()));
        assert_eq!(error.is_ok(), count == 4, "{error:?}");
    }
}

#[test]
fn a_deployment_file_names_chains_with_their_bounds() {
    let _dog = watchdog("deployment file", LIMIT);
    let file = std::env::temp_dir().join(format!("chains-{}.toml", std::process::id()));
    let text = r#"
[machine]
cpus = 1
[[worker]]
name = "source"
guarantee = { rate = "100 Hz", takes = "1 ms" }
releases = { every = "10 ms" }
[[worker]]
name = "middle"
guarantee = { rate = "100 Hz", takes = "1 ms" }
[[worker]]
name = "sampler"
guarantee = { rate = "20 Hz", takes = "1 ms" }
releases = { every = "50 ms" }
[[chain]]
name = "from the file"
workers = ["source", "middle", "sampler"]
deadline = "500 ms"
"#;
    std::fs::write(&file, text).unwrap();
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(&ctx);
    exec.admission(false).overlay(&file);
    source(&mut exec, &node, "raw");
    sink(&mut exec, &node, "middle", "raw");
    exec.worker("sampler")
        .subscribe(&node, "raw", roomy(), |_: &Int32, _| ())
        .unwrap()
        .timer(MS, |_| ())
        .unwrap();
    exec.chain("from the file", ["gone"], None); // the file's replaces it
    let running = exec.start().unwrap();
    std::fs::remove_file(&file).unwrap();
    assert!(eventually(|| running.report().chains[0].ended >= 3));
    let report = running.stop();
    let [all] = &*report.chains else {
        panic!("{:?}", report.chains)
    };
    assert_eq!(all.stages, ["source", "middle", "sampler/timer:0"]);
    assert_eq!(all.limit, Some(500_000_000));
    // The sampler's period, and a response of each stage.
    let bound = all.bound.unwrap();
    assert!((53_000_000..500_000_000).contains(&bound), "{bound}");
    assert!(all.ended <= executed(&report, "sampler/timer:0"));
}

/// Guarantees of three stages: the rates of the first two, in Hz, and the chain's limit.
fn guaranteed(rates: [f64; 2], limit: Duration) -> Result<Report, String> {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _log) = executor(&ctx);
    let out = publisher(&node, "raw");
    let [source, sink] = rates.map(|rate| Guarantee::at(rate).taking(MS));
    exec.worker("source")
        .guarantee(source)
        .timer(10 * MS, move |_| out.publish(&Int32 { data: 1 }))
        .unwrap();
    exec.worker("sink")
        .guarantee(sink)
        .subscribe(&node, "raw", roomy(), |_: &Int32, _| ())
        .unwrap();
    exec.worker("sampler")
        .guarantee(Guarantee::at(20.0).taking(MS))
        .timer(50 * MS, |_| ())
        .unwrap();
    exec.worker("greedy").timer(HOUR, |_| ()).unwrap();
    exec.guarantee_chain("brake", ["source", "sink", "sampler"], limit);
    let running = exec.start().map_err(|e| e.to_string())?;
    assert!(eventually(|| running.report().chains[0].ended >= 3));
    Ok(running.stop())
}

#[test]
fn a_guaranteed_chain_has_a_bound_or_does_not_start() {
    let _dog = watchdog("guaranteed", LIMIT);
    let report = guaranteed([100.0; 2], HOUR).unwrap();
    let chain = chain(&report, "brake");
    let plan = report.admission.plan.as_ref().unwrap();
    let response = |name: &str| {
        let worker = plan.workers.iter().find(|w| w.name == name);
        worker.unwrap().worst_response.unwrap()
    };
    let sum: u64 = ["source", "sink", "sampler"].map(response).iter().sum();
    let bound = sum + 50_000_000; // the sampler's period
    assert_eq!(chain.bound, Some(bound));
    assert_eq!(chain.limit, Some(3_600_000_000_000));

    // A limit of just that is kept, and none below it.
    let limit = Duration::from_nanos(bound);
    assert!(guaranteed([100.0; 2], limit).is_ok());
    let why = guaranteed([100.0; 2], limit - Duration::from_nanos(1)).unwrap_err();
    let sentence = format!("a limit of {limit:?} would fit");
    assert!(
        why.contains("chain \"brake\" does not hold") && why.contains(&sentence),
        "{why}"
    );
    assert!(why.contains("most of it in worker \"sampler\""), "{why}");
    let why = guaranteed([100.0, 50.0], HOUR).unwrap_err();
    assert!(
        why.contains("\"sink\" release it up to every 10ms"),
        "{why}"
    );

    let refused = |change: &dyn Fn(&mut Executor)| {
        let (mut exec, _log) = executor(&Context::in_process());
        let quick = Guarantee::at(10.0).taking(MS);
        exec.worker("quick")
            .guarantee(quick)
            .timer(HOUR, |_| ())
            .unwrap();
        exec.worker("slow").timer(HOUR, |_| ()).unwrap();
        change(&mut exec);
        exec.start()
            .map(|running| drop(running.stop()))
            .unwrap_err()
            .to_string()
    };
    let certain = "nothing is certain for worker";
    let why = refused(&|exec| {
        exec.guarantee_chain("c", ["quick", "slow"], HOUR);
    });
    assert!(why.contains(&format!("{certain} \"slow\"")), "{why}");
    let why = refused(&|exec| {
        exec.admission(false).guarantee_chain("c", ["quick"], HOUR);
    });
    assert!(why.contains(&format!("{certain} \"quick\"")), "{why}");
    let why = refused(&|exec| {
        exec.guarantee_chain("c", ["gone"], HOUR);
    });
    assert!(why.contains("gone"), "{why}");
}
