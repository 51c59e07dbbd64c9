//! One worker's thread: it takes its budget, and runs its wait set from one spin to the next.
//!
//! ```text
//!   begun ─► waits for a spin ─► runs until the spin ends ─► reports ─┐
//!                 ▲    └────────── the runtime is gone ─► ends        │
//!                 └───────────────────────────────────────────────────┘
//! ```

use crate::crew::Event;
use crate::payload::Found;
use rclrs::{RclReturnCode, RclrsError, WaitSetRunConditions, WaitSetRunner};
use replenish_threads as threads;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, Sender};
use std::thread::{Builder, JoinHandle};

/// The kernel keeps so many bytes of a thread's name.
const KEPT: usize = 15;

/// Starts the thread; it waits for its first spin.
pub(crate) fn start(
    runner: WaitSetRunner,
    found: Found,
    spins: Receiver<WaitSetRunConditions>,
    events: Sender<Event>,
) -> std::io::Result<JoinHandle<()>> {
    let end = (0..=KEPT)
        .rev()
        .find(|end| found.name.is_char_boundary(*end));
    let short = found.name.get(..end.unwrap_or(0)).unwrap_or_default();
    Builder::new()
        .name(short.to_owned())
        .spawn(move || run(runner, &found, &spins, &events))
}

fn run(
    mut runner: WaitSetRunner,
    found: &Found,
    spins: &Receiver<WaitSetRunConditions>,
    events: &Sender<Event>,
) {
    let attached = found.budget.map(|budget| threads::attach(budget, None));
    while let Ok(conditions) = spins.recv() {
        let ended = match &attached {
            Some(Err(failure)) => {
                rclrs::log_fatal!("replenish", "worker {:?}: {failure}", found.name);
                conditions
                    .halt_spinning
                    .store(true, std::sync::atomic::Ordering::Release);
                Ok(Err(RclrsError::RclError {
                    code: RclReturnCode::Error,
                    msg: None,
                }))
            }
            _ => catch_unwind(AssertUnwindSafe(|| runner.run_blocking(conditions))),
        };
        let panicked = ended.is_err();
        if events.send(Event::Ended(ended)).is_err() || panicked {
            break;
        }
    }
    // The payload goes with the runner, and may end the budget.
    if let Some(budget) = found.budget {
        threads::detach(budget, None).ok();
    }
}
