//! Notices to clients: endpoints with incompatible QoS, and requesters whose service has a server
//! now or has none any more. See [`Notice`].

use super::state::AgentCore;
use crate::bridge::BridgeId;
use crate::entities::{Address, Plan, TopicId};
use replenish_xrce::wire::{Notice, ObjectId};
use std::hash::Hash;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Notifies a new entity and the endpoints that it is incompatible with, or that it serves.
    pub(super) fn notify_incompatible(&mut self, client: usize, object: ObjectId) {
        let me = Address { client, object };
        let of_client = self.clients.get_mut(client);
        let Some(record) = of_client.and_then(|c| c.entities.record(object)) else {
            return;
        };
        let ends = (record.writer.as_deref(), record.reader.as_deref());
        let clashes: Vec<(Address, u8)> = match (&record.plan, ends) {
            (Plan::Writer { qos, .. }, (Some(writer), _)) => {
                let others = self.topics.readers(writer.topic).iter();
                others
                    .map(|o| (o.address, qos.incompatibilities(&o.qos)))
                    .collect()
            }
            (Plan::Reader { qos, .. }, (_, Some(reader))) => {
                let others = self.topics.writers(reader.topic).iter();
                others
                    .map(|o| (o.address, o.qos.incompatibilities(qos)))
                    .collect()
            }
            (Plan::Requester { .. }, (Some(writer), _)) => {
                let topic = writer.topic;
                return self.notify_served(topic);
            }
            (Plan::Replier { .. }, (_, Some(reader))) => {
                let topic = reader.topic;
                return self.notify_served(topic);
            }
            _ => return,
        };
        for (other, policies) in clashes.into_iter().filter(|(_, policies)| *policies != 0) {
            self.notice(me, Notice::IncompatibleQos(policies));
            self.notice(other, Notice::IncompatibleQos(policies));
        }
    }

    /// Notifies the requesters of `topic` if their service has a server now, or has none any more.
    pub(super) fn notify_served(&mut self, topic: TopicId) {
        let here = !self.topics.readers(topic).is_empty();
        let requesters = self.topics.writers(topic).iter();
        let requesters: Vec<Address> = requesters.map(|w| w.address).collect();
        for address in requesters {
            let client = self.clients.get_mut(address.client);
            let record = client.and_then(|c| c.entities.record_mut(address.object));
            let Some(record) = record else {
                continue;
            };
            let served = here || record.served_beyond;
            if matches!(record.plan, Plan::Requester { .. })
                && std::mem::replace(&mut record.notified_served, served) != served
            {
                self.notice(address, Notice::Served(served));
            }
        }
    }

    /// Notes whether a requester has servers beyond the bridge.
    pub fn served_beyond(&mut self, id: BridgeId, served: bool) {
        let address = self.bridge.as_ref().and_then(|bridge| bridge.address(id));
        let Some(address) = address else {
            return; // deleted meanwhile
        };
        let client = self.clients.get_mut(address.client);
        let record = client.and_then(|c| c.entities.record_mut(address.object));
        let Some(record) = record else {
            return;
        };
        record.served_beyond = served;
        if let Some(topic) = record.writer.as_deref().map(|writer| writer.topic) {
            self.notify_served(topic);
        }
    }

    /// Notifies an endpoint that it is incompatible with an endpoint beyond the bridge in these
    /// policies, as [`Notice`]'s bits.
    pub fn incompatible_beyond(&mut self, id: BridgeId, policies: u8) {
        let address = self.bridge.as_ref().and_then(|bridge| bridge.address(id));
        if let Some(address) = address.filter(|_| policies != 0) {
            self.notice(address, Notice::IncompatibleQos(policies));
        }
    }

    fn notice(&mut self, Address { client, object }: Address, notice: Notice) {
        if let Some(of) = self.clients.get_mut(client) {
            of.notice(object, notice, &self.limits);
        }
        self.serve(self.time, client);
    }
}
