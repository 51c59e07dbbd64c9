//! The clients: sessions, streams, and the table of them.
//!
//! ```text
//!   table ──► client ──┬── input_stream   order, fragments, ACKNACKs to the client
//!                      └── output_stream  readers in turns, HEARTBEATs, retransmission
//!   replies                answers outside of streams, to addresses
//! ```

mod client;
mod input_stream;
mod output_stream;
mod replies;
mod table;

pub(crate) use client::{Client, ClientOrigin};
pub(crate) use input_stream::InputStream;
pub(crate) use replies::Replies;
pub(crate) use table::Clients;
