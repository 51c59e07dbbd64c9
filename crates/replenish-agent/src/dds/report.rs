//! The state of DDS as plain data.

use super::endpoint::Id;

/// The state of a [`Dds`](super::Dds).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct DdsReport {
    /// Why its thread ended by itself, if it did.
    pub ended: Option<String>,
    /// Times that a participant, an endpoint or a match of others was left out, since as many as
    /// there may be were known, or that events about others were lost.
    pub left_out: u64,
    /// The endpoints and nodes, by id.
    pub endpoints: Vec<EndpointReport>,
}

/// One endpoint or node.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct EndpointReport {
    /// Its id.
    pub id: Id,
    /// The domain.
    pub domain: u16,
    /// The topic, of a service that of the requests; of a node its name.
    pub name: String,
    /// Where it stands.
    pub state: EndpointState,
    /// Writers and readers of others that it talks with.
    pub matched: usize,
    /// Samples that wait for DDS.
    pub waiting_out: usize,
    /// Samples that wait for the program.
    pub waiting_in: usize,
    /// Its counters.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub counts: EndpointCounts,
}

/// The counters of an endpoint; they only grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct EndpointCounts {
    /// Times that a writer or reader of others did not match because of its QoS.
    pub mismatched: u64,
    /// Samples handed to DDS.
    pub sent: u64,
    /// Samples from others handed to the program's queue.
    pub received: u64,
    /// Samples for DDS dropped because too many waited, or because they are too long.
    pub dropped_out: u64,
    /// Samples from DDS dropped because too many waited, because they are too long or because
    /// their encoding is not little-endian XCDR1.
    pub dropped_in: u64,
    /// Samples that a reader never got, by the gaps in their writers' numbers: lost by a
    /// best-effort writer or the network, or overwritten before they were taken.
    pub missed: u64,
    /// Requests forgotten without a reply, and replies to unknown requests.
    pub calls_lost: u64,
    /// Readers and writers of others that were lost because their participant was silent for
    /// longer than its lease.
    pub lost: u64,
    /// Lost readers and writers that it talks with again.
    pub returned: u64,
    /// Samples that lost readers did not get, at most: up to 256 that were on the way to each, and
    /// those sent until it came back.
    pub unheard: u64,
}

impl core::ops::AddAssign for EndpointCounts {
    fn add_assign(&mut self, more: Self) {
        self.mismatched += more.mismatched;
        self.sent += more.sent;
        self.received += more.received;
        self.dropped_out += more.dropped_out;
        self.dropped_in += more.dropped_in;
        self.missed += more.missed;
        self.calls_lost += more.calls_lost;
        self.lost += more.lost;
        self.returned += more.returned;
        self.unheard += more.unheard;
    }
}

/// Where an endpoint stands.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum EndpointState {
    /// The thread of DDS has not seen it yet.
    Opening,
    /// It is in DDS.
    Open,
    /// DDS refused it; why.
    Failed(String),
}
