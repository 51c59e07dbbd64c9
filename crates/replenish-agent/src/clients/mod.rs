//! The clients: sessions, streams, and the table of them.

mod client;
mod input_stream;
mod output_stream;
mod replies;
mod table;

pub(crate) use client::{Client, ClientOrigin};
pub(crate) use input_stream::InputStream;
pub(crate) use replies::Replies;
pub(crate) use table::Clients;
