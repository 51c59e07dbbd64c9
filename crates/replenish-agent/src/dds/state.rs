//! The state that the program and the thread of DDS share, under one lock: the wanted endpoints,
//! the samples that wait in both directions, and the counters.
//!
//! ```text
//!   open ──► WANTED ──(thread takes work)──► SEEN ──► open or failed
//!              │ close                         │ close
//!              ▼                               ▼
//!            gone                     CLOSING ──(thread takes work)──► gone
//! ```
//!
//! The thread closes before it opens, so that neither side ever has more than the limit.

use super::config::{DdsLimits, MAX_DOMAIN};
use super::endpoint::{Endpoint, Id, Incoming, Node, Outgoing};
use super::error::OpenError;
use super::qos::Mismatch;
use super::queues::{Queues, Weight};
use super::report::{DdsReport, EndpointCounts, EndpointReport, EndpointState};
use replenish_os::{PiMutex, WakeFd};
use std::collections::{HashMap, VecDeque};
use std::sync::Arc;

/// Bytes that a waiting sample is counted with besides its own.
const QUEUE_OVERHEAD: usize = 64;

impl Weight for Outgoing {
    fn weight(&self) -> usize {
        self.payload.len() + QUEUE_OVERHEAD
    }
}

impl Weight for Incoming {
    fn weight(&self) -> usize {
        self.payload.len() + QUEUE_OVERHEAD
    }
}

/// Something in the table.
#[derive(Clone, Debug)]
pub(crate) enum DdsEntity {
    Node(Node),
    Endpoint(Endpoint),
}

impl DdsEntity {
    pub(crate) fn domain(&self) -> u16 {
        match self {
            Self::Node(node) => node.domain,
            Self::Endpoint(endpoint) => endpoint.domain,
        }
    }

    fn name(&self) -> &str {
        match self {
            Self::Node(node) => &node.name,
            Self::Endpoint(endpoint) => &endpoint.kind.topic().name,
        }
    }
}

#[derive(Debug)]
struct EndpointSlot {
    entity: DdsEntity,
    seen: bool,
    state: EndpointState,
    matched: usize,
    /// It has readers for its requests and writers of its replies.
    served: bool,
    counts: EndpointCounts,
    /// The policies of all that did not match.
    mismatch: Mismatch,
}

/// The work of the thread.
#[derive(Debug, Default)]
pub(crate) struct Work {
    pub(crate) stop: bool,
    pub(crate) closes: Vec<Id>,
    pub(crate) opens: Vec<(Id, DdsEntity)>,
}

/// The state that the program and the thread share.
#[derive(Debug)]
pub(crate) struct SharedState {
    pub(crate) table: PiMutex<EndpointTable>,
    /// Wakes the program.
    pub(crate) program: Arc<WakeFd>,
}

/// The table of endpoints and nodes, with the samples that wait for them.
#[derive(Debug)]
pub(crate) struct EndpointTable {
    limits: DdsLimits,
    table: HashMap<Id, EndpointSlot>,
    wanted: VecDeque<Id>,
    closing: Vec<Id>,
    stop: bool,
    ended: Option<String>,
    /// Times that a bound of what is known of others was reached.
    pub(crate) left_out: u64,
    /// Towards DDS.
    pub(crate) outgoing: Queues<Outgoing>,
    /// From DDS.
    pub(crate) incoming: Queues<Incoming>,
    /// Endpoints that are newly served, or not served any more, for the program.
    served_changed: VecDeque<Id>,
    /// Endpoints with newly incompatible policies, for the program.
    mismatched: VecDeque<Id>,
}

impl EndpointTable {
    pub(crate) fn new(limits: DdsLimits) -> Self {
        Self {
            limits,
            table: HashMap::new(),
            wanted: VecDeque::new(),
            closing: Vec::new(),
            stop: false,
            ended: None,
            left_out: 0,
            outgoing: Queues::new(limits.queue, limits.queued_bytes),
            incoming: Queues::new(limits.queue, limits.queued_bytes),
            served_changed: VecDeque::new(),
            mismatched: VecDeque::new(),
        }
    }

    pub(crate) fn open(&mut self, id: Id, entity: DdsEntity) -> Result<(), OpenError> {
        if self.ended.is_some() {
            return Err(OpenError::Ended);
        }
        if entity.domain() > MAX_DOMAIN {
            return Err(OpenError::Domain(entity.domain()));
        }
        if self.table.contains_key(&id) || self.closing.contains(&id) {
            return Err(OpenError::Exists);
        }
        if self.table.len() >= self.limits.endpoints {
            return Err(OpenError::Full);
        }
        let slot = EndpointSlot {
            entity,
            seen: false,
            state: EndpointState::Opening,
            matched: 0,
            served: false,
            counts: EndpointCounts::default(),
            mismatch: Mismatch::default(),
        };
        self.table.insert(id, slot);
        self.outgoing.pause(id); // until it is there
        self.wanted.push_back(id);
        Ok(())
    }

    pub(crate) fn close(&mut self, id: Id) {
        let Some(slot) = self.table.remove(&id) else {
            return;
        };
        self.outgoing.remove(id);
        self.incoming.remove(id);
        if slot.seen {
            self.closing.push(id);
        } else {
            self.wanted.retain(|wanted| *wanted != id);
        }
    }

    /// Queues a sample; returns whether the thread has to be woken for it.
    pub(crate) fn write(&mut self, id: Id, outgoing: Outgoing) -> bool {
        let Some(slot) = self.table.get_mut(&id) else {
            return false;
        };
        let failed = matches!(slot.state, EndpointState::Failed(_));
        if failed || outgoing.payload.len() > self.limits.sample {
            slot.counts.dropped_out += 1;
            return false;
        }
        let idle = self.outgoing.is_empty();
        slot.counts.dropped_out += self.outgoing.push(id, outgoing);
        idle && !self.outgoing.is_empty()
    }

    /// Queues a sample from DDS; returns whether the program has to be woken for it.
    pub(crate) fn deliver(&mut self, id: Id, incoming: Incoming) -> bool {
        let Some(slot) = self.table.get_mut(&id) else {
            return false;
        };
        if incoming.payload.len() > self.limits.sample {
            slot.counts.dropped_in += 1;
            return false;
        }
        let idle = self.incoming.is_empty();
        slot.counts.received += 1;
        slot.counts.dropped_in += self.incoming.push(id, incoming);
        idle
    }

    pub(crate) fn stop(&mut self) {
        self.stop = true;
    }

    pub(crate) fn end(&mut self, why: String) {
        if !self.stop {
            self.ended = Some(why);
        }
    }

    pub(crate) fn take_work(&mut self) -> Work {
        let wanted = std::mem::take(&mut self.wanted);
        let mut take = |id: Id| {
            let slot = self.table.get_mut(&id)?;
            slot.seen = true;
            Some((id, slot.entity.clone()))
        };
        Work {
            stop: self.stop,
            closes: std::mem::take(&mut self.closing),
            opens: wanted.into_iter().filter_map(&mut take).collect(),
        }
    }

    pub(crate) fn opened(&mut self, id: Id, result: Result<(), String>) {
        if let Some(slot) = self.table.get_mut(&id) {
            slot.state = match result {
                Ok(()) => {
                    self.outgoing.resume(id);
                    EndpointState::Open
                }
                Err(why) => {
                    self.outgoing.remove(id);
                    EndpointState::Failed(why)
                }
            };
        }
    }

    /// The next endpoint that is served now, or not any more.
    pub(crate) fn take_served(&mut self) -> Option<(Id, bool)> {
        loop {
            let id = self.served_changed.pop_front()?;
            if let Some(slot) = self.table.get(&id) {
                return Some((id, slot.served));
            }
        }
    }

    /// The next endpoint that does not fit others in more policies than before; all of them.
    pub(crate) fn take_mismatch(&mut self) -> Option<(Id, Mismatch)> {
        loop {
            let id = self.mismatched.pop_front()?;
            if let Some(slot) = self.table.get(&id) {
                return Some((id, slot.mismatch));
            }
        }
    }

    /// Adds the thread's counters and mismatches; returns whether the program must be woken.
    pub(crate) fn account(
        &mut self,
        id: Id,
        (counts, mismatch): (EndpointCounts, Mismatch),
        live: (usize, bool),
    ) -> bool {
        let Some(slot) = self.table.get_mut(&id) else {
            return false;
        };
        let (matched, served) = live;
        slot.matched = matched;
        let mut changed = std::mem::replace(&mut slot.served, served) != served;
        if changed && !self.served_changed.contains(&id) {
            self.served_changed.push_back(id);
        }
        slot.counts += counts;
        let mismatch = slot.mismatch.and(mismatch);
        if std::mem::replace(&mut slot.mismatch, mismatch) != mismatch {
            changed = true;
            if !self.mismatched.contains(&id) {
                self.mismatched.push_back(id);
            }
        }
        changed
    }

    pub(crate) fn report(&self) -> DdsReport {
        let report = |(id, slot): (&Id, &EndpointSlot)| EndpointReport {
            id: *id,
            domain: slot.entity.domain(),
            name: slot.entity.name().to_string(),
            state: slot.state.clone(),
            matched: slot.matched,
            waiting_out: self.outgoing.len(*id),
            waiting_in: self.incoming.len(*id),
            counts: slot.counts,
        };
        let mut endpoints: Vec<EndpointReport> = self.table.iter().map(report).collect();
        endpoints.sort_by_key(|endpoint| endpoint.id);
        DdsReport {
            ended: self.ended.clone(),
            left_out: self.left_out,
            endpoints,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node() -> DdsEntity {
        DdsEntity::Node(Node {
            domain: 0,
            name: "n".into(),
        })
    }

    fn state(endpoints: usize) -> EndpointTable {
        EndpointTable::new(DdsLimits {
            endpoints,
            queue: 2,
            sample: 8,
            ..DdsLimits::DEFAULT
        })
    }

    #[test]
    fn what_is_closed_before_it_was_seen_never_was() {
        let mut state = state(1);
        for id in 0..1000 {
            assert_eq!(state.open(id, node()), Ok(()));
            assert_eq!(state.open(id, node()), Err(OpenError::Exists));
            assert_eq!(state.open(id + 1, node()), Err(OpenError::Full));
            state.close(id);
        }
        let work = state.take_work();
        assert!(work.opens.is_empty() && work.closes.is_empty() && state.wanted.is_empty());
    }

    #[test]
    fn the_thread_closes_what_it_has_seen() {
        let mut state = state(1);
        assert_eq!(state.open(1, node()), Ok(()));
        assert_eq!(state.take_work().opens.len(), 1);
        state.close(1);
        assert_eq!(state.open(1, node()), Err(OpenError::Exists));
        assert_eq!(state.open(2, node()), Ok(()));
        let work = state.take_work();
        assert_eq!((work.closes, work.opens.len()), (vec![1], 1));
        let far = DdsEntity::Node(Node {
            domain: 233,
            name: String::new(),
        });
        assert_eq!(state.open(3, far), Err(OpenError::Domain(233)));
    }

    #[test]
    fn drops_are_counted_where_they_happen() {
        let mut state = state(4);
        assert_eq!(state.open(1, node()), Ok(()));
        assert!(
            !state.write(1, Outgoing::sample(vec![7])),
            "nobody is there yet"
        );
        assert_eq!(state.outgoing.pop(), None);
        state.opened(1, Ok(()));
        assert_eq!(state.outgoing.pop(), Some((1, Outgoing::sample(vec![7]))));
        let wakes: Vec<bool> = (0..4)
            .map(|i| state.write(1, Outgoing::sample(vec![i])))
            .collect();
        assert_eq!(wakes, [true, false, false, false]);
        assert!(!state.write(1, Outgoing::sample(vec![0; 9])), "too long");
        assert!(!state.write(2, Outgoing::sample(vec![0])), "nobody");
        let incoming = |payload| Incoming {
            payload,
            request: None,
        };
        assert!(state.deliver(1, incoming(vec![1])));
        assert!(!state.deliver(1, incoming(vec![0; 9])));
        let report = state.report();
        let endpoint = &report.endpoints[0];
        assert_eq!((endpoint.counts.dropped_out, endpoint.waiting_out), (3, 2));
        assert_eq!(
            (endpoint.counts.dropped_in, endpoint.counts.received),
            (1, 1)
        );
        state.opened(1, Err("no".into()));
        assert!(!state.write(1, Outgoing::sample(vec![0])));
        assert_eq!(state.report().endpoints[0].counts.dropped_out, 4);
    }
}
