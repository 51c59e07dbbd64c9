//! The promises of the FreeRTOS back end, case by case, each on a fresh boot.
//!
//! The command line names the case. `cargo xtask board test` runs all cases and knows which are to
//! end badly.
//!
//! - [`check`]: the tools of every case: expectations, tasks, the order of events.
//! - [`locks`]: priority inheritance.
//! - [`budgets`]: suspension, blocking in callbacks, CPU time.
//! - [`defects`]: budgets that were broken on Linux once.
//! - [`waits`]: hand-off, timers, timeouts, sleep, the clock's overflow.
//! - [`scheduling`]: policies granted and refused, equals in order, an idle board asleep.
//! - [`failures`]: panics, the sealed heap, stacks that are too small.
//! - [`executor`]: the same through the executor.
//! - `logged`: its events in the image's logger (feature `log`).
#![no_std]
#![no_main]

extern crate alloc;

mod budgets;
mod check;
mod defects;
mod executor;
mod failures;
mod locks;
#[cfg(feature = "log")]
mod logged;
mod scheduling;
mod waits;

use firmware::work::Burst;
use firmware::{console, say};
use replenish_os::freertos::{SealedHeap, start};

#[global_allocator]
static HEAP: SealedHeap<{ 96 * 1024 }> = SealedHeap::new();

/// Above the tasks of the cases, so that it looks on time.
const MAIN_PRIORITY: u8 = 90;

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(MAIN_PRIORITY, 16384, || {
        let mut line = [0_u8; 64];
        let words = console::command_line(&mut line);
        let name = words.split_ascii_whitespace().last().unwrap_or_default();
        let Some((_, case)) = CASES.iter().find(|(n, _)| *n == name) else {
            for (name, _) in CASES {
                say!("{name}");
            }
            console::exit(false)
        };
        case(Burst::calibrate());
        console::exit(check::all_held())
    });
    say!("the kernel did not start: {:?}", started.err());
    console::exit(false)
}

type Case = fn(Burst);

const CASES: &[(&str, Case)] = &[
    ("lock-inherits", locks::inherits),
    ("lock-chain", locks::chain),
    ("lock-in-background", locks::in_background),
    ("lock-in-suspension", locks::in_suspension),
    ("lock-order", locks::order),
    ("lock-limited", locks::limited_wait),
    ("suspend", budgets::suspend),
    ("blocking-is-free", budgets::blocking_is_free),
    ("cpu-time-exact", budgets::cpu_time_exact),
    ("defect-suspended-in-lock", defects::suspended_in_lock),
    ("defect-inherited", defects::inherited),
    ("defect-shares", defects::shares),
    ("defect-small-and-blocking", defects::small_and_blocking),
    ("defect-small-pieces", defects::small_pieces),
    ("hand-off", waits::hand_off),
    ("hand-off-interrupt", waits::hand_off_interrupt),
    ("timers-ordered", waits::timers_ordered),
    ("timeouts", waits::timeouts),
    ("sleep", waits::sleep),
    ("long-clock", waits::long_clock),
    ("granted", scheduling::granted_as_asked),
    ("refused", scheduling::refused),
    ("equals-in-order", scheduling::equals_in_order),
    ("idle", scheduling::idle),
    ("idle-ten-timers", executor::idle_ten_timers),
    ("executor-granted", executor::granted_as_asked),
    ("executor-refused", executor::refused),
    ("executor-panic", executor::panic_halts_one),
    #[cfg(feature = "log")]
    ("executor-log", logged::events_reach_the_logger),
    ("panic", failures::panic_halts_one),
    ("heap-sealed", failures::heap_sealed),
    ("heap-refusal-handled", failures::heap_refusal_handled),
    ("stack-overflow", failures::stack_overflow),
    ("stack-overflow-deep", failures::stack_overflow_deep),
];
