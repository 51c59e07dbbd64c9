//! Handles and their callbacks.

pub(crate) mod callback;
pub(crate) mod client;
pub(crate) mod deadline;
pub(crate) mod entry;
pub(crate) mod env;
pub(crate) mod group;
pub(crate) mod guard;
pub(crate) mod handle;
pub(crate) mod options;
pub(crate) mod outbox;
pub(crate) mod service;
pub(crate) mod state;
pub(crate) mod subscription;
pub(crate) mod timer;
