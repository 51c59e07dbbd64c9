//! The executor, its workers and their handles as the program describes them.

pub(crate) mod builder;
pub(crate) mod executor;
pub(crate) mod factory;
mod handle_methods;
#[cfg_attr(not(feature = "plan"), path = "planning_disabled.rs")]
pub(crate) mod planning;
pub(crate) mod topic;
