//! The kernel's scheduler trace, in an instance of its own that goes when this is dropped.

use super::timeline::{Reader, Timeline};
use crate::load::Nanos;
use replenish_cli::outcome::Failure;
use replenish_os::baseline::CpuTicks;
use replenish_os::{Policy, Thread, ThreadSpec};
use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Where the kernel's documentation mounts it.
const USUAL: &str = "/sys/kernel/tracing";
/// Of an instance, before the id of its process.
const NAME: &str = "replenish-";
/// The events, and what is wanted of other CPUs: one that reads a worker's CPU clock advances it,
/// and `N` stands for the CPU under test.
const EVENTS: [(&str, &str); 12] = [
    ("sched/sched_switch", ""),
    ("sched/sched_wakeup", " || target_cpu == N"),
    ("sched/sched_stat_runtime", " || comm ~ \"w*\""),
    ("sched/sched_pi_setprio", ""),
    ("syscalls/sys_enter_sched_setscheduler", WATCHDOG),
    ("syscalls/sys_enter_sched_setparam", WATCHDOG),
    ("timer/hrtimer_start", ""),
    ("timer/hrtimer_expire_entry", ""),
    ("irq/irq_handler_entry", ""),
    ("irq/irq_handler_exit", ""),
    ("irq/softirq_entry", ""),
    ("irq/softirq_exit", ""),
];
/// A timer of the kernel rings so often on the CPU under test: late, it stood still.
const TICKS: Nanos = 50_000;
/// The watchdog judges in the place of an enforcer that does not get the CPU.
const WATCHDOG: &str = " || comm == \"watchdog\"";
/// The reader's priority: above what else is on its CPU, below the executor's own threads.
const READER_PRIORITY: u8 = 50;
/// Per CPU: seconds of a busy machine.
const BUFFER_KIB: &str = "32768";
/// `O_NONBLOCK` of the architectures that this runs on.
const NON_BLOCKING: i32 = 0o4000;

/// A trace under way.
pub(super) struct Trace {
    instance: PathBuf,
    over: Arc<AtomicBool>,
    reader: Option<Thread<Timeline>>,
    /// Where the kernel refuses them, the judge has its other signs.
    _ticks: Option<CpuTicks>,
}

impl Trace {
    /// Traces what happens on `cpu` from now on; the text goes to `reader` on the CPU `support`,
    /// and `keep` gets a copy of it.
    pub(super) fn start(
        cpu: usize,
        support: usize,
        reader: Reader,
        keep: Option<&Path>,
    ) -> Result<Self, Failure> {
        let root = root()?;
        let copy = keep.map(fs::File::create).transpose();
        let copy = copy.map_err(|e| refused(keep.unwrap_or(&root), &e))?;
        let instances = root.join("instances");
        remove_stale(&instances);
        let instance = instances.join(format!("{NAME}{}", std::process::id()));
        fs::create_dir_all(&instance).map_err(|e| refused(&instance, &e))?;
        let mut trace = Self {
            instance,
            over: Arc::default(),
            reader: None,
            _ticks: CpuTicks::start(cpu, TICKS).ok(),
        };
        trace.set("buffer_size_kb", BUFFER_KIB)?;
        trace.set("trace_clock", "mono")?;
        for (event, more) in EVENTS {
            let filter = format!("CPU == N{more}").replace('N', &cpu.to_string());
            trace.set(&format!("events/{event}/filter"), &filter)?;
            trace.set(&format!("events/{event}/enable"), "1")?;
        }
        let path = trace.instance.join("trace_pipe");
        let pipe = fs::OpenOptions::new()
            .read(true)
            .custom_flags(NON_BLOCKING)
            .open(&path)
            .map_err(|e| refused(&path, &e))?;
        let over = Arc::clone(&trace.over);
        let policy = Policy::fifo(READER_PRIORITY).map_err(Failure::refused)?;
        let spec = ThreadSpec::new("trace").policy(policy).cpu(support);
        let thread = replenish_os::spawn(spec, move || read(pipe, copy, reader, &over));
        trace.reader = Some(thread.map_err(Failure::refused)?);
        Ok(trace)
    }

    /// Ends it; what happened.
    pub(super) fn finish(mut self) -> Result<Timeline, Failure> {
        self.set("tracing_on", "0")?;
        self.over.store(true, Ordering::Release);
        let reader = self.reader.take().map(Thread::join);
        match reader {
            Some(Ok(timeline)) => Ok(timeline),
            _ => Err(Failure::refused("the reader of the trace panicked")),
        }
    }

    fn set(&self, file: &str, value: &str) -> Result<(), Failure> {
        let path = self.instance.join(file);
        fs::write(&path, value).map_err(|e| refused(&path, &e))
    }
}

impl Drop for Trace {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        if let Some(reader) = self.reader.take() {
            reader.join().ok();
        }
        fs::remove_dir(&self.instance).ok();
    }
}

fn refused(path: &Path, e: &std::io::Error) -> Failure {
    Failure::refused(format!("the kernel's trace: {}: {e}", path.display()))
}

/// Removes the instances of processes that were killed: each holds its buffers for good.
fn remove_stale(instances: &Path) {
    let entries = fs::read_dir(instances).into_iter().flatten().flatten();
    let lives = |id: u32| Path::new("/proc").join(id.to_string()).exists();
    for entry in entries.filter(|e| is_stale(&e.file_name().to_string_lossy(), lives)) {
        fs::remove_dir(entry.path()).ok(); // in use still: somebody reads it
    }
}

/// Whether an instance of this name belongs to a process of ours that has ended.
fn is_stale(name: &str, lives: impl Fn(u32) -> bool) -> bool {
    let id = name.strip_prefix(NAME).and_then(|id| id.parse().ok());
    id.is_some_and(|id| !lives(id))
}

/// The file system of the trace, mounted if need be.
fn root() -> Result<PathBuf, Failure> {
    let usual = PathBuf::from(USUAL);
    if !usual.join("trace_pipe").exists() {
        let mount = Command::new("mount")
            .args(["-t", "tracefs", "tracefs", USUAL])
            .output();
        let why = match mount {
            Ok(output) if output.status.success() => return Ok(usual),
            Ok(output) => String::from_utf8_lossy(&output.stderr).trim().to_string(),
            Err(e) => e.to_string(),
        };
        return Err(Failure::refused(format!(
            "bench torture judges by the kernel's scheduler trace, and cannot mount tracefs at \
             {USUAL}: {why}"
        )));
    }
    Ok(usual)
}

fn read(
    mut pipe: fs::File,
    mut copy: Option<fs::File>,
    mut reader: Reader,
    over: &AtomicBool,
) -> Timeline {
    let mut buffer = vec![0_u8; 1 << 18];
    let mut text = Vec::new();
    loop {
        // Asked before reading: the last records are read after the end.
        let last = over.load(Ordering::Acquire);
        match pipe.read(&mut buffer) {
            Ok(0) if last => return reader.finish(),
            Ok(n) if n > 0 => {
                let came = buffer.get(..n).unwrap_or_default();
                // A copy that cannot be written is short; the judge does not need it.
                if copy.as_mut().is_some_and(|c| c.write_all(came).is_err()) {
                    copy = None;
                }
                text.extend_from_slice(came);
                let end = text
                    .iter()
                    .rposition(|b| *b == b'\n')
                    .map_or(0, |at| at + 1);
                let rest = text.split_off(end);
                String::from_utf8_lossy(&text)
                    .lines()
                    .for_each(|l| reader.line(l));
                text = rest;
            }
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) if last || e.kind() != ErrorKind::WouldBlock => return reader.finish(),
            _ => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instances_of_others_and_of_processes_that_live_stay() {
        let lives = |id| id == 7;
        assert!(is_stale("replenish-8", lives));
        assert!(!is_stale("replenish-7", lives));
        for foreign in ["perf", "replenish-", "replenish-8x", "other-8"] {
            assert!(!is_stale(foreign, lives), "{foreign}");
        }
    }

    #[test]
    fn the_instance_of_a_killed_process_is_removed() {
        let instances = std::env::temp_dir().join(format!("tracefs-{}", std::process::id()));
        let (mine, dead) = (std::process::id(), u32::MAX);
        for id in [mine, dead] {
            fs::create_dir_all(instances.join(format!("{NAME}{id}"))).unwrap();
        }
        remove_stale(&instances);
        let left: Vec<_> = fs::read_dir(&instances).unwrap().flatten().collect();
        assert_eq!(left.len(), 1);
        assert_eq!(left[0].file_name(), *format!("{NAME}{mine}"));
        fs::remove_dir_all(&instances).unwrap();
    }
}
