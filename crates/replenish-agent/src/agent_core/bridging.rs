//! The core's calls for a bridge to another middleware; see [`crate::bridge`].

use super::state::{AgentCore, Now};
use crate::bridge::{
    Asker, Bridge, BridgeEvent, BridgeId, BridgeSample, NameRefusal, Names, ros_node,
};
use crate::entities::{Address, Plan, Role};
use crate::flow::{Guid, Identity, Sample, SampleInfo};
use crate::report::BridgeSnapshot;
use replenish_xrce::wire::{Create, ObjectId};
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Reports entities and samples to a bridge from now on, which must
    /// [ask](Self::poll_bridge) for them. To be called before there are clients.
    ///
    /// Clients that say domain 0 are in `domain`, and bring at most `names` topic names to each
    /// domain: half of them the clients of one host, an eighth one client. More is refused with
    /// `RESOURCES`, and a name with another type than that it is used with with `INCOMPATIBLE`.
    #[must_use]
    pub fn bridged(self, domain: u16, names: usize) -> Self {
        Self {
            bridge: Some(Bridge::new(Names::new(domain, names))),
            ..self
        }
    }

    /// The next event for the bridge, in order. Call it until
    /// there is none after every [`receive`](Self::receive) and [`pump`](Self::pump): samples
    /// beyond 1024 are dropped and counted.
    pub fn poll_bridge(&mut self) -> Option<BridgeEvent> {
        self.bridge.as_mut()?.poll()
    }

    /// Takes a sample from the bridge for one reader, requester or replier.
    pub fn from_bridge(&mut self, now: Now, id: BridgeId, sample: &BridgeSample) {
        let at = now.monotonic;
        self.counters.bridge_in.hit();
        let address = self.bridge.as_ref().and_then(|bridge| bridge.address(id));
        let Some(Address { client, object }) = address else {
            return; // deleted meanwhile
        };
        let Some(target) = self.clients.get_mut(client) else {
            return;
        };
        let Some(reader) = target.entities.reader(object) else {
            return;
        };
        let identity = sample.request.map(|(guid, seq)| Identity {
            guid: Guid(guid),
            seq: seq.cast_unsigned(),
        });
        let mut info = SampleInfo::default();
        match reader.role {
            Role::Data => {}
            Role::Replier => info.request = identity,
            Role::Requester(_) => info.reply_to = identity,
        }
        let payload = sample.payload();
        let fits = payload.len() <= self.limits.sample;
        let sample = fits.then(|| Sample::new(payload, info, &self.pool));
        let Some(sample) = sample.flatten() else {
            self.counters.samples_refused.hit();
            return;
        };
        if reader.offer(&sample, None, at, &target.ledger, &self.counters) {
            self.counters.samples_routed.hit();
        } else if info.reply_to.is_some() {
            self.counters.replies_unwanted.hit();
        }
        target.queue(object, at, &self.counters);
        self.serve(at, client);
    }

    /// Asks whether the topic names of a new entity may cross; without a bridge they need not.
    pub(super) fn bridge_admits(
        &mut self,
        client: usize,
        object: ObjectId,
    ) -> Result<(), NameRefusal> {
        let (Some(bridge), Some(of)) = (&mut self.bridge, self.clients.get_mut(client)) else {
            return Ok(());
        };
        let by = Asker {
            key: of.key,
            host: (self.host)(&of.peer),
        };
        match of.entities.record(object) {
            Some(record) => bridge.admit(by, Address { client, object }, record),
            None => Ok(()),
        }
    }

    /// Notes in a row about `id` whose it is: client, entity and node.
    pub fn name_bridge_row(&self, id: BridgeId, node: Option<BridgeId>, row: &mut BridgeSnapshot) {
        let Some(bridge) = &self.bridge else { return };
        let of = |id| {
            let address = bridge.address(id)?;
            Some((self.clients.get(address.client)?, address.object))
        };
        if let Some((client, object)) = of(id) {
            row.client = client.key.to_string();
            row.id = crate::report::hex(object);
        }
        if let Some((client, object)) = node.and_then(of)
            && let Some(record) = client.entities.record(object)
            && let Plan::Participant { name, .. } = &record.plan
        {
            row.node = ros_node(name);
        }
    }

    /// Reports a new entity to the bridge.
    pub(super) fn bridge_created(&mut self, client: usize, create: &Create<'_>) {
        let object = create.base.object;
        let (Some(bridge), Some(of)) = (&mut self.bridge, self.clients.get_mut(client)) else {
            return;
        };
        if let Some(record) = of.entities.record(object) {
            bridge.created(Address { client, object }, &create.entity, record);
        }
    }

    /// Reports a deleted entity to the bridge.
    pub(super) fn bridge_deleted(&mut self, client: usize, object: ObjectId) {
        if let Some(bridge) = &mut self.bridge {
            bridge.deleted(Address { client, object });
        }
    }

    /// Times that the bridge left something of others out, all in all.
    pub fn left_out_beyond(&self, count: u64) {
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        self.counters.bridge_left_out.set(count);
    }

    /// The name of an entity at the seam, if there is one.
    pub(super) fn beyond(&self, client: usize, object: ObjectId) -> Option<BridgeId> {
        self.bridge.as_ref()?.id(Address { client, object })
    }

    /// Hands a written sample to the bridge.
    pub(super) fn cross(&mut self, id: BridgeId, sample: &Sample) {
        if let Some(bridge) = &mut self.bridge {
            if bridge.wrote(id, sample) {
                self.counters.bridge_out.hit();
            } else {
                self.counters.bridge_dropped.hit();
            }
        }
    }
}
