//! The agent under load: a process of its own, watched from outside.

use super::generator::DEPTH;
use crate::load::Nanos;
use crate::roles::protocol::Event;
use crate::testbench::child::{Child, News};
use replenish_cli::machine::facts;
use replenish_cli::outcome::Failure;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver};
use std::time::Duration;

/// Time that the agent has to start, and to end.
const PATIENCE: Duration = Duration::from_secs(10);

/// Clock ticks a second in `/proc/PID/stat`; 100 on every Linux since 2.6.
const TICKS: f64 = 100.0;

/// A running agent.
#[derive(Debug)]
pub(super) struct AgentProcess {
    child: Child,
    address: SocketAddr,
    /// The file that the agent writes when it ends.
    json: PathBuf,
    samples: Vec<Sample>,
    /// Keeps its events from being refused.
    _news: Receiver<News>,
}

/// The accounts of the kernel about the agent at one time.
#[derive(Debug, Clone, Copy)]
struct Sample {
    at: Nanos,
    resident: u64,
    cpu_seconds: f64,
    /// Time so far that threads were ready and had no CPU: the agent's, the clients', and what the
    /// hypervisor kept of all CPUs, in ns.
    waited: [Nanos; 3],
}

/// Measurements of an agent that has ended.
#[derive(Debug)]
pub(super) struct Seen {
    /// The counters of the agent itself.
    pub(super) counters: serde_json::Value,
    /// Resident bytes after ten seconds, or as near to that as there is, and at the end.
    pub(super) resident: (u64, u64),
    /// CPUs that the agent kept busy.
    pub(super) cpus: f64,
    /// The cause of the tail, in ns: how long the agent and the clients were ready and had no CPU,
    /// and what the hypervisor kept of all CPUs.
    pub(super) waited: [Nanos; 3],
}

impl AgentProcess {
    /// Starts it on a free port of loopback, with room for that many clients.
    pub(super) fn start(clients: u16, topics: u16) -> Result<Self, Failure> {
        let (sender, news) = mpsc::channel();
        let json = std::env::temp_dir().join(format!("replenish-load-{}.json", std::process::id()));
        let args = [
            "--udp=127.0.0.1:0".to_string(),
            format!("--clients={clients}"),
            // Topics and their endpoints, both ways; participant, publisher, subscriber.
            format!("--entities={}", 4 * topics + 3),
            "--strangers-rate=0".into(),
            format!("--depth={DEPTH}"),
            "--ordinary".into(),
            format!("--json={}", json.display()),
        ];
        let child = Child::spawn("agent", &args, sender)?;
        let address = loop {
            match news.recv_timeout(PATIENCE) {
                Ok(News::Event(_, Event::Ready(ready))) => break ready.address,
                Ok(News::Event(..)) => {}
                _ => return Err(Failure::refused("the agent does not start")),
            }
        };
        let address = address.as_deref().and_then(|text| text.parse().ok());
        Ok(Self {
            address: address.ok_or_else(|| Failure::refused("the agent's address is unknown"))?,
            child,
            json,
            samples: Vec::new(),
            _news: news,
        })
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Looks at it, `at` nanoseconds after the load began.
    pub(super) fn sample(&mut self, at: Nanos) {
        let id = self.child.id();
        let Some(resident) = resident(id) else {
            return;
        };
        self.samples.push(Sample {
            at,
            resident,
            cpu_seconds: cpu_seconds(id).unwrap_or(0.0),
            waited: [
                waited(id),
                waited(std::process::id()),
                (0..).map_while(replenish_os::steal_time).sum(),
            ],
        });
    }

    /// Ends it; what was seen.
    pub(super) fn end(mut self) -> Result<Seen, Failure> {
        let status = self.child.wait(PATIENCE)?;
        let text = std::fs::read_to_string(&self.json).unwrap_or_default();
        std::fs::remove_file(&self.json).ok();
        if !status.success() {
            return Err(Failure::refused(format!("the agent ended with {status}")));
        }
        let counters = serde_json::from_str(&text)
            .map_err(|e| Failure::refused(format!("what the agent wrote: {e}")))?;
        let first = self.samples.first().copied();
        let last = self.samples.last().copied();
        let (Some(first), Some(last)) = (first, last) else {
            return Err(Failure::refused("the agent was not seen running"));
        };
        let ten = 10 * crate::load::SEC;
        let early = self.samples.iter().find(|s| s.at >= ten).unwrap_or(&first);
        let seconds = last.at.saturating_sub(first.at) as f64 / 1e9;
        Ok(Seen {
            counters,
            resident: (early.resident, last.resident),
            cpus: (last.cpu_seconds - first.cpu_seconds) / seconds.max(1e-9),
            waited: std::array::from_fn(|i| last.waited[i].saturating_sub(first.waited[i])),
        })
    }
}

/// Bytes of memory that a process has resident.
fn resident(id: u32) -> Option<u64> {
    let status = facts::read(format!("/proc/{id}/status"))?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Time in ns that the threads of a process were ready and had no CPU.
fn waited(id: u32) -> Nanos {
    let tasks = std::fs::read_dir(format!("/proc/{id}/task"));
    let of = |stat: String| stat.split_whitespace().nth(1)?.parse::<Nanos>().ok();
    let tasks = tasks.into_iter().flatten().flatten();
    let stats = tasks.filter_map(|task| facts::read(task.path().join("schedstat")));
    stats.filter_map(of).sum()
}

/// CPU time of a process, user and system.
fn cpu_seconds(id: u32) -> Option<f64> {
    let stat = facts::read(format!("/proc/{id}/stat"))?;
    // The name, in parentheses, may contain anything.
    let (_, after) = stat.rsplit_once(')')?;
    let mut fields = after.split_whitespace().skip(11);
    let user: f64 = fields.next()?.parse().ok()?;
    let system: f64 = fields.next()?.parse().ok()?;
    Some((user + system) / TICKS)
}
