//! The events that a participant reports: peers, matches, bounds that were reached.

use crate::wire::{Guid, GuidPrefix};

/// A change, in the order it happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Event {
    /// A participant was heard for the first time.
    ParticipantFound(GuidPrefix),
    /// A participant is gone, by its own word or because its lease is over.
    ParticipantLost(GuidPrefix),
    /// A participant was not heard for its lease; the losses of its endpoints and its own follow.
    Silent(GuidPrefix),
    /// Two endpoints exchange samples from now on: ours and theirs.
    Matched(Guid, Guid),
    /// Two endpoints that exchanged samples do so no longer: ours and theirs.
    Unmatched(Guid, Guid),
    /// Two endpoints of a topic cannot exchange samples: ours, theirs, why.
    Incompatible(Guid, Guid, Policy),
    /// A reader asks for what it had acknowledged, because it had lost us for a while: ours and
    /// theirs. A late ACKNACK looks the same.
    Anew(Guid, Guid),
    /// A bound was reached, and something was left out.
    Full(Bound),
}

/// Why two endpoints of one topic do not fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Policy {
    /// Their types have different names.
    Type,
    /// The writer is best effort, the reader reliable.
    Reliability,
    /// The writer keeps less for late readers than the reader requests.
    Durability,
    /// The writer's deadline is longer than the reader's.
    Deadline,
    /// The writer shows itself less often, or in a weaker way, than the reader requests.
    Liveliness,
    /// One is shared, the other exclusive.
    Ownership,
    /// The reader orders by the source's time, the writer does not.
    DestinationOrder,
    /// The writer's data representation is not one of the reader's.
    Representation,
    /// They have no partition in common.
    Partition,
}

impl Policy {
    /// Its name, in lower case.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Policy::Type => "type",
            Policy::Reliability => "reliability",
            Policy::Durability => "durability",
            Policy::Deadline => "deadline",
            Policy::Liveliness => "liveliness",
            Policy::Ownership => "ownership",
            Policy::DestinationOrder => "destination order",
            Policy::Representation => "data representation",
            Policy::Partition => "partition",
        }
    }
}

/// A bound of [`Limits`](super::Limits).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Bound {
    /// `participants`: another one was heard.
    Participants,
    /// `endpoints`: another one was announced.
    Endpoints,
    /// `matches`: an endpoint of ours fits more peers.
    Matches,
    /// `events`: the oldest were dropped.
    Events,
}
