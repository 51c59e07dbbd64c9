//! The endpoints that exchange samples (DDS 1.4, 2.2.3: offered against requested).

use super::Policy;
use crate::wire::Qos;

/// The first policy by which `offered`, a writer's, does not meet `requested`, a reader's.
#[must_use]
pub fn incompatible(offered: &Qos, requested: &Qos) -> Option<Policy> {
    let checks = [
        (
            offered.reliability < requested.reliability,
            Policy::Reliability,
        ),
        (
            offered.durability < requested.durability,
            Policy::Durability,
        ),
        (offered.deadline > requested.deadline, Policy::Deadline),
        (
            offered.liveliness < requested.liveliness
                || offered.liveliness_lease > requested.liveliness_lease,
            Policy::Liveliness,
        ),
        (offered.exclusive != requested.exclusive, Policy::Ownership),
        (
            requested.by_source_time && !offered.by_source_time,
            Policy::DestinationOrder,
        ),
        (
            !offered.representations.meets(requested.representations),
            Policy::Representation,
        ),
    ];
    let first = checks.into_iter().find(|(broken, _)| *broken);
    first.map(|(_, policy)| policy)
}
