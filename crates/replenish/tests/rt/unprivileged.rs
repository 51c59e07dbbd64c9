//! An ordinary user: budgets fall back to callback boundaries, with one event and in the report;
//! `strict` refuses with the reason. With a limit of priorities below 99 there are enforcers, but
//! no watchdog looks after them, and that is said as well. A program that loses the right to raise
//! threads while it runs goes on low. Each trial runs this very program again as such a user.

use crate::common::{burn, cpu, eventually, executor};
use replenish::{
    Budget, Context, Enforcement, Error, Every, Group, HandleOptions, Low, Params, Policy,
};
use replenish_os::privilege;
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::process::Command;
use std::time::Duration;

const CHILD: &str = "REPLENISH_UNPRIVILEGED_CHILD";
/// The limit of priorities of the second trial.
const LIMIT: u8 = 80;
const MS: Duration = Duration::from_millis(1);
/// For threads that have to end: they may wait for a CPU.
const GRACE: Duration = Duration::from_secs(30);

/// The second run, if this process is it.
pub(crate) fn child() -> bool {
    let Some(run) = std::env::var_os(CHILD) else {
        return false;
    };
    if run == "strict" {
        watched(); // without another thread
        return true;
    }
    let _dog = watchdog("the unprivileged run", Duration::from_secs(60));
    if run == "limited" {
        unwatched();
    } else if run == "dropping" {
        grouped();
    } else {
        fallback();
        strict();
        stop_while_deferred();
    }
    true
}

/// An ordinary user.
const ORDINARY: [&str; 5] = [
    "setpriv",
    "--reuid=65534",
    "--regid=65534",
    "--clear-groups",
    "--inh-caps=-all",
];
/// A user with the privilege to have any priority, and a limit of threads.
const OWN: [&str; 6] = [
    "setpriv",
    "--reuid=54321",
    "--regid=54321",
    "--clear-groups",
    "--inh-caps=+sys_nice",
    "--ambient-caps=+sys_nice",
];

pub(crate) fn trials() -> Vec<Trial> {
    let root = std::fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0);
    let has = |tool: &str| Command::new(tool).arg("--version").output().is_ok();
    let needed = privilege::probe().fifo.is_ok();
    let skip = needed && !(root && has("setpriv"));
    let why = "this user has real-time priority and no way to drop it";
    let tools = needed && root && has("setpriv") && has("prlimit");
    let no_tools = "this needs root, setpriv and prlimit";
    let raises = Command::new("prlimit")
        .args(["--rtprio=99:99", "true"])
        .output();
    let raises = tools && raises.is_ok_and(|done| done.status.success());
    let limited = "this user cannot raise the limit of priorities";
    vec![
        trial(
            "an_ordinary_user_gets_the_declared_fallback_and_strict_refuses",
            move || drop(again(if needed { &ORDINARY } else { &[] }, "plain")),
        )
        .skipped_if(skip.then_some(why)),
        trial(
            "an_enforcer_without_a_watchdog_is_a_fallback_and_strict_refuses",
            || {
                let limit = format!("--rtprio={LIMIT}:{LIMIT}");
                let words = [&["prlimit", &limit], &ORDINARY[..]].concat();
                again(&words, "limited");
            },
        )
        .skipped_if((!raises).then_some(limited)),
        trial(
            "strict_refuses_an_enforcer_without_a_watchdog",
            too_few_threads,
        )
        .skipped_if((!tools).then_some(no_tools)),
        rt_trial(
            "a_group_goes_on_when_the_kernel_raises_nobody_any_more",
            || drop(again(&[], "dropping")),
        )
        .skipped_if((!root).then_some("only root has privileges to give up")),
    ]
}

/// Runs a copy of this program that every account may execute, with these words in front; its
/// output.
fn again(words: &[&str], run: &str) -> String {
    let this = std::env::current_exe().unwrap();
    let copy = std::env::temp_dir().join(format!("replenish-{run}-{}", std::process::id()));
    std::fs::copy(&this, &copy).unwrap();
    std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    let file = copy.to_str().unwrap();
    let words = [words, &[file]].concat();
    let mut command = Command::new(words[0]);
    command.args(&words[1..]);
    let output = command.env(CHILD, run).current_dir("/").output();
    std::fs::remove_file(&copy).unwrap();
    let output = output.unwrap();
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{out}{err}");
    out.into_owned()
}

/// The enforcer is the last thread that its user may have: no watchdog can look after it.
fn too_few_threads() {
    let said = |threads: u8| {
        let limit = format!("--nproc={threads}:{threads}");
        let words = [&["prlimit", &limit], &OWN[..]].concat();
        again(&words, "strict")
    };
    let all: Vec<String> = (2..8).map(said).collect();
    let refused = |said: &&String| said.contains("a watchdog for the enforcer cannot be granted");
    assert!(all.iter().any(|said| refused(&said)), "{all:#?}");
}

/// Prints why an executor with a budget does not start.
fn watched() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.strict(true);
    exec.worker("w")
        .budget(Budget::of(10 * MS).every(100 * MS))
        .timer(MS, |_| ())
        .unwrap();
    println!("{:?}", exec.start().map(|_| ()).map_err(|e| e.to_string()));
}

/// The fallback: said once, in the report, and budgets held at callback boundaries.
fn fallback() {
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    exec.stop_grace(GRACE);
    for name in ["one", "two"] {
        exec.worker(name)
            .budget(Budget::of(3 * MS).every(100 * MS))
            .cpu(cpu())
            .timer(Every::period(MS).first_after(Duration::ZERO), |_| burn(2))
            .unwrap();
    }
    let running = exec.start().unwrap();
    assert_eq!(log.lines().len(), 1, "{:?}", log.lines());
    let line = &log.lines()[0];
    for part in ["one, two", "callback boundaries", "CAP_SYS_NICE", "setcap"] {
        assert!(line.contains(part), "{part:?} is missing in: {line}");
    }
    std::thread::sleep(450 * MS);
    // On a loaded machine an ordinary thread may get less than its budget for a while.
    let used_up = |name: &&str| running.usage(name).unwrap().exhaustions > 0;
    assert!(eventually(|| ["one", "two"].iter().all(used_up)));
    let periods = running.report().elapsed / 100_000_000 + 1;
    let report = running.stop();
    assert_eq!(report.fallbacks, log.lines());
    for name in ["one", "two"] {
        let thread = report.thread(name).unwrap();
        assert_eq!(thread.enforcement, Some(Enforcement::Deferred));
        assert!(thread.granted.starts_with("OTHER"), "{}", thread.granted);
        let used = thread.usage.cpu_high + thread.usage.cpu_low;
        // A callback that has begun is not interrupted: one of 2 ms more in each period, repaid.
        assert!(used <= (periods + 1) * 3_000_000 + 2_500_000, "{report}");
        assert!(thread.usage.exhaustions > 0, "{report}");
    }
}

fn strict() {
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    exec.strict(true);
    exec.worker("w")
        .budget(Budget::of(10 * MS).every(100 * MS))
        .timer(MS, |_| -> () { panic!("it ran") })
        .unwrap();
    let error = exec.start().unwrap_err();
    assert!(matches!(error, Error::NotGranted { .. }), "{error:?}");
    let text = error.to_string();
    assert!(
        text.contains('w') && text.contains("CAP_SYS_NICE"),
        "{text}"
    );
    assert!(log.lines().is_empty());
    // Without anything real-time there is nothing to refuse.
    let (mut exec, _) = executor(&ctx);
    exec.strict(true);
    exec.worker("w").timer(MS, |_| ()).unwrap();
    exec.start().unwrap().stop();
}

/// A worker that waits for a replenishment an hour away ends with the executor.
fn stop_while_deferred() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(GRACE);
    exec.worker("w")
        .budget(Budget::of(MS).every(3_600_000 * MS))
        .timer(MS, |_| burn(2))
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| running.usage("w").unwrap().low));
    std::thread::sleep(10 * MS);
    let report = running.stop();
    assert!(report.stuck.is_empty(), "{report}");
    assert_eq!(report.handle("w/timer:0").unwrap().stats.executed, 1);
}

/// The enforcer gets priority 80, and its watchdog not its 99.
fn unwatched() {
    let ctx = Context::in_process();
    let budgeted = || {
        let (mut exec, log) = executor(&ctx);
        exec.enforcer_priority(LIMIT);
        exec.worker("w")
            .budget(Budget::of(10 * MS).every(100 * MS))
            .timer(MS, |_| ())
            .unwrap();
        (exec, log)
    };
    let (exec, log) = budgeted();
    let report = exec.start().unwrap().stop();
    assert_eq!(report.fallbacks, log.lines());
    let mut lines = report.fallbacks.iter();
    let line = lines.find(|line| line.contains("watchdog")).unwrap();
    for part in ["if an enforcer fails", "FIFO 99", "RLIMIT_RTPRIO"] {
        assert!(line.contains(part), "{part:?} is missing in: {line}");
    }
    let granted = report.thread("w").unwrap().enforcement;
    assert_ne!(granted, Some(Enforcement::Deferred), "there is an enforcer");
    let (mut exec, log) = budgeted();
    exec.strict(true);
    let error = exec.start().unwrap_err();
    assert!(matches!(error, Error::NotGranted { .. }), "{error:?}");
    assert!(error.to_string().contains("a watchdog"), "{error}");
    assert!(log.lines().is_empty());
}

/// Two workers of a group, and the kernel raises neither of them any more: neither has the group
/// for good, and neither has its priority again. The one that was stopped goes on in the
/// time-sharing class.
fn grouped() {
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    let group = Group::new("shared");
    for (name, priority, low) in [("a", 60, Low::Background(2)), ("b", 50, Low::Suspend)] {
        let params = Params::new(priority, low, 5_000_000, 50_000_000, 8).unwrap();
        exec.worker(name)
            .policy(Policy::sporadic(params).unwrap())
            .cpu(cpu())
            .timer(3 * MS, |_| burn(2))
            .unwrap()
            .options(HandleOptions::new().group(&group));
    }
    let running = exec.start().unwrap();
    let usage = |name| running.usage(name).unwrap();
    let names = ["a", "b"];
    assert!(eventually(|| names
        .iter()
        .all(|n| usage(n).replenishments > 2)));
    replenish_os::baseline::become_user(65534).unwrap();
    let limit = privilege::probe().rtprio.soft;
    if limit.is_none_or(|limit| limit >= 60) {
        println!("the limit of priorities was raised at the start: nothing is refused");
        assert!(running.stop().stuck.is_empty());
        return;
    }
    let refused = |n: usize| {
        let lines = log.lines();
        lines
            .iter()
            .filter(|line| line.contains("refuses to raise"))
            .count()
            >= n
    };
    assert!(eventually(|| refused(2)), "{:?}", log.lines());
    let executed = || names.map(|name| running.stats(&id(name)).unwrap().executed);
    let (high, before) = (names.map(|name| usage(name).cpu_high), executed());
    assert!(eventually(|| {
        let mut both = executed().into_iter().zip(before);
        both.all(|(now, then)| now >= then + 5)
    }));
    assert_eq!(
        names.map(|name| usage(name).cpu_high),
        high,
        "one was raised"
    );
    let report = running.stop();
    assert!(report.stuck.is_empty(), "{report}");
}

fn id(worker: &str) -> String {
    format!("{worker}/timer:0")
}
