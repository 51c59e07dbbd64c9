//! Keeps the measured CPU from sleeping between messages.
//!
//! A thread of `SCHED_IDLE` runs there whenever no other thread does, as `cyclictest` holds
//! `/dev/cpu_dma_latency`: what a core or a hypervisor forgets while a CPU sleeps is the machine's
//! affair, differs from one to the next, and is no part of what a message costs a program.

use replenish_cli::outcome::{Failure, Outcome};
use replenish_os::{SchedClass, Thread, ThreadSpec, current_tid, set_priority, spawn};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A CPU that does not sleep, until this is dropped.
#[derive(Debug)]
pub(super) struct Awake {
    ends: Arc<AtomicBool>,
    thread: Option<Thread<Outcome>>,
}

impl Awake {
    pub(super) fn keep(cpu: usize) -> Result<Self, Failure> {
        let ends = Arc::new(AtomicBool::new(false));
        let end = Arc::clone(&ends);
        let body = move || {
            set_priority(current_tid(), SchedClass::Idle).map_err(Failure::refused)?;
            while !end.load(Ordering::Relaxed) {
                std::hint::black_box(0); // no `pause`: a hypervisor may take it for a wait
            }
            Ok(())
        };
        let spec = ThreadSpec::new("awake").cpu(cpu);
        let thread = spawn(spec, body).map_err(Failure::refused)?;
        Ok(Self {
            ends,
            thread: Some(thread),
        })
    }

    /// Lets it sleep again.
    pub(super) fn stop(mut self) -> Outcome {
        self.end()
    }

    fn end(&mut self) -> Outcome {
        self.ends.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map_or(Ok(Ok(())), Thread::join);
        ended.map_err(|_| Failure::refused("what keeps the CPU awake panicked"))?
    }
}

impl Drop for Awake {
    fn drop(&mut self) {
        self.end().ok(); // `stop` tells what went wrong
    }
}
