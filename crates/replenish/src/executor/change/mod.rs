//! Handles that come and go while the executor runs.

#[cfg(not(feature = "live"))]
pub(crate) mod fixed;
#[cfg(feature = "live")]
pub(crate) mod handle_group;
#[cfg(feature = "live")]
pub(crate) mod live;
#[cfg(feature = "live")]
mod live_handles;

#[cfg(not(feature = "live"))]
pub(crate) use fixed as live;
