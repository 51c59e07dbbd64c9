//! Every message that a user can provoke at the command line and at the start of a program, each
//! read once aloud. `tests/said/*.txt` has a line for each command, and below it its exit code and
//! what it wrote on standard error.
//!
//! With `REPLENISH_REWRITE=1` the files are written anew: add a line that begins with `$`, rewrite,
//! and read.

use crate::{empty, repository, succeeds};
use replenish_testkit::harness::{Trial, trial};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const REPLENISH: &str = env!("CARGO_BIN_EXE_replenish");

pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = vec![trial("a_program", || {
        compare("program.txt", &[heartbeat()], Path::new("off"));
    })];
    // Without its features the command has other options.
    if cfg!(feature = "secure") {
        trials.push(trial("the_command", || {
            // Files that other trials damage lie in other directories.
            compare("command.txt", &[REPLENISH.into()], &empty("said-live"));
        }));
    }
    trials
}

/// The program of `examples/ros2_package`, built.
fn heartbeat() -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    succeeds(
        Command::new(env!("CARGO"))
            .args([
                "build",
                "--quiet",
                "--locked",
                "-p",
                "heartbeat",
                "--target-dir",
            ])
            .arg(target)
            .current_dir(repository()),
    );
    target.join("debug/heartbeat")
}

/// `live`: the directory of recordings.
fn compare(file: &str, programs: &[PathBuf], live: &Path) {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/said");
    let path = directory.join(file);
    let expected = std::fs::read_to_string(&path).unwrap();
    let mut said = String::new();
    for line in expected.lines().filter_map(|l| l.strip_prefix("$ ")) {
        let (code, text) = run(line, programs, &directory, live);
        writeln!(said, "$ {line}\n{code}\n{text}").unwrap();
    }
    if std::env::var_os("REPLENISH_REWRITE").is_some_and(|v| v == "1") {
        std::fs::write(&path, said).unwrap();
        return;
    }
    // The first command that says something else, and not two pages of text.
    let entries = |text: &str| -> Vec<String> {
        let entries = format!("\n{text}");
        entries.split("\n$ ").skip(1).map(str::to_owned).collect()
    };
    for (said, expected) in entries(&said).iter().zip(entries(&expected)) {
        let hint = "REPLENISH_REWRITE=1 writes the file anew";
        assert_eq!(said.trim_end(), expected.trim_end(), "{file}; {hint}");
    }
}

/// The exit code, and standard error.
fn run(line: &str, programs: &[PathBuf], directory: &Path, live: &Path) -> (i32, String) {
    let path = std::env::var("PATH").unwrap();
    let mut folders: Vec<PathBuf> = programs
        .iter()
        .map(|p| p.parent().unwrap().into())
        .collect();
    folders.extend(std::env::split_paths(&path));
    let output = Command::new("sh")
        .args(["-c", line])
        .current_dir(directory)
        .env("PATH", std::env::join_paths(folders).unwrap())
        .env("REPLENISH_LEDGER", "off")
        .env("REPLENISH_LIVE", live)
        .env_remove("ROS_DOMAIN_ID")
        .env_remove("COLUMNS")
        .env("NO_COLOR", "1")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let code = output.status.code().unwrap_or(-1);
    assert_ne!(code, 0, "{line}: it was not refused");
    (code, String::from_utf8(output.stderr).unwrap())
}
