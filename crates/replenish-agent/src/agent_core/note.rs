//! Noting rejections for the log and for snapshots, with the names of ROS.

use super::state::AgentCore;
use crate::bridge::{ros_node, ros_topic, ros_type};
use crate::report::{Reason, Subject};
use replenish_xrce::wire::{ClientKey, ObjectId};
use std::hash::Hash;
use std::sync::Arc;

impl<P: Copy + Eq + Hash> AgentCore<P> {
    /// Logs a rejection.
    pub(crate) fn note(&mut self, peer: P, key: Option<ClientKey>, reason: Reason) {
        self.note_about(peer, key, reason, None);
    }

    /// The same, with the topic or node that it is about.
    fn note_about(
        &mut self,
        peer: P,
        key: Option<ClientKey>,
        reason: Reason,
        about: Option<Subject>,
    ) {
        self.rejections += 1;
        let (at, number) = (self.time, self.rejections);
        if let Some(key) = key {
            self.refusals.note(key, reason, about.as_ref());
        }
        self.log.note(at, number, (peer, key), about, reason);
    }

    /// The same for the client in slot `index`.
    pub(super) fn note_of(&mut self, index: usize, reason: Reason) {
        self.note_of_about(index, reason, None);
    }

    /// The same, with the topic or node that it is about.
    pub(super) fn note_of_about(&mut self, index: usize, reason: Reason, about: Option<Subject>) {
        if let Some(client) = self.clients.get_mut(index) {
            let (peer, key) = (client.peer, client.key);
            self.note_about(peer, Some(key), reason, about);
        }
    }

    /// The topic or node of an entity, in ROS names.
    pub(super) fn subject_of(&self, index: usize, object: ObjectId) -> Option<Subject> {
        let record = self.clients.get(index)?.entities.record(object)?;
        record.plan.subject().map(subject)
    }
}

/// Names on the wire as those of ROS.
pub(super) fn subject((name, type_name): (Arc<str>, Option<Arc<str>>)) -> Subject {
    match type_name {
        Some(type_name) => Subject {
            name: ros_topic(&name),
            type_name: ros_type(&type_name),
        },
        None => Subject {
            name: ros_node(&name),
            type_name: String::new(),
        },
    }
}
