//! Ours: an agent, an executor with so many subscriptions on one worker, and publishers.

use super::threads::{self, Used};
use super::{Received, Receiver, Setting};
use crate::load::spec::{DISPATCHER_PRIORITY, HIGH_PRIORITY, SUPPORT_PRIORITY};
use crate::machine::fifo_or_other;
use crate::outcome::{Failure, Outcome};
use replenish::msg::std_msgs::UInt64;
use replenish::{CallbackContext, Context, Executor, Publisher, Qos, RunningExecutor};
use replenish_agent::{Agent, AgentConfig, Limits, StopHandle};
use replenish_os::{Thread, ThreadSpec, Tid, clock, spawn};
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

/// The worker's name.
const WORKER: &str = "receiver";

/// The executor and the way to it.
pub(super) struct Ours {
    running: RunningExecutor,
    publishers: Vec<Publisher<UInt64>>,
    received: Arc<Received>,
    tids: Vec<Tid>,
    agent: Thread<Outcome>,
    stop: StopHandle,
}

impl Ours {
    pub(super) fn start(setting: Setting, handles: u16) -> Result<Self, Failure> {
        let stop = StopHandle::new();
        let (agent, address) = agent(setting, stop.clone())?;
        let received = Arc::new(Received::new(setting.rate));
        let connect = || Context::xrce_udp(&address.to_string()).map_err(Failure::refused);
        let context = connect()?;
        let mut executor = Executor::new(&context);
        executor.no_ledger().admission(false);
        executor.dispatcher(fifo_or_other(DISPATCHER_PRIORITY));
        executor.dispatcher_cpu(setting.cpu);
        let node = context.node("receiver").map_err(Failure::refused)?;
        let mut worker = executor.worker(WORKER).cpu(setting.cpu);
        worker = worker.policy(fifo_or_other(HIGH_PRIORITY));
        for n in 0..handles {
            let notes = Arc::clone(&received);
            let callback =
                move |message: &UInt64, _: &CallbackContext<'_>| notes.note(message.data);
            let topic = format!("bench_{n}");
            let added = worker.subscribe(&node, topic.as_str(), Qos::best_effort(), callback);
            worker = added.map_err(Failure::refused)?;
        }
        let running = executor.start().map_err(Failure::refused)?;
        let tids = threads::named(&["dispatcher", WORKER])?;
        let sender = connect()?;
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

    /// The policies that the kernel gave.
    pub(super) fn granted(&self) -> String {
        let report = self.running.report();
        let threads = report.threads.iter();
        let each = threads.map(|t| format!("{}: {}", t.name, t.granted));
        each.collect::<Vec<_>>().join("; ")
    }

    pub(super) fn stop(self) -> Outcome {
        drop(self.publishers);
        self.running.stop();
        self.stop.stop();
        let ended = self.agent.join();
        ended.map_err(|_| Failure::refused("the agent panicked"))?
    }
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
