//! `run` and `adopt` as a user calls them, with shells as foreign programs.

use replenish_os::foreign::{self, Original};
use replenish_os::{CpuSet, SchedClass, Tid, affinity, current_tid, granted, set_priority};
use replenish_testkit::harness::{Trial, rt_trial, skip};
use replenish_testkit::program::{Running, Scratch, run, stderr, stdout};
use replenish_testkit::witness::Witness;
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

pub(crate) const BIN: &str = env!("CARGO_BIN_EXE_replenish");

/// A shell's long work: until its parent has ended, so that nothing of a trial stays. A shell whose
/// parent had ended before it began sees its new one, which may live for ever: hence the count.
pub(crate) const SPIN: &str = "n=0; while [ $n -lt 20000 ] && [ $PPID -gt 1 ] && kill -0 $PPID 2>/dev/null; do \
                    n=$((n+1)); i=0; while [ $i -lt 9999 ]; do i=$((i+1)); done; done";
pub(crate) const LIMIT: Duration = Duration::from_secs(60);

pub(crate) fn cpu() -> usize {
    affinity(current_tid()).unwrap().iter().last().unwrap()
}

/// A foreign program; ended when dropped.
pub(crate) struct Foreign(pub(crate) Child);

impl Foreign {
    pub(crate) fn shell(script: &str) -> Self {
        let mut shell = Command::new("sh");
        Self(
            shell
                .args(["-c", script])
                .stdin(Stdio::null())
                .spawn()
                .unwrap(),
        )
    }

    pub(crate) fn pid(&self) -> Tid {
        Tid::new(self.0.id().cast_signed()).unwrap()
    }
}

impl Drop for Foreign {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

pub(crate) fn adopt(program: &Foreign, more: &[&str]) -> Running {
    let (pid, cpu) = (program.pid().to_string(), cpu().to_string());
    let args = [
        &["adopt", &pid, "--budget", "5ms/20ms", "--cpu", &cpu],
        more,
    ]
    .concat();
    let mut running = Running::start(BIN, &args);
    running.expect_line("adopted on CPU", LIMIT);
    running
}

/// Waits until a thread has what it had; how long that took.
pub(crate) fn back(tid: Tid, had: &Original) -> Duration {
    let begun = Instant::now();
    while Original::of(tid).unwrap() != *had {
        assert!(
            begun.elapsed() < LIMIT,
            "{} has {}",
            tid,
            granted(tid).unwrap()
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    begun.elapsed()
}

pub(crate) fn until(what: &str, holds: impl Fn() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < LIMIT, "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

pub(crate) fn json(path: &std::path::Path) -> serde_json::Value {
    crate::schema::read(path)
}

/// Two programs on one CPU, 30/100 and the rest, found by their names as children of the shell that
/// is run; the exit code is that of the shell.
fn programs_share_a_cpu_by_name() {
    let scratch = Scratch::new("run-names");
    let sh = ["/bin/sh", "/usr/bin/sh"]
        .iter()
        .find(|sh| std::path::Path::new(sh).exists());
    for name in ["alpha", "beta"] {
        std::os::unix::fs::symlink(sh.unwrap(), scratch.path(name)).unwrap();
    }
    let dir = scratch.dir().display();
    let script = format!(
        "{dir}/alpha -c '{SPIN}' & a=$!; {dir}/beta -c '{SPIN}' & b=$!; sleep 2; kill $a $b; exit 7"
    );
    let (file, cpu) = (scratch.path("run.json"), cpu().to_string());
    let file = file.to_str().unwrap();
    let witness = Witness::start();
    let output = run(
        BIN,
        &[
            "run",
            "--thread",
            "alph?=30ms/100ms@60,none=1ms/10ms",
            "--cpu",
            &cpu,
            "--json",
            file,
            "--",
            "sh",
            "-c",
            &script,
        ],
    );
    let still = witness.settled();
    assert_eq!(output.status.code(), Some(7), "{}", stderr(&output));
    let report = json(std::path::Path::new(file));
    let threads = report["threads"].as_array().unwrap();
    assert_eq!(threads.len(), 1, "{report:#}");
    let alpha = &threads[0];
    let number = |key: &str| alpha[key].as_u64().unwrap();
    assert_eq!(alpha["name"], "alpha");
    assert_eq!(alpha["policy"], "FIFO 60, then idle");
    assert_eq!(
        (number("budget_ns"), number("period_ns")),
        (30_000_000, 100_000_000)
    );
    assert!(number("tid") > 0, "{report:#}");
    let share = &report["shares"][0];
    let (high, error) = (number("high_ns"), share["error_percent"].as_f64().unwrap());
    let elapsed = share["elapsed_ns"].as_u64().unwrap();
    eprintln!(
        "{high} of {elapsed} ns, {error:+.3} %, background {}",
        number("background_ns")
    );
    assert!(
        high <= (elapsed / 100_000_000 + 1) * 30_000_000 + 500_000,
        "{report:#}"
    );
    // The program began to work after it was found, its last period is not over, and no thread gets
    // anything while the machine stands still.
    let most = 3.0 + still as f64 * 100.0 / elapsed as f64;
    assert!(error > -most, "{still} ns still: {report:#}");
    let periods = elapsed / 100_000_000;
    assert!(number("exhaustions") >= periods / 2, "{report:#}");
    // The other one takes the rest before `alpha` gets anything of it.
    assert!(number("background_ns") < elapsed / 3, "{report:#}");
    assert!(
        report["notes"]
            .to_string()
            .contains("no thread fitted 'none'")
    );
}

/// The supervisor is killed with `kill -9`, again and again: everything is as it was, and at once,
/// not after the second in which a supervisor may be silent.
fn a_killed_supervisor_leaves_nothing_behind() {
    let times = std::env::var("REPLENISH_KILLS").map_or(5, |times| times.parse().unwrap());
    let (plain, fifo) = (Foreign::shell(SPIN), Foreign::shell(SPIN));
    set_priority(fifo.pid(), SchedClass::RoundRobin(3)).unwrap();
    let had = [&plain, &fifo].map(|program| Original::of(program.pid()).unwrap());
    let mut fastest = LIMIT;
    for _ in 0..times {
        let mut supervisor = adopt(&plain, &[&fifo.pid().to_string()]);
        for program in [&plain, &fifo] {
            assert_eq!(affinity(program.pid()).unwrap(), CpuSet::one(cpu()));
        }
        supervisor.signal("KILL");
        supervisor.end(LIMIT);
        for (program, had) in [&plain, &fifo].iter().zip(&had) {
            fastest = fastest.min(back(program.pid(), had));
        }
    }
    eprintln!("{times} of {times} back, the fastest after {fastest:?}");
    assert!(fastest < Duration::from_millis(500), "{fastest:?}");
}

/// A child that a program under a budget starts gets back the program's policy as well.
fn children_of_an_adopted_program_are_put_right() {
    let scratch = Scratch::new("adopt-children");
    let go = scratch.path("go");
    let wait = format!("while [ ! -e {} ]; do :; done", go.display());
    let program = Foreign::shell(&format!("{wait}; sh -c '{SPIN}' & {SPIN}"));
    let had = Original::of(program.pid()).unwrap();
    let mut supervisor = adopt(&program, &[]);
    std::fs::write(&go, "").unwrap();
    until("no child", || foreign::family(program.pid()).len() == 2);
    let child = foreign::family(program.pid())[1];
    until("no budget for the child", || {
        granted(child).is_ok_and(|has| has.reset_on_fork)
    });
    supervisor.signal("KILL");
    supervisor.end(LIMIT);
    back(program.pid(), &had);
    back(child, &had);
}

/// A supervisor that stands still counts as gone after a second; when it goes on, so do the
/// budgets.
fn a_stopped_supervisor_counts_as_gone() {
    let program = Foreign::shell(SPIN);
    let had = Original::of(program.pid()).unwrap();
    let mut supervisor = adopt(&program, &[]);
    supervisor.signal("STOP");
    back(program.pid(), &had);
    supervisor.signal("CONT");
    until("no budget again", || {
        granted(program.pid()).is_ok_and(|has| has.reset_on_fork)
    });
    supervisor.signal("TERM");
    assert!(supervisor.end(LIMIT).success());
    assert_eq!(Original::of(program.pid()).unwrap(), had);
}

/// The guardian is killed, and the supervisor after it: another guardian knows everything.
fn a_killed_guardian_is_replaced() {
    let program = Foreign::shell(SPIN);
    let had = Original::of(program.pid()).unwrap();
    let mut supervisor = adopt(&program, &[]);
    let me = Tid::new(supervisor.id().cast_signed()).unwrap();
    let first = foreign::children(me);
    assert_eq!(first.len(), 1, "{first:?}");
    let kill = Command::new("kill")
        .args(["-9", &first[0].to_string()])
        .status();
    assert!(kill.unwrap().success());
    until("no other guardian", || {
        let now = foreign::children(me);
        // It has begun to listen.
        now.len() == 1 && now != first && granted(now[0]).is_ok_and(|has| has.priority == 98)
    });
    std::thread::sleep(Duration::from_millis(300));
    supervisor.signal("KILL");
    supervisor.end(LIMIT);
    back(program.pid(), &had);
}

fn programs_are_listed_and_released() {
    let scratch = Scratch::new("adopt-list");
    let file = scratch.path("list.json");
    let (one, two) = (Foreign::shell(SPIN), Foreign::shell(SPIN));
    let had = Original::of(one.pid()).unwrap();
    let mut supervisor = adopt(&one, &[&two.pid().to_string()]);
    let pid = one.pid().to_string();
    let output = run(BIN, &["adopt", "--list", "--json", file.to_str().unwrap()]);
    assert!(output.status.success());
    assert!(
        stdout(&output).contains("*=5 ms/20 ms@50"),
        "{}",
        stdout(&output)
    );
    let list = json(&file);
    let ours = list["programs"]
        .as_array()
        .unwrap()
        .iter()
        .find(|p| p["pid"] == one.pid().get());
    assert_eq!(ours.unwrap()["threads"], 1, "{list:#}");
    assert_eq!(ours.unwrap()["supervisor"], supervisor.id());
    // A second supervisor of the same program is refused.
    let output = run(BIN, &["adopt", &pid, "--budget", "1ms/10ms"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("--release"), "{}", stderr(&output));
    let output = run(BIN, &["adopt", "--release", &pid]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(Original::of(one.pid()).unwrap(), had);
    let output = run(BIN, &["adopt", "--release", &pid]);
    assert!(
        stderr(&output).contains("has no budgets"),
        "{}",
        stderr(&output)
    );
    // It ends with its last program.
    run(BIN, &["adopt", "--release", &two.pid().to_string()]);
    assert!(supervisor.end(LIMIT).success());
}

fn signals_are_passed_on() {
    let script = "trap 'exit 9' TERM; echo ready; while :; do sleep 0.02; done";
    let mut running = Running::start(
        BIN,
        &["run", "--budget", "5ms/20ms", "--", "sh", "-c", script],
    );
    running.expect_line("ready", LIMIT);
    running.signal("TERM");
    assert_eq!(running.end(LIMIT).code(), Some(9));
    // One that does not listen is ended after --seconds, and a shell sees its signal.
    let script = "trap '' TERM; while :; do sleep 0.02; done";
    let args = [
        "run",
        "--budget",
        "5ms/20ms",
        "--seconds",
        "1",
        "--",
        "sh",
        "-c",
        script,
    ];
    assert_eq!(run(BIN, &args).status.code(), Some(128 + 9));
}

fn programs_that_may_not_be_changed_are_refused() {
    let refusal = |args: &[&str]| {
        let output = run(BIN, args);
        assert!(
            matches!(output.status.code(), Some(1 | 2)),
            "{}",
            stderr(&output)
        );
        stderr(&output)
    };
    let pid = std::process::id().to_string();
    assert!(refusal(&["adopt", &pid]).contains("no budget"));
    assert!(refusal(&["adopt", &pid, "--budget", "30ms"]).contains("TIME/PERIOD"));
    let much = refusal(&[
        "adopt",
        &pid,
        "--budget",
        "60ms/100ms",
        "--thread",
        "x=4ms/10ms",
    ]);
    assert!(much.contains("100.0 %") && much.contains("95 %"), "{much}");
    let nobody = refusal(&["adopt", "2147483647", "--budget", "1ms/10ms"]);
    assert!(nobody.contains("there is no thread"), "{nobody}");
    let far = refusal(&["adopt", &pid, "--budget", "1ms/10ms", "--cpu", "1000"]);
    assert!(far.contains("--cpu"), "{far}");
    let none = refusal(&["run", "--budget", "1ms/10ms", "--", "/nonexistent/program"]);
    assert!(none.contains("cannot start /nonexistent/program"), "{none}");
    // Another user: from a copy that every account may run.
    let copy = std::env::temp_dir().join(format!("replenish-adopt-{pid}"));
    std::fs::copy(BIN, &copy).unwrap();
    std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    let output = Command::new("setpriv")
        .args([
            "--reuid=65534",
            "--regid=65534",
            "--clear-groups",
            "--inh-caps=-all",
        ])
        .arg(&copy)
        .args([
            "adopt",
            &pid,
            "--budget",
            "1ms/10ms",
            "--background",
            "other",
        ])
        .current_dir("/")
        .output();
    std::fs::remove_file(&copy).unwrap();
    match output {
        Ok(output) if !stderr(&output).contains("setpriv:") => {
            assert_eq!(output.status.code(), Some(1));
            assert!(
                stderr(&output).contains("CAP_SYS_NICE"),
                "{}",
                stderr(&output)
            );
        }
        _ => skip("no setpriv, or not root"),
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial("programs_share_a_cpu_by_name", programs_share_a_cpu_by_name),
        rt_trial(
            "a_killed_supervisor_leaves_nothing_behind",
            a_killed_supervisor_leaves_nothing_behind,
        ),
        rt_trial(
            "children_of_an_adopted_program_are_put_right",
            children_of_an_adopted_program_are_put_right,
        ),
        rt_trial(
            "a_stopped_supervisor_counts_as_gone",
            a_stopped_supervisor_counts_as_gone,
        ),
        rt_trial(
            "a_killed_guardian_is_replaced",
            a_killed_guardian_is_replaced,
        ),
        rt_trial(
            "programs_are_listed_and_released",
            programs_are_listed_and_released,
        ),
        rt_trial("signals_are_passed_on", signals_are_passed_on),
        rt_trial(
            "programs_that_may_not_be_changed_are_refused",
            programs_that_may_not_be_changed_are_refused,
        ),
    ]
}
