//! Never too little: the share of a thread that always wanted the CPU.

use super::super::case::Case;
use super::super::timeline::Piece;
use super::Finding;
use super::finding::latency;
use super::view::{View, share_of_time};
use crate::load::Nanos;

const US: Nanos = 1000;

/// A share may lack one part of this many in the long run: 0.05 %.
const SHARE: Nanos = 2000;

impl View<'_> {
    /// The share of a thread that always wanted the CPU.
    pub(super) fn share(&self, case: &Case) -> Vec<Finding> {
        let grouped = case.workers.iter().any(|w| w.group.is_some());
        if !self.worker.is_hungry() || grouped || case.drops_at.is_some() {
            return Vec::new();
        }
        let spans = self.evidence.spans();
        spans
            .filter_map(|(from, to)| self.share_of((from, to), case.records))
            .collect()
    }

    fn share_of(&self, (from, to): (Nanos, Nanos), records: bool) -> Option<Finding> {
        let (budget, period) = (self.worker.budget, self.worker.period);
        // Kept from the CPU for longer than a period: that budget does not pile up. Where nobody
        // records blocking, all time that it was kept from the CPU makes its period longer.
        let free = if records { period } else { 0 };
        let lost = |kept: Nanos| share_of_time(kept.saturating_sub(free), budget, period);
        // (n − 1) budgets in n periods: it may have had one of them just before a stop.
        let first_span = self.evidence.halts.get(1).is_none_or(|h| from < h.from);
        let had = if first_span { 0 } else { budget };
        let within = |p: &&Piece| from <= p.from && p.to <= to;
        let first = self.pieces().filter(within).find(|p| self.is_high(p))?.from;
        let periods = to.saturating_sub(first) / period;
        // At the end of one of the last periods everything has been had that came back.
        let ends = (1..=3.min(periods)).map(|back| periods + 1 - back);
        let lacks = ends.map(|count| {
            let end = first + count * period;
            let (mut got, mut missing, mut kept) = (0, 0, 0);
            for p in self
                .pieces()
                .filter(within)
                .filter(|p| p.to <= end && p.from >= first)
            {
                let foreign =
                    p.rank >= self.worker.priority && !self.evidence.own.contains(&p.thread);
                // A suspended worker pays for what it uses until it has stopped.
                let pays = self.worker.background.is_none() && p.thread == self.thread;
                let high = self.is_high(p);
                if high || pays {
                    got += p.cpu;
                } else if p.withheld || foreign {
                    missing += p.wall();
                }
                if !high && (p.withheld || p.rank >= self.worker.priority) {
                    kept += p.wall();
                } else {
                    missing += lost(kept);
                    kept = 0;
                }
                if p.thread != 0 {
                    missing += p.wall().saturating_sub(p.cpu + 100 * US);
                }
            }
            missing += lost(kept);
            let allowed = count * budget / SHARE + latency(budget) + missing + had;
            let lack = (count * budget).saturating_sub(got);
            self.finding("share", allowed, lack, end)
        });
        lacks.min_by_key(Finding::beyond)
    }
}
