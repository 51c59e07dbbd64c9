//! What every image has: reset, vectors, clock, console, panics.
//!
//! - [`board`]: the chip: vectors, reset, interrupts.
//! - [`time`]: TIM2 counts, TIM5 rings: the clock of the FreeRTOS back end.
//! - [`console`]: semihosting, which QEMU and debug probes carry to the host.
//! - [`case`]: which workers run, from the command line.
//! - [`work`]: burning CPU time.
//! - [`options`], [`answer`]: what the images that talk are told, and what their workers do.
//! - [`uart`]: USART2 as the port of the XRCE adapter; [`line`]: the line that QEMU lacks.
#![no_std]

extern crate alloc;

pub mod answer;
pub mod board;
pub mod case;
pub mod console;
mod frames;
pub mod line;
pub mod options;
pub mod regs;
mod ring;
pub mod shared_port;
pub mod time;
pub mod uart;
pub mod work;
