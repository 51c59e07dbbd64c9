//! Parameters: values of a node that have a name, a type and a description, and can be read and set
//! by the program and by others.
//!
//! ```text
//!   set, or a request ──► stage: name, type, range, size ──► veto callbacks ──► commit, all or none
//!                              │ table lock                    │ no table lock     │ table lock
//!                                                                                  ├─► event
//!   get ──► copy (table lock, as long as the copy takes)                           └─► callbacks after
//! ```
//!
//! - [`value`]: what a parameter can be. [`descriptor`]: what it may be. [`store`]: the table,
//!   pure.
//! - [`error`]: what can go wrong. [`server`]: setting with callbacks and events. [`services`]: the
//!   six services of ROS 2. [`owner`]: the node's own rights.
//!
//! All buffers are allocated when the parameters are made, for a fixed number of parameters with
//! values of a fixed size. One more, or a longer one, is an error that names the limit.

mod descriptor;
mod error;
mod owner;
mod server;
mod services;
mod store;
mod value;

pub use descriptor::Descriptor;
pub use error::{ParameterError, ParameterErrorKind};
pub use server::{ParameterChange, ParameterOptions, Parameters};
pub use value::{FromParameter, ParameterValue};
