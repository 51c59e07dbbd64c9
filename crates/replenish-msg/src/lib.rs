//! ROS 2 messages without allocation: the [`Message`] trait, XCDR1, and the common types.
//!
//! A message is a plain struct with bounded fields. It is encoded into a buffer that the caller
//! owns and decoded *in place* into a value that already exists, so that a real-time callback
//! neither allocates nor moves 4 kB around:
//!
//! ```
//! use replenish_msg::{Message, decode, encode, std_msgs::Int32};
//!
//! let mut buf = [0; Int32::MAX_SIZE];
//! let len = encode(&Int32 { data: 7 }, &mut buf)?;
//! assert_eq!(buf[..len], [7, 0, 0, 0]);
//!
//! let mut back = Int32::default();
//! decode(&mut back, &buf[..len])?;
//! assert_eq!(back.data, 7);
//! # Ok::<(), replenish_msg::CdrError>(())
//! ```
//!
//! Modules: [`cdr`] (the encoding), [`std_msgs`], [`builtin_interfaces`]; for actions: [`action`],
//! [`action_msgs`], [`unique_identifier_msgs`].
//! Other interfaces are generated from their `.msg`, `.srv` and `.action` files by
//! `replenish-msg-gen`, and `replenish-interfaces` is the common ones; both build on [`wire`],
//! [`view`] and [`structure`]. XCDR2 and `long double` are missing.
//!
//! Bytes are the bare CDR payload, as DDS-XRCE carries it. DDS itself puts a 4-byte
//! encapsulation header in front of the same bytes.
//!
//! Features: `alloc` for owned values of types with unbounded fields.
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

#[cfg(feature = "alloc")]
extern crate alloc;

pub mod action;
pub mod action_msgs;
pub mod builtin_interfaces;
pub mod cdr;
pub mod field_path;
mod message;
pub mod std_msgs;
pub mod structure;
pub mod unique_identifier_msgs;
pub mod view;
pub mod wire;

pub use action::Action;
pub use cdr::{CdrError, CdrReader, CdrWriter, Endianness};
pub use field_path::{DecodeError, decode_encapsulated, decode_whole, decode_with_path};
pub use heapless;
pub use message::{Message, Service, decode, encode};
pub use structure::Structure;
pub use view::{View, Viewed};

/// The names that generated code uses.
#[doc(hidden)]
#[cfg(feature = "alloc")]
pub mod owned {
    pub use alloc::{string::String, vec::Vec};
}
