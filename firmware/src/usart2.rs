//! USART2 of the chip: registers, rings, the bell and counters.
//!
//! [`crate::uart`] is the port over it; under QEMU [`crate::line`] moves its bytes by a timer.

use crate::regs::Reg;
use crate::ring::Ring;
use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use replenish_os::Notify;

const BASE: usize = 0x4000_4400;
pub(crate) const STATUS: Reg = Reg(BASE);
const DATA: Reg = Reg(BASE + 0x04);
pub(crate) const RATE: Reg = Reg(BASE + 0x08);
pub(crate) const CONTROL: Reg = Reg(BASE + 0x0C);

const FRAMING: u32 = 1 << 1;
const NOISE: u32 = 1 << 2;
const OVERRUN: u32 = 1 << 3;
pub(crate) const SILENT: u32 = 1 << 4;
pub(crate) const RECEIVED: u32 = 1 << 5;
pub(crate) const ROOM: u32 = 1 << 7;
/// Enabled, transmits, receives.
pub(crate) const ON: u32 = 1 << 13 | 1 << 3 | 1 << 2;

pub(crate) static RX: Ring<1024> = Ring::new();
pub(crate) static TX: Ring<1024> = Ring::new();

pub(crate) static BELL: AtomicPtr<Notify> = AtomicPtr::new(ptr::null_mut());
/// 1 after a `write` that took less than it was given.
pub(crate) static WANTS_ROOM: AtomicU32 = AtomicU32::new(0);

static OVERRUNS: AtomicU32 = AtomicU32::new(0);
static DISTURBED: AtomicU32 = AtomicU32::new(0);
static MISFRAMED: AtomicU32 = AtomicU32::new(0);
static DROPPED: AtomicU32 = AtomicU32::new(0);
static RECEIVED_BYTES: AtomicU32 = AtomicU32::new(0);
static SENT_BYTES: AtomicU32 = AtomicU32::new(0);

/// The port's counters, modulo 2^32 each.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Bytes received.
    pub received: u32,
    /// Bytes sent.
    pub sent: u32,
    /// Bytes that the chip lost because the one before had not been fetched (ORE).
    pub overruns: u32,
    /// Bytes with a disturbed sample (NE).
    pub disturbed: u32,
    /// Bytes without a stop bit (FE).
    pub misframed: u32,
    /// Bytes for which the RX ring had no room.
    pub dropped: u32,
}

/// Reads the counters.
pub fn counts() -> Counts {
    let get = |n: &AtomicU32| n.load(Ordering::Relaxed);
    Counts {
        received: get(&RECEIVED_BYTES),
        sent: get(&SENT_BYTES),
        overruns: get(&OVERRUNS),
        disturbed: get(&DISTURBED),
        misframed: get(&MISFRAMED),
        dropped: get(&DROPPED),
    }
}

/// Rings the bell if one is attached.
pub(crate) fn ring() {
    let bell = BELL.load(Ordering::Acquire);
    // SAFETY: null, or from `attach`, which gave it away.
    if let Some(bell) = unsafe { bell.as_ref() } {
        bell.set();
    }
}

/// Takes the byte that the chip has received, if there is one.
pub(crate) fn fetch() -> Option<u8> {
    let status = STATUS.get();
    for (bit, count) in [
        (OVERRUN, &OVERRUNS),
        (NOISE, &DISTURBED),
        (FRAMING, &MISFRAMED),
    ] {
        if status & bit != 0 {
            bump(count);
        }
    }
    // Reading the data register also clears the errors and the silence.
    let data = (status & (RECEIVED | OVERRUN | SILENT) != 0).then(|| DATA.get());
    data.filter(|_| status & RECEIVED != 0).map(|b| b as u8)
}

/// Whether the chip rings for received bytes.
pub(crate) fn listen(yes: bool) {
    let bit = if yes { RECEIVED } else { 0 };
    CONTROL.set(CONTROL.get() & !RECEIVED | bit);
}

/// A byte has come off the line.
pub(crate) fn deliver(byte: u8) {
    bump(&RECEIVED_BYTES);
    if !RX.push(byte) {
        bump(&DROPPED);
    }
}

/// Gives a byte to the line; it is free.
pub(crate) fn transmit(byte: u8) {
    bump(&SENT_BYTES);
    DATA.set(byte.into());
}

/// Rings the bell when a writer waits for room in the TX ring and there is some.
pub(crate) fn tell_room() {
    if TX.len() < 512 && WANTS_ROOM.swap(0, Ordering::AcqRel) != 0 {
        ring();
    }
}

fn bump(count: &AtomicU32) {
    count.store(
        count.load(Ordering::Relaxed).wrapping_add(1),
        Ordering::Relaxed,
    );
}
