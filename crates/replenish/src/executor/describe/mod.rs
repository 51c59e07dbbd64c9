//! The executor, its workers and their handles as the program describes them.

pub(crate) mod builder;
pub(crate) mod executor;
pub(crate) mod factory;
mod handle_methods;
pub(crate) mod topic;
