//! Requirements of the host. Nothing is installed; the commands that would install it are printed.

use crate::output::Outcome;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The images' target.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// All that is missing, in one text.
pub(crate) fn check() -> Outcome {
    let mut missing = String::new();
    let mut lacks =
        |what: &str, how: &str| missing.push_str(&format!("missing: {what}\n  {how}\n"));
    if !on_path("qemu-system-arm") {
        lacks(
            "qemu-system-arm (10.0.2 is what the results were made with)",
            "apt install qemu-system-arm   (Debian 12: -t bookworm-backports)",
        );
    }
    if !on_path("arm-none-eabi-gcc") {
        lacks(
            "arm-none-eabi-gcc, which compiles the FreeRTOS kernel",
            "apt install gcc-arm-none-eabi   (no C library is needed)",
        );
    }
    if !has_target() {
        lacks(
            "Rust's core library for the board",
            "rustup target add thumbv7em-none-eabihf",
        );
    }
    if missing.is_empty() {
        Ok(())
    } else {
        Err(missing)
    }
}

/// Names the host's program where it has been built.
const PROGRAM: &str = "REPLENISH_PROGRAM";

/// Builds the host's program, `replenish`, if `REPLENISH_PROGRAM` does not name one; where it is.
pub(crate) fn replenish() -> Outcome<PathBuf> {
    if let Some(program) = std::env::var_os(PROGRAM).map(PathBuf::from) {
        return if program.is_file() {
            Ok(program)
        } else {
            Err(format!("{PROGRAM}: there is no file {}", program.display()))
        };
    }
    let status = Command::new("cargo")
        .args(["build", "--quiet", "-p", "replenish-bench"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if !status.success() {
        return Err("the program replenish was not built".into());
    }
    Ok(target().join("debug/replenish-bench"))
}

/// The directory of cargo's builds for the host.
pub(crate) fn target() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    std::env::var_os("CARGO_TARGET_DIR").map_or(here, PathBuf::from)
}

fn on_path(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|dir| dir.join(program).is_file())
}

fn has_target() -> bool {
    let answer = Command::new("rustc")
        .args(["--print", "target-libdir", "--target", TARGET])
        .output();
    answer.is_ok_and(|a| Path::new(String::from_utf8_lossy(&a.stdout).trim()).is_dir())
}
