//! In the place of `descriptors` without feature `std`: the frames of a serial line over a port
//! that the program drives.

mod port;

pub use port::{Port, PortTransport};
