//! Managed nodes: configured, activated, deactivated, cleaned up and shut down from outside.
//!
//! ```text
//!   services ─ change_state ─┐
//!                            ├─► node: Lifecycle ──► machine: allowed? ──► callback ──► machine: outcome
//!   Lifecycle::change ───────┘      ▲                    │ event                          │ event
//!   publisher: silent unless active ┘
//! ```

mod machine;
mod node;
mod publisher;
pub(crate) mod services;

pub use machine::{Outcome, State, Transition};
pub use node::{Lifecycle, LifecycleError};
pub use publisher::ManagedPublisher;
