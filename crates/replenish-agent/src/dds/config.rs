//! The configuration of a [`Dds`](super::Dds): interfaces, service mapping and limits.

use replenish_os::config::{ConfigError, within};
use replenish_rtps::ros::GidSize;
use std::net::{IpAddr, Ipv4Addr};

/// The highest DDS domain whose ports exist with the default port mapping (DDSI-RTPS 2.5, 9.6.2).
pub const MAX_DOMAIN: u16 = 232;

/// Configuration of a [`Dds`](super::Dds).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DdsConfig {
    /// The network interfaces to use.
    pub interfaces: Interfaces,
    /// The form in which requests and replies say what belongs together.
    pub services: ServiceMapping,
    /// The form of identifiers in `ros_discovery_info`.
    pub gids: GidSize,
    /// Its limits.
    pub limits: DdsLimits,
}

/// The network interfaces that are announced to other participants and used for multicast.
///
/// One alone is the only one that datagrams are taken from: with the default, programs on other
/// hosts cannot reach the bridge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Interfaces {
    /// The interfaces with these IPv4 addresses; 1 to 16.
    Only(Vec<IpAddr>),
    /// All there are.
    All,
}

impl Default for Interfaces {
    /// Loopback: DDS knows no authentication.
    fn default() -> Self {
        Self::Only(vec![Ipv4Addr::LOCALHOST.into()])
    }
}

/// The form in which a reply names its request. ROS 2's middlewares differ in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ServiceMapping {
    /// By the peer: Cyclone's form for peers whose vendor id is Eclipse Cyclone DDS's, otherwise
    /// the enhanced one. A request to servers of both kinds has the enhanced form.
    #[default]
    Auto,
    /// In the sample's meta data, as `related_sample_identity` (DDS-RPC 1.0, 7.8.2, "enhanced"):
    /// `rmw_fastrtps`, `rmw_connextdds`, ros2-client.
    Enhanced,
    /// In the first 16 bytes of the payload: `rmw_cyclonedds`.
    Cyclone,
}

/// Limits of a [`Dds`](super::Dds).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DdsLimits {
    /// Domains, each with a participant of its own (three sockets), 1 to 16.
    pub domains: usize,
    /// Endpoints and nodes, 1 to 4096.
    pub endpoints: usize,
    /// Topic names that an agent's clients may bring to a domain at a time, 1 to 65536.
    pub topics: usize,
    /// Samples of one endpoint that wait in one direction, 1 to 65536; then the oldest goes.
    pub queue: usize,
    /// Bytes of all samples that wait in one direction, 1024 to 2^32.
    pub queued_bytes: usize,
    /// Requests of one requester or replier that wait for their replies, 1 to 65536; then the
    /// oldest is forgotten.
    pub calls: usize,
    /// Bytes of a sample, 1 to 2^26; longer ones are dropped.
    pub sample: usize,
}

impl DdsLimits {
    /// The limits of [`DdsLimits::default`].
    pub const DEFAULT: DdsLimits = DdsLimits {
        domains: 4,
        endpoints: 200,
        topics: 1024,
        queue: 256,
        queued_bytes: 16 << 20,
        calls: 256,
        sample: 64 << 10,
    };
}

impl Default for DdsLimits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl DdsConfig {
    /// Checks all ranges.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if let Interfaces::Only(addresses) = &self.interfaces {
            within("dds.interfaces.length", addresses.len(), 1..=16)?;
        }
        let limits = &self.limits;
        within("dds.limits.domains", limits.domains, 1..=16)?;
        within("dds.limits.endpoints", limits.endpoints, 1..=4096)?;
        within("dds.limits.topics", limits.topics, 1..=65_536)?;
        within("dds.limits.queue", limits.queue, 1..=65_536)?;
        let bytes = 1024..=1_usize << 32;
        within("dds.limits.queued_bytes", limits.queued_bytes, bytes)?;
        within("dds.limits.calls", limits.calls, 1..=65_536)?;
        within("dds.limits.sample", limits.sample, 1..=1 << 26)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_valid_and_every_error_names_field_value_and_range() {
        assert_eq!(DdsConfig::default().validate(), Ok(()));
        let limits = DdsLimits {
            queue: 0,
            ..DdsLimits::DEFAULT
        };
        let nowhere = DdsConfig {
            interfaces: Interfaces::Only(Vec::new()),
            ..DdsConfig::default()
        };
        let queueless = DdsConfig {
            limits,
            ..DdsConfig::default()
        };
        let text = |config: DdsConfig| config.validate().unwrap_err().to_string();
        assert_eq!(
            text(nowhere),
            "dds.interfaces.length is 0, allowed is 1 to 16"
        );
        assert_eq!(
            text(queueless),
            "dds.limits.queue is 0, allowed is 1 to 65536"
        );
    }
}
