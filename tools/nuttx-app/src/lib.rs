//! `replenish_main`, an entry point for NuttX: checks the image, then runs cases of threads that
//! burn bursts of 10 ms for 10 s, and prints what each of them did.
//!
//! - [`work`]: the bursts.
//! - [`case`]: threads of one case, started, measured, ended.
//! - [`behaviour`]: what the tests on Linux assert, asked here.
//! - [`executor`]: the same with the executor, its timers and messages.
//! - `board`: a clock finer than the tick, and the end of the emulation (feature `qemu-stm32f405`).
#![no_std]

extern crate alloc;

mod behaviour;
#[cfg(feature = "qemu-stm32f405")]
mod board;
mod case;
mod executor;
mod print;
mod work;

use case::{Case, Load};
use core::ffi::{c_char, c_int};
use replenish_os::nuttx::{self, SystemHeap};
use replenish_os::{SchedClass, current_tid, set_priority};

#[global_allocator]
static HEAP: SystemHeap = SystemHeap::new();

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    nuttx::halt(info)
}

/// The application.
#[unsafe(no_mangle)]
pub extern "C" fn replenish_main(_: c_int, _: *const *const c_char) -> c_int {
    #[cfg(feature = "qemu-stm32f405")]
    board::start_clock();
    let facts = match nuttx::check() {
        Ok(facts) => facts,
        Err(why) => {
            say!("refused: {why}");
            return end(1);
        }
    };
    say!("{facts}");
    if let Err(why) = set_priority(current_tid(), SchedClass::Fifo(behaviour::MAIN)) {
        say!("refused: {why}");
        return end(1);
    }
    let failed = behaviour::run();
    say!("case: done by each in 10 s [CPU high/low in ms]");
    for budget in 1..10 {
        let budget = 10 * budget;
        Case::of(&[Load::budget(60, budget), Load::fifo(10)]).run();
    }
    for offset in [0, 1, 2, 10, 20] {
        let second = Load::budget(59, 30).after(offset);
        Case::of(&[Load::budget(60, 30), second, Load::fifo(10)]).run();
    }
    Case::of(&[
        Load::budget(60, 20),
        Load::budget(59, 25).after(3),
        Load::budget(58, 15).after(10),
        Load::fifo(10),
    ])
    .run();
    Case::of(&[
        Load::budget(60, 30).endless(),
        Load::budget(59, 30),
        Load::fifo(10),
    ])
    .run();
    for budget in [10, 30, 50, 70, 90] {
        executor::run(budget);
    }
    // Last: the system asserts when a thread with this policy ends, so they are left running.
    if facts.native_repl > 0 {
        Case::of(&[
            Load::native(60, 30),
            Load::native(59, 30).after(1),
            Load::fifo(10),
        ])
        .run();
    }
    HEAP.seal();
    let refused = alloc::vec::Vec::<u8>::new().try_reserve(64).is_err() && HEAP.refused() == 1;
    say!(
        "  {}: a sealed heap refuses",
        if refused { "ok" } else { "FAILED" }
    );
    end(c_int::from(failed > 0 || !refused))
}

fn end(code: c_int) -> c_int {
    #[cfg(feature = "qemu-stm32f405")]
    board::exit(code == 0);
    #[cfg(not(feature = "qemu-stm32f405"))]
    code
}
