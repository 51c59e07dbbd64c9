//! Programs in a DDS domain of this test process alone.

#![allow(dead_code, reason = "every test binary uses its own part")]

use replenish_agent::dds::{
    Dds, DdsConfig, Endpoint, EndpointKind, EndpointReport, EndpointState, Id, Incoming, Outgoing,
    Qos, Topic,
};
use replenish_os::{PollFd, WakeFd, clock, poll};
pub(crate) use replenish_testkit::domain::domain;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The longest time that any step may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// A program with DDS.
pub(crate) struct Program {
    pub(crate) dds: Dds,
    pub(crate) domain: u16,
    wake: Arc<WakeFd>,
    next: Id,
    got: Vec<(Id, Incoming)>,
}

impl Program {
    pub(crate) fn new(domain: u16) -> Self {
        Self::with(domain, &DdsConfig::default())
    }

    pub(crate) fn with(domain: u16, config: &DdsConfig) -> Self {
        let wake = Arc::new(WakeFd::new().unwrap());
        Self {
            dds: Dds::start(config, Arc::clone(&wake)).unwrap(),
            domain,
            wake,
            next: 0,
            got: Vec::new(),
        }
    }

    pub(crate) fn open(&mut self, kind: EndpointKind) -> Id {
        self.next += 1;
        let endpoint = Endpoint {
            domain: self.domain,
            node: None,
            kind,
        };
        self.dds.open(self.next, endpoint).unwrap();
        self.next
    }

    pub(crate) fn writer(&mut self, topic: &Topic, qos: Qos) -> Id {
        let topic = topic.clone();
        self.open(EndpointKind::Writer { topic, qos })
    }

    pub(crate) fn reader(&mut self, topic: &Topic, qos: Qos) -> Id {
        let topic = topic.clone();
        self.open(EndpointKind::Reader { topic, qos })
    }

    pub(crate) fn write(&self, id: Id, payload: &[u8]) {
        self.dds.write(id, Outgoing::sample(payload.to_vec()));
    }

    pub(crate) fn report(&self, id: Id) -> EndpointReport {
        let report = self.dds.report();
        assert_eq!(report.ended, None);
        let found = report.endpoints.into_iter().find(|found| found.id == id);
        found.expect("an endpoint that is open")
    }

    /// Waits until `id` talks with `count` of others.
    pub(crate) fn matched(&self, id: Id, count: usize) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let report = self.report(id);
            assert!(
                !matches!(report.state, EndpointState::Failed(_)),
                "{report:?}"
            );
            if report.matched == count {
                return;
            }
            assert!(Instant::now() < deadline, "in vain: {report:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// The next sample for `id`.
    pub(crate) fn next(&mut self, id: Id) -> Incoming {
        let found = self.within(id, PATIENCE);
        found.unwrap_or_else(|| panic!("in vain: {:?}", self.report(id)))
    }

    /// The next sample for `id` within some time.
    pub(crate) fn within(&mut self, id: Id, timeout: Duration) -> Option<Incoming> {
        let deadline = Instant::now() + timeout;
        loop {
            self.wake.clear();
            while let Some(sample) = self.dds.take() {
                self.got.push(sample);
            }
            if let Some(at) = self.got.iter().position(|(of, _)| *of == id) {
                return Some(self.got.remove(at).1);
            }
            if Instant::now() > deadline {
                return None;
            }
            let until = clock::monotonic() + 20_000_000;
            poll(&mut [PollFd::readable(&*self.wake)], Some(until)).unwrap();
        }
    }
}
