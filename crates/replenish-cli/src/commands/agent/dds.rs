//! The options of the bridge to DDS.

use clap::ValueEnum;
use replenish_agent::dds::{DdsConfig, DdsLimits, GidSize, Interfaces, MAX_DOMAIN, ServiceMapping};
use replenish_agent::{AgentConfig, DdsBridge};
use std::net::IpAddr;

/// Form in which the clients appear in DDS.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "ROS 2")]
pub(crate) struct Bridge {
    /// Make the clients' topics, services and nodes those of DDS, too, so that ROS 2 sees them.
    #[arg(long)]
    dds: bool,

    /// The DDS domain of clients that say 0, which microcontrollers usually do; others have the
    /// domain they say.
    // Without `requires`: the environment variable may be there without --dds.
    #[arg(long, value_name = "N", env = "ROS_DOMAIN_ID", default_value_t = 0,
          value_parser = clap::value_parser!(u16).range(0..=i64::from(MAX_DOMAIN)))]
    domain: u16,

    /// The address of a network interface to use, or "all"; may be given several times. Without it
    /// only programs on this machine are found. DDS knows no authentication.
    #[arg(long, value_name = "ADDRESS", requires = "dds", value_parser = parse_interface)]
    interface: Vec<Interface>,

    /// The form in which a reply names its request.
    #[arg(long, value_name = "FORM", requires = "dds", default_value = "auto")]
    services: Form,

    /// List nodes in the form of ROS 2 Humble and older.
    #[arg(long, requires = "dds")]
    humble: bool,

    /// Nodes, writers, readers, requesters and repliers in DDS; the rest waits.
    #[arg(long, value_name = "N", requires = "dds",
          default_value_t = DdsLimits::DEFAULT.endpoints as u64,
          value_parser = clap::value_parser!(u64).range(1..=4096))]
    dds_endpoints: u64,
}

/// Form of service requests and replies on DDS, by the RMW that has it.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Form {
    /// As the other side does it.
    Auto,
    /// As `rmw_fastrtps` and `rmw_connextdds` do it.
    Enhanced,
    /// As `rmw_cyclonedds` does it.
    Cyclone,
}

/// An interface, or all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Interface {
    At(IpAddr),
    All,
}

fn parse_interface(text: &str) -> Result<Interface, String> {
    if text == "all" {
        return Ok(Interface::All);
    }
    match text.parse() {
        Ok(IpAddr::V6(_)) => Err(
            "the bridge speaks IPv4: allowed is an IPv4 address of this \
                                  machine, or all"
                .into(),
        ),
        Ok(address) => Ok(Interface::At(address)),
        Err(_) => Err("allowed is the IPv4 address of an interface of this machine, or all".into()),
    }
}

impl Bridge {
    /// Whether there is a bridge.
    pub(crate) fn is_on(&self) -> bool {
        self.dds
    }

    /// The agent's configuration with the bridge, if that was asked for.
    pub(crate) fn add_to(&self, config: AgentConfig) -> AgentConfig {
        let dds = self.config(config.limits.sample);
        AgentConfig { dds, ..config }
    }

    /// The bridge, for samples as long as the agent takes them.
    fn config(&self, sample: usize) -> Option<DdsBridge> {
        if !self.dds {
            return None;
        }
        let given = self.interface.iter().map(|interface| match interface {
            Interface::At(address) => Some(*address),
            Interface::All => None,
        });
        let interfaces = match given.collect::<Option<Vec<IpAddr>>>() {
            None => Interfaces::All,
            Some(none) if none.is_empty() => Interfaces::default(),
            Some(addresses) => Interfaces::Only(addresses),
        };
        let services = match self.services {
            Form::Auto => ServiceMapping::Auto,
            Form::Enhanced => ServiceMapping::Enhanced,
            Form::Cyclone => ServiceMapping::Cyclone,
        };
        let gids = if self.humble {
            GidSize::Bytes24
        } else {
            GidSize::Bytes16
        };
        let limits = DdsLimits {
            endpoints: usize::try_from(self.dds_endpoints).unwrap_or(usize::MAX),
            sample: sample.max(DdsLimits::DEFAULT.sample),
            ..DdsLimits::DEFAULT
        };
        let dds = DdsConfig {
            interfaces,
            services,
            gids,
            limits,
        };
        let domain = self.domain;
        Some(DdsBridge { dds, domain })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfaces_are_addresses_of_ipv4_or_all() {
        assert_eq!(parse_interface("all"), Ok(Interface::All));
        let address = parse_interface("192.168.1.10");
        assert_eq!(address, Ok(Interface::At([192, 168, 1, 10].into())));
        for text in ["::1", "fe80::1", "::ffff:127.0.0.1"] {
            let error = parse_interface(text).unwrap_err();
            assert!(error.contains("IPv4"), "{text}: {error}");
        }
        parse_interface("eth0").unwrap_err();
    }
}
