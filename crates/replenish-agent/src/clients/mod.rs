//! The clients: sessions, streams, and the table of them.
//!
//! ```text
//!   table ──► client ──┬── input_stream   order, fragments, ACKNACKs to the client
//!                      └── output_stream  readers in turns, HEARTBEATs, retransmission
//!   replies                answers outside of streams, to addresses
//! ```

mod client;
mod echo;
mod input_stream;
mod output_stream;
mod replies;
mod table;

pub(crate) use client::{Client, ClientOrigin};
pub(crate) use echo::Echo;
pub(crate) use input_stream::InputStream;
pub(crate) use output_stream::STREAM_BYTES;
pub(crate) use replies::{LONGEST_REPLY, Replies};
pub(crate) use table::Clients;
