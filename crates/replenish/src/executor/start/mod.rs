//! Starts an executor from its description.
//!
//! ```text
//!   planning: overlay ──► admission ──► plan ──► assembly ──► threads ──► running ──► report ──► report_text ──► table
//!             (files)     (does it fit) (policies) (parts)       ▲           ▲          ▲
//!                                        launch ──► starter ─────┘           │          │
//!                                                     └──► refused: fallbacks that are declared
//!   local: the same parts without threads ───────────────────────────────────┴──────────┘
//!   dynamic: both hand out the handle of room `change`
//! ```
//!
//! `planning_disabled` stands in for `planning` in builds without feature `plan`.

#[cfg(feature = "plan")]
mod admission;
pub(crate) mod assembly;
#[cfg(feature = "full")]
mod dynamic;
pub(crate) mod launch;
pub(crate) mod local;
#[cfg(feature = "plan")]
mod overlay;
pub(crate) mod plan;
#[cfg_attr(not(feature = "plan"), path = "planning_disabled.rs")]
mod planning;
mod refused;
pub(crate) mod report;
mod report_text;
pub(crate) mod running;
mod starter;
mod table;
pub(crate) mod threads;
