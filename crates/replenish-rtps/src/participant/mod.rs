//! [`Participant`]: discovery and matching of everything that one process has in a domain.
//!
//! ```text
//!   other participants, by SPDP                      endpoints, by SEDP
//!
//!   (unknown) ──announced──► known ──┐               known ──same topic, type, fitting──► matched
//!       ▲                      │     │ announced       ▲      quality of service             │
//!       │   lease over, said   │     │ again           └──────────said goodbye──────────────┘
//!       └───── goodbye ────────┘ ◄───┘
//!
//!   participant ──► receive, transmit, own, endpoints, kept, moves, shared ──► state
//!             state ──► announcements, matching, promises, status, remote, event, config
//! ```
//!
//! Everything is bounded by [`Limits`]; an [`Event::Full`] says when a bound was reached.

mod announcements;
mod config;
mod endpoints;
mod event;
mod kept;
mod matching;
mod moves;
mod own;
mod promises;
mod receive;
mod remote;
#[cfg_attr(not(feature = "shared"), path = "shared_disabled.rs")]
mod shared;
mod state;
mod status;
mod transmit;

pub use config::{ConfigError, DEFAULT_LEASE, EndpointSpec, Limits, ParticipantConfig};
pub use event::{Bound, Event, Policy};
pub use matching::incompatible;
pub use remote::{RemoteEndpoint, RemoteParticipant};
pub use state::{Participant, ReaderId, WriterId};
pub use status::EndpointStatus;
pub use transmit::Part;
