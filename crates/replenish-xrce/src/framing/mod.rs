//! Messages on byte streams: serial lines and TCP, as eProsima's clients and agents frame them.
//!
//! ```text
//!   serial   0x7E, then escaped: source, target, length LE, message, CRC-16 LE of the message
//!   tcp      length LE, message (prefixed)          checksum: that CRC
//! ```
//!
//! Both decoders take bytes in pieces of any size and hand out whole messages; both directions are
//! the same for client and agent.

mod checksum;
mod prefixed;
mod serial;

pub use prefixed::{Prefixed, prefix};
pub use serial::{
    FrameStats, FrameTooShort, SERIAL_AGENT, SERIAL_CLIENT, Serial, serial_frame, serial_frame_len,
};
