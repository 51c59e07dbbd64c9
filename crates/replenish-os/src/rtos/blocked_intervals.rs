//! The stretches for which a thread was blocked, between two readings by its enforcer.

use crate::Nanos;
use sporadic::{BlockedInterval, since};

/// Intervals kept between two readings; more are joined to the last one, which is safe (a later
/// activation delays a replenishment).
const MAX_INTERVALS: usize = 4;

/// The blocking stretches since they were last taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockedIntervals {
    pub(crate) list: [BlockedInterval; MAX_INTERVALS],
    pub(crate) len: usize,
    /// CPU clock up to which intervals have counted.
    mark: Nanos,
    open: Option<Nanos>,
}

impl BlockedIntervals {
    pub(crate) const fn new() -> Self {
        const NONE: [BlockedInterval; MAX_INTERVALS] = [BlockedInterval {
            ran: 0,
            out_at: 0,
            in_at: 0,
        }; MAX_INTERVALS];
        Self {
            list: NONE,
            len: 0,
            mark: 0,
            open: None,
        }
    }

    /// Forgets the intervals so far; an open one stays open.
    pub(crate) fn clear(&mut self, cpu: Nanos) {
        self.len = 0;
        self.mark = cpu;
    }

    /// The thread blocks now.
    pub(crate) fn open(&mut self, now: Nanos) {
        self.open = Some(now);
    }

    /// The thread runs again, with `cpu` on its clock.
    pub(crate) fn close(&mut self, now: Nanos, cpu: Nanos) {
        let Some(out_at) = self.open.take() else {
            return;
        };
        let interval = BlockedInterval {
            ran: since(cpu, self.mark),
            out_at,
            in_at: now,
        };
        if let Some(place) = self.list.get_mut(self.len) {
            *place = interval;
            self.len += 1;
            self.mark = cpu;
        } else if let Some(last) = self.list.last_mut() {
            last.in_at = now;
        }
    }
}

#[cfg(all(test, nuttx_host))]
mod tests {
    use super::*;

    #[test]
    fn too_many_blocks_join_the_last_one() {
        let mut blocked = BlockedIntervals::new();
        for n in 0..9 {
            blocked.open(100 * n + 10);
            blocked.close(100 * n + 90, 10 * (n + 1));
        }
        assert_eq!(blocked.len, MAX_INTERVALS);
        let spans = blocked.list.map(|i| (i.ran, i.out_at, i.in_at));
        let first = |n: u64| (10, 100 * n + 10, 100 * n + 90);
        assert_eq!(spans, [first(0), first(1), first(2), (10, 310, 890)]);
    }
}
