//! From a description to what runs: plan, admission, threads, and the executor that runs.

#[cfg(feature = "plan")]
mod admission;
pub(crate) mod assembly;
pub(crate) mod launch;
pub(crate) mod local;
#[cfg(feature = "plan")]
mod overlay;
pub(crate) mod plan;
#[cfg_attr(not(feature = "plan"), path = "planning_disabled.rs")]
mod planning;
pub(crate) mod report;
pub(crate) mod running;
mod table;
mod threads;
