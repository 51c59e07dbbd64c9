//! The time in which a worker had the CPU: a few slices per window, recorded by the worker itself.
//!
//! The loop that burns CPU time reads the clock all the time; a jump means that another thread had
//! the CPU. Short jumps (the dispatcher, an interrupt) are no end of a slice.

use crate::load::Nanos;

/// Jumps of the clock shorter than this do not end a slice.
const MERGE: Nanos = 300_000;

/// Slices kept per window; more are not needed for a picture.
const KEPT: usize = 64;

/// The slices of one window: absolute start and end.
#[derive(Debug, Clone)]
pub(crate) struct CpuTrace {
    slices: [(Nanos, Nanos); KEPT],
    len: usize,
}

impl CpuTrace {
    /// No slices.
    pub(crate) const fn new() -> Self {
        Self {
            slices: [(0, 0); KEPT],
            len: 0,
        }
    }

    /// The worker ran at `now`.
    pub(crate) fn ran(&mut self, now: Nanos) {
        if let Some(last) = self.len.checked_sub(1).and_then(|n| self.slices.get_mut(n))
            && now.saturating_sub(last.1) < MERGE
        {
            last.1 = last.1.max(now);
        } else if let Some(free) = self.slices.get_mut(self.len) {
            *free = (now, now);
            self.len += 1;
        }
    }

    /// Takes the slices, relative to `start`, and begins a new recording.
    pub(crate) fn take(&mut self, start: Nanos) -> Vec<(Nanos, Nanos)> {
        let taken = self
            .slices
            .iter()
            .take(self.len)
            .filter(|s| s.1 > start)
            .map(|s| (s.0.saturating_sub(start), s.1 - start))
            .collect();
        self.len = 0;
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_gaps_are_bridged_and_long_ones_end_a_slice() {
        let mut cpu_trace = CpuTrace::new();
        for t in [1_000_000, 1_100_000, 1_350_000, 9_000_000, 9_100_000] {
            cpu_trace.ran(t);
        }
        assert_eq!(
            cpu_trace.take(1_000_000),
            [(0, 350_000), (8_000_000, 8_100_000)]
        );
        assert_eq!(cpu_trace.take(0), []);
    }

    #[test]
    fn a_full_tape_stops_recording() {
        let mut cpu_trace = CpuTrace::new();
        for n in 0..1_000 {
            cpu_trace.ran(n * 1_000_000);
        }
        assert_eq!(cpu_trace.take(0).len(), KEPT - 1); // the slice at the start has no length
    }
}
