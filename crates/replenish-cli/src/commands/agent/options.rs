//! The agent's options, and the configuration they make.
//!
//! Groups: where to listen, what clients may make it hold, what goes first. Ranges are those of
//! [`Limits`]; a value outside is refused with the option's name and the range.

use crate::options::{AGENT_PORT, address};
use crate::outcome::Failure;
use clap::builder::RangedU64ValueParser;
use replenish_agent::{AgentConfig, ConfigError, Limits, Profiles, SerialConfig, TopicRule};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;

/// Addresses and serial lines that the agent listens at.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Where to listen")]
pub(crate) struct Transports {
    /// A UDP address, IPv4 or IPv6 as `[::1]:8888`; may be given several times; without a port
    /// 8888, port 0 for any free one. Without any address or line: 127.0.0.1:8888. For clients on
    /// other hosts 0.0.0.0:8888; but XRCE knows no authentication: any host that reaches the
    /// address can read and write every topic (see --access and --dtls).
    #[arg(long, visible_alias = "listen", value_name = "ADDRESS", value_parser = address)]
    udp: Vec<SocketAddr>,

    /// A TCP address; without a port 8888.
    #[arg(long, value_name = "ADDRESS", value_parser = address)]
    tcp: Option<SocketAddr>,

    /// A serial line, as /dev/ttyUSB0, with the stock framing; may be given several times.
    #[arg(long, value_name = "DEVICE")]
    serial: Vec<PathBuf>,

    /// The baud rate of the serial lines; once for all of them or once for each, in their order.
    #[arg(long, value_name = "N", requires = "serial", default_value = "115200")]
    baud: Vec<u32>,
}

/// Limits on memory that clients may make the agent hold.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "What clients may make it hold")]
pub(crate) struct Bounds {
    /// Clients at the same time.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.clients as u64,
          value_parser = clap::value_parser!(u64).range(1..=4096))]
    clients: u64,

    /// Entities of one client.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.entities as u64,
          value_parser = clap::value_parser!(u64).range(1..=4096))]
    entities: u64,

    /// Streams of one client in each direction.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.streams as u64,
          value_parser = clap::value_parser!(u64).range(1..=16))]
    streams: u64,

    /// Bytes that all clients together make the agent keep; each has an equal part of its own.
    /// Without it --clients times --client-memory.
    #[arg(long, value_name = "BYTES", conflicts_with = "client_memory",
          value_parser = clap::value_parser!(u64).range(4096..=1 << 40))]
    memory: Option<u64>,

    /// Bytes that one client makes the agent keep: buffers of its streams, its entities, and
    /// samples that wait.
    #[arg(long, value_name = "BYTES", default_value_t = Limits::DEFAULT.client_bytes as u64,
          value_parser = clap::value_parser!(u64).range(4096..=1 << 40))]
    client_memory: u64,

    /// Bytes of one message to a client.
    #[arg(long, value_name = "BYTES", default_value_t = Limits::DEFAULT.message as u64,
          value_parser = clap::value_parser!(u64).range(64..=65_535))]
    message: u64,

    /// Bytes of one sample. Each reliable stream of a client takes as much of its part of the
    /// memory, which is to be four times as much above 65531.
    #[arg(long, value_name = "BYTES", default_value_t = Limits::DEFAULT.sample as u64,
          value_parser = clap::value_parser!(u64).range(1..=16 << 20))]
    sample: u64,

    /// The most samples that a reader's queue keeps, whatever its QoS says.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.max_depth as u64,
          value_parser = clap::value_parser!(u64).range(1..=65_535))]
    depth: u64,

    /// Datagrams per second taken from one client; 0 for no limit.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.datagrams_per_second,
          value_parser = rate())]
    rate: u32,

    /// Log-ins and pings per second taken from all who have no session, together; a quarter of it
    /// from one host, a sixteenth from one address; 0 for no limit.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.unauthenticated_per_second,
          value_parser = rate())]
    strangers_rate: u32,

    /// Bytes that leave for a UDP address for each byte from there, until it acknowledges
    /// something: the source of a datagram can be forged. Samples wait for that. 0 for no limit,
    /// for clients without any reliable stream.
    #[arg(long, value_name = "N", default_value_t = Limits::DEFAULT.reflection,
          value_parser = RangedU64ValueParser::<u32>::new().range(0..=1000))]
    reflection: u32,

    /// Seconds for which a reliable keep-all reader that is full holds up reliable keep-all writers
    /// before samples for it are dropped. Without it as long as both live.
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(0..=60))]
    patience: Option<u64>,

    /// Seconds of silence after which a client is forgotten.
    #[arg(long, value_name = "SECONDS", default_value_t = Limits::DEFAULT.silence / SECOND,
          value_parser = clap::value_parser!(u64).range(1..=86_400))]
    silence: u64,
}

/// The precedence of clients and topics.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "What goes first")]
pub(crate) struct Service {
    /// Priorities of topics on the way to clients: PATTERN=PRIORITY or PATTERN=PRIORITY:WEIGHT; may
    /// be given several times, the first that matches counts. A pattern is a ROS name (/scan,
    /// /arm/*) or a DDS one (rt/scan), * for any part; priority 0 to 7, the most urgent, 4 without
    /// a rule; weight, samples in a turn among equals, 1 to 1000.
    #[arg(long, value_name = "RULE", value_parser = parse_rule)]
    priority: Vec<TopicRule>,

    /// Entities that clients describe by a name alone, in the format of eProsima's agent.refs.
    #[arg(long, value_name = "FILE")]
    refs: Option<PathBuf>,
}

const SECOND: u64 = 1_000_000_000;

/// The least that a client of `--memory` must have.
const LEAST_SHARE: u64 = 4096;

fn rate() -> RangedU64ValueParser<u32> {
    RangedU64ValueParser::new().range(0..=10_000_000)
}

impl Transports {
    /// Whether a UDP address was given.
    pub(crate) fn has_udp(&self) -> bool {
        !self.udp.is_empty()
    }

    /// Puts them into `config`.
    fn apply(&self, config: &mut AgentConfig) -> Result<(), Failure> {
        let other = self.tcp.is_some() || !self.serial.is_empty();
        config.without_udp = self.udp.is_empty() && other;
        let first = self.udp.first().copied();
        config.addr = first.unwrap_or_else(|| (Ipv4Addr::LOCALHOST, AGENT_PORT).into());
        config.more_udp = self.udp.iter().skip(1).copied().collect();
        config.tcp = self.tcp;
        let lines = self.serial.len();
        if lines > 0 && self.baud.len() != 1 && self.baud.len() != lines {
            let allowed = format!("1 or {lines}, once for each --serial");
            return Err(Failure::range("number of --baud", self.baud.len(), allowed));
        }
        let rates = self.baud.iter().cycle();
        let lines = self.serial.iter().zip(rates);
        config.serial = lines
            .map(|(path, baud)| SerialConfig {
                path: path.clone(),
                baud: *baud,
            })
            .collect();
        Ok(())
    }
}

impl Bounds {
    fn limits(&self) -> Result<Limits, Failure> {
        let size = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        let max_depth = size(self.depth);
        let share = self.memory.map(|memory| memory / self.clients);
        if share.is_some_and(|share| share < LEAST_SHARE) {
            let least = self.clients.saturating_mul(LEAST_SHARE);
            let allowed = format!("at least {least} for --clients {}", self.clients);
            return Err(Failure::range(
                "--memory",
                self.memory.unwrap_or(0),
                allowed,
            ));
        }
        Ok(Limits {
            clients: size(self.clients),
            entities: size(self.entities),
            streams: size(self.streams),
            message: size(self.message),
            sample: size(self.sample),
            client_bytes: size(share.unwrap_or(self.client_memory)),
            default_depth: Limits::DEFAULT.default_depth.min(max_depth),
            max_depth,
            datagrams_per_second: self.rate,
            unauthenticated_per_second: self.strangers_rate,
            reflection: self.reflection,
            writer_block_limit: self.patience.map(|seconds| seconds.saturating_mul(SECOND)),
            silence: self.silence.saturating_mul(SECOND),
            ..Limits::DEFAULT
        })
    }
}

/// The configuration that the options describe.
pub(crate) fn config(
    transports: &Transports,
    bounds: &Bounds,
    service: &Service,
) -> Result<AgentConfig, Failure> {
    let mut config = AgentConfig {
        limits: bounds.limits()?,
        rules: service.priority.clone(),
        ..AgentConfig::default()
    };
    transports.apply(&mut config)?;
    if let Some(path) = &service.refs {
        let failed = |why: &dyn std::fmt::Display| {
            Failure::refused(format!("cannot read {}: {why}", path.display()))
        };
        let xml = std::fs::read_to_string(path).map_err(|e| failed(&e))?;
        config.profiles = Profiles::parse(&xml).map_err(|e| failed(&e))?;
    }
    config.validate().map_err(|error| refusal(&error))?;
    Ok(config)
}

/// An error of the library in the words of the command line.
fn refusal(error: &ConfigError) -> Failure {
    let option = match error.field {
        "limits.client_bytes" => "--client-memory",
        "serial.baud" => "--baud",
        "serial.length" => "number of --serial",
        "more_udp.length" => "number of --udp after the first",
        "rules.length" => "number of --priority",
        "rules.pattern.length" => "bytes of the pattern of --priority",
        other => other,
    };
    Failure::range(option, &error.value, &error.allowed)
}

/// Reads `PATTERN=PRIORITY[:WEIGHT]`.
fn parse_rule(text: &str) -> Result<TopicRule, String> {
    let (pattern, service) = text
        .rsplit_once('=')
        .ok_or("a rule is PATTERN=PRIORITY or PATTERN=PRIORITY:WEIGHT")?;
    if pattern.is_empty() || pattern.len() > 1024 {
        return Err("the pattern has 1 to 1024 bytes".into());
    }
    let (priority, weight) = service.split_once(':').unwrap_or((service, "1"));
    let number = |name: &str, text: &str, most: u16, least: u16| match text.parse::<u16>() {
        Ok(n) if (least..=most).contains(&n) => Ok(n),
        _ => Err(format!("{name} is {text}, allowed is {least} to {most}")),
    };
    let level = number("priority", priority, 7, 0)?;
    Ok(TopicRule {
        weight: number("weight", weight, 1000, 1)?,
        ..TopicRule::new(pattern, u8::try_from(level).unwrap_or(7))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules() {
        let rule = parse_rule("/arm/*=7:3").unwrap();
        assert_eq!(
            (&*rule.pattern, rule.priority, rule.weight),
            ("/arm/*", 7, 3)
        );
        assert_eq!(parse_rule("a=b=0").unwrap().pattern, "a=b");
        for (text, why) in [
            ("/a", "PATTERN=PRIORITY"),
            ("=1", "pattern"),
            ("/a=8", "priority is 8, allowed is 0 to 7"),
            ("/a=1:0", "weight is 0, allowed is 1 to 1000"),
        ] {
            let error = parse_rule(text).unwrap_err();
            assert!(error.contains(why), "{text}: {error}");
        }
    }

    #[test]
    fn the_ranges_are_those_of_the_library() {
        let limits = Limits {
            silence: 86_400 * SECOND,
            ..Limits::DEFAULT
        };
        assert_eq!(limits.validate(), Ok(()));
        assert_eq!(Limits::DEFAULT.silence % SECOND, 0);
    }
}
