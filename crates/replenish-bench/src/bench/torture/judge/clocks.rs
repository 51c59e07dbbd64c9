//! The executor's account and the timeline, against the kernel's CPU clocks.

use super::Finding;
use super::finding::LATE;
use super::view::View;
use crate::load::Nanos;

/// Both readings of a CPU clock take a moment, and so does the change of a priority, in ns.
const READING: Nanos = 60_000;

/// The way from a callback's end to the thread's sleep, in ns at most: the account charges it when
/// the thread wakes, since nobody reads its clock before. Cold caches made it 110 us. Others may
/// preempt the thread on this way.
pub(super) const TAIL: Nanos = 200_000;

impl View<'_> {
    /// The account's CPU time against the kernel's.
    pub(super) fn account(&self) -> Option<Finding> {
        let [first, last] = &self.evidence.accounts;
        let (first, last) = (first.get(self.index)?, last.get(self.index)?);
        let said = (last.high + last.low).saturating_sub(first.high + first.low);
        let mine = || self.pieces().filter(|p| p.thread == self.thread);
        let inside = mine().filter(|p| p.from >= first.after && p.to <= last.before);
        let around = mine().filter(|p| p.to >= first.before && p.from <= last.after);
        let least: Nanos = inside.map(|p| p.cpu).sum();
        let most: Nanos = around.map(|p| p.cpu).sum();
        let unread = |at: Nanos| {
            let before = mine().take_while(|p| p.to <= at);
            let (since_sleep, _) = before.fold((0, true), |(cpu, slept), piece| {
                let before = if slept { 0 } else { cpu };
                (before + piece.cpu, piece.waits)
            });
            since_sleep.min(TAIL)
        };
        let missing = least.saturating_sub(said + unread(last.before));
        let wrong = missing.max(said.saturating_sub(most + unread(first.before)));
        // A clock that is read while its CPU stands still goes on, and the trace shows it later.
        let timeline = &self.evidence.timeline;
        let still = [first, last].map(|reading| {
            let from = reading.before.saturating_sub(LATE);
            timeline.stood_still(from, reading.after + LATE)
        });
        let allowed = READING + still.iter().sum::<Nanos>();
        Some(self.finding("account", allowed, wrong, last.before))
    }

    /// The timeline against `/proc`.
    pub(super) fn trace(&self) -> Option<Finding> {
        let [first, last] = &self.evidence.clocks;
        let clock = last
            .get(self.index)?
            .saturating_sub(*first.get(self.index)?);
        let mine = self.pieces().filter(|p| p.thread == self.thread);
        let traced: Nanos = mine.map(|p| p.cpu).sum();
        let wrong = traced.abs_diff(clock);
        Some(self.finding("trace", READING, wrong, self.evidence.to))
    }
}
