//! `metrics`: `peers/openmetrics.py` reads the text with Prometheus's own client library, where
//! `peers/setup.sh` has installed that, as it does in CI.

use crate::common::{Scratch, stderr, stdout};
use crate::openmetrics::parse;
use crate::recorded::Program;
use replenish_testkit::harness::{Trial, peer_trial};
use std::path::{Path, PathBuf};
use std::process::Command;

fn python() -> PathBuf {
    replenish_testkit::peer::python(env!("CARGO_TARGET_TMPDIR"), "openmetrics")
}

pub(crate) fn trials() -> Vec<Trial> {
    let script = "crates/replenish-cli/tests/peers/setup.sh";
    let missing = (!python().exists()).then(|| format!("no prometheus_client: run {script}"));
    vec![peer_trial("prometheus_client_reads_it", missing, read)]
}

/// It finds as many samples as our reader.
fn read() {
    let scratch = Scratch::new("openmetrics");
    let program = Program::start("openmetrics");
    program.wait(&scratch.path("top.json"));
    let output = program.command(&["metrics"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = scratch.path("metrics.txt");
    std::fs::write(&text, &output.stdout).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/openmetrics.py");
    let mut command = Command::new(python());
    let read = command.arg(script).arg(&text).output().unwrap();
    assert!(read.status.success(), "{}", stderr(&read));
    let samples = parse(&stdout(&output)).unwrap().len();
    assert!(samples > 40, "{samples}");
    assert_eq!(stdout(&read).trim(), samples.to_string());
}
