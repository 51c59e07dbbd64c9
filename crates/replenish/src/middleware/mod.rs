//! The seam between the executor and whatever carries the bytes.
//!
//! The executor's dispatcher is the only thread that calls [`Middleware::wait`] and
//! [`Middleware::take`]; any thread may [`publish`](Middleware::publish) or
//! [`wake`](Middleware::wake):
//!
//! ```text
//!   dispatcher                          callbacks, timers, other threads
//!   ┌────────────────────┐              ┌─────────────────────────────┐
//!   │ wait  (no lock)    │◄──── wake ───┤ worker made room; stop()    │
//!   │ take  (short lock) │              │ publish (same short lock)   │
//!   └────────────────────┘              └─────────────────────────────┘
//! ```
//!
//! Two rules carry the executor's guarantees. **No lock is held across a wait**, so that a
//! publisher waits for bytes being handled, never for a timeout. **Readiness is level-triggered on
//! the interest set**: `wait` returns at once while a reader *in* the set has data, and data of a
//! reader *outside* the set never ends a wait, so that nothing is missed and nothing is spun on.
//!
//! ```text
//!   in_process · xrce · rtps ─► contract: Middleware ─► incompatible_qos · interest · watch ─► ids
//!                                                   └─► source: a reader's samples for its worker
//!   encoding · remedy · error: payloads, and what can go wrong with them      places: endpoints
//! ```

mod contract;
#[cfg_attr(not(feature = "texts"), path = "encoding_disabled.rs")]
pub(crate) mod encoding;
mod error;
mod ids;
mod in_process;
mod incompatible_qos;
mod interest;
mod places;
pub(crate) mod remedy;
#[cfg(feature = "std")]
pub mod rtps;
mod shared;
mod source;
mod watch;
#[cfg(feature = "xrce")]
pub mod xrce;

pub use crate::handoff::{RequestIdentity, SampleInfo, Shared};
pub use crate::platform::{LocalReader, SourceSet};
pub use contract::{EndpointSpec, GraphEnd, LinkState, Middleware, Room, ServiceSpec};
pub use error::{MiddlewareError, PublishError};
pub use ids::{ReaderId, WriterId};
pub use in_process::{InProcess, InProcessBus};
pub use incompatible_qos::IncompatibleQos;
pub use interest::{Interest, MAX_READERS};
pub use source::Source;
pub use watch::{End, EndStatus, Watch};
