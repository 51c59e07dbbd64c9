//! The agent's settings.

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
