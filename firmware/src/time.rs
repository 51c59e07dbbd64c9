//! The board's clock: TIM2 counts, its overflows are counted as it is read; TIM5 rings.
//!
//! A reading at least every 34 s keeps the overflow count right: TIM5 rings at the latest after 4
//! s, also if no task asked.
//!
//! In QEMU a tick is an instruction, so that what happens while the clock [stands
//! still](stand_still) leaves no trace, not even in the instant within a tick.

use crate::regs::{ALARM, CLOCK, IRQ_TIM5, RCC_APB1ENR, Timer, enable_interrupt, forget_interrupt};
use core::cell::UnsafeCell;
use core::ffi::c_void;
use core::ptr;
use core::sync::atomic::{AtomicPtr, Ordering};
use replenish_os::freertos::AtomicU64;

/// Clock of the timers, in Hz.
///
/// QEMU's model of this chip has 1 GHz, which cannot be changed. A real board at 168 MHz has twice
/// its APB1 clock.
const TIMER_HZ: u32 = if cfg!(feature = "hardware") {
    84_000_000
} else {
    1_000_000_000
};
/// Ticks per second.
const RATE: u32 = if cfg!(feature = "hardware") {
    4_000_000
} else {
    125_000_000
};
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

/// The time that the alarm is set to.
static ARMED: AtomicU64 = AtomicU64::new(u64::MAX);

/// The terms that turn TIM2's count into a time.
struct Reckoning {
    /// The time at count 0, in ns, modulo 2^64: grows with each overflow, and shrinks by what the
    /// clock stood still.
    base: u64,
    /// The time that the clock gives while it stands still, in ns; 0: it runs.
    stands: u64,
    /// The count when it was read last.
    last: u32,
}

static RECKONING: Held = Held(UnsafeCell::new(Reckoning {
    base: 0,
    stands: 0,
    last: 0,
}));

/// State that is reached with all interrupts masked only.
///
/// Every switch reads it, and a mask of its own would cost as much as the clock.
struct Held(UnsafeCell<Reckoning>);

// SAFETY: one core, and nothing interrupts who reaches it.
unsafe impl Sync for Held {}

impl Held {
    /// Runs `f` on it; masked, and `f` does not reach it again.
    fn with<R>(&self, f: impl FnOnce(&mut Reckoning) -> R) -> R {
        // SAFETY: masked by contract, and the only reference until `f` ends.
        f(unsafe { &mut *self.0.get() })
    }
}

impl Reckoning {
    /// The time, whether it stands still or not.
    fn now(&mut self) -> u64 {
        let count = CLOCK.cnt().get();
        if count < self.last {
            self.base = self.base.wrapping_add(RESOLUTION << 32);
        }
        self.last = count;
        self.base.wrapping_add(u64::from(count) * RESOLUTION)
    }
}

/// Nanoseconds since [`start`], without those for which the clock stood still.
#[unsafe(no_mangle)]
extern "C" fn rp_board_now() -> u64 {
    let before = mask();
    let now = RECKONING.with(|r| match r.stands {
        0 => Ok(r.now()),
        then => Err(then),
    });
    let now = now.unwrap_or_else(stands);
    unmask(before);
    now
}

/// The clock stands at `then`, unless the task for which it does has gone to wait.
#[cold]
#[inline(never)]
fn stands(then: u64) -> u64 {
    let stopper = STOPPER.load(Ordering::Relaxed);
    if !stopper.is_null() && stopper != current_task() {
        go_on(then);
    }
    then
}

unsafe extern "C" {
    fn rp_current_task() -> *mut c_void;
}

fn current_task() -> *mut c_void {
    // SAFETY: of the kernel's shim; reads which task runs.
    unsafe { rp_current_task() }
}

/// The task that has stopped the clock until it waits; null: there is none.
static STOPPER: AtomicPtr<c_void> = AtomicPtr::new(ptr::null_mut());

/// As [`stand_still`], until the calling task waits for something: the next task that runs finds
/// the clock where it was. For a task that exists in emulation only.
pub fn stand_still_until_waiting(f: impl FnOnce()) {
    let before = mask();
    let now = rp_board_now();
    RECKONING.with(|r| r.stands = now);
    unmask(before);
    f();
    STOPPER.store(current_task(), Ordering::Relaxed);
}

/// The clock stands still while `f` runs, which is given the time that it really took so far. A
/// timer that rings meanwhile finds nothing due, and is set again. For what exists in emulation
/// only.
pub fn stand_still(f: impl FnOnce(&dyn Fn() -> u64)) {
    let before = mask();
    let now = rp_board_now();
    let outer = RECKONING.with(|r| core::mem::replace(&mut r.stands, now)) != 0;
    unmask(before);
    let begin = raw();
    f(&|| raw() - begin);
    if outer {
        return; // whoever stopped it starts it
    }
    let before = mask();
    go_on(now);
    unmask(before);
}

/// The clock, which stood at `then`, runs again; masked.
fn go_on(then: u64) {
    STOPPER.store(ptr::null_mut(), Ordering::Relaxed);
    RECKONING.with(|r| {
        let now = r.now();
        r.base = r.base.wrapping_sub(now.wrapping_sub(then));
        r.stands = 0;
    });
    forget_interrupt(IRQ_TIM5);
    ring_after(ALARM, until(ARMED.load(Ordering::Relaxed)));
}

/// Nanoseconds, also while the clock stands still.
fn raw() -> u64 {
    let before = mask();
    let now = RECKONING.with(Reckoning::now);
    unmask(before);
    now
}

/// Rings at `at` (at once if that has passed) by calling the back end's `on_timer`.
#[unsafe(no_mangle)]
extern "C" fn rp_board_arm(at: u64) {
    ARMED.store(at, Ordering::Relaxed);
    ring_after(ALARM, until(at));
}

fn until(at: u64) -> u64 {
    at.saturating_sub(rp_board_now()).min(LONGEST)
}

/// Lets `timer` interrupt once, in `wait` ns.
pub(crate) fn ring_after(timer: Timer, wait: u64) {
    // As fast as the clock times its prescaler, so that both count alike.
    let ticks = (wait * u64::from(TIMER_HZ / RATE))
        .div_ceil(RESOLUTION)
        .max(SHORTEST);
    timer.cr1().set(URS);
    timer.arr().set(ticks as u32);
    timer.sr().set(0);
    // Counting before it starts afresh, so that the shortest time is not over before.
    timer.cr1().set(URS | CEN);
    // The chip counts from where it was; QEMU's model counts from the writing of the reload
    // register, and twice too long after a fresh start (seen in 10.0.2).
    if cfg!(feature = "hardware") {
        timer.egr().set(1);
    }
}

/// `timer` has rung: it rests until it is set again.
pub(crate) fn rang(timer: Timer) {
    timer.cr1().set(URS);
    timer.sr().set(0);
}

/// TIM5's interrupt.
pub fn alarm() {
    rang(ALARM);
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
