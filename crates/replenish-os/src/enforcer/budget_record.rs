//! An enforcer's record of a worker's budget.
//!
//! The holder of the enforcer's lock writes: the enforcer's thread, the worker, or the watchdog. So
//! there is one writer at a time.

use super::config::AnyServer;
use crate::backend::live::{SharedMemory, SharedSlice};
use crate::{Level, Nanos};
use replenish_recorder::{Event, Kind, RunningTotals, ThreadSpan, Writer, write_totals};
use sporadic::{BudgetServer, Reservation};
use std::sync::Arc;

/// The places of a worker's budget in a recording.
#[derive(Debug)]
pub struct BudgetRecord {
    entry: SharedSlice,
    ring: SharedSlice,
    writer: Writer,
}

impl BudgetRecord {
    /// In the places of this thread; `None` if none was laid out for a budget.
    #[must_use]
    pub fn new(memory: &Arc<SharedMemory>, thread: &ThreadSpan) -> Option<Self> {
        let ring = thread.budget?;
        Some(Self {
            entry: SharedSlice::new(memory, thread.entry),
            ring: SharedSlice::new(memory, ring),
            writer: Writer::new(ring.words)?,
        })
    }

    /// The account so far; returns the budget left, and the CPU time used.
    pub(super) fn totals(
        &self,
        reservation: &Reservation<AnyServer>,
        now: Nanos,
    ) -> (Nanos, Nanos) {
        let counters = reservation.counters();
        let available = reservation.server().available(now);
        let totals = RunningTotals {
            high: counters.cpu_high,
            low: counters.cpu_low,
            exhaustions: counters.exhaustions,
            replenishments: counters.replenishments,
            available,
            is_low: reservation.level() == Level::Low,
        };
        write_totals(&self.entry, &totals);
        (available, totals.high.saturating_add(totals.low))
    }

    pub(super) fn write(&mut self, kind: Kind, time: Nanos, a: u64, b: u64) {
        let event = Event {
            time,
            kind,
            name: 0,
            a,
            b,
        };
        self.writer.write(&self.ring, &event);
    }
}
