//! XRCE sessions on real sockets, for measuring the agent: without an executor around them, so that
//! one thread can be many clients.

pub(crate) mod client;
