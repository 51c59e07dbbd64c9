//! [`Promises`]: deadlines and leases of own endpoints, and the assertions that others wait for.
//! `kept.rs` watches them.
//!
//! ```text
//!   sample written ─► deadline, lease of the writer      sample ready ─► deadline of the reader
//!   anything heard ─► leases of the peer's automatic writers      next_at, transmit ─► check
//!
//!   own writers with an automatic lease ─► an assertion each third of the shortest one
//! ```

use crate::promise::{Deadline, Lease};
use crate::wire::{INFINITE, LivelinessKind, Nanos, Qos};

/// The promises of an own endpoint.
#[derive(Clone, Copy, Debug)]
pub(super) struct Promises {
    pub(super) deadline: Deadline,
    /// Of a writer that shows itself that it is alive.
    pub(super) lease: Lease,
    /// The samples that a reader had when it was looked at last.
    pub(super) received: u64,
}

impl Promises {
    pub(super) const fn of(qos: &Qos) -> Self {
        let manual = !matches!(qos.liveliness, LivelinessKind::Automatic);
        Self {
            deadline: Deadline::new(qos.deadline),
            lease: Lease::new(if manual {
                qos.liveliness_lease
            } else {
                INFINITE
            }),
            received: 0,
        }
    }

    /// A sample was written.
    pub(super) const fn written(&mut self, now: Nanos) {
        self.deadline.renew(now);
        self.lease.renew(now);
    }

    pub(super) fn next(&self) -> Nanos {
        self.deadline.next().min(self.lease.next())
    }

    pub(super) const fn check(&mut self, now: Nanos) {
        self.deadline.check(now);
        self.lease.check(now);
    }
}

/// The assertions of a participant whose writers are alive because it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Assertions {
    pub(super) period: Nanos,
    pub(super) at: Nanos,
}

impl Assertions {
    pub(super) const NONE: Self = Self {
        period: INFINITE,
        at: INFINITE,
    };
}
