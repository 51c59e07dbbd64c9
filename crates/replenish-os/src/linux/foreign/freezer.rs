//! Budgets whose threads are stopped without budget, by the kernel's freezer of control groups.
//!
//! ```text
//!   enforcer ── lowers and raises ──► threads
//!      │ switch: wanted                  ▲ stopped, going on
//!      ▼                                 │
//!   freezer's thread ── "1", "0" ──► cgroup.freeze of the budget's control group
//! ```
//!
//! The kernel changes control groups under one lock for all of them, without priority inheritance.
//! The enforcer must not wait for that lock. It lowers the threads to their background as ever, and
//! leaves the file to a thread of its own. A stop that comes late costs time in the background, no
//! time at the priority.

use crate::linux::config::ENFORCER_STACK;
use crate::linux::spawn_error::SpawnError;
use crate::linux::thread::{Thread, spawn};
use crate::pi_mutex::PiMutex;
use crate::{Level, Notify, Policy, ThreadSpec};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The thread that writes, and what it writes to; it goes on with all threads when it is dropped.
#[derive(Debug)]
pub(super) struct Freezer {
    shared: Arc<Shared>,
    thread: Option<Thread<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    switches: PiMutex<Vec<Arc<Switch>>>,
    bell: Notify,
    stop: AtomicBool,
}

/// The file of one budget.
#[derive(Debug)]
struct Switch {
    file: File,
    wanted: AtomicBool,
    /// Content of the file, as the freezer's thread knows it.
    frozen: AtomicBool,
}

/// A budget's side of its switch.
#[derive(Debug)]
pub(super) struct Brake {
    switch: Arc<Switch>,
    shared: Arc<Shared>,
}

impl Freezer {
    /// Starts the thread on `cpu`, at FIFO `priority`.
    pub(super) fn start(cpu: usize, priority: u8) -> Result<Self, SpawnError> {
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        let spec = ThreadSpec::new(format!("freezer/{cpu}"))
            .policy(Policy::Fifo { priority }) // checked by `spawn`
            .stack_size(ENFORCER_STACK)
            .cpu(cpu);
        let thread = Some(spawn(spec, move || theirs.run())?);
        Ok(Self { shared, thread })
    }

    /// A switch for one budget more; `file` is the `cgroup.freeze` of its threads.
    pub(super) fn brake(&self, file: File) -> Brake {
        let switch = Arc::new(Switch {
            file,
            wanted: AtomicBool::new(false),
            frozen: AtomicBool::new(false),
        });
        self.shared.switches.lock().push(Arc::clone(&switch));
        Brake {
            switch,
            shared: Arc::clone(&self.shared),
        }
    }
}

impl Drop for Freezer {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::SeqCst);
        self.shared.bell.set();
        if let Some(thread) = self.thread.take() {
            thread.join().ok(); // it cannot panic
        }
        for switch in self.shared.switches.lock().iter() {
            switch.file.write_at(b"0", 0).ok(); // the control group has gone
        }
    }
}

impl Brake {
    /// Stops the threads, or lets them go on. Never waits.
    pub(super) fn set(&self, level: Level) {
        self.switch
            .wanted
            .store(level == Level::Low, Ordering::SeqCst);
        self.shared.bell.set();
    }
}

impl Shared {
    /// The freezer's thread.
    fn run(&self) {
        while !self.stop.load(Ordering::SeqCst) {
            self.bell.wait();
            for switch in self.switches.lock().iter() {
                switch.follow();
            }
        }
    }
}

impl Switch {
    fn follow(&self) {
        let wanted = self.wanted.load(Ordering::SeqCst);
        if wanted != self.frozen.load(Ordering::Relaxed) {
            let text = if wanted { b"1" } else { b"0" };
            // Refused, the threads stay in their background: tried again with the next change.
            let done = self.file.write_at(text, 0).is_ok();
            self.frozen.store(wanted == done, Ordering::Relaxed);
        }
    }
}
