//! Notices that an agent of replenish sends unasked: endpoints that do not talk because of their
//! QoS, servers that come and go. Other agents send none.

use super::objects::State;
use crate::middleware::{IncompatibleQos, ReaderId, WriterId};
use replenish_xrce::wire::ObjectKind;

impl State {
    /// Whether a client's service has a server, if the agent is one that tells.
    pub(super) fn is_served(&self, client: WriterId) -> Option<bool> {
        if !self.is_up() {
            return Some(false);
        }
        let writer = self.endpoints.writers.get(usize::from(client.0))?;
        self.session.has_notices().then_some(writer.served)
    }

    pub(super) fn next_incompatible_qos(&mut self) -> Option<IncompatibleQos> {
        loop {
            let Some((object, policies)) = self.endpoints.clashes.pop() else {
                self.endpoints.flags.show_clash(false);
                return None;
            };
            let (topic, reader) = match object.kind() {
                Ok(ObjectKind::DataReader) => {
                    let slot = self.endpoints.slots.get(object.number());
                    let reader = self.endpoints.readers.get(usize::from(slot));
                    (reader.and_then(|r| r.topic), Some(ReaderId(slot)))
                }
                _ => {
                    let writer = self.endpoints.writers.iter().find(|w| w.object == object);
                    (writer.and_then(|w| w.topic), None)
                }
            };
            let topic = self.topics.iter().find(|t| Some(t.object) == topic);
            if let Some(topic) = topic {
                return Some(IncompatibleQos::known_by_policy(
                    &topic.name,
                    reader,
                    policies,
                ));
            }
        }
    }
}
