//! USART2 as a `Port` of the XRCE adapter: two rings and an interrupt.
//!
//! ```text
//!   write ─► TX ring ─► data register ─► line          bell: the line fell silent after bytes,
//!   read  ◄─ RX ring ◄─ data register ◄─ line          RX is half full, or TX has room again
//! ```
//!
//! On the chip the interrupt comes for each byte, and once when the line falls silent. QEMU's model
//! takes and gives bytes at once, whatever the baud rate, and knows no silent line: there
//! [`crate::line`] paces both directions by a timer. Errors of the receiver are counted.

use crate::line;
use crate::regs::{IRQ_USART2, RCC_AHB1ENR, RCC_APB1ENR, Reg, enable_interrupt};
use crate::ring::Ring;
use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use replenish::middleware::xrce::{Port, Received};
use replenish_os::Arc;
use replenish_os::Notify;

const BASE: usize = 0x4000_4400;
const STATUS: Reg = Reg(BASE);
const DATA: Reg = Reg(BASE + 0x04);
const RATE: Reg = Reg(BASE + 0x08);
const CONTROL: Reg = Reg(BASE + 0x0C);

const FRAMING: u32 = 1 << 1;
const NOISE: u32 = 1 << 2;
const OVERRUN: u32 = 1 << 3;
const SILENT: u32 = 1 << 4;
const RECEIVED: u32 = 1 << 5;
const ROOM: u32 = 1 << 7;
/// Enabled, transmits, receives.
const ON: u32 = 1 << 13 | 1 << 3 | 1 << 2;

/// What clocks the USART on a real board: half of the timers' clock.
const CLOCK_HZ: u32 = 42_000_000;

pub(crate) static RX: Ring<1024> = Ring::new();
pub(crate) static TX: Ring<1024> = Ring::new();

static BELL: AtomicPtr<Notify> = AtomicPtr::new(ptr::null_mut());
/// 1 after a `write` that took less than it was given.
static WANTS_ROOM: AtomicU32 = AtomicU32::new(0);

static OVERRUNS: AtomicU32 = AtomicU32::new(0);
static DISTURBED: AtomicU32 = AtomicU32::new(0);
static MISFRAMED: AtomicU32 = AtomicU32::new(0);
static DROPPED: AtomicU32 = AtomicU32::new(0);
static RECEIVED_BYTES: AtomicU32 = AtomicU32::new(0);
static SENT_BYTES: AtomicU32 = AtomicU32::new(0);

/// What the port has seen, modulo 2^32 each.
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

/// The port. There is one.
#[derive(Debug)]
pub struct Usart2 {
    baud: u32,
}

impl Usart2 {
    /// Starts the port with `baud` bits per second, 8N1.
    pub fn start(baud: u32) -> Self {
        RCC_AHB1ENR.set(RCC_AHB1ENR.get() | 1); // port A: PA2, PA3 are USART2's (AF7)
        Reg(0x4002_0000).set(Reg(0x4002_0000).get() & !0xF0 | 0xA0);
        Reg(0x4002_0020).set(Reg(0x4002_0020).get() & !0xFF00 | 0x7700);
        RCC_APB1ENR.set(RCC_APB1ENR.get() | 1 << 17);
        RATE.set(CLOCK_HZ / baud.max(1));
        line::start(baud);
        crate::board::on_usart2(interrupt);
        CONTROL.set(ON | RECEIVED | if line::PACED { 0 } else { SILENT });
        enable_interrupt(IRQ_USART2);
        Self { baud }
    }
}

/// What was counted so far.
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

impl Port for Usart2 {
    fn read(&self, into: &mut [u8]) -> usize {
        RX.take(into)
    }

    fn lend(&self, take: impl FnOnce(&[u8])) -> Option<Received> {
        Some(match RX.lend(take) {
            None => Received::Nothing,
            Some(true) => Received::Something,
            Some(false) => Received::All, // what comes from now on rings
        })
    }

    fn write(&self, bytes: &[u8]) -> usize {
        let len = bytes.iter().take_while(|b| TX.push(**b)).count();
        if len < bytes.len() {
            WANTS_ROOM.store(1, Ordering::Release);
        }
        if line::PACED {
            line::go();
        } else {
            CONTROL.set(CONTROL.get() | ROOM);
        }
        len
    }

    fn attach(&self, bell: &Arc<Notify>) {
        // For ever: the interrupt may ring it at any time.
        let bell = core::mem::ManuallyDrop::new(Arc::clone(bell));
        BELL.store(
            core::ptr::from_ref::<Notify>(&bell).cast_mut(),
            Ordering::Release,
        );
    }

    fn baud(&self) -> u32 {
        self.baud
    }
}

/// Rings the bell, if somebody has attached one.
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
    // Reading it also forgets the errors and the silence.
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

/// Tells who waits for it that the TX ring has room.
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

fn interrupt() {
    if line::PACED {
        return line::arrived();
    }
    let silent = STATUS.get() & SILENT != 0;
    if let Some(byte) = fetch() {
        deliver(byte);
    }
    if silent || RX.len() >= 512 {
        ring();
    }
    if CONTROL.get() & ROOM != 0 && STATUS.get() & ROOM != 0 {
        match TX.pop() {
            Some(byte) => transmit(byte),
            None => CONTROL.set(CONTROL.get() & !ROOM),
        }
        tell_room();
    }
}
