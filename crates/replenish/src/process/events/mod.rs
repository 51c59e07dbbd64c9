//! QoS events: what a callback hears of the peers of a publisher or subscription.
//!
//! ```text
//!   add: AddHandles::on_event ──► source: publisher or handle's id
//!        │ callback, on a worker ◄── watch: the latest status ◄── middleware
//!        └──► event: the difference from the last reported status
//! ```

mod add;
mod event;
mod source;
mod watch;

pub use event::{Count, QosEvent};
pub use source::EventSource;
