//! The board's clock: TIM2 counts at 4 MHz, its overflows are counted as it is read; TIM5 rings.
//!
//! A reading at least every 17 minutes keeps the overflow count right: TIM5 rings at the latest
//! after 4 s, also if nobody asked.

use crate::regs::{ALARM, CLOCK, IRQ_TIM5, RCC_APB1ENR, enable_interrupt};
use core::sync::atomic::{AtomicU32, Ordering};

/// What the timers are clocked with: QEMU's model of this chip says 1 GHz, and cannot be told
/// otherwise; a real board at 168 MHz has twice its APB1 clock.
const TIMER_HZ: u32 = if cfg!(feature = "hardware") {
    84_000_000
} else {
    1_000_000_000
};
/// Ticks per second.
const RATE: u32 = 4_000_000;
/// Nanoseconds per tick.
pub const RESOLUTION: u64 = 1_000_000_000 / RATE as u64;
/// The longest time between two rings, in ns.
const LONGEST: u64 = 4_000_000_000;

/// The shortest alarm in ticks of the timer: 2 us in QEMU, whose model never rings for one that is
/// over before it has been set.
const SHORTEST: u64 = 2_000;

/// Counts.
const CEN: u32 = 1;
/// Only the end of the count is an update, not a fresh start.
const URS: u32 = 1 << 2;

static HIGH: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU32 = AtomicU32::new(0);

/// Starts both timers.
pub fn start() {
    RCC_APB1ENR.set(RCC_APB1ENR.get() | 1 | 1 << 3);
    CLOCK.psc().set(TIMER_HZ / RATE - 1);
    CLOCK.arr().set(u32::MAX);
    CLOCK.egr().set(1);
    CLOCK.cr1().set(1);
    ALARM.psc().set(0);
    ALARM.dier().set(1);
    enable_interrupt(IRQ_TIM5);
}

/// Nanoseconds since [`start`].
#[unsafe(no_mangle)]
extern "C" fn rp_board_now() -> u64 {
    let before = mask();
    let count = CLOCK.cnt().get();
    if count < LAST.load(Ordering::Relaxed) {
        HIGH.store(HIGH.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }
    LAST.store(count, Ordering::Relaxed);
    let high = HIGH.load(Ordering::Relaxed);
    unmask(before);
    (u64::from(high) << 32 | u64::from(count)) * RESOLUTION
}

/// Rings at `at` (at once if that has passed) by calling the back end's `on_timer`.
#[unsafe(no_mangle)]
extern "C" fn rp_board_arm(at: u64) {
    let wait = at.saturating_sub(rp_board_now()).min(LONGEST);
    // 4 MHz times the prescaler of the clock, so that both count alike.
    let ticks = (wait * u64::from(TIMER_HZ / RATE))
        .div_ceil(RESOLUTION)
        .max(SHORTEST);
    ALARM.cr1().set(URS);
    ALARM.arr().set(ticks as u32);
    ALARM.sr().set(0);
    // Counting before it starts afresh, so that the shortest time is not over before.
    ALARM.cr1().set(URS | CEN);
    // The chip counts from where it was; QEMU's model counts from the writing of the reload
    // register, and twice too long after a fresh start (seen in 10.0.2).
    if cfg!(feature = "hardware") {
        ALARM.egr().set(1);
    }
}

/// TIM5's interrupt.
pub fn alarm() {
    ALARM.cr1().set(URS);
    ALARM.sr().set(0);
    replenish_os::freertos::on_timer();
}

fn mask() -> u32 {
    let before: u32;
    // SAFETY: reads PRIMASK and masks all interrupts.
    unsafe { core::arch::asm!("mrs {}, PRIMASK", "cpsid i", out(reg) before, options(nostack)) };
    before
}

fn unmask(before: u32) {
    // SAFETY: `before` came from `mask`.
    unsafe { core::arch::asm!("msr PRIMASK, {}", in(reg) before, options(nostack)) };
}
