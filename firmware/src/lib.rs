//! The parts of every image: reset, vectors, clock, console, panics.
//!
//! ```text
//!   images   bin/*  ─►  answer ─ work     options ─► case     console
//!   serial   shared_port ─► uart ─┬─► board ─┐
//!                                 └──────────┴─► line ─► usart2 ─► ring     line ─► frames
//!   alone    talker
//!   chip     board ─► time ─► regs
//! ```
//!
//! - [`board`]: the chip's vectors, reset and interrupts.
//! - [`time`]: TIM2 counts, TIM5 rings: the clock of the FreeRTOS back end.
//! - [`console`]: semihosting, which QEMU and debug probes carry to the host.
//! - [`case`]: which workers run, from the command line; [`options`]: the rest of it.
//! - [`answer`], [`work`]: the callbacks of the images that talk, and burning CPU time.
//! - [`uart`]: USART2 as the port of the XRCE adapter, over `usart2`, the chip's registers.
//! - [`line`]: the pace of a serial line, which QEMU lacks; `frames` counts its samples.
//! - [`talker`]: ROS 2 without an agent: discovery and one writer.
//! - [`shared_port`]: one port for several users. [`regs`], `ring`: registers, a byte ring.
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
pub mod talker;
pub mod time;
pub mod uart;
mod usart2;
pub mod work;
