//! `cargo xtask … | head`: a reader that goes ends it, without a word about it.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::io::{Read as _, pipe};
use std::process::{Command, Stdio};

#[test]
fn a_reader_that_goes_ends_it_quietly() {
    // Without QEMU it is standard error that something is written to.
    let (reader, nobody) = pipe().unwrap();
    drop(reader);
    let mut check = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let both = check
        .args(["board", "check"])
        .stdin(Stdio::null())
        .stdout(nobody.try_clone().unwrap())
        .stderr(nobody)
        .status()
        .unwrap();
    assert_eq!(both.code(), Some(141), "as a shell has it of `yes | head`");
}

#[test]
fn a_full_disk_is_an_error_that_is_told() {
    let full = std::fs::File::options()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let (mut said, stderr) = pipe().unwrap();
    let mut check = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let status = check
        .args(["board", "check"])
        .stdin(Stdio::null())
        .stdout(full)
        .stderr(stderr)
        .status()
        .unwrap();
    drop(check); // and with it our end of the pipe
    let mut text = String::new();
    said.read_to_string(&mut text).unwrap();
    assert_eq!(status.code(), Some(1), "{text}");
    assert!(!text.contains("panicked"), "{text}");
}
