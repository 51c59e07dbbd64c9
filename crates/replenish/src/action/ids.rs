//! Names for goals.

use crate::platform;
use crate::sync::{AtomicU64, Ordering};
use replenish_msg::unique_identifier_msgs::UUID;

/// Gives out ids that no other client gives out: random bits, then a number.
pub(super) struct Ids {
    random: u64,
    next: AtomicU64,
}

impl Ids {
    pub(super) fn new() -> Self {
        Self {
            random: platform::random(1),
            next: AtomicU64::new(platform::random(2)),
        }
    }

    /// A UUID as RFC 9562 wants it: version 8, whose bits are the maker's own affair.
    pub(super) fn next(&self) -> UUID {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let mut uuid = [0; 16];
        let (random, counted) = uuid.split_at_mut(8);
        random.copy_from_slice(&self.random.to_be_bytes());
        counted.copy_from_slice(&number.to_be_bytes());
        uuid[6] = uuid[6] & 0x0f | 0x80;
        uuid[8] = uuid[8] & 0x3f | 0x80;
        UUID { uuid }
    }
}
