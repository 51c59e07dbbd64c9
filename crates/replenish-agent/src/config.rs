//! What an agent listens on, what it may hold, and what it knows beforehand.

use crate::error::ConfigError;
use crate::limits::Limits;
use crate::profiles::Profiles;
use crate::rules::TopicRule;
use std::net::{Ipv4Addr, SocketAddr};

/// Time and intervals in nanoseconds.
pub type Nanos = u64;

/// How to run an [`Agent`](crate::Agent).
#[derive(Clone, Debug)]
pub struct AgentConfig {
    /// Where to listen for UDP. Port 0 lets the operating system choose one.
    ///
    /// Loopback unless told otherwise: XRCE knows no authentication, so that whoever reaches
    /// this address can read and write every topic.
    pub addr: SocketAddr,
    /// Bounds on what clients can make the agent hold.
    pub limits: Limits,
    /// Which topics are more urgent than others; at most 256.
    pub rules: Vec<TopicRule>,
    /// What entities are that clients describe by a name alone.
    pub profiles: Profiles,
}

impl AgentConfig {
    /// Whether everything is in its range.
    ///
    /// # Errors
    /// The first thing that is not.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.limits.validate()?;
        crate::limits::within("rules.length", self.rules.len(), 0..=256)?;
        self.rules.iter().try_for_each(TopicRule::validate)
    }
}

impl Default for AgentConfig {
    /// `127.0.0.1:8888`, the port that stock agents use.
    fn default() -> Self {
        Self {
            addr: (Ipv4Addr::LOCALHOST, 8888).into(),
            limits: Limits::default(),
            rules: Vec::new(),
            profiles: Profiles::default(),
        }
    }
}
