//! What every image has: reset, vectors, clock, console, panics.
//!
//! - [`board`]: the chip: vectors, reset, interrupts.
//! - [`time`]: TIM2 counts, TIM5 rings: the clock of the FreeRTOS back end.
//! - [`console`]: semihosting, which QEMU and debug probes carry to the host.
//! - [`case`]: which workers run, from the command line.
//! - [`work`]: burning CPU time.
#![no_std]

extern crate alloc;

pub mod board;
pub mod case;
pub mod console;
pub mod regs;
pub mod time;
pub mod work;
