//! `trace --ctf` as ROS 2's readers see it: babeltrace2, and `tracetools_analysis` where it is.

use crate::common::{BIN, Scratch, stderr};
use crate::missing;
use crate::recorded::Program;
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Dump, Executor, Qos};
use replenish_recorder::{Kind, View};
use replenish_testkit::harness::{Trial, peer_trial, trial};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// Begin and end of each callback of a recording that has both, by handle.
fn callbacks(bytes: &[u8]) -> Vec<(String, u64, u64)> {
    let view = View::read(bytes).unwrap();
    let names = view.names(bytes);
    let mut all = Vec::new();
    for thread in &view.threads {
        let mut open = None;
        for event in thread.events(bytes).0 {
            match event.kind {
                Kind::Begin => open = Some(event),
                Kind::End => {
                    if let Some(begin) = open.take().filter(|b| b.name == event.name) {
                        let (_, name) = names[begin.name as usize].clone().unwrap();
                        all.push((name, begin.time, event.time));
                    }
                }
                _ => {}
            }
        }
    }
    all.sort();
    all
}

/// The value of a field in a line of babeltrace2.
fn field<'a>(line: &'a str, name: &str) -> &'a str {
    let (_, rest) = line.split_once(&format!("{name} = ")).unwrap();
    rest.split([',', ' ', '}']).next().unwrap()
}

fn babeltrace_reads_every_callback_of_a_killed_program() {
    let scratch = Scratch::new("ctf");
    let mut program = Program::start("ctf");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let file = program.file();
    let expected = callbacks(&std::fs::read(&file).unwrap());
    assert!(expected.len() > 5, "{}", expected.len());
    let out = scratch.path("ctf");
    let trace = || {
        let mut command = Command::new(BIN);
        command
            .arg("trace")
            .arg(&file)
            .arg("--ctf")
            .arg(&out)
            .output()
            .unwrap()
    };
    let output = trace();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(!trace().status.success(), "the directory is there");

    let text = babeltrace(&out);
    let seen = seen(&text);
    assert_eq!(seen.len(), expected.len());
    assert_eq!(seen, expected);
    for tracepoint in [
        "rcl_subscription_init",
        "rcl_timer_init",
        "rcl_publish",
        "rmw_take",
    ] {
        assert!(
            text.contains(&format!("ros2:{tracepoint}:")),
            "{tracepoint}"
        );
    }
}

/// A trace as babeltrace2 prints it.
fn babeltrace(trace: &Path) -> String {
    let mut babeltrace = Command::new("babeltrace2");
    let output = babeltrace
        .arg("--clock-cycles")
        .arg(trace)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(stderr(&output), "");
    String::from_utf8(output.stdout).unwrap()
}

/// The callbacks that it printed: handle, begin, end.
fn seen(text: &str) -> Vec<(String, u64, u64)> {
    let mut symbols = std::collections::HashMap::new();
    let mut open = std::collections::HashMap::new();
    let mut seen = Vec::new();
    for line in text.lines() {
        let time = || -> u64 {
            let (time, _) = line.trim_start_matches('[').split_once(']').unwrap();
            time.trim().parse().unwrap()
        };
        if line.contains("ros2:rclcpp_callback_register:") {
            let symbol = field(line, "symbol").trim_matches('"').to_owned();
            symbols.insert(field(line, "callback").to_owned(), symbol);
        } else if line.contains("ros2:callback_start:") {
            open.insert(field(line, "callback").to_owned(), time());
        } else if line.contains("ros2:callback_end:") {
            let callback = field(line, "callback");
            let begin = open.remove(callback).unwrap();
            seen.push((symbols[callback].clone(), begin, time()));
        }
    }
    seen.sort();
    seen
}

/// A program that ends in order says itself how often each callback ran; its dump, as a trace, says
/// the same, and has the dump's durations.
fn babeltrace_counts_as_the_report_of_the_run() {
    let scratch = Scratch::new("ctf-report");
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger().admission(false).on_event(|_| ());
    let directory = scratch.path("");
    exec.recorder(4 << 20).dump(Dump::to(&directory).on_stop());
    let mut n = 0;
    exec.worker("source")
        .timer(Duration::from_millis(2), move |_| {
            n += 1;
            out.publish(&Int32 { data: n })
        })
        .unwrap();
    exec.worker("sink")
        .budget(Budget::of(Duration::from_millis(2)).every(Duration::from_millis(20)))
        .subscribe(&node, "t", Qos::reliable(), |m: &Int32, cx| {
            let end = Instant::now() + Duration::from_micros(100);
            while Instant::now() < end {}
            if m.data == 200 {
                cx.stop();
            }
        })
        .unwrap();
    let report = exec.spin().unwrap();
    let dump = format!("{}-1-stop.dump", std::process::id());
    let (dump, out) = (directory.join(dump), scratch.path("ctf"));
    let mut trace = Command::new(BIN);
    let output = trace
        .arg("trace")
        .arg(&dump)
        .arg("--ctf")
        .arg(&out)
        .output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let seen = seen(&babeltrace(&out));
    for id in ["source/timer:0", "/n/sub:/t"] {
        let stats = &report.handle(id).unwrap().stats;
        let own = seen.iter().filter(|(handle, ..)| handle == id);
        assert_eq!(own.count() as u64, stats.executed, "{id}");
    }
    assert_eq!(seen, callbacks(&std::fs::read(&dump).unwrap()));
    assert!(seen.len() >= 400, "{}", seen.len());
}

/// A Python that has `tracetools_analysis`, `tracetools_read` and Debian's `python3-babeltrace`:
/// the one that this variable names, or `python3`. No registry has the first two but ROS 2's own.
const PYTHON: &str = "REPLENISH_TRACETOOLS_PYTHON";

fn python() -> Command {
    let python = std::env::var_os(PYTHON);
    Command::new(python.unwrap_or_else(|| "python3".into()))
}

fn no_tracetools() -> Option<String> {
    let modules = "import tracetools_analysis.utils.ros2, tracetools_read.trace";
    let output = python().args(["-c", modules]).output();
    let found = output.is_ok_and(|output| output.status.success());
    (!found).then(|| format!("no tracetools_analysis: source ROS 2, or set {PYTHON}"))
}

fn tracetools_analysis_reads_every_callback_of_a_killed_program() {
    let scratch = Scratch::new("tracetools");
    let mut program = Program::start("tracetools");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let (file, out) = (program.file(), scratch.path("ctf"));
    let mut expected = std::collections::BTreeMap::<String, (u64, u64)>::new();
    for (handle, begin, end) in callbacks(&std::fs::read(&file).unwrap()) {
        let (count, sum) = expected.entry(handle).or_default();
        (*count, *sum) = (*count + 1, *sum + end - begin);
    }
    let mut trace = Command::new(BIN);
    let output = trace
        .arg("trace")
        .arg(&file)
        .arg("--ctf")
        .arg(&out)
        .output();
    assert!(output.unwrap().status.success());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/tracetools.py");
    let output = python().arg(script).arg(&out).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut seen = std::collections::BTreeMap::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let [symbol, count, sum] = words[..] else {
            panic!("{text}")
        };
        let numbers: (u64, u64) = (count.parse().unwrap(), sum.parse().unwrap());
        if numbers.0 > 0 {
            seen.insert(symbol.to_owned(), numbers);
        }
    }
    assert_eq!(seen, expected);
}

pub(crate) fn trials() -> Vec<Trial> {
    let reads = |name, body: fn()| peer_trial(name, missing("babeltrace2", "babeltrace2"), body);
    let tracetools = trial(
        "tracetools_analysis_reads_every_callback_of_a_killed_program",
        tracetools_analysis_reads_every_callback_of_a_killed_program,
    );
    vec![
        reads(
            "babeltrace_reads_every_callback_of_a_killed_program",
            babeltrace_reads_every_callback_of_a_killed_program,
        ),
        reads(
            "babeltrace_counts_as_the_report_of_the_run",
            babeltrace_counts_as_the_report_of_the_run,
        ),
        tracetools.skipped_if(no_tracetools().as_deref()),
    ]
}
