//! A ROS 2 and micro-ROS executor that gives every callback a CPU budget.
//!
//! - [`middleware`]: the seam between the executor and whatever carries the bytes.
//! - [`qos`]: reliability and history of an endpoint.
//!
//! Modules name `core` and `alloc` wherever they can: the crate is meant to lose `std`.
#![forbid(unsafe_code)]

extern crate alloc;

pub mod middleware;
pub mod qos;

/// Nanoseconds; of `CLOCK_MONOTONIC` where it is an instant.
pub type Nanos = u64;
