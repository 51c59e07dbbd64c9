//! The line and the host that QEMU's USART lacks.
//!
//! The line takes time and disturbs bytes on demand. The host is neither faster nor slower than the
//! board.
//!
//! ```text
//!   host ─► USART ─► INCOMING ──┐ one byte per byte time (TIM3) ┌──► RX ring
//!   host ◄─ USART ◄─────────────┘                               └─── TX ring
//! ```
//!
//! **Lockstep.** Under `-icount` virtual time runs ahead of the host's, or behind. After
//! [`expect`], as soon as what was written before has left, the board's clock stands still until
//! the host's answer has arrived: so many samples. They then take their time on the line like any
//! byte. The board never sees how fast the host is, and a run can be repeated.
//!
//! Between two looks at the chip that find nothing the board counts for a while. Each look takes
//! the emulator's global lock and wakes its main loop, which needs that lock to bring the next
//! byte: a board that looks without a break keeps its own bytes out, and on a loaded host none come
//! for seconds.
//!
//! A build for a real board has none of this but [`PACED`], which is false there.

use crate::frames::Frames;
use crate::regs::{IRQ_TIM3, LINE, RCC_APB1ENR, enable_interrupt};
use crate::ring::Ring;
use crate::{time, usart2};
use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use replenish_os::clock;

/// Whether the bytes are paced here.
pub const PACED: bool = !cfg!(feature = "hardware");

/// The longest wait for the host, in ns of the emulator's time: some ten seconds of the host's, or
/// more.
const PATIENCE: u64 = 30_000_000_000;

/// Rounds of an empty loop between two looks at the chip: some ten microseconds of the host's time.
const REST: u32 = 1_000;

static INCOMING: Ring<2048> = Ring::new();
/// ns for ten bits.
static BYTE: AtomicU32 = AtomicU32::new(0);
static RUNS: AtomicBool = AtomicBool::new(false);
/// Flips one bit in every Nth byte; 0: in none.
static NOISE: AtomicU32 = AtomicU32::new(0);
static PASSED: AtomicU32 = AtomicU32::new(0);
static DAMAGED: AtomicU32 = AtomicU32::new(0);
/// Samples that the host owes; 0: nothing is expected.
static EXPECTED: AtomicU32 = AtomicU32::new(0);
/// Output that must have left before the clock stands still: bytes of the TX ring, modulo 2^32.
static AFTER: AtomicU32 = AtomicU32::new(0);
static SAMPLES: AtomicU32 = AtomicU32::new(0);
static UNANSWERED: AtomicU32 = AtomicU32::new(0);

/// State that the interrupts share; all of them have the same priority.
struct Shared(UnsafeCell<State>);

struct State {
    frames: Frames,
    due: u64,
    /// Bytes were delivered since the bell last rang.
    fresh: bool,
}

// SAFETY: only interrupts of one priority reach it, which do not interrupt each other.
unsafe impl Sync for Shared {}

static STATE: Shared = Shared(UnsafeCell::new(State {
    frames: Frames::new(),
    due: 0,
    fresh: false,
}));

/// Counts of the damage to the traffic, and of the host's missing answers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Bytes that lost a bit on purpose.
    pub damaged: u32,
    /// Times the host did not answer what was expected.
    pub unanswered: u32,
}

/// The counts so far.
pub fn counts() -> Counts {
    Counts {
        damaged: DAMAGED.load(Ordering::Relaxed),
        unanswered: UNANSWERED.load(Ordering::Relaxed),
    }
}

/// Sets the pace.
pub(crate) fn start(baud: u32) {
    if !PACED {
        return;
    }
    BYTE.store(
        (10_000_000_000 / u64::from(baud.max(1))) as u32,
        Ordering::Relaxed,
    );
    RCC_APB1ENR.set(RCC_APB1ENR.get() | 1 << 1);
    LINE.psc().set(0);
    LINE.dier().set(1);
    enable_interrupt(IRQ_TIM3);
}

/// From now on every `n`th byte, in either direction, loses a bit; 0: none does.
pub fn disturb(n: u32) {
    NOISE.store(n, Ordering::Relaxed);
}

/// When all that was written has left, time stands still until the host has sent `samples`.
pub fn expect(samples: u32) {
    AFTER.store(usart2::TX.total_put(), Ordering::Relaxed);
    SAMPLES.store(0, Ordering::Relaxed);
    EXPECTED.store(samples, Ordering::Release);
    go();
}

/// Lets the line run if it does not.
pub(crate) fn go() {
    if !RUNS.swap(true, Ordering::AcqRel) {
        time::ring_after(LINE, BYTE.load(Ordering::Relaxed).into());
    }
}

/// The chip has received something.
pub(crate) fn arrived() {
    // SAFETY: called by the interrupt only, and nothing below calls back.
    let state = unsafe { &mut *STATE.0.get() };
    take(&mut state.frames);
    go();
}

/// Takes a byte off the chip; whether there was one.
fn take(frames: &mut Frames) -> bool {
    if INCOMING.is_full() {
        usart2::listen(false); // the host waits
        return false;
    }
    let Some(byte) = usart2::fetch() else {
        return false;
    };
    INCOMING.push(byte);
    SAMPLES.fetch_add(frames.push(byte), Ordering::Relaxed);
    true
}

/// TIM3's interrupt: the time of one byte is over.
pub(crate) fn tick() {
    time::rang(LINE);
    // SAFETY: as in `arrived`.
    let state = unsafe { &mut *STATE.0.get() };
    let byte = u64::from(BYTE.load(Ordering::Relaxed));
    let now = clock::monotonic();
    // An interrupt that comes late does not slow the line; after a pause it starts afresh.
    let due = state.due + byte;
    state.due = if due + byte < now { now } else { due };
    match INCOMING.pop() {
        Some(got) => {
            usart2::deliver(passed(got));
            state.fresh = true;
            usart2::listen(true);
            if usart2::RX.len() >= 512 {
                usart2::ring();
            }
        }
        // A byte time without a byte: the line is silent.
        None if core::mem::take(&mut state.fresh) => usart2::ring(),
        None => {}
    }
    if let Some(next) = usart2::TX.pop() {
        usart2::transmit(passed(next));
        usart2::tell_room();
    }
    if EXPECTED.load(Ordering::Acquire) > 0 && left() {
        time::stand_still(|elapsed| await_host(&mut state.frames, elapsed));
    }
    let more = state.fresh || !INCOMING.is_empty() || !usart2::TX.is_empty();
    RUNS.store(more, Ordering::Release);
    if more {
        time::ring_after(LINE, (state.due + byte).saturating_sub(now));
    }
}

/// Whether all has left that the host has to see.
fn left() -> bool {
    let ahead = AFTER
        .load(Ordering::Relaxed)
        .wrapping_sub(usart2::TX.total_taken());
    ahead == 0 || ahead > u32::MAX / 2
}

/// Polls the chip until the samples are there.
fn await_host(frames: &mut Frames, elapsed: &dyn Fn() -> u64) {
    let owed = EXPECTED.swap(0, Ordering::AcqRel);
    usart2::listen(false);
    while SAMPLES.load(Ordering::Relaxed) < owed {
        if take(frames) {
            continue;
        }
        if elapsed() > PATIENCE {
            UNANSWERED.fetch_add(1, Ordering::Relaxed);
            break;
        }
        for _ in 0..REST {
            core::hint::black_box(()); // not `spin_loop`, which QEMU is slow at
        }
    }
    usart2::listen(true);
}

/// The byte as it leaves the line: with the noise, one of its bits may be flipped.
fn passed(byte: u8) -> u8 {
    let n = PASSED.load(Ordering::Relaxed).wrapping_add(1);
    PASSED.store(n, Ordering::Relaxed);
    match NOISE.load(Ordering::Relaxed) {
        every if every > 0 && n.is_multiple_of(every) => {
            DAMAGED.fetch_add(1, Ordering::Relaxed);
            byte ^ 1 << (n / every % 8)
        }
        _ => byte,
    }
}
