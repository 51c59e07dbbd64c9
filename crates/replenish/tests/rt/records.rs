//! The kernel refuses switch records to some workers: their budgets come back late, and the report
//! has to say so. One trial runs this program again with few descriptors; each record needs one.

use crate::common::executor;
use replenish::{Budget, Context, Error, Executor};
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::process::Command;
use std::time::Duration;

const CHILD: &str = "REPLENISH_FEW_DESCRIPTORS_CHILD";
const MS: Duration = Duration::from_millis(1);

/// The second run, if this process is it.
pub(crate) fn child() -> bool {
    let this = std::env::var_os(CHILD).is_some();
    if this {
        let _dog = watchdog("the run with few descriptors", Duration::from_secs(60));
        told();
        refused();
    }
    this
}

pub(crate) fn trials() -> Vec<Trial> {
    let name = "missing_switch_records_are_a_fallback_and_strict_refuses";
    vec![trial(name, again)]
}

/// On b209253 a strict start went well, and 10 of 40 workers had no records.
fn again() {
    let output = Command::new("sh")
        .args(["-c", "ulimit -n 24 && exec \"$0\""])
        .arg(std::env::current_exe().unwrap())
        .env(CHILD, "1")
        .output()
        .unwrap();
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(output.status.success(), "{out}{err}");
}

fn forty_workers(exec: &mut Executor) {
    for n in 0..40 {
        exec.worker(&format!("w{n}"))
            .budget(Budget::of(MS).every(100 * MS))
            .timer(100 * MS, |_| ())
            .unwrap();
    }
}

fn told() {
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    exec.stop_grace(Duration::from_secs(30));
    forty_workers(&mut exec);
    let report = exec.start().unwrap().stop();
    assert_eq!(report.fallbacks, log.lines());
    let mut lines = report.fallbacks.iter();
    let line = lines.find(|line| line.contains("records")).unwrap();
    for part in ["w39.", "come back late", "ulimit -n", "os error 24"] {
        assert!(line.contains(part), "{part:?} is missing in: {line}");
    }
    assert!(!line.contains("w0,"), "{line}");
}

fn refused() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.strict(true);
    forty_workers(&mut exec);
    let error = exec.start().unwrap_err();
    assert!(matches!(error, Error::NotGranted { .. }), "{error:?}");
}
