//! Builds an image and runs cases of it in QEMU, deterministically: `-icount` makes every
//! instruction 8 ns of virtual time, whatever the host does.

use super::host::{self, TARGET};
use crate::output::Outcome;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Compiler flags of fast images: for the chip's core, and with functions
/// repeated where they are called rather than called.
const SPEED: &str =
    "-Ctarget-cpu=cortex-m4 -Cllvm-args=-inline-threshold=1000 -Cllvm-args=-unroll-threshold=30";

/// Builds image `name`; its ELF file.
pub(crate) fn build(name: &str) -> Outcome<PathBuf> {
    build_for(name, "release")
}

/// Builds image `name` without texts; its ELF file.
pub(crate) fn build_without_texts(name: &str) -> Outcome<PathBuf> {
    build_with(name, "release", &["--no-default-features"])
}

/// Builds image `name` with a profile; its ELF file.
pub(crate) fn build_for(name: &str, profile: &str) -> Outcome<PathBuf> {
    build_with(name, profile, &[])
}

/// Builds image `name` with a profile and more options of cargo; its ELF file.
pub(crate) fn build_with(name: &str, profile: &str, options: &[&str]) -> Outcome<PathBuf> {
    host::check()?;
    let firmware = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware");
    let target = match std::env::var_os("CARGO_TARGET_DIR") {
        Some(dir) => std::path::absolute(PathBuf::from(dir).join("firmware")),
        None => std::path::absolute(firmware.join("target")),
    }
    .map_err(|e| e.to_string())?;
    // In addition to firmware/.cargo/config.toml.
    let flags = if profile == "speed" { SPEED } else { "" };
    let status = Command::new("cargo")
        .args(["build", "--quiet", "--profile", profile, "--bin", name])
        .args(options)
        .env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS", flags)
        .current_dir(&firmware) // its .cargo/config.toml names target and linker script
        .env("CARGO_TARGET_DIR", &target)
        .env_remove("RUSTFLAGS")
        .status()
        .map_err(|e| format!("cargo: {e}"))?;
    if !status.success() {
        return Err(format!("the image {name} was not built"));
    }
    Ok(target.join(TARGET).join(profile).join(name))
}

/// The emulator with `image`, which gets `words` as its command line. A `-serial` that is added is
/// the board's USART2. `sleeps`: it takes its time while the board sleeps, so that
/// the board's clock runs about as the host's.
pub(crate) fn command(image: &Path, words: &[String], sleeps: bool) -> Command {
    let mut semihosting = String::from("enable=on,target=native,arg=image");
    for word in words {
        semihosting.push_str(",arg=");
        semihosting.push_str(word);
    }
    let mut command = Command::new("qemu-system-arm");
    command
        .args(["-M", "olimex-stm32-h405", "-nographic", "-monitor", "none"])
        .args(["-serial", "null", "-icount"])
        .arg(if sleeps {
            "shift=3,sleep=on"
        } else {
            "shift=3,sleep=off"
        })
        .args(["-semihosting-config", &semihosting])
        .arg("-kernel")
        .arg(image);
    command
}

/// Boots the image with `words` as its command line; returns its output.
pub(crate) fn boot(image: &Path, words: &[String]) -> Outcome<String> {
    let output = command(image, words, false)
        .output()
        .map_err(|e| format!("qemu-system-arm: {e}"))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    if output.status.success() {
        Ok(text)
    } else {
        Err(format!("the image failed on {words:?}:\n{text}"))
    }
}

/// Boots the image and reads its JSON.
pub(crate) fn measure(image: &Path, words: &[String]) -> Outcome<Value> {
    let text = boot(image, words)?;
    serde_json::from_str(&text).map_err(|e| format!("{e} in what the image printed:\n{text}"))
}
