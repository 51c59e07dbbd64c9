//! The packages that users get: Debian's, a ROS 2 package, containers, crates. Some trials need a
//! tool that not every machine has, and count as ignored without it.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod ament;
mod container;
mod crates;
mod ctf;
mod debian;
mod metrics;
mod said;
mod systemd;
mod trace;

#[path = "../it/common.rs"]
#[allow(dead_code, reason = "`it` uses the rest")]
mod common;
#[path = "../it/openmetrics.rs"]
mod openmetrics;
#[path = "../it/perfetto.rs"]
mod perfetto;
#[path = "../it/recorded.rs"]
#[allow(dead_code, reason = "`it` uses the rest")]
mod recorded;
#[path = "../it/schema.rs"]
mod schema;

use std::path::{Path, PathBuf};
use std::process::Command;

/// The checkout.
fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .unwrap()
}

/// The sentence about a program that is not here, with the package that has it.
fn missing(program: &str, package: &str) -> Option<String> {
    let found = Command::new(program).arg("--version").output();
    found
        .is_err()
        .then(|| format!("{program} is missing (apt install {package})"))
}

/// Runs a command that must succeed, for what it prints.
fn succeeds(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {text}{error}");
    text
}

/// An empty directory of a test.
fn empty(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&path).ok();
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn main() {
    if recorded::is_this() {
        return recorded::program();
    }
    replenish_testkit::harness::run_in_turn([
        ("ament", ament::trials()),
        ("container", container::trials()),
        ("crates", crates::trials()),
        ("ctf", ctf::trials()),
        ("debian", debian::trials()),
        ("metrics", metrics::trials()),
        ("said", said::trials()),
        ("systemd", systemd::trials()),
        ("trace", trace::trials()),
    ])
}
