//! A foreign program that does everything that is unpleasant for a supervisor, and supervisors that
//! are killed: everybody's policy is back, each time.

use crate::foreign::{Foreign, LIMIT, SPIN, adopt, back, cpu, until};
use replenish_os::foreign::{Original, family, start_of, tasks};
use replenish_os::{CpuSet, GrantedPolicy, Tid, affinity, granted};
use replenish_testkit::harness::{Trial, rt_trial, skip};
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// 100 threads a second that come and go, one that changes its own policy and CPUs, processes that
/// fork, exec and die; until its parent has ended, and for five minutes at most.
const TORTURE: &str = r#"
import os, threading, time
parent, cpus = os.getppid(), sorted(os.sched_getaffinity(0))
def busy(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end: pass
def change():
    while True:
        try:
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
            os.sched_setaffinity(0, cpus)
        except OSError: pass
        busy(0.001)
        time.sleep(0.01)
threading.Thread(target=change, daemon=True).start()
end, children = time.monotonic() + 300, []
print("ready", flush=True)
n = 0
while time.monotonic() < end and os.getppid() == parent:
    n += 1
    threading.Thread(target=busy, args=(0.0005,), daemon=True).start()
    if n % 10 == 0:
        child = os.fork()
        if child == 0:
            busy(0.002)
            if n % 20 == 0: os.execvp("sh", ["sh", "-c", "sleep 0.05; exit 3"])
            os._exit(0)
        children.append(child)
    if len(children) > 5: os.waitpid(children.pop(0), 0)
    time.sleep(0.01)
"#;

/// `SCHED_BATCH`, which the program chooses itself.
const BATCH: u32 = 3;

/// Whether a thread has a policy and CPUs that no budget gives.
fn is_free(tid: Tid, cpus: &CpuSet) -> bool {
    // One that has ended keeps its policy until its parent asks how.
    let (Some(_), Ok(has)) = (start_of(tid), granted(tid)) else {
        return true;
    };
    let policy = matches!(
        has.policy,
        GrantedPolicy::Other { .. } | GrantedPolicy::Unknown(BATCH)
    );
    policy && !has.reset_on_fork && has.cpus == *cpus
}

fn a_tortured_program_gets_everything_back() {
    let times: u32 = std::env::var("REPLENISH_KILLS").map_or(5, |times| times.parse().unwrap());
    let mut python = Command::new("python3");
    python.args(["-c", TORTURE]).stdout(Stdio::piped());
    let Ok(mut child) = python.spawn() else {
        skip("no python3");
    };
    let said = child.stdout.take().unwrap();
    let program = Foreign(child);
    // It has noted its CPUs by then: bound to one before, it would keep to that one for ever.
    let ready = BufReader::new(said).lines().next().unwrap().unwrap();
    assert_eq!(ready, "ready");
    let cpus = affinity(program.pid()).unwrap();
    if cpus == CpuSet::one(cpu()) {
        skip("one CPU");
    }
    let had = Original::of(program.pid()).unwrap();
    let mut slowest = Duration::ZERO;
    for _ in 0..times {
        let mut supervisor = adopt(&program, &["--thread", "tid:1=1ms/20ms"]);
        std::thread::sleep(Duration::from_millis(200));
        supervisor.signal("KILL");
        supervisor.end(LIMIT);
        let begun = Instant::now();
        back(program.pid(), &had);
        until("a thread that is not as it was", || {
            let all = family(program.pid());
            let mut all = all
                .into_iter()
                .flat_map(|pid| tasks(pid).unwrap_or_default());
            all.all(|tid| is_free(tid, &cpus))
        });
        slowest = slowest.max(begun.elapsed());
    }
    eprintln!("{times} of {times} back, the slowest after {slowest:?}");
}

fn control_group(pid: Tid) -> String {
    let text = std::fs::read_to_string(format!("/proc/{pid}/cgroup")).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("0::"));
    line.unwrap_or_default().to_owned()
}

/// Mount point of control groups of version 2; the trial is skipped where none can be made.
pub(crate) fn control_groups() -> PathBuf {
    let table = std::fs::read_to_string("/proc/self/mountinfo").unwrap();
    let line = table.lines().find(|line| line.contains(" - cgroup2 "));
    let Some(mount) = line.and_then(|line| line.split(' ').nth(4)) else {
        skip("no control groups of version 2");
    };
    let (mount, name) = (
        PathBuf::from(mount),
        format!("trial-{}", std::process::id()),
    );
    if std::fs::create_dir(mount.join(&name)).is_err() {
        skip("control groups cannot be made here");
    }
    std::fs::remove_dir(mount.join(&name)).unwrap();
    mount
}

/// Threads that are suspended by a control group go on when the supervisor is killed, and the
/// control group is gone.
fn a_suspended_program_goes_on_when_its_supervisor_is_killed() {
    let mount = control_groups();
    let program = Foreign::shell(SPIN);
    let (had, home) = (
        Original::of(program.pid()).unwrap(),
        control_group(program.pid()),
    );
    let frozen = |group: &str| {
        let events = Path::new(&format!("{}{group}", mount.display())).join("cgroup.events");
        std::fs::read_to_string(events).is_ok_and(|text| text.contains("frozen 1"))
    };
    for _ in 0..3 {
        let mut supervisor = adopt(&program, &["--background", "suspend"]);
        let group = control_group(program.pid());
        assert!(group.ends_with("/b0"), "{group}");
        until("it is never stopped", || frozen(&group));
        until("it never goes on", || !frozen(&group));
        until("it is never stopped again", || frozen(&group));
        supervisor.signal("KILL");
        supervisor.end(LIMIT);
        back(program.pid(), &had);
        until("it stays in its control group", || {
            control_group(program.pid()) == home
        });
        let parent = Path::new(group.trim_start_matches('/')).parent().unwrap();
        until("its control group stays", || !mount.join(parent).exists());
    }
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial(
            "a_tortured_program_gets_everything_back",
            a_tortured_program_gets_everything_back,
        ),
        rt_trial(
            "a_suspended_program_goes_on_when_its_supervisor_is_killed",
            a_suspended_program_goes_on_when_its_supervisor_is_killed,
        ),
    ]
}
