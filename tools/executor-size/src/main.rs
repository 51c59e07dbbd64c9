//! Pong as an image for a microcontroller would have it: the executor with two budgeted workers,
//! two subscriptions and two publishers over an XRCE session on a serial port. It is linked and
//! measured, never run: its port is two registers in memory, and the kernel's functions are left
//! open. On a computer the program does nothing.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod image;

#[cfg(not(target_os = "none"))]
fn main() {}
