//! The last log-ins and requests that were refused, for snapshots.

use super::hex::hex;
use super::reason::Reason;
use super::subject::Subject;
use replenish_xrce::wire::ClientKey;
use std::collections::VecDeque;

/// Refusals of log-ins that are kept, and as many of requests: a flood of the ones does not push
/// out the others.
const KEPT: usize = 64;

/// A log-in or request that was refused.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Refusal {
    /// The client's key, as in [`ClientSnapshot::key`](crate::ClientSnapshot::key).
    pub key: String,
    /// The object of a request, as in [`EntitySnapshot::id`](crate::EntitySnapshot::id); empty for
    /// a log-in.
    pub id: String,
    /// The topic, service or node in ROS names, if it is known: `/chatter`.
    pub name: String,
    /// Its type: `std_msgs/msg/String`.
    pub type_name: String,
    /// The answer: `UNKNOWN_REFERENCE`, `RESOURCES`, and so on.
    pub status: String,
    /// Why, as in the log.
    pub reason: String,
}

/// The last refusals.
#[derive(Debug, Default)]
pub(crate) struct Refusals {
    log_ins: VecDeque<Record>,
    requests: VecDeque<Record>,
}

#[derive(Debug)]
struct Record {
    key: ClientKey,
    about: Option<Subject>,
    reason: Reason,
}

impl Refusals {
    /// Notes a rejection, if it is a refusal.
    pub(crate) fn note(&mut self, key: ClientKey, reason: Reason, about: Option<&Subject>) {
        if reason.status().is_none() {
            return;
        }
        let list = match reason.object() {
            Some(_) => &mut self.requests,
            None => &mut self.log_ins,
        };
        if list.len() >= KEPT {
            list.pop_front();
        }
        let about = about.cloned();
        list.push_back(Record { key, about, reason });
    }

    pub(crate) fn snapshot(&self) -> Vec<Refusal> {
        let refusal = |record: &Record| {
            let about = record.about.clone().unwrap_or_default();
            Refusal {
                key: record.key.to_string(),
                id: record.reason.object().map(hex).unwrap_or_default(),
                name: about.name,
                type_name: about.type_name,
                status: record
                    .reason
                    .status()
                    .map(|s| s.to_string())
                    .unwrap_or_default(),
                reason: record.reason.to_string(),
            }
        };
        let all = self.log_ins.iter().chain(&self.requests);
        all.map(refusal).collect()
    }
}
