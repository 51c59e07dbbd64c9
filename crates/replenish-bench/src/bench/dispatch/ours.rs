//! Ours: an agent, an executor with all subscriptions on one worker, and publishers.

use super::receiver::{Received, Receiver, Setting};
use super::threads::{self, Used};
use crate::load::spec::{DISPATCHER_PRIORITY, HIGH_PRIORITY, SUPPORT_PRIORITY};
use replenish::msg::std_msgs::UInt64;
use replenish::{
    CallbackContext, Context, Executor, Publisher, Qos, RunningExecutor, WorkerBuilder,
};
use replenish_agent::{Agent, AgentConfig, Limits, StopHandle};
use replenish_cli::machine::fifo_or_other;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::{Thread, ThreadSpec, Tid, clock, spawn};
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

/// The worker's name.
const WORKER: &str = "receiver";
/// The thread that spins an executor without threads.
const ONE_THREAD: &str = "one-thread";

/// The record of what an executor does.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// Bytes of each thread's ring.
    pub(super) ring: usize,
    /// Each message is an instance of a chain, which begins and ends with its callback.
    pub(super) chain: bool,
}

/// As it is by default.
pub(super) const SEEN: Seen = Seen {
    ring: 256 << 10,
    chain: false,
};

/// An executor and the way to it.
pub(super) struct Ours {
    running: Running,
    publishers: Vec<Publisher<UInt64>>,
    received: Arc<Received>,
    tids: Vec<Tid>,
    agent: Thread<Outcome>,
    stop: StopHandle,
}

/// The two ways to run an executor.
enum Running {
    /// A dispatcher and a worker.
    Threads(Box<RunningExecutor>),
    /// A thread that spins it, and what stops that.
    OneThread(Thread<Outcome>, replenish::StopHandle),
}

impl Ours {
    /// With a dispatcher and a worker.
    pub(super) fn start_threads(setting: Setting, handles: u16) -> Result<Self, Failure> {
        Self::start_seen(setting, handles, SEEN)
    }

    /// The same, with another record of what it does.
    pub(super) fn start_seen(setting: Setting, handles: u16, seen: Seen) -> Result<Self, Failure> {
        Self::with(
            setting,
            handles,
            &["dispatcher", WORKER],
            |address, notes| {
                let (context, mut executor) = connect(address)?;
                executor.dispatcher(fifo_or_other(DISPATCHER_PRIORITY));
                executor.dispatcher_cpu(setting.cpu);
                executor.recorder(seen.ring);
                if seen.chain {
                    executor.chain("bench", [WORKER], None);
                }
                let worker = executor.worker(WORKER).cpu(setting.cpu);
                let worker = worker.policy(fifo_or_other(HIGH_PRIORITY));
                subscribe(&context, worker, handles, &notes)?;
                executor
                    .start()
                    .map(|e| Running::Threads(Box::new(e)))
                    .map_err(Failure::refused)
            },
        )
    }

    /// Without either: the callbacks run on the thread that waits for messages.
    pub(super) fn start(setting: Setting, handles: u16) -> Result<Self, Failure> {
        Self::with(setting, handles, &[ONE_THREAD], |address, notes| {
            let (ready, is_ready) = std::sync::mpsc::channel();
            let body = move || {
                let (context, mut executor) = connect(address)?;
                subscribe(&context, executor.worker(WORKER), handles, &notes)?;
                let mut local = executor.local().map_err(Failure::refused)?;
                ready.send(local.stop_handle()).ok();
                local.spin();
                Ok(())
            };
            let policy = fifo_or_other(HIGH_PRIORITY);
            let spec = ThreadSpec::new(ONE_THREAD).policy(policy).cpu(setting.cpu);
            let thread = spawn(spec, body).map_err(Failure::refused)?;
            match is_ready.recv() {
                Ok(stop) => Ok(Running::OneThread(thread, stop)),
                Err(_) => Err(joined(thread)
                    .err()
                    .unwrap_or_else(|| Failure::refused("the executor ended before it began"))),
            }
        })
    }

    fn with(
        setting: Setting,
        handles: u16,
        threads: &[&str],
        start: impl FnOnce(SocketAddr, Arc<Received>) -> Result<Running, Failure>,
    ) -> Result<Self, Failure> {
        let stop = StopHandle::new();
        let (agent, address) = agent(setting, stop.clone())?;
        let received = Arc::new(Received::new(setting.rate));
        let others = threads::known(threads);
        let running = start(address, Arc::clone(&received))?;
        let tids = threads::named(threads, &others)?;
        let sender = Context::xrce_udp(&address.to_string()).map_err(Failure::refused)?;
        let node = sender.node("sender").map_err(Failure::refused)?;
        let publisher = |n| node.publisher(&format!("bench_{n}"), Qos::best_effort());
        let publishers = (0..handles).map(publisher).collect::<Result<_, _>>();
        Ok(Self {
            running,
            publishers: publishers.map_err(Failure::refused)?,
            received,
            tids,
            agent,
            stop,
        })
    }

    pub(super) fn stop(self) -> Outcome {
        drop(self.publishers);
        match self.running {
            Running::Threads(running) => drop(running.stop()),
            Running::OneThread(thread, stop) => {
                stop.stop();
                joined(thread)?;
            }
        }
        self.stop.stop();
        joined(self.agent)
    }
}

fn joined(thread: Thread<Outcome>) -> Outcome {
    let ended = thread.join();
    ended.map_err(|_| Failure::refused("a thread panicked"))?
}

fn connect(agent: SocketAddr) -> Result<(Context, Executor), Failure> {
    let context = Context::xrce_udp(&agent.to_string()).map_err(Failure::refused)?;
    let mut executor = Executor::new(&context);
    executor.no_ledger().admission(false);
    Ok((context, executor))
}

fn subscribe(
    context: &Context,
    mut worker: WorkerBuilder<'_>,
    handles: u16,
    notes: &Arc<Received>,
) -> Outcome {
    let node = context.node("receiver").map_err(Failure::refused)?;
    for n in 0..handles {
        let notes = Arc::clone(notes);
        let callback = move |message: &UInt64, _: &CallbackContext<'_>| notes.note(message.data);
        let topic = format!("bench_{n}");
        let added = worker.subscribe(&node, topic.as_str(), Qos::best_effort(), callback);
        worker = added.map_err(Failure::refused)?;
    }
    Ok(())
}

impl Receiver for Ours {
    fn send(&mut self, n: u64) -> Outcome {
        let at = n % (self.publishers.len() as u64).max(1);
        let at = usize::try_from(at).unwrap_or(0);
        let Some(publisher) = self.publishers.get(at) else {
            return Ok(());
        };
        let data = clock::monotonic();
        publisher
            .publish(&UInt64 { data })
            .map_err(Failure::refused)
    }

    fn received(&self) -> &Received {
        &self.received
    }

    fn used(&self) -> Result<Used, Failure> {
        threads::used(&self.tids)
    }
}

fn agent(setting: Setting, stop: StopHandle) -> Result<(Thread<Outcome>, SocketAddr), Failure> {
    let config = AgentConfig {
        addr: (Ipv4Addr::LOCALHOST, 0).into(),
        limits: Limits {
            entities: 4096,
            client_bytes: 64 * 1024 * 1024,
            datagrams_per_second: 0,
            ..Limits::DEFAULT
        },
        ..AgentConfig::default()
    };
    let mut agent = Agent::bind(&config).map_err(Failure::refused)?;
    let address = agent.local_addr();
    let policy = fifo_or_other(SUPPORT_PRIORITY);
    let spec = ThreadSpec::new("xrce-agent")
        .policy(policy)
        .cpu(setting.support);
    let thread = spawn(spec, move || agent.run(&stop).map_err(Failure::refused));
    Ok((thread.map_err(Failure::refused)?, address))
}
