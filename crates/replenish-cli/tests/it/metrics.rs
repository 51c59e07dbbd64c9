//! `metrics` as a user runs it: once, on a port, and beside files of strangers.

use crate::common::{BIN, Scratch, run, stderr, stdout};
use crate::openmetrics::{Sample, parse};
use crate::recorded::Program;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The samples of `metrics` with more options.
fn once(program: &Program, more: &[&str]) -> Vec<Sample> {
    let output = program.command(&[&["metrics"], more].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    parse(&stdout(&output)).unwrap()
}

/// The value of a series whose labels contain these.
fn value(all: &[Sample], name: &str, labels: &[(&str, &str)]) -> Option<f64> {
    let has = |s: &Sample| {
        let label = |(name, value): &(&str, &str)| s.labels.get(*name).is_some_and(|v| v == value);
        s.name == name && labels.iter().all(label)
    };
    let mut found = all.iter().filter(|s| has(s));
    let first = found.next()?.value;
    assert!(found.next().is_none(), "{name} {labels:?} is no one series");
    Some(first)
}

#[test]
fn a_program_is_there_as_top_shows_it() {
    let scratch = Scratch::new("metrics");
    let mut program = Program::start("metrics");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let running = once(&program, &[]);
    assert!(running.iter().all(|s| s.labels.is_empty()), "{running:?}");
    let all = once(&program, &["--ended"]);
    let top = program.top(&scratch.path("top.json"));
    let top = &top["programs"][0];
    let pid = program.child.id().to_string();
    let name = top["program"].as_str().unwrap();
    let one = [("program", name), ("pid", pid.as_str())];
    assert_eq!(value(&all, "replenish_program_up", &one), Some(0.0));
    for worker in top["workers"].as_array().unwrap() {
        let labels = [one[0], one[1], ("worker", worker["name"].as_str().unwrap())];
        for (metric, field, unit) in [
            ("cpu_seconds_total", "used_ns", 1e9),
            ("background_cpu_seconds_total", "background_ns", 1e9),
            ("budget_seconds", "budget_ns", 1e9),
            ("period_seconds", "period_ns", 1e9),
            ("available_seconds", "available_ns", 1e9),
        ] {
            let got = value(&all, &format!("replenish_worker_{metric}"), &labels);
            let got = got.map(|seconds| (seconds * unit).round());
            assert_eq!(got, worker[field].as_f64(), "{metric} {labels:?}");
        }
        let budget = worker["budget_ns"].as_u64();
        for count in ["exhaustions", "replenishments"] {
            let got = value(&all, &format!("replenish_worker_{count}_total"), &labels);
            assert_eq!(
                got,
                budget.and(worker[count].as_f64()),
                "{count} {labels:?}"
            );
        }
        assert_eq!(value(&all, "replenish_worker_info", &labels), Some(1.0));
    }
    let pipe = &top["chains"][0];
    let labels = [one[0], one[1], ("chain", "pipe")];
    let chain = |name: &str| value(&all, &format!("replenish_chain_{name}"), &labels);
    for (metric, field) in [
        ("begun", "begun"),
        ("ended", "ended"),
        ("exceeded", "exceeded"),
    ] {
        assert_eq!(
            chain(&format!("{metric}_total")),
            pipe[field].as_f64(),
            "{metric}"
        );
    }
    let ns = |seconds: Option<f64>| seconds.map(|seconds| (seconds * 1e9).round());
    assert_eq!(ns(chain("limit_seconds")), Some(5e6));
    assert_eq!(chain("bound_seconds"), None);
    assert_eq!(
        ns(chain("worst_latency_seconds")),
        pipe["worst"]["latency_ns"].as_f64()
    );
    assert_eq!(
        chain("latency_seconds_count"),
        pipe["latency_ns"]["count"].as_f64()
    );
    // The program may have been killed before a chain ended.
    let ended = pipe["latency_ns"]["count"].as_u64() > Some(0);
    assert_eq!(chain("latency_seconds_sum") > Some(0.0), ended);
    let hungry = [one[0], one[1], ("worker", "hungry")];
    let [ran, count] = ["executions", "response_seconds_gcount"]
        .map(|name| value(&all, &format!("replenish_handle_recorded_{name}"), &hungry));
    assert!(ran > Some(0.0) && ran == count, "{ran:?} {count:?}");
    let handle = all
        .iter()
        .find(|s| s.name == "replenish_handle_recorded_executions");
    let handle = &handle.unwrap().labels;
    assert!(
        handle["handle"].starts_with(&handle["worker"]),
        "{handle:?}"
    );
}

/// Names in files of strangers, and a file that says what another one says.
#[test]
fn names_of_strangers_are_labels_and_nothing_else() {
    let scratch = Scratch::new("metrics-names");
    let mut program = Program::start("metrics-names");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let mut bytes = std::fs::read(program.file()).unwrap();
    let word = |bytes: &[u8], at: usize| {
        let word: [u8; 8] = bytes[at..at + 8].try_into().unwrap();
        usize::try_from(u64::from_le_bytes(word)).unwrap()
    };
    let (threads, names) = (word(&bytes, 40), word(&bytes, 56));
    let evil = "x\\\"} 1\n# EOF\n\u{1b}[2J";
    let mut put = |at: usize, size: usize| {
        bytes[at..at + size].fill(0);
        bytes[at..at + evil.len()].copy_from_slice(evil.as_bytes());
    };
    put(96, 128);
    // Two workers, of the same name then.
    put(threads + 256 + 128, 64);
    put(threads + 512 + 128, 64);
    (0..16).for_each(|n| put(names + 128 * n + 8, 120));
    let step = |sum: u64, b: &u8| (sum ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3);
    let sum = bytes[..224].iter().fold(0xcbf2_9ce4_8422_2325, step);
    bytes[224..232].copy_from_slice(&sum.to_le_bytes());
    for name in ["evil.live", "again.live"] {
        std::fs::write(program.directory().join(name), &bytes).unwrap();
    }
    std::fs::write(program.directory().join("left-out.live"), "no recording").unwrap();
    let all = once(&program, &["--ended"]);
    let shown = evil.replace(['\n', '\u{1b}'], "\u{fffd}");
    let labels = [("program", shown.as_str())];
    assert_eq!(value(&all, "replenish_program_up", &labels), Some(0.0));
    let labels = [labels[0], ("worker", shown.as_str())];
    assert!(value(&all, "replenish_worker_cpu_seconds_total", &labels).is_some());
    let handle = |s: &&Sample| s.labels.get("handle") == Some(&shown);
    assert!(all.iter().filter(handle).count() > 0);
    assert_eq!(value(&all, "replenish_recordings_left_out", &[]), Some(1.0));
}

#[test]
fn an_address_that_others_reach_is_refused() {
    for address in ["0.0.0.0:9464", "192.168.7.1", "[::]:9464", "9464"] {
        let output = run(&["metrics", "--listen", address]);
        assert_eq!(output.status.code(), Some(2), "{address}");
        let text = stderr(&output);
        assert!(
            text.contains("loopback") && text.contains("--listen"),
            "{text}"
        );
    }
}

struct Server {
    child: Child,
    address: String,
}

impl Server {
    fn start(program: &Program) -> Self {
        let mut child = Command::new(BIN)
            .args(["metrics", "--listen", "127.0.0.1:0"])
            .env("REPLENISH_LIVE", program.directory())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let out = child.stdout.as_mut().unwrap();
        BufReader::new(out).read_line(&mut line).unwrap();
        let address = line.strip_prefix("http://").unwrap();
        let address = address.strip_suffix("/metrics\n").unwrap().to_owned();
        Self { child, address }
    }

    /// Headers and body of an answer.
    fn ask(&self, request: &[u8]) -> (String, String) {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        stream.write_all(request).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.into(), body.into())
    }

    fn samples(&self) -> Vec<Sample> {
        let (head, body) = self.ask(b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
        assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
        let media = "Content-Type: application/openmetrics-text; version=1.0.0; charset=utf-8";
        assert!(head.contains(media), "{head}");
        assert!(
            head.contains(&format!("Content-Length: {}", body.len())),
            "{head}"
        );
        parse(&body).unwrap()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

#[test]
fn the_port_has_counters_that_rise() {
    let scratch = Scratch::new("metrics-port");
    let program = Program::start("metrics-port");
    program.wait(&scratch.path("top.json"));
    let mut server = Server::start(&program);
    let hungry = [("worker", "hungry")];
    let ran = |all: &[Sample]| value(all, "replenish_handle_executions_total", &hungry);
    let first = server.samples();
    let end = Instant::now() + Duration::from_secs(60);
    // A client that says nothing is left after its two seconds.
    let silent = TcpStream::connect(&server.address).unwrap();
    let later = loop {
        let later = server.samples();
        if ran(&later) > ran(&first) {
            break later;
        }
        assert!(Instant::now() < end, "{later:?}");
    };
    drop(silent);
    let mut counters = 0;
    for old in first.iter().filter(|s| s.kind == "counter") {
        let same = |s: &&Sample| s.name == old.name && s.labels == old.labels;
        let new = later.iter().find(same).unwrap();
        assert!(new.value >= old.value, "{old:?} {new:?}");
        counters += 1;
    }
    assert!(counters > 10, "{first:?}");
    let responses = value(&later, "replenish_handle_response_seconds_count", &hungry);
    assert_eq!(responses, ran(&later));

    let (head, body) = server.ask(b"HEAD /metrics HTTP/1.1\r\n\r\n");
    assert!(
        head.starts_with("HTTP/1.1 200") && body.is_empty(),
        "{head}"
    );
    for (request, status) in [
        (&b"GET /passwd HTTP/1.1\r\n\r\n"[..], "404"),
        (b"POST /metrics HTTP/1.1\r\n\r\n", "405"),
        (b"\xff\x00\r\n\r\n", "400"),
        (&[b'x'; 8192], "431"),
    ] {
        let (head, _) = server.ask(request);
        assert!(head.starts_with(&format!("HTTP/1.1 {status}")), "{head}");
    }
    let pid = server.child.id().to_string();
    let kill = Command::new("kill").args(["-s", "TERM", &pid]).status();
    assert!(kill.unwrap().success());
    assert!(server.child.wait().unwrap().success());
}
