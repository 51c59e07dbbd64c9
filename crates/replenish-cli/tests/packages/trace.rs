//! `trace --perfetto`: `peers/perfetto_trace.py` reads the trace with Perfetto's own protobuf
//! module, where `peers/setup.sh` has installed that, as it does in CI.

use crate::common::{Scratch, stderr, stdout};
use crate::perfetto::check;
use crate::recorded::Program;
use replenish_testkit::harness::{Trial, peer_trial};
use std::path::{Path, PathBuf};
use std::process::Command;

fn python() -> PathBuf {
    replenish_testkit::peer::python(env!("CARGO_TARGET_TMPDIR"), "perfetto")
}

pub(crate) fn trials() -> Vec<Trial> {
    let script = "crates/replenish-cli/tests/peers/setup.sh";
    let missing = (!python().exists()).then(|| format!("no module of Perfetto: run {script}"));
    vec![peer_trial("perfettos_module_reads_it", missing, read)]
}

/// It finds as many events as our decoder, and no field that it does not know.
fn read() {
    let scratch = Scratch::new("perfetto");
    let mut program = Program::start("perfetto");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let trace = scratch.path("a.pftrace");
    let (pid, path) = (program.child.id().to_string(), trace.to_str().unwrap());
    let output = program.command(&["trace", &pid, "--perfetto", path]);
    assert!(output.status.success(), "{}", stderr(&output));
    let counts = check(&std::fs::read(&trace).unwrap());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/perfetto_trace.py");
    let mut command = Command::new(python());
    let output = command.arg(script).arg(&trace).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let events: usize = counts.iter().sum();
    assert_eq!(stdout(&output).trim(), events.to_string());
}
