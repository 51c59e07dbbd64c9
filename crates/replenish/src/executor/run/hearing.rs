//! A worker waits for samples that the middleware hands to it, beside its bell.
//!
//! It asks the kernel before it sleeps, and before each round if it has several such handles: then
//! the handle with the highest priority among those with samples has its turn first.

use super::state::{Worker, WorkerSpec};
use crate::Nanos;
use crate::executor::wake::run_queue::RunQueue;
use crate::handoff::Woken;
use crate::platform::STD;

impl Worker {
    /// Sleeps until the bell rings, samples have come, or until `release`. A worker whose rounds
    /// begin by the clock sleeps until then: samples wait in the middleware.
    pub(super) fn sleep(&mut self, release: Option<Nanos>) -> Woken {
        let listens = STD && self.spec.rules.every.is_none() && self.own_sources() > 0;
        match self.sources.as_ref().filter(|_| listens) {
            None => self.bell.wait(release),
            Some(sources) => {
                let (run_queue, spec): (_, &mut WorkerSpec) = (&mut self.run_queue, &mut self.spec);
                sources.sleep(&self.bell, release, &mut |slot| note(run_queue, spec, slot))
            }
        }
    }

    /// Before a round: hears of samples of other handles.
    pub(super) fn listen(&mut self) {
        if STD && self.spec.rules.every.is_none() && self.own_sources() > 1 {
            self.hear(Some(0));
        }
    }

    /// Waits until `deadline`, and notes of which handles samples have come.
    pub(super) fn hear(&mut self, deadline: Option<Nanos>) {
        let (run_queue, spec): (_, &mut WorkerSpec) = (&mut self.run_queue, &mut self.spec);
        if let Some(sources) = self.sources.as_ref().filter(|_| STD) {
            sources.wait(deadline, &mut |slot| note(run_queue, spec, slot));
        }
    }

    fn own_sources(&self) -> usize {
        self.sources.as_ref().map_or(0, |sources| sources.handles())
    }
}

/// Samples have come for the handle in this slot.
fn note(run_queue: &mut RunQueue, spec: &mut WorkerSpec, slot: usize) {
    let at = run_queue.position(slot);
    if let Some((at, entry)) = at.and_then(|at| Some((at, spec.entries.get_mut(at)?))) {
        entry.heard();
        run_queue.insert(at);
    }
}
