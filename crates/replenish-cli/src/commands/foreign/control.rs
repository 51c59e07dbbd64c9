//! The socket of a supervisor: another `replenish` asks which programs it has, and has one
//! released.
//!
//! The address is an abstract one with the supervisor's process number, so nothing has to be
//! removed after it was killed. Both sides talk to the same user and to root alone.

use crate::outcome::Failure;
use crate::signals::Stop;
use replenish_os::Tid;
use replenish_os::foreign::{peer_user, user};
use std::io::{Read, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener, UnixStream};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

const PREFIX: &str = "replenish-adopt-";
/// The longest time that one side waits for the other.
const PATIENCE: Duration = Duration::from_secs(1);
/// The longest answer that is read, in bytes.
const LONGEST: u64 = 1 << 20;
/// Supervisors that are asked.
const MOST: usize = 256;

/// A program under budgets.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Program {
    /// The process that gives it budgets.
    pub(crate) supervisor: u32,
    pub(crate) pid: i32,
    pub(crate) name: String,
    /// Its threads under budgets.
    pub(crate) threads: u64,
    /// The rules, as they were said.
    pub(crate) budgets: String,
}

/// A supervisor's side.
#[derive(Debug, Clone, Default)]
pub(super) struct Control(Arc<Mutex<Shared>>);

#[derive(Debug, Default)]
struct Shared {
    programs: Vec<Program>,
    releases: Vec<Tid>,
}

impl Control {
    /// Listens from now on; a question wakes `stop`'s waiters no earlier than their time.
    pub(super) fn start() -> Result<Self, Failure> {
        let refused = |e| Failure::refused(format!("cannot listen for --list and --release: {e}"));
        let address = address(std::process::id()).map_err(refused)?;
        let listener = UnixListener::bind_addr(&address).map_err(refused)?;
        let control = Self::default();
        let theirs = control.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                theirs.answer(stream);
            }
        });
        Ok(control)
    }

    /// Sets the programs that the next question is answered with.
    pub(super) fn tell(&self, programs: Vec<Program>) {
        self.shared().programs = programs;
    }

    /// Processes that are to be released.
    pub(super) fn releases(&self) -> Vec<Tid> {
        std::mem::take(&mut self.shared().releases)
    }

    fn shared(&self) -> std::sync::MutexGuard<'_, Shared> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn answer(&self, mut stream: UnixStream) {
        if !is_trusted(&stream) || stream.set_read_timeout(Some(PATIENCE)).is_err() {
            return;
        }
        stream.set_write_timeout(Some(PATIENCE)).ok();
        let mut question = String::new();
        let asked = (&stream).take(64).read_to_string(&mut question);
        if asked.is_err() {
            return;
        }
        let answer = match question.strip_prefix("release ") {
            None => serde_json::to_string(&self.shared().programs).unwrap_or_default(),
            Some(pid) => {
                let pid = pid.trim().parse().ok().and_then(Tid::new);
                let mut shared = self.shared();
                let has = |pid: &Tid| shared.programs.iter().any(|p| p.pid == pid.get());
                let found = pid.filter(has);
                shared.releases.extend(found);
                found.is_some().to_string()
            }
        };
        stream.write_all(answer.as_bytes()).ok(); // gone again: nobody wants to know
    }
}

fn address(supervisor: u32) -> std::io::Result<SocketAddr> {
    SocketAddr::from_abstract_name(format!("{PREFIX}{supervisor}"))
}

/// Whether the other side is the same user or root; to root everybody is.
fn is_trusted(stream: &UnixStream) -> bool {
    peer_user(stream).is_ok_and(|peer| peer == 0 || peer == user())
}

/// Asks supervisor `number`.
fn ask(number: u32, question: &str) -> Option<String> {
    let stream = UnixStream::connect_addr(&address(number).ok()?).ok()?;
    if !is_trusted(&stream) {
        return None;
    }
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    (&stream).write_all(question.as_bytes()).ok()?;
    stream.shutdown(std::net::Shutdown::Write).ok()?;
    let mut answer = String::new();
    stream.take(LONGEST).read_to_string(&mut answer).ok()?;
    Some(answer)
}

/// The supervisors that run in this network namespace.
fn supervisors() -> Vec<u32> {
    let text = std::fs::read_to_string("/proc/net/unix").unwrap_or_default();
    let names = text
        .lines()
        .filter_map(|line| line.split_whitespace().last());
    let numbers = names.filter_map(|name| name.strip_prefix('@')?.strip_prefix(PREFIX));
    let mut numbers: Vec<u32> = numbers.filter_map(|number| number.parse().ok()).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers.truncate(MOST);
    numbers
}

/// Every program of this user that has budgets.
pub(crate) fn list() -> Vec<Program> {
    let answers = supervisors().into_iter().filter_map(|number| {
        let answer = ask(number, "list")?;
        let mut programs: Vec<Program> = serde_json::from_str(&answer).ok()?;
        for program in &mut programs {
            program.supervisor = number;
            program.name.retain(|c| !c.is_control());
            program.budgets.retain(|c| !c.is_control());
        }
        Some(programs)
    });
    answers.flatten().collect()
}

/// Has process `pid` released; waits until it is.
pub(crate) fn release(pid: u32, stop: &Stop) -> Result<(), Failure> {
    let has = |program: &&Program| u32::try_from(program.pid) == Ok(pid);
    let programs = list();
    let Some(program) = programs.iter().find(has) else {
        return Err(Failure::refused(format!(
            "process {pid} has no budgets from here: `replenish adopt --list` shows all that have"
        )));
    };
    ask(program.supervisor, &format!("release {pid}"));
    for _ in 0..50 {
        if !list().iter().any(|p| has(&p)) {
            return Ok(());
        }
        if stop.wait(Duration::from_millis(20)) {
            break;
        }
    }
    Err(Failure::refused(format!(
        "supervisor {} has not released process {pid} within a second",
        program.supervisor
    )))
}
