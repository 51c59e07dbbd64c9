//! Managed nodes: configured, activated, deactivated, cleaned up and shut down from outside.
//!
//! ```text
//!   services ─ change_state ─┐
//!                            ├─► node: Lifecycle ──► machine: allowed? ──► callback ──► machine: outcome
//!   Lifecycle::change ───────┘      ▲                    │ event                          │ event
//!   publisher: silent unless active ┘
//! ```

pub(crate) mod error;
mod machine;
mod node;
mod publisher;
mod services;

pub use error::LifecycleError;
pub use machine::{Outcome, State, Transition};
pub use node::Lifecycle;
pub use publisher::ManagedPublisher;
