//! Receiving on a best-effort stream: older messages than the newest are dropped.

use crate::SeqNum;
use crate::counter::{count, count_all, count_inline};

/// The counters of a best-effort input stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct BestEffortStats {
    /// Messages that were accepted.
    pub received: u64,
    /// Numbers that were skipped: lost, or late and then also in `old`.
    pub skipped: u64,
    /// Messages dropped because a newer one, or the same, had come before.
    pub old: u64,
}

impl BestEffortStats {
    /// Both together.
    #[must_use]
    pub const fn plus(self, other: Self) -> Self {
        BestEffortStats {
            received: self.received.saturating_add(other.received),
            skipped: self.skipped.saturating_add(other.skipped),
            old: self.old.saturating_add(other.old),
        }
    }
}

/// The receiving end of a best-effort stream.
#[derive(Debug, Default)]
pub struct InputBestEffort {
    newest: Option<SeqNum>,
    stats: BestEffortStats,
}

impl InputBestEffort {
    /// A stream at its beginning; whatever number comes first is accepted.
    #[must_use]
    pub const fn new() -> Self {
        InputBestEffort {
            newest: None,
            stats: BestEffortStats {
                received: 0,
                skipped: 0,
                old: 0,
            },
        }
    }

    /// Back to the beginning, for a new session. The counters go on.
    pub const fn reset(&mut self) {
        self.newest = None;
    }

    /// Whether message `seq` is to be handled.
    #[inline]
    pub fn accept(&mut self, seq: SeqNum) -> bool {
        let expected = self.newest.map_or(seq, |newest| newest.plus(1));
        let ahead = seq.since(expected);
        let Ok(skipped) = usize::try_from(ahead) else {
            count(&mut self.stats.old);
            return false;
        };
        self.newest = Some(seq);
        count_inline(&mut self.stats.received);
        if skipped > 0 {
            count_all(&mut self.stats.skipped, skipped);
        }
        true
    }

    /// The counters so far.
    #[must_use]
    pub const fn stats(&self) -> BestEffortStats {
        self.stats
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_order_across_the_wrap_and_counts() {
        let mut stream = InputBestEffort::new();
        let accepted: [bool; 7] =
            [65533, 65535, 65534, 65535, 0, 3, 2].map(|seq| stream.accept(SeqNum(seq)));
        assert_eq!(accepted, [true, true, false, false, true, true, false]);
        assert_eq!(
            stream.stats(),
            BestEffortStats {
                received: 4,
                skipped: 3,
                old: 3
            }
        );
        stream.reset();
        assert!(stream.accept(SeqNum(0)));
    }
}
