//! An XRCE agent for tests, in a thread whose allocations do not count.

use replenish::Context;
use replenish_agent::{Agent, AgentConfig, StopHandle};
use replenish_testkit::alloc::exempt_this_thread;
use std::net::SocketAddr;
use std::thread::JoinHandle;

/// Stops and is joined when it is dropped.
pub struct TestAgent {
    pub address: SocketAddr,
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
        let (address, stop) = (agent.local_addr(), StopHandle::new());
        let handle = stop.clone();
        let run = move || {
            exempt_this_thread();
            agent.run(&handle).unwrap();
        };
        let thread = Some(std::thread::spawn(run));
        TestAgent {
            address,
            stop,
            thread,
        }
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
