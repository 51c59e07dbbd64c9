//! Feature `log`: what the executor has to tell goes to the logger that the image installs, and the
//! heap stays sealed.

use crate::HEAP;
use crate::check::{MS, hold};
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use firmware::say;
use firmware::work::Burst;
use replenish::{Context, Error, Executor, Policy, RunningExecutor};
use replenish_os::clock;

static RECORDS: AtomicU32 = AtomicU32::new(0);

/// Prints records on the console.
struct Printer;

impl log::Log for Printer {
    fn enabled(&self, record: &log::Metadata<'_>) -> bool {
        record.target() == "replenish"
    }

    fn log(&self, record: &log::Record<'_>) {
        RECORDS.fetch_add(1, Ordering::Relaxed);
        say!("{} {}: {}", record.level(), record.target(), record.args());
    }

    fn flush(&self) {}
}

/// A callback that returns an error is a warning each time its count doubles; the worker goes on.
pub fn events_reach_the_logger(_: Burst) {
    if log::set_logger(&Printer).is_err() {
        hold!(false, "there is a logger already");
        return;
    }
    log::set_max_level(log::LevelFilter::Warn);
    let described = || -> Result<RunningExecutor, Error> {
        let context = Context::in_process();
        let mut exec = Executor::new(&context);
        exec.worker("failing")
            .policy(Policy::fifo(60)?)
            .stack_size(4096)
            .timer(Duration::from_millis(10), |_| Err::<(), _>("out of paper"))?;
        exec.start()
    };
    let running = match described() {
        Ok(running) => running,
        Err(e) => {
            hold!(false, "{e}");
            return;
        }
    };
    HEAP.seal();
    clock::sleep_until(clock::monotonic() + 85 * MS);
    let records = RECORDS.load(Ordering::Relaxed);
    hold!(records == 4, "{records} records of failures 1, 2, 4 and 8");
    let refused = HEAP.usage().refused;
    hold!(refused == 0, "{refused} allocations after the start");
    core::mem::forget(running);
}
