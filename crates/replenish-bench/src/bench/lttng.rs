//! One LTTng-UST tracepoint, measured beside ours where `LTTng` is installed: a C program, built
//! here, in a session of its own.
//!
//! `apt install liblttng-ust-dev lttng-tools gcc` brings the parts.

use replenish_cli::outcome::Failure;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const HEADER: &str = include_str!("lttng/event.h");
const PROGRAM: &str = include_str!("lttng/measure.c");
/// Nanoseconds of a tracepoint; the error says what is missing, or what did not work.
pub(super) fn measure(cpu: usize) -> Result<f64, String> {
    let directory = Scratch::new().map_err(|e| e.to_string())?;
    let at = |name: &str| directory.0.join(name);
    let write = |name, text| std::fs::write(at(name), text).map_err(|e| e.to_string());
    write("event.h", HEADER)?;
    write("measure.c", PROGRAM)?;
    let mut cc = Command::new("cc");
    cc.args(["-O2", "-I."])
        .arg("measure.c")
        .args(["-o", "measure", "-llttng-ust", "-ldl"]);
    done(cc.current_dir(&directory.0)).map_err(|why| {
        format!("apt install gcc liblttng-ust-dev lttng-tools brings what it needs: {why}")
    })?;
    let daemon = Daemon::start(&at("sessiond.pid"))?;
    let session = Session::start(&at("trace"))?;
    let mut program = Command::new("taskset");
    program.args(["-c", &cpu.to_string()]).arg(at("measure"));
    let output = done(program.env("LTTNG_UST_REGISTER_TIMEOUT", "-1"))?;
    drop((session, daemon));
    let text = String::from_utf8_lossy(&output.stdout);
    let number = text.trim().parse().ok();
    number.ok_or_else(|| format!("its program printed {text:?}"))
}

/// Says on standard error why there is no figure.
pub(super) fn measure_or_say(cpu: usize) -> Option<f64> {
    measure(cpu)
        .inspect_err(|why| eprintln!("no LTTng: {why}"))
        .ok()
}

fn done(command: &mut Command) -> Result<Output, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.stdin(Stdio::null()).output();
    let output = output.map_err(|e| format!("{name}: {e}"))?;
    if output.status.success() {
        return Ok(output);
    }
    let why = String::from_utf8_lossy(&output.stderr);
    Err(format!("{name}: {}", why.trim()))
}

fn lttng(words: &[&str]) -> Result<Output, String> {
    done(Command::new("lttng").arg("--no-sessiond").args(words))
}

/// A directory that goes with it.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Result<Self, Failure> {
        let name = format!("replenish-lttng-{}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir(&path).map_err(Failure::refused)?;
        Ok(Self(path))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

/// The session daemon, if none ran before.
struct Daemon(Option<PathBuf>);

impl Daemon {
    fn start(pid_file: &Path) -> Result<Self, String> {
        if lttng(&["list"]).is_ok() {
            return Ok(Self(None));
        }
        let mut command = Command::new("lttng-sessiond");
        command
            .args(["--no-kernel", "--daemonize", "--pidfile"])
            .arg(pid_file);
        let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
        match status {
            Ok(status) if status.success() => Ok(Self(Some(pid_file.into()))),
            Ok(status) => Err(format!("lttng-sessiond: {status}")),
            Err(e) => Err(format!("lttng-sessiond: {e}")),
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let pid = self
            .0
            .as_ref()
            .and_then(|file| std::fs::read_to_string(file).ok());
        if let Some(pid) = pid {
            Command::new("kill").arg(pid.trim()).status().ok();
        }
    }
}

/// A session in memory, as a flight recorder of `LTTng` would be.
struct Session(String);

impl Session {
    fn start(out: &Path) -> Result<Self, String> {
        let name = format!("replenish-{}", std::process::id());
        let output = format!("--output={}", out.display());
        lttng(&["create", &name, "--snapshot", &output])?;
        let session = Self(name);
        lttng(&["enable-event", "-u", "replenish_bench:*"])?;
        lttng(&["start"])?;
        Ok(session)
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        lttng(&["destroy", &self.0]).ok();
    }
}
