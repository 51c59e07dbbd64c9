//! Ping: sends on two topics and counts the answers.

use super::answers::Answers;
use super::echo::{Echo, Echoed};
use super::link;
use super::pong::report_event;
use super::protocol::Ready;
use super::sender::Sender;
use super::supervised::SharedGrid;
use crate::load::Nanos;
use crate::load::spec::{SENDER_PRIORITY, SUPPORT_PRIORITY};
use replenish::msg::std_msgs::Int32;
use replenish::{Executor, Qos, RunningExecutor};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::outcome::Failure;
use replenish_cli::signals::Stop;
use replenish_cli::threads;
use replenish_os::{Thread, ThreadSpec, spawn};
use std::fmt::Display;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The topics, in the order of all pairs here.
const TOPICS: [&str; 2] = ["high", "low"];

/// Settings of ping.
#[derive(Debug, Clone)]
pub(crate) struct Config {
    /// The agent's address.
    pub agent: SocketAddr,
    /// Time between two messages of one topic.
    pub interval: Nanos,
    /// The CPU of its threads.
    pub cpu: Option<usize>,
    /// Whether an orchestrator reads the events.
    pub supervised: bool,
    /// Whether each message of topic `tick` releases a pair, with its number, instead of the clock.
    pub ticked: bool,
    /// Messages of the low topic on top of each pair that a tick releases.
    pub flood: u32,
    /// Whether topics `sure` and `loose` are sent back.
    pub echo: bool,
}

/// A ping that runs.
pub(crate) struct Ping {
    running: RunningExecutor,
    /// Absent where ticks release the messages.
    sender: Option<Thread<()>>,
    answers: Arc<[Answers; 2]>,
    sent: Arc<[AtomicU64; 2]>,
    failed: Arc<AtomicU64>,
    echo: Option<Echo>,
}

/// Totals of both topics: high, low.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub(crate) struct Totals {
    /// Messages sent.
    pub sent: [u64; 2],
    /// Answers received.
    pub answered: [u64; 2],
    /// Messages that could not be sent.
    pub failed: u64,
    /// Messages sent back, on topics sure and loose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub echoed: Option<[Echoed; 2]>,
}

/// Connects, creates the endpoints, starts executor and sender.
pub(crate) fn start(config: &Config, grid: &SharedGrid, stop: &Stop) -> Result<Ping, Failure> {
    let context = link::connect(config.agent)?;
    let node = context.node("ping").map_err(Failure::refused)?;
    let publisher = |name: &str| {
        node.publisher(&format!("{name}_ping"), Qos::best_effort())
            .map_err(Failure::refused)
    };
    let topics = [publisher(TOPICS[0])?, publisher(TOPICS[1])?];

    let answers = Arc::new([Answers::default(), Answers::default()]);
    let supervised = config.supervised;
    let mut exec = Executor::new(&context);
    exec.on_event(move |event| report_event(event, supervised));
    exec.dispatcher(fifo_or_other(SUPPORT_PRIORITY + 1));
    if let Some(cpu) = config.cpu {
        exec.dispatcher_cpu(cpu);
    }
    let mut worker = exec
        .worker("answers")
        .policy(fifo_or_other(SUPPORT_PRIORITY));
    if let Some(cpu) = config.cpu {
        worker = worker.cpu(cpu);
    }
    for (n, name) in TOPICS.iter().enumerate() {
        let answers = Arc::clone(&answers);
        let count = move |pong: &Int32, _: &replenish::CallbackContext<'_>| {
            if let Some(a) = answers.get(n) {
                a.count(pong.data);
            }
        };
        let topic = format!("{name}_pong");
        worker = worker
            .subscribe(&node, topic.as_str(), Qos::best_effort(), count)
            .map_err(Failure::refused)?;
    }
    let echo = if config.echo {
        let (with, echo) = Echo::add(worker, &node)?;
        worker = with;
        Some(echo)
    } else {
        None
    };
    let sent = Arc::new([AtomicU64::new(0), AtomicU64::new(0)]);
    let failed = Arc::new(AtomicU64::new(0));
    let sender = Sender {
        topics,
        answers: Arc::clone(&answers),
        sent: Arc::clone(&sent),
        failed: Arc::clone(&failed),
        interval: config.interval,
    };
    let sender = if config.ticked {
        let flood = config.flood;
        let release = move |tick: &Int32, _: &replenish::CallbackContext<'_>| {
            sender.pair(tick.data, flood);
        };
        worker
            .subscribe(&node, "tick", Qos::best_effort(), release)
            .map_err(Failure::refused)?;
        None
    } else {
        Some(sender)
    };
    let running = exec.start().map_err(Failure::refused)?;

    let spec = ThreadSpec::new("sender")
        .policy(fifo_or_other(SENDER_PRIORITY))
        .cpu(config.cpu);
    let (grid, stop) = (Arc::clone(grid), stop.clone());
    let run = |sender: Sender| spawn(spec, move || sender.run(&grid, supervised, &stop));
    let sender = sender.map(run).transpose().map_err(|e| panicked(&e))?;
    Ok(Ping {
        running,
        sender,
        answers,
        sent,
        failed,
        echo,
    })
}

fn panicked(e: &dyn Display) -> Failure {
    Failure::refused(format!("sender thread: {e}"))
}

impl Ping {
    /// Ping's report that set-up is done.
    pub(crate) fn ready(&self) -> Ready {
        let rows = [
            ("sender", SENDER_PRIORITY),
            ("dispatcher", SUPPORT_PRIORITY + 1),
            ("answers", SUPPORT_PRIORITY),
        ];
        let threads = rows.map(|(name, p)| threads::row("ping", name, &fifo_or_other(p)));
        Ready {
            threads: threads.to_vec(),
            ..Ready::default()
        }
    }

    /// Totals so far.
    pub(crate) fn totals(&self) -> Totals {
        let [high, low] = &*self.answers;
        let [sent_high, sent_low] = &*self.sent;
        Totals {
            sent: [
                sent_high.load(Ordering::Relaxed),
                sent_low.load(Ordering::Relaxed),
            ],
            answered: [high.total(), low.total()],
            failed: self.failed.load(Ordering::Relaxed),
            echoed: self.echo.as_ref().map(Echo::totals),
        }
    }

    /// Ends it, after the stop was triggered.
    pub(crate) fn end(self) -> Result<Totals, Failure> {
        let totals = self.totals();
        if let Some(sender) = self.sender {
            sender.join().map_err(|_| panicked(&"it panicked"))?;
        }
        self.running.stop();
        Ok(totals)
    }
}
