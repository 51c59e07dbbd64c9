//! An XRCE agent for tests, in a thread whose allocations do not count.

use replenish::Context;
use replenish_agent::{Agent, AgentConfig, Inspector, StopHandle};
use replenish_testkit::alloc::exempt_this_thread;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::thread::JoinHandle;
use std::time::Duration;

/// Stops and is joined when it is dropped.
pub struct TestAgent {
    pub address: SocketAddr,
    pub tcp: Option<SocketAddr>,
    inspector: Inspector,
    stop: StopHandle,
    thread: Option<JoinHandle<()>>,
}

impl TestAgent {
    pub fn start(address: &str) -> Self {
        let addr = address.parse().unwrap();
        Self::with(&AgentConfig {
            addr,
            ..AgentConfig::default()
        })
    }

    pub fn with(config: &AgentConfig) -> Self {
        let mut agent = Agent::bind(config).unwrap();
        let (address, tcp, stop) = (agent.local_addr(), agent.tcp_addr(), StopHandle::new());
        let (handle, inspector) = (stop.clone(), agent.inspector());
        let run = move || {
            exempt_this_thread();
            agent.run(&handle).unwrap();
        };
        let thread = Some(std::thread::spawn(run));
        TestAgent {
            address,
            tcp,
            inspector,
            stop,
            thread,
        }
    }

    /// Number of entities of the agent's clients, by kind.
    #[must_use]
    pub fn entities(&self) -> BTreeMap<&'static str, usize> {
        let snapshot = self.inspector.snapshot(Duration::from_secs(10)).unwrap();
        let mut kinds = BTreeMap::new();
        for entity in snapshot.clients.iter().flat_map(|c| &c.entities) {
            *kinds.entry(entity.kind).or_default() += 1;
        }
        kinds
    }

    /// The agent's state at this moment.
    #[must_use]
    pub fn snapshot(&self) -> replenish_agent::Snapshot {
        self.inspector.snapshot(Duration::from_secs(10)).unwrap()
    }

    #[must_use]
    pub fn context(&self) -> Context {
        Context::xrce_udp(&self.address.to_string()).unwrap()
    }
}

impl Drop for TestAgent {
    fn drop(&mut self) {
        self.stop.stop();
        self.thread.take().unwrap().join().unwrap();
    }
}
