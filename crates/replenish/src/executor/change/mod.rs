//! Handles that come and go while the executor runs.

#[cfg(not(feature = "full"))]
pub(crate) mod fixed;
#[cfg(feature = "full")]
pub(crate) mod handle_group;
#[cfg(feature = "full")]
pub(crate) mod live;
#[cfg(feature = "full")]
mod live_handles;

#[cfg(not(feature = "full"))]
pub(crate) use fixed as live;
