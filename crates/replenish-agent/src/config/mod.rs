//! The agent's settings.
//!
//! ```text
//!   agent ──┬── limits    bounds on the resources that clients can take
//!           ├── rules     priorities of topics
//!           ├── access    the clients that may log in; access_file, their list as TOML;
//!           │             access_secrets, their psk and certificates
//!           ├── secure    ports for DTLS and TLS (feature `secure`)
//!           └── profiles  entities that clients describe by reference
//! ```

mod access;
mod access_file;
mod access_secrets;
mod agent;
mod limits;
mod profiles;
mod psk;
mod rules;
#[cfg(feature = "secure")]
mod secure;

pub use access::AccessList;
pub(crate) use access::Grant;
pub use access_file::AccessError;
pub use agent::DdsBridge;
pub use agent::{AgentConfig, SerialConfig};
pub use limits::Limits;
pub(crate) use profiles::Profile;
pub use profiles::Profiles;
pub use rules::TopicRule;
pub(crate) use rules::{LEVELS, Service, service};
#[cfg(feature = "secure")]
pub use secure::{SecureConfig, TlsConfig};
