//! The agent's settings.
//!
//! ```text
//!   agent ──┬── limits    bounds on the resources that clients can take
//!           ├── rules     priorities of topics
//!           └── profiles  entities that clients describe by reference
//! ```

mod agent;
mod limits;
mod profiles;
mod rules;

#[cfg(feature = "dds")]
pub use agent::DdsBridge;
pub use agent::{AgentConfig, SerialConfig};
pub use limits::Limits;
pub(crate) use profiles::Profile;
pub use profiles::Profiles;
pub use rules::TopicRule;
pub(crate) use rules::{LEVELS, Service, service};
