//! A callback of pong: it answers a message with a burst of CPU time.

use crate::case::Worker;
use crate::work::Burst;
use alloc::sync::Arc;
use core::sync::atomic::{AtomicI32, AtomicU32, Ordering};
use replenish::Publisher;
use replenish::middleware::PublishError;
use replenish::msg::std_msgs::Int32;
use replenish_os::freertos::AtomicU64;
use replenish_os::{Notify, clock};

/// The begin of the run, shared by all workers and the main task.
#[derive(Debug, Default)]
pub struct Scene {
    /// Time at which the first message of the run reached a callback, in ns; 0: none has.
    pub begun: AtomicU64,
    /// Rings at that moment.
    pub begin: Notify,
}

/// Counts of a worker's answers.
#[derive(Debug, Default)]
pub struct Count {
    /// Answers published.
    pub answered: AtomicU32,
    /// Answers that the middleware did not take.
    pub failed: AtomicU32,
    /// The latest message before the run, which is not answered: its number, below 0; 0: none has
    /// come.
    pub rehearsed: AtomicI32,
}

/// One worker's callback. An answer takes its burst of the worker's CPU time all in all: what the
/// executor needs of it to take the message and to send the answer is part of it.
pub struct Answer {
    /// The worker that answers.
    pub worker: Worker,
    /// The worker's counts, which other tasks read.
    pub count: Arc<Count>,
    /// The begin of the run, shared with the other workers.
    pub scene: Arc<Scene>,
    /// Its topic.
    pub pong: Arc<Publisher<Int32>>,
    /// The loop that burns CPU time.
    pub burst: Burst,
    /// CPU time of an answer, in ns.
    pub cpu: u64,
    /// Sleep of an answer after its CPU time, in ns.
    pub sleep: u64,
    /// Reading of the worker's CPU clock at which the present answer is done.
    pub target: Option<u64>,
}

impl Answer {
    /// Answers `ping`; a number below 0 is a rehearsal.
    ///
    /// # Errors
    /// Of the middleware.
    pub fn answer(&mut self, ping: &Int32) -> Result<(), PublishError> {
        if ping.data < 0 {
            self.count.rehearsed.store(ping.data, Ordering::Relaxed);
            return Ok(());
        }
        let first = self.target.is_none();
        if first {
            self.wait_for_turn();
        }
        if self.worker.endless {
            loop {
                core::hint::black_box(()); // not `spin_loop`, which QEMU is slow at
            }
        }
        let target = self.target.unwrap_or_else(clock::thread_cpu) + self.cpu;
        self.target = Some(target);
        self.burst.until(target);
        if self.sleep > 0 {
            clock::sleep_until(clock::monotonic() + self.sleep);
        }
        let sent = self.pong.publish(ping);
        let count = if sent.is_ok() {
            &self.count.answered
        } else {
            &self.count.failed
        };
        count.fetch_add(1, Ordering::Relaxed);
        sent
    }

    /// The first message begins the run, and the worker's offset counts from there.
    fn wait_for_turn(&self) {
        let now = clock::monotonic();
        if self.scene.begun.load(Ordering::SeqCst) == 0 {
            self.scene.begun.store(now, Ordering::SeqCst);
            self.scene.begin.set();
        }
        if self.worker.offset > 0 {
            clock::sleep_until(self.scene.begun.load(Ordering::SeqCst) + self.worker.offset);
        }
    }
}
