//! `trace` and `top` as a user runs them, on a real program: while it runs, and after `kill -9`.
//!
//! The trace is read by a decoder that stands here and shares nothing with the encoder;
//! `peers/perfetto_trace.py` reads it with Perfetto's own protobuf module, where
//! `peers/setup.sh` has installed that, as it does in CI.

use crate::common::{Scratch, json, run, stderr};
use replenish::msg::std_msgs::Int32;
use replenish::{Budget, Context, Executor, Mark, Qos};
use std::collections::BTreeMap;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const CHILD: &str = "REPLENISH_RECORDED_CHILD";
const MS: Duration = Duration::from_millis(1);

/// The program that is looked at; a test that does nothing where it was not started as that.
#[test]
fn the_program_that_is_looked_at() {
    if std::env::var_os(CHILD).is_none() {
        return;
    }
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger().admission(false).on_event(|_| ());
    exec.worker("source")
        .timer(MS, move |_| out.publish(&Int32 { data: 1 }))
        .unwrap();
    let mark = Mark::new("in the sink");
    exec.worker("sink")
        .subscribe(&node, "t", Qos::reliable(), move |_: &Int32, cx| {
            cx.mark(mark, 7);
        })
        .unwrap();
    exec.worker("hungry")
        .budget(Budget::of(2 * MS).every(20 * MS))
        .timer(10 * MS, |_| {
            let begin = Instant::now();
            while begin.elapsed() < 6 * MS {}
        })
        .unwrap();
    exec.spin().unwrap();
}

/// A directory in memory with that program.
pub(crate) struct Program {
    directory: PathBuf,
    pub(crate) child: Child,
}

impl Program {
    pub(crate) fn start(name: &str) -> Self {
        let directory = format!("/dev/shm/replenish-cli-{name}-{}", std::process::id());
        let directory = PathBuf::from(directory);
        std::fs::create_dir(&directory).unwrap();
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "live::the_program_that_is_looked_at"])
            .env(CHILD, "1")
            .env("REPLENISH_LIVE", &directory)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self { directory, child }
    }

    fn command(&self, args: &[&str]) -> Output {
        let mut command = Command::new(crate::common::BIN);
        let command = command.args(args).env("REPLENISH_LIVE", &self.directory);
        command.output().unwrap()
    }

    fn top(&self, out: &Path) -> serde_json::Value {
        let out = out.to_str().unwrap();
        let output = self.command(&["top", "--once", "--ended", "--json", out]);
        assert!(output.status.success(), "{}", stderr(&output));
        json(Path::new(out))
    }

    /// Waits until the budget has been exhausted a few times.
    pub(crate) fn wait(&self, out: &Path) -> serde_json::Value {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let top = self.top(out);
            let workers = &top["programs"][0]["workers"];
            if workers[2]["exhaustions"].as_u64().unwrap_or(0) >= 3 {
                return top;
            }
            assert!(Instant::now() < end, "{top:#}");
            std::thread::sleep(20 * MS);
        }
    }

    pub(crate) fn directory(&self) -> &Path {
        &self.directory
    }

    pub(crate) fn file(&self) -> PathBuf {
        let mut entries = std::fs::read_dir(&self.directory).unwrap();
        entries.next().unwrap().unwrap().path()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
        std::fs::remove_dir_all(&self.directory).ok();
    }
}

/// The fields of an encoded message.
fn fields(mut bytes: &[u8]) -> Vec<(u64, Field<'_>)> {
    fn varint(bytes: &mut &[u8]) -> u64 {
        let mut value = 0;
        for shift in (0..).step_by(7) {
            let (byte, rest) = bytes.split_first().unwrap();
            *bytes = rest;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return value;
            }
        }
        unreachable!()
    }
    let mut all = Vec::new();
    while !bytes.is_empty() {
        let tag = varint(&mut bytes);
        let field = match tag & 7 {
            0 => Field::Number(varint(&mut bytes)),
            1 => {
                let (number, rest) = bytes.split_first_chunk::<8>().unwrap();
                bytes = rest;
                Field::Number(u64::from_le_bytes(*number))
            }
            2 => {
                let length = usize::try_from(varint(&mut bytes)).unwrap();
                let (part, rest) = bytes.split_at(length);
                bytes = rest;
                Field::Bytes(part)
            }
            other => panic!("wire type {other}"),
        };
        all.push((tag >> 3, field));
    }
    all
}

#[derive(Clone, Copy)]
enum Field<'a> {
    Number(u64),
    Bytes(&'a [u8]),
}

fn number(fields: &[(u64, Field<'_>)], wanted: u64) -> Option<u64> {
    fields.iter().find_map(|(n, field)| match field {
        Field::Number(value) if *n == wanted => Some(*value),
        _ => None,
    })
}

fn part<'a>(fields: &[(u64, Field<'a>)], wanted: u64) -> Option<&'a [u8]> {
    fields.iter().find_map(|(n, field)| match field {
        Field::Bytes(value) if *n == wanted => Some(*value),
        _ => None,
    })
}

/// Reads a trace and checks it: a clock snapshot first, every event on a described track, slices
/// that nest, flows with both ends, a budget of 0 where it is exhausted. How many entries of each
/// type: slices' begins and ends, instants, values of counters, states.
fn check(trace: &[u8]) -> [usize; 5] {
    let packets = fields(trace);
    let (mut tracks, mut depth, mut counts) = (BTreeMap::new(), BTreeMap::new(), [0; 5]);
    let (mut from, mut to, mut exhausted, mut empty) = (vec![], vec![], vec![], vec![]);
    for (n, (field, packet)) in packets.iter().enumerate() {
        let Field::Bytes(packet) = packet else {
            panic!("packet {n}")
        };
        assert_eq!(*field, 1);
        let packet = fields(packet);
        let sequence = number(&packet, 10).unwrap();
        if n == 0 {
            assert_eq!(fields(part(&packet, 6).unwrap()).len(), 3, "three clocks");
        }
        if let Some(descriptor) = part(&packet, 60) {
            let uuid = number(&fields(descriptor), 1).unwrap();
            assert!(tracks.insert(sequence, uuid).is_none());
            assert_eq!(number(&packet, 13), Some(1));
        }
        let Some(event) = part(&packet, 11) else {
            continue;
        };
        assert!(tracks.contains_key(&sequence));
        let (time, event) = (number(&packet, 8).unwrap(), fields(event));
        let kind = usize::try_from(number(&event, 9).unwrap()).unwrap();
        counts[kind - 1] += 1;
        let depth: &mut i32 = depth.entry(sequence).or_default();
        *depth += match kind {
            1 => 1,
            2 => -1,
            _ => 0,
        };
        assert!(*depth >= 0, "a slice ends that has not begun");
        from.extend(number(&event, 47));
        to.extend(number(&event, 48));
        if part(&event, 23) == Some(b"exhausted") {
            exhausted.push(time);
        }
        if number(&event, 30) == Some(0) {
            empty.push(time);
        }
    }
    from.sort_unstable();
    to.sort_unstable();
    assert_eq!(from, to, "every flow has both ends");
    assert!(!from.is_empty() && !exhausted.is_empty());
    assert!(exhausted.iter().all(|time| empty.contains(time)));
    counts
}

/// Perfetto's module finds as many events, and no field that it does not know.
fn perfetto_reads(trace: &Path, events: usize) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    let python = here
        .join("../..")
        .join(target)
        .join("peers/perfetto/bin/python");
    if !python.exists() {
        println!("not read with Perfetto's module: tests/peers/setup.sh installs it");
        return;
    }
    let mut command = Command::new(python);
    let command = command
        .arg(here.join("tests/peers/perfetto_trace.py"))
        .arg(trace);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(crate::common::stdout(&output).trim(), events.to_string());
}

#[test]
fn a_program_is_seen_while_it_runs_and_after_it_was_killed() {
    let scratch = Scratch::new("live");
    let mut program = Program::start("seen");
    let out = scratch.path("top.json");
    let top = program.wait(&out);
    let [first] = &**top["programs"].as_array().unwrap() else {
        panic!("{top:#}");
    };
    assert_eq!(first["pid"], program.child.id());
    assert_eq!(first["alive"], true);
    let workers = first["workers"].as_array().unwrap();
    let names: Vec<&str> = workers
        .iter()
        .map(|w| w["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["source", "sink", "hungry"]);
    let hungry = &workers[2];
    assert_eq!(hungry["budget_ns"], 2_000_000);
    assert_eq!(hungry["period_ns"], 20_000_000);
    assert!(
        hungry["used_ns"].as_u64().unwrap() > 2_000_000,
        "{hungry:#}"
    );
    assert!(hungry["policy"].as_str().is_some_and(|p| !p.is_empty()));
    assert!(workers[0]["budget_ns"].is_null() && workers[0]["exhaustions"] == 0);

    let pid = program.child.id().to_string();
    let (trace, summary) = (scratch.path("a.pftrace"), scratch.path("trace.json"));
    let [trace_path, summary_path] = [&trace, &summary].map(|p| p.to_str().unwrap());
    for killed in [false, true] {
        if killed {
            program.child.kill().unwrap(); // SIGKILL
            program.child.wait().unwrap();
        }
        let args = [
            "trace",
            &pid,
            "--perfetto",
            trace_path,
            "--json",
            summary_path,
        ];
        // The threads without a budget may not have had the CPU yet.
        let end = Instant::now() + Duration::from_secs(60);
        let summary = loop {
            let output = program.command(&args);
            assert!(output.status.success(), "{}", stderr(&output));
            let summary = json(&summary);
            let sink = summary["rings"].as_array().unwrap().iter();
            let mut sink = sink.filter(|r| r["thread"] == "sink" && r["ring"] == "thread");
            let events = sink.next().map(|r| r["events"].as_u64().unwrap());
            if killed || events >= Some(40) {
                break summary;
            }
            assert!(Instant::now() < end, "{summary:#}");
            std::thread::sleep(20 * MS);
        };
        assert_eq!(summary["alive"], !killed);
        let rings = summary["rings"].as_array().unwrap();
        assert_eq!(rings.len(), 5, "{summary:#}");
        assert!(rings.iter().all(|r| r["torn"] == 0), "{summary:#}");
        let [begun, ended, instants, values, states] = check(&std::fs::read(&trace).unwrap());
        assert!(
            begun >= ended && ended > 10 && instants > 10,
            "{begun} {ended}"
        );
        assert!(values > 5 && states > 3, "{values} {states}");
        let events = begun + ended + instants + values + states;
        perfetto_reads(&trace, events);
    }
    assert_eq!(program.top(&out)["programs"][0]["alive"], false);

    // The end alone.
    let whole = json(&summary)["span_ns"].as_u64().unwrap();
    let file = program.file();
    let file = file.to_str().unwrap();
    let args = ["trace", file, "--last", "20ms", "--perfetto", trace_path];
    let output = run(&[&args[..], &["--json", summary_path]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let span = json(&summary)["span_ns"].as_u64().unwrap();
    assert!(span <= 20_000_000 && span < whole, "{span} of {whole}");
}

/// A copy that is taken while the program writes is whole, and read as the file is.
#[test]
fn a_dump_is_taken_from_outside_while_the_program_runs() {
    let scratch = Scratch::new("dumped");
    let program = Program::start("dumped");
    program.wait(&scratch.path("top.json"));
    let pid = program.child.id().to_string();
    let [dump, trace, out] = ["a.dump", "a.pftrace", "a.json"].map(|name| scratch.path(name));
    let [dump_path, trace_path, out_path] = [&dump, &trace, &out].map(|p| p.to_str().unwrap());
    let output = program.command(&["trace", &pid, "--dump", dump_path]);
    assert!(output.status.success(), "{}", stderr(&output));
    let args = [
        "trace",
        dump_path,
        "--perfetto",
        trace_path,
        "--json",
        out_path,
    ];
    let output = run(&args);
    assert!(output.status.success(), "{}", stderr(&output));
    let summary = json(&out);
    assert_eq!(summary["alive"], false, "a copy of it does not run");
    let rings = summary["rings"].as_array().unwrap();
    assert!(rings.iter().all(|r| r["torn"] == 0), "{summary:#}");
    check(&std::fs::read(&trace).unwrap());
    let output = run(&["why", dump_path, "--json", out_path]);
    assert!(output.status.success(), "{}", stderr(&output));
    for late in json(&out)["late"].as_array().unwrap() {
        let parts = late["parts"].as_object().unwrap();
        let sum: u64 = parts.values().map(|ns| ns.as_u64().unwrap()).sum();
        assert_eq!(late["response_ns"], sum, "{late:#}");
    }
    let output = program.command(&["trace", &pid]);
    assert_eq!(
        output.status.code(),
        Some(2),
        "neither --perfetto nor --dump"
    );
}

/// Files of strangers: links, directories, half of a file, another's bytes.
#[test]
fn foreign_files_are_left_out_and_named() {
    let scratch = Scratch::new("foreign");
    let mut program = Program::start("foreign");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let (file, directory) = (program.file(), &program.directory);
    let whole = std::fs::read(&file).unwrap();
    symlink(&file, directory.join("link.live")).unwrap();
    std::fs::create_dir(directory.join("directory.live")).unwrap();
    std::fs::write(directory.join("half.live"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(directory.join("a\u{1b}[2J.live"), b"nothing").unwrap();
    let mut forged = whole.clone();
    forged[96..104].copy_from_slice(b"\x1b[2J\x07bad");
    std::fs::write(directory.join("forged.live"), &forged).unwrap();
    let top = program.top(&scratch.path("top.json"));
    assert_eq!(top["programs"].as_array().unwrap().len(), 1, "{top:#}");
    let warnings = top["warnings"].as_array().unwrap();
    assert_eq!(warnings.len(), 5, "{top:#}");
    let texts = warnings.iter().map(|w| w.as_str().unwrap());
    assert!(texts.into_iter().all(|w| !w.chars().any(char::is_control)));
    let output = program.command(&["top", "--once", "--ended"]);
    assert!(!output.stdout.contains(&0x1b));
    let output = program.command(&["trace", "nobody", "--perfetto", "/dev/null"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("nobody: no recording of such a program"));
    let output = program.command(&["trace", "x", "--perfetto", "/dev/null", "--last", "5"]);
    assert_eq!(output.status.code(), Some(2));
}
