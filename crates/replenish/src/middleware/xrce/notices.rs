//! What the agent tells unasked: endpoints that do not talk because of their QoS, servers that come
//! and go. Agents of replenish do; from others nothing is known.

use super::state::State;
#[cfg(feature = "full")]
use crate::middleware::WriterId;
#[cfg(feature = "texts")]
use crate::middleware::{Clash, ReaderId};
#[cfg(feature = "texts")]
use replenish_xrce::wire::ObjectKind;

impl State {
    /// Whether a client's service has a server, if the agent is one that tells.
    #[cfg(feature = "full")]
    pub(super) fn is_served(&self, client: WriterId) -> Option<bool> {
        if !self.is_up() {
            return Some(false);
        }
        let writer = self.ends.writers.get(usize::from(client.0))?;
        self.session.has_notices().then_some(writer.served)
    }

    #[cfg(feature = "texts")]
    pub(super) fn next_clash(&mut self) -> Option<Clash> {
        loop {
            let Some((object, policies)) = self.ends.clashes.pop() else {
                self.ends.glance.show_clash(false);
                return None;
            };
            let (topic, reader) = match object.kind() {
                Ok(ObjectKind::DataReader) => {
                    let slot = self.ends.slots.get(object.number());
                    let reader = self.ends.readers.get(usize::from(slot));
                    (reader.and_then(|r| r.topic), Some(ReaderId(slot)))
                }
                _ => {
                    let writer = self.ends.writers.iter().find(|w| w.object == object);
                    (writer.and_then(|w| w.topic), None)
                }
            };
            let topic = self.topics.iter().find(|t| Some(t.object) == topic);
            if let Some(topic) = topic {
                return Some(Clash::known_by_policy(&topic.name, reader, policies));
            }
        }
    }
}
