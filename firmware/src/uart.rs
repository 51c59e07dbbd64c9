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
use crate::usart2::{
    BELL, CONTROL, ON, RATE, RECEIVED, ROOM, RX, SILENT, STATUS, TX, WANTS_ROOM, deliver, fetch,
    ring, tell_room, transmit,
};
use core::sync::atomic::Ordering;
use replenish::middleware::xrce::{Port, Received};
use replenish_os::Arc;
use replenish_os::Notify;

pub use crate::usart2::{Counts, counts};

/// The clock of the USART on a real board: half of the timers' clock.
const CLOCK_HZ: u32 = 42_000_000;

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

impl Port for Usart2 {
    fn read(&self, into: &mut [u8]) -> usize {
        RX.take(into)
    }

    fn lend(&self, take: impl FnOnce(&[u8])) -> Option<Received> {
        Some(match RX.lend(take) {
            None => Received::Nothing,
            Some(true) => Received::Something,
            Some(false) => Received::All, // later bytes ring
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
        // Never freed: the interrupt may ring it at any time.
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
