//! Turns a thread's context-switch records into the blocking stretches of one reading.
//!
//! Only the kernel's records tell a thread that was *preempted* (it stays activated) from one that
//! *blocked* inside its callback (it is activated anew when it wakes, POSIX XSH 2.8.4 rule R2).

use crate::Nanos;
use crate::linux::context_switches::{ContextSwitch, SwitchDirection};
use sporadic::{BlockedInterval, Readings};

/// More intervals than this in one reading are joined to the last one; joining is safe (a later
/// activation delays a replenishment).
const MAX_INTERVALS: usize = 16;

/// The reader's state between two readings.
#[derive(Clone, Debug)]
pub(crate) struct BlockedIntervals {
    intervals: [BlockedInterval; MAX_INTERVALS],
    len: usize,
    ran: Nanos,
    in_at: Nanos,
    on_cpu: bool,
    blocked_at: Option<Nanos>,
    /// Records of this reading are missing.
    incomplete: bool,
}

impl BlockedIntervals {
    pub(crate) const fn new() -> Self {
        const NONE: BlockedInterval = BlockedInterval {
            ran: 0,
            out_at: 0,
            in_at: 0,
        };
        Self {
            intervals: [NONE; MAX_INTERVALS],
            len: 0,
            ran: 0,
            in_at: 0,
            on_cpu: true,
            blocked_at: None,
            incomplete: false,
        }
    }

    /// Starts afresh with a thread that runs: what was recorded belongs to its wait.
    pub(crate) fn restart(&mut self, now: Nanos) {
        *self = Self::new();
        self.in_at = now;
    }

    /// Starts the next reading, keeping what is still open.
    pub(crate) fn next_reading(&mut self, now: Nanos) {
        self.len = 0;
        self.ran = 0;
        self.incomplete = false;
        self.in_at = self.in_at.max(now);
    }

    /// An open block belongs to a suspension by the enforcer and does not count.
    pub(crate) fn forget_block(&mut self) {
        self.blocked_at = None;
    }

    pub(crate) fn feed(&mut self, switch: ContextSwitch) {
        match switch.kind {
            SwitchDirection::Out { preempted } => {
                if self.on_cpu {
                    self.ran += switch.time.saturating_sub(self.in_at);
                }
                self.on_cpu = false;
                self.blocked_at = (!preempted).then_some(switch.time);
            }
            SwitchDirection::In => {
                self.on_cpu = true;
                self.in_at = switch.time;
                if let Some(out_at) = self.blocked_at.take() {
                    self.push(BlockedInterval {
                        ran: self.ran,
                        out_at,
                        in_at: switch.time,
                    });
                    self.ran = 0;
                }
            }
        }
    }

    /// Records were lost, or there are none: it is not known when the thread blocked, and the last
    /// record says nothing about the thread any more. It may be running, or blocked: then the next
    /// record shows that it runs again.
    pub(crate) fn lost(&mut self, now: Nanos) {
        self.restart(now);
        self.incomplete = true;
        self.blocked_at = Some(now);
    }

    /// Whether the thread was off the CPU after the last record, none being lost.
    pub(crate) fn is_off_cpu(&self) -> bool {
        !self.on_cpu
    }

    pub(crate) fn readings(&self) -> Readings<'_> {
        if self.incomplete {
            Readings::Unknown
        } else {
            Readings::Exact(self.intervals())
        }
    }

    fn intervals(&self) -> &[BlockedInterval] {
        self.intervals.get(..self.len).unwrap_or(&[])
    }

    fn push(&mut self, interval: BlockedInterval) {
        if let Some(place) = self.intervals.get_mut(self.len) {
            *place = interval;
            self.len += 1;
        } else if let Some(last) = self.intervals.last_mut() {
            last.in_at = interval.in_at;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn out(time: Nanos, preempted: bool) -> ContextSwitch {
        ContextSwitch {
            time,
            kind: SwitchDirection::Out { preempted },
        }
    }
    fn inn(time: Nanos) -> ContextSwitch {
        ContextSwitch {
            time,
            kind: SwitchDirection::In,
        }
    }

    #[test]
    fn preemption_is_no_gap_and_blocking_is_one() {
        let mut t = BlockedIntervals::new();
        t.restart(100);
        for s in [
            out(110, true),
            inn(120),
            out(125, false),
            inn(200),
            out(230, true),
        ] {
            t.feed(s);
        }
        assert_eq!(
            t.intervals(),
            [BlockedInterval {
                ran: 15,
                out_at: 125,
                in_at: 200
            }]
        );
    }

    #[test]
    fn a_block_that_spans_two_readings_is_seen_in_the_second() {
        let mut t = BlockedIntervals::new();
        t.restart(0);
        t.feed(out(10, false));
        assert_eq!(t.intervals(), []);
        t.next_reading(50);
        t.feed(inn(70));
        assert_eq!(
            t.intervals(),
            [BlockedInterval {
                ran: 0,
                out_at: 10,
                in_at: 70
            }]
        );
    }

    /// On b209253 the thread counted as off the CPU for ever: its clock was not read again.
    #[test]
    fn after_a_loss_the_last_record_is_not_believed() {
        let mut t = BlockedIntervals::new();
        t.restart(0);
        t.feed(out(10, false));
        assert!(t.is_off_cpu());
        t.lost(50);
        assert!(!t.is_off_cpu());
        t.next_reading(50);
        t.feed(inn(70));
        t.feed(out(80, false));
        t.feed(inn(90));
        let interval = |ran, out_at, in_at| BlockedInterval { ran, out_at, in_at };
        assert_eq!(t.intervals(), [interval(0, 50, 70), interval(10, 80, 90)]);
        t.lost(100);
        assert_eq!(t.readings(), Readings::Unknown);
        t.next_reading(100);
        t.feed(out(120, true));
        t.feed(inn(130));
        assert_eq!(t.readings(), Readings::Exact(&[]), "it was running");
    }

    #[test]
    fn too_many_gaps_are_joined_at_the_later_time() {
        let mut t = BlockedIntervals::new();
        t.restart(0);
        for i in 0..40 {
            t.feed(out(10 * i + 5, false));
            t.feed(inn(10 * i + 9));
        }
        assert_eq!(t.intervals().len(), MAX_INTERVALS);
        assert_eq!(t.intervals()[MAX_INTERVALS - 1].in_at, 399);
    }
}
