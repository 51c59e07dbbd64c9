//! The variables by which ROS 2 chooses whom a program talks with.
//!
//! `REPLENISH_SHARED_MEMORY` is ours. The others are read as `rcl` of Kilted reads them: an unknown
//! range is that of the local host, with a warning; `ROS_LOCALHOST_ONLY=1` overrides range and
//! static peers, and keeps to loopback, as in Humble.

use super::config::{DiscoveryRange, RtpsConfig, RtpsError};
use alloc::borrow::ToOwned;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use std::net::Ipv4Addr;

const DOMAIN: &str = "ROS_DOMAIN_ID";
const LOCALHOST_ONLY: &str = "ROS_LOCALHOST_ONLY";
const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
const PEERS: &str = "ROS_STATIC_PEERS";
const SHARED: &str = "REPLENISH_SHARED_MEMORY";
/// Bytes of a static peer's name that ROS takes.
const LONGEST_PEER: usize = 255;

/// Settings, and what the user is to be warned of.
pub(super) struct Environment {
    pub(super) config: RtpsConfig,
    pub(super) warnings: Vec<String>,
}

impl Environment {
    /// Reads the variables through `get`, which is `None` for one that is not set.
    pub(super) fn parse(get: impl Fn(&str) -> Option<String>) -> Result<Self, RtpsError> {
        let get = |name| get(name).unwrap_or_default();
        let mut warnings = Vec::new();
        let mut config = RtpsConfig {
            domain: domain(&get(DOMAIN))?,
            range: range(&get(RANGE), &mut warnings),
            static_peers: peers(&get(PEERS), &mut warnings),
            shared_memory: shared(&get(SHARED), &mut warnings),
            ..RtpsConfig::default()
        };
        if get(LOCALHOST_ONLY) == "1" {
            config.range = DiscoveryRange::Localhost;
            config.static_peers.clear();
            config.interfaces = [Ipv4Addr::LOCALHOST].into();
        }
        Ok(Self { config, warnings })
    }
}

fn domain(text: &str) -> Result<u16, RtpsError> {
    let trimmed = text.trim();
    let number = if trimmed.is_empty() {
        Some(0)
    } else {
        trimmed.parse().ok()
    };
    let domain = number.filter(|domain| *domain <= 232);
    domain.ok_or_else(|| RtpsError::Setting {
        field: DOMAIN,
        value: text.to_owned(),
        allowed: "a whole number, 0 to 232",
    })
}

fn range(text: &str, warnings: &mut Vec<String>) -> DiscoveryRange {
    match text {
        "" | "SUBNET" | "SYSTEM_DEFAULT" => DiscoveryRange::Subnet,
        "LOCALHOST" => DiscoveryRange::Localhost,
        "OFF" => DiscoveryRange::Off,
        other => {
            warnings.push(format!(
                "{RANGE} = {other:?} is not allowed: SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT; \
                 LOCALHOST is used"
            ));
            DiscoveryRange::Localhost
        }
    }
}

fn shared(text: &str, warnings: &mut Vec<String>) -> bool {
    if !matches!(text, "" | "0" | "1") {
        warnings.push(format!(
            "{SHARED} = {text:?} is not allowed: 0 or 1; 1 is used"
        ));
    }
    text != "0"
}

fn peers(text: &str, warnings: &mut Vec<String>) -> Vec<String> {
    let mut peers = Vec::new();
    for peer in text.split(';').filter(|peer| !peer.is_empty()) {
        if peer.len() > LONGEST_PEER {
            warnings.push(format!(
                "{PEERS}: a peer's name of {} bytes is left out, {LONGEST_PEER} are allowed",
                peer.len()
            ));
        } else {
            peers.push(peer.to_owned());
        }
    }
    peers
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(variables: &[(&str, &str)]) -> Result<Environment, String> {
        let get = |name: &str| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        Environment::parse(get).map_err(|e| format!("{e}"))
    }

    #[test]
    fn nothing_set_is_domain_0_on_the_subnet() {
        let read = read(&[]).unwrap();
        assert_eq!(read.config.domain, 0);
        assert_eq!(read.config.range, DiscoveryRange::Subnet);
        assert!(read.config.static_peers.is_empty() && read.warnings.is_empty());
    }

    #[test]
    fn every_range_is_read_and_an_unknown_one_is_the_local_host() {
        for (text, range, warnings) in [
            ("", DiscoveryRange::Subnet, 0),
            ("SUBNET", DiscoveryRange::Subnet, 0),
            ("SYSTEM_DEFAULT", DiscoveryRange::Subnet, 0),
            ("LOCALHOST", DiscoveryRange::Localhost, 0),
            ("OFF", DiscoveryRange::Off, 0),
            ("subnet", DiscoveryRange::Localhost, 1),
        ] {
            let read = read(&[(RANGE, text)]).unwrap();
            assert_eq!((read.config.range, read.warnings.len()), (range, warnings));
        }
    }

    #[test]
    fn shared_memory_is_used_unless_it_is_switched_off() {
        for (text, used, warnings) in [
            ("", true, 0),
            ("1", true, 0),
            ("0", false, 0),
            ("no", true, 1),
        ] {
            let read = read(&[(SHARED, text)]).unwrap();
            assert_eq!(
                (read.config.shared_memory, read.warnings.len()),
                (used, warnings)
            );
        }
    }

    #[test]
    fn static_peers_are_separated_by_semicolons() {
        let long = "x".repeat(256);
        let list = format!("192.168.0.7;;robot.local;{long};");
        let read = read(&[(PEERS, &list)]).unwrap();
        assert_eq!(read.config.static_peers, ["192.168.0.7", "robot.local"]);
        assert_eq!(read.warnings.len(), 1);
    }

    #[test]
    fn localhost_only_overrides_range_and_peers() {
        let others = [(RANGE, "SUBNET"), (PEERS, "192.168.0.7")];
        for (text, range, peers, loopback) in [
            ("1", DiscoveryRange::Localhost, 0, true),
            ("0", DiscoveryRange::Subnet, 1, false),
            ("", DiscoveryRange::Subnet, 1, false),
        ] {
            let read = read(&[others[0], others[1], (LOCALHOST_ONLY, text)]).unwrap();
            let found = (read.config.range, read.config.static_peers.len());
            assert_eq!(found, (range, peers), "{text:?}");
            assert_eq!(read.config.is_loopback(), loopback, "{text:?}");
        }
    }

    #[test]
    fn a_domain_out_of_range_names_the_variable_and_the_range() {
        assert_eq!(read(&[(DOMAIN, "232")]).unwrap().config.domain, 232);
        for text in ["233", "-1", "seven", "1.5"] {
            let error = read(&[(DOMAIN, text)]).err().unwrap();
            let expected =
                format!("ROS_DOMAIN_ID = {text:?} is not allowed: a whole number, 0 to 232");
            assert_eq!(error, expected);
        }
    }
}
