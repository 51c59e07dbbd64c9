//! An ordinary user: budgets fall back to callback boundaries, told once and reported; `strict`
//! refuses with the reason. One trial runs this very program again as such a user.

use crate::common::{burn, cpu, eventually, executor};
use replenish::{Budget, Context, Enforcement, Error, Every};
use replenish_os::privilege;
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::process::Command;
use std::time::Duration;

const CHILD: &str = "REPLENISH_UNPRIVILEGED_CHILD";
const MS: Duration = Duration::from_millis(1);
/// For threads that have to end: they may wait for a CPU.
const GRACE: Duration = Duration::from_secs(30);

/// The second run, if this process is it.
pub(crate) fn child() -> bool {
    let this = std::env::var_os(CHILD).is_some();
    if this {
        let _dog = watchdog("the unprivileged run", Duration::from_secs(60));
        fallback();
        strict();
        stop_while_deferred();
    }
    this
}

pub(crate) fn trials() -> Vec<Trial> {
    let name = "an_ordinary_user_gets_the_declared_fallback_and_strict_refuses";
    let root = std::fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0);
    let setpriv = Command::new("setpriv").arg("--version").output().is_ok();
    let needed = privilege::probe().fifo.is_ok();
    let skip = needed && !(root && setpriv);
    let why = "this user has real-time priority and no way to drop it";
    vec![trial(name, move || again(needed)).skipped_if(skip.then_some(why))]
}

/// Runs this program as a user without privilege, from a copy that everybody may execute.
fn again(drop_privilege: bool) {
    let this = std::env::current_exe().unwrap();
    let copy = std::env::temp_dir().join(format!("replenish-ordinary-{}", std::process::id()));
    std::fs::copy(&this, &copy).unwrap();
    std::fs::set_permissions(&copy, std::fs::Permissions::from_mode(0o755)).unwrap();
    let mut command = if drop_privilege {
        let mut setpriv = Command::new("setpriv");
        let ids = [
            "--reuid=65534",
            "--regid=65534",
            "--clear-groups",
            "--inh-caps=-all",
        ];
        setpriv.args(ids).arg(&copy);
        setpriv
    } else {
        Command::new(&copy)
    };
    let output = command.env(CHILD, "1").current_dir("/").output();
    std::fs::remove_file(&copy).unwrap();
    let output = output.unwrap();
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{out}{err}");
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
