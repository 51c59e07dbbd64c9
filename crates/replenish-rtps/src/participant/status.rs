//! [`EndpointStatus`]: the peers of an own endpoint, and promises that were not kept (DDS 1.4,
//! 2.2.4.1).

use super::event::Policy;

/// Counts of an own endpoint, from its creation on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EndpointStatus {
    /// Peers that it has had, each counted anew when it comes again.
    pub matched_total: u64,
    /// Peers that it has.
    pub matched: usize,
    /// Peers of its topic whose quality of service does not fit.
    pub incompatible: u64,
    /// The policy by which the last one did not fit.
    pub last_incompatible: Option<Policy>,
    /// Peers of its topic that have another type.
    pub wrong_type: u64,
    /// Periods of its deadline without a sample.
    pub deadline_missed: u64,
    /// Times that a writer was silent for longer than its lease.
    pub liveliness_lost: u64,
    /// Matched writers of a reader that are alive.
    pub alive: usize,
}

impl EndpointStatus {
    /// A peer of the topic was looked at.
    pub(super) fn met(&mut self, known: bool, fit: Result<(), Policy>, taken: bool) {
        match fit {
            Ok(()) if taken && !known => self.matched_total += 1,
            Ok(()) | Err(Policy::Partition) => {}
            Err(Policy::Type) => self.wrong_type += 1,
            Err(policy) => {
                self.incompatible += 1;
                self.last_incompatible = Some(policy);
            }
        }
    }
}
