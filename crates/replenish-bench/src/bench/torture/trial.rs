//! One case: the child, the disturbances from outside, and the evidence.

use super::case::{Case, name};
use super::child::{DROP, News, Order};
use super::judge::{Evidence, Halt};
use super::timeline::Reader;
use super::tracefs::Trace;
use crate::load::{MS, Nanos};
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_os::clock;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

/// The child answers within this time, or it hangs.
const PATIENCE: Duration = Duration::from_secs(10);
/// A stopped process comes to rest in this time, unless others have the CPU.
const REST: Nanos = 20 * MS;
/// It does in this time whoever has it.
const LONGEST_REST: Nanos = 2_000 * MS;

/// The outcome of a case.
pub(super) struct Shown {
    /// The case as it ran: the executor chooses the priorities of guarantees.
    pub case: Case,
    pub evidence: Evidence,
    pub fallbacks: Vec<String>,
    /// The executor did not do what it must: a sentence each.
    pub faults: Vec<String>,
    /// Time that the hypervisor took of the CPU under test.
    pub stolen: Nanos,
}

/// Runs a case for so many seconds; `keep` gets the kernel's trace.
pub(super) fn run(
    case: &Case,
    seconds: u64,
    cpus: Cpus,
    keep: Option<&Path>,
    stop: &Stop,
) -> Result<Shown, Failure> {
    let reader = Reader::new(cpus.measured).with_prompt(case.prompt());
    let trace = Trace::start(cpus.measured, cpus.support, reader, keep)?;
    let mut child = Child::start(&Order {
        case: case.clone(),
        cpu: cpus.measured,
        support: cpus.support,
    })?;
    let mut faults = Vec::new();
    let mut case = case.clone();
    let fallbacks = match child.hear() {
        Some(News::Started { fallbacks, workers }) => {
            case.workers = workers;
            fallbacks
        }
        other => {
            faults.push(format!("the executor did not start: {other:?}"));
            Vec::new()
        }
    };
    let mut evidence = Evidence::default();
    let stolen = || replenish_os::steal_time(cpus.measured).unwrap_or(0);
    let before = stolen();
    if faults.is_empty() {
        observe(&mut child, &case, seconds, stop, &mut evidence)?;
        child.stdin = None;
        let mut news = child.hear();
        // Without the right to raise it, a worker that has asked for the enforcer's lock may wait
        // for the CPU to the end, and whoever reads the account waits behind it.
        while case.drops_at.is_some() && matches!(news, Some(News::Account(_))) {
            news = child.hear();
        }
        match news {
            Some(News::Ended { stuck }) if stuck.is_empty() => {}
            Some(News::Ended { stuck }) => faults.push(format!("stuck: {}", stuck.join(", "))),
            other => faults.push(format!("the executor did not stop: {other:?}")),
        }
        if let Some(why) = child.bad_end() {
            faults.push(why);
        }
    }
    drop(child);
    let stolen = stolen().saturating_sub(before);
    evidence.timeline = trace.finish()?;
    Ok(Shown {
        case,
        evidence,
        fallbacks,
        faults,
        stolen,
    })
}

/// From one stop of the whole process to another one, with what happens in between.
fn observe(
    child: &mut Child,
    case: &Case,
    seconds: u64,
    stop: &Stop,
    evidence: &mut Evidence,
) -> Result<(), Failure> {
    let sleep_until = |time| sleep_until(time, stop);
    sleep_until(clock::monotonic() + 100 * MS)?;
    let threads = child.threads();
    evidence.own = threads.values().copied().collect();
    let enforcer = threads
        .iter()
        .find(|(name, _)| name.starts_with("enforcer"));
    evidence.enforcer = enforcer.map(|(_, tid)| *tid);
    let workers = (0..case.workers.len()).map(|index| threads.get(&name(index)).copied());
    evidence.threads = workers.map(|tid| tid.unwrap_or(-1)).collect();

    let from = clock::monotonic();
    child.signal("STOP")?;
    child.rest();
    evidence.clocks[0] = child.clocks(&evidence.threads);
    evidence.from = clock::monotonic();
    evidence.halts.push(child.go_on(from)?);
    let end = evidence.from + seconds * 1000 * MS;
    sleep_until(evidence.from + 50 * MS)?;
    evidence.accounts[0] = child.account();
    let mut drops_at = case.drops_at.map(|after| evidence.from + after);
    for halt in &case.stops {
        let at = evidence.from + halt.at;
        if let Some(drop) = drops_at.take_if(|drop| *drop < at) {
            sleep_until(drop)?;
            child.say(DROP);
        }
        if at < clock::monotonic() || at + halt.lasts + 100 * MS > end {
            continue;
        }
        sleep_until(at)?;
        let stopped = clock::monotonic();
        child.signal("STOP")?;
        sleep_until(clock::monotonic() + halt.lasts)?;
        evidence.halts.push(child.go_on(stopped)?);
    }
    if let Some(drop) = drops_at {
        sleep_until(drop)?;
        child.say(DROP);
    }
    sleep_until(end.saturating_sub(50 * MS))?;
    evidence.accounts[1] = child.account();
    sleep_until(end)?;
    evidence.ends = clock::monotonic();
    child.signal("STOP")?;
    child.rest();
    evidence.to = clock::monotonic();
    evidence.clocks[1] = child.clocks(&evidence.threads);
    child.signal("CONT")
}

/// Fails as soon as somebody wants the end: the child and the trace go at once.
fn sleep_until(time: Nanos, stop: &Stop) -> Result<(), Failure> {
    // A signal is noticed within so long, and the last stretch is as exact as the clock.
    while clock::monotonic() + 100 * MS < time {
        clock::sleep_until(clock::monotonic() + 50 * MS);
        if stop.is_triggered() {
            return Err(Failure::refused("interrupted"));
        }
    }
    clock::sleep_until(time);
    Ok(())
}

/// The process of the executor under test; dropping it ends it.
struct Child {
    process: std::process::Child,
    stdin: Option<ChildStdin>,
    news: Receiver<News>,
}

impl Child {
    fn start(order: &Order) -> Result<Self, Failure> {
        let program = std::env::current_exe().map_err(Failure::refused)?;
        let mut process = Command::new(program)
            .args(["bench", "torture", "--child"])
            .env("REPLENISH_LEDGER", "off")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(Failure::refused)?;
        let (stdin, stdout) = (process.stdin.take(), process.stdout.take());
        let (tx, news) = mpsc::channel();
        std::thread::spawn(move || {
            let lines = stdout.map(|out| BufReader::new(out).lines().map_while(Result::ok));
            for line in lines.into_iter().flatten() {
                if let Ok(said) = serde_json::from_str(&line)
                    && tx.send(said).is_err()
                {
                    return;
                }
            }
        });
        let mut child = Self {
            process,
            stdin,
            news,
        };
        child.say(&serde_json::to_string(order).map_err(Failure::refused)?);
        Ok(child)
    }

    /// A child that has ended does not hear it, and does not answer.
    fn say(&mut self, line: &str) {
        if let Some(stdin) = &mut self.stdin {
            writeln!(stdin, "{line}").and_then(|()| stdin.flush()).ok();
        }
    }

    fn hear(&self) -> Option<News> {
        self.news.recv_timeout(PATIENCE).ok()
    }

    fn account(&mut self) -> Vec<super::child::Reading> {
        self.say("account");
        match self.hear() {
            Some(News::Account(readings)) => readings,
            _ => Vec::new(),
        }
    }

    fn signal(&self, signal: &str) -> Result<(), Failure> {
        let id = self.process.id().to_string();
        let status = Command::new("kill").args(["-s", signal, &id]).status();
        status.map(drop).map_err(Failure::refused)
    }

    /// Ends a stop that began after `from`.
    fn go_on(&self, from: Nanos) -> Result<Halt, Failure> {
        let continues = clock::monotonic();
        self.signal("CONT")?;
        Ok(Halt {
            from,
            continues,
            to: clock::monotonic(),
        })
    }

    fn path(&self) -> String {
        format!("/proc/{}/task", self.process.id())
    }

    /// Waits until every thread has stopped: one that has not had the CPU since the signal has some
    /// instructions to go, and its CPU clock would be read too early. A thread that is said to be
    /// stopped may still be on its way off the CPU, and is charged when it gets there: both looks
    /// must find all of them stopped.
    fn rest(&self) {
        let end = clock::monotonic() + LONGEST_REST;
        let mut looks = 0;
        while looks < 2 && clock::monotonic() < end {
            clock::sleep_until(clock::monotonic() + REST);
            let tasks = fs::read_dir(self.path()).into_iter().flatten().flatten();
            // One that has ended since has no state.
            let mut states = tasks.flat_map(|task| fs::read_to_string(task.path().join("stat")));
            let all_stopped = states.all(|stat| is_stopped(&stat));
            looks = if all_stopped { looks + 1 } else { 0 };
        }
    }

    /// All threads by name.
    fn threads(&self) -> BTreeMap<String, i32> {
        let mut all = BTreeMap::new();
        for entry in fs::read_dir(self.path()).into_iter().flatten().flatten() {
            let comm = fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
            if let Ok(tid) = entry.file_name().to_string_lossy().parse() {
                let mut name = comm.trim().to_string();
                while all.contains_key(&name) {
                    name.push('+');
                }
                all.insert(name, tid);
            }
        }
        all
    }

    /// The CPU time of the threads, by `/proc`: exact while they are stopped.
    fn clocks(&self, threads: &[i32]) -> Vec<Nanos> {
        let read = |tid: &i32| {
            let text = fs::read_to_string(format!("{}/{tid}/schedstat", self.path())).ok()?;
            text.split_whitespace().next()?.parse().ok()
        };
        threads.iter().map(|tid| read(tid).unwrap_or(0)).collect()
    }

    /// Why its end is not a good one.
    fn bad_end(&mut self) -> Option<String> {
        let end = clock::monotonic() + 10_000 * MS;
        while clock::monotonic() < end {
            match self.process.try_wait() {
                Ok(Some(status)) if status.success() => return None,
                Ok(Some(status)) => return Some(format!("the process ended with {status}")),
                _ => std::thread::sleep(Duration::from_millis(10)),
            }
        }
        Some("the process did not end".into())
    }
}

/// Whether the thread of this `/proc/…/stat` is stopped: `7 (w) 0) T 1 …`.
fn is_stopped(stat: &str) -> bool {
    let state = stat.rsplit_once(") ").map_or("", |(_, rest)| rest);
    state.starts_with('T')
}

impl Drop for Child {
    fn drop(&mut self) {
        // It has ended, or hangs, or is stopped: nothing but this ends it for certain.
        self.process.kill().ok();
        self.process.wait().ok();
    }
}

#[cfg(test)]
mod tests {
    use super::is_stopped;

    /// Torture, seed 13: a worker that had not had the CPU since the signal ran for another 227 us,
    /// half of it after its clock was read.
    #[test]
    fn a_process_rests_when_all_its_threads_are_stopped() {
        assert!(is_stopped("7 (w) R (x) T 1 7 7 0"));
        assert!(!is_stopped("7 (w) T (x) R 1 7 7 0"));
        assert!(!is_stopped("7 (enforcer/1) S 1 7 7 0"));
        assert!(!is_stopped(""));
    }
}
