//! A board's recording as a file of the format that programs of the host have: what reads those
//! reads this.

use super::relay::{HostEvent, Known, Relay};
use crate::layout::{
    Clocks, LayoutError, Plan, Planned, write_name, write_policy, write_tid, write_totals,
};
use crate::ring::Writer;
use crate::word::Word;
use alloc::vec::Vec;
use core::ops::Deref;

/// The file of a board, in memory of the caller's.
#[derive(Debug)]
pub struct Image<M> {
    memory: M,
    plan: Plan,
    /// The number that stands for a process id.
    pid: u32,
    /// Of each thread: of its own ring, and of its budget's.
    writers: Vec<(Option<Writer>, Option<Writer>)>,
}

impl Known {
    fn planned(&self) -> Planned<'_> {
        Planned {
            name: &self.name,
            role: self.role,
            cpu: None,
            budget: self.budget,
        }
    }
}

fn planned(relay: &Relay) -> Vec<Planned<'_>> {
    let threads = relay.threads.iter().flatten();
    threads.map(Known::planned).collect()
}

impl<M> Image<M> {
    /// Bytes of the file of this board, with rings of `ring` bytes, `MIN_RING..=MAX_RING`.
    ///
    /// # Errors
    /// [`LayoutError`] if the ring is out of its range, or no thread is known.
    pub fn bytes(relay: &Relay, ring: usize) -> Result<usize, LayoutError> {
        Ok(Plan::new(&planned(relay), ring)?.bytes)
    }
}

impl<M: Deref<Target = [W]>, W: Word> Image<M> {
    /// Lays the file out in `memory`: zeros, as many as [`bytes`](Self::bytes) says. `pid` stands
    /// for a process id, and the numbers after it for thread ids.
    ///
    /// # Errors
    /// As [`bytes`](Self::bytes).
    pub fn new(
        relay: &Relay,
        ring: usize,
        pid: u32,
        clocks: Clocks,
        memory: M,
    ) -> Result<Self, LayoutError> {
        let threads = planned(relay);
        let plan = Plan::new(&threads, ring)?;
        plan.write(&memory, &relay.board, pid, clocks, &threads);
        let writers = plan.threads.iter();
        let writers = writers.map(|at| {
            let budget = at.budget.and_then(|ring| Writer::new(ring.words));
            (Writer::new(at.ring.words), budget)
        });
        let image = Self {
            writers: writers.collect(),
            memory,
            plan,
            pid,
        };
        image.refresh(relay);
        Ok(image)
    }

    /// Writes an event into the ring that it belongs to.
    pub fn write(&mut self, event: &HostEvent) {
        let at = self.plan.threads.get(event.thread);
        let Some((at, (own, budget))) = at.zip(self.writers.get_mut(event.thread)) else {
            return;
        };
        let (writer, ring) = match (event.of_budget, at.budget) {
            (true, Some(ring)) => (budget, ring),
            (true, None) => return,
            (false, _) => (own, at.ring),
        };
        if let Some(writer) = writer {
            writer.write(ring.of(&self.memory), &event.event);
        }
    }

    /// Brings accounts and names up to date.
    pub fn refresh(&self, relay: &Relay) {
        let threads = self.plan.threads.iter().zip(&relay.threads);
        for (n, (at, known)) in (1..).zip(threads) {
            let Some(known) = known else { continue };
            let entry = at.entry.of(&self.memory);
            write_tid(entry, u64::from(self.pid) + n);
            write_policy(entry, &known.policy);
            write_totals(entry, &known.totals);
        }
        let names = self.plan.names.of(&self.memory);
        for (id, name) in (1..).zip(&relay.names) {
            if let Some((kind, name)) = name {
                write_name(names, id, *kind, name);
            }
        }
    }
}
