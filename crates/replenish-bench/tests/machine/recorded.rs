//! The recording of `experiment isolation`, killed in the middle: Perfetto's own protobuf module
//! and babeltrace2 read it.

use crate::common::{BIN, Scratch, json, run, stderr};
use replenish_recorder::{Event, Kind, View};
use replenish_testkit::harness::{Trial, rt_program_trial, skip_peer};
use replenish_testkit::peer;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_program_trial("perfetto_reads_isolation_after_a_kill", perfetto_reads),
        rt_program_trial("babeltrace_reads_isolation_after_a_kill", babeltrace_reads),
    ]
}

fn python() -> PathBuf {
    peer::python(env!("CARGO_TARGET_TMPDIR"), "perfetto")
}

/// Recordings of the experiment.
struct Killed(PathBuf);

impl Drop for Killed {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

impl Killed {
    /// Starts it, and kills it when a budget has been used up and has come back.
    fn start(name: &str, scratch: &Scratch) -> Self {
        let directory = format!("/dev/shm/replenish-isolation-{name}-{}", std::process::id());
        std::fs::create_dir(&directory).unwrap();
        let this = Self(directory.into());
        let mut child: Child = Command::new(BIN)
            .args(["experiment", "isolation", "--windows", "1"])
            .env("REPLENISH_LIVE", &this.0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let end = Instant::now() + Duration::from_secs(180); // others may hold the lock
        let out = scratch.path("top.json");
        while !this.is_used_up(&out) {
            let ended = child.try_wait().unwrap();
            assert!(ended.is_none() && Instant::now() < end, "{ended:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
        child.kill().unwrap(); // SIGKILL
        child.wait().unwrap();
        this
    }

    fn command(&self, args: &[&str]) -> std::process::Output {
        let mut command = Command::new(BIN);
        command
            .args(args)
            .env("REPLENISH_LIVE", &self.0)
            .output()
            .unwrap()
    }

    fn is_used_up(&self, out: &Path) -> bool {
        let args = ["top", "--once", "--json", out.to_str().unwrap()];
        let output = self.command(&args);
        assert!(output.status.success(), "{}", stderr(&output));
        let top = json(out);
        let programs = top["programs"].as_array().unwrap();
        let workers = programs
            .iter()
            .flat_map(|p| p["workers"].as_array().unwrap());
        let mut workers = workers;
        workers.any(|w| {
            w["exhaustions"].as_u64() >= Some(3) && w["replenishments"].as_u64() >= Some(3)
        })
    }

    fn file(&self) -> PathBuf {
        let entries = std::fs::read_dir(&self.0).unwrap();
        let mut files = entries.map(|entry| entry.unwrap().path());
        files
            .find(|p| p.extension().is_some_and(|e| e == "live"))
            .unwrap()
    }
}

fn perfetto_reads() {
    if !python().exists() {
        skip_peer("no module of Perfetto: run crates/replenish-cli/tests/peers/setup.sh");
    }
    let scratch = Scratch::new("isolation-perfetto");
    let killed = Killed::start("perfetto", &scratch);
    let (file, out) = (killed.file(), scratch.path("i.pftrace"));
    let out = out.to_str().unwrap();
    let output = run(&["trace", file.to_str().unwrap(), "--perfetto", out]);
    assert!(output.status.success(), "{}", stderr(&output));
    let script = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = script.join("../replenish-cli/tests/peers/perfetto_trace.py");
    let output = Command::new(python())
        .arg(script)
        .arg(out)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let events: u64 = String::from_utf8(output.stdout)
        .unwrap()
        .trim()
        .parse()
        .unwrap();
    assert!(events > 100, "{events}");
}

/// Durations of callbacks that have both ends, shortest first.
fn durations(bytes: &[u8]) -> Vec<u64> {
    let view = View::read(bytes).unwrap();
    let mut all = Vec::new();
    for thread in &view.threads {
        let mut open: Option<Event> = None;
        for event in thread.events(bytes).0 {
            match event.kind {
                Kind::Begin => open = Some(event),
                Kind::End => all.extend(open.take().map(|begin| event.time - begin.time)),
                _ => {}
            }
        }
    }
    all.sort_unstable();
    all
}

fn babeltrace_reads() {
    let babeltrace = Command::new("babeltrace2").arg("--version").output();
    if babeltrace.is_err() {
        skip_peer("babeltrace2 is missing (apt install babeltrace2)");
    }
    let scratch = Scratch::new("isolation-ctf");
    let killed = Killed::start("ctf", &scratch);
    let (file, out) = (killed.file(), scratch.path("ctf"));
    let out = out.to_str().unwrap();
    let output = run(&["trace", file.to_str().unwrap(), "--ctf", out]);
    assert!(output.status.success(), "{}", stderr(&output));
    let expected = durations(&std::fs::read(&file).unwrap());
    let output = Command::new("babeltrace2")
        .args(["--clock-cycles", out])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut open = std::collections::HashMap::new();
    let mut seen = Vec::new();
    for line in text.lines() {
        let (time, rest) = line.trim_start_matches('[').split_once(']').unwrap();
        let time: u64 = time.trim().parse().unwrap();
        let callback = || {
            rest.split_once("callback = ")
                .unwrap()
                .1
                .split([',', ' '])
                .next()
                .unwrap()
        };
        if rest.contains("ros2:callback_start:") {
            open.insert(callback().to_owned(), time);
        } else if rest.contains("ros2:callback_end:") {
            seen.push(time - open.remove(callback()).unwrap());
        }
    }
    seen.sort_unstable();
    assert!(seen.len() > 20, "{}", seen.len());
    assert_eq!(seen, expected);
}
