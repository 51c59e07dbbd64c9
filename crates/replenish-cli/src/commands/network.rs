//! Lacks of this host for ROS 2 without an agent, and for `agent --dds`: receive buffers,
//! interfaces, multicast, and the environment variables that say whom ROS 2 looks for.

use super::finding::Finding;
use crate::machine::facts;
use replenish_os::host_addresses;
use std::env;
use std::io;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::time::Duration;

/// Bytes that a subscription's socket asks for.
const BUFFER: i64 = 1 << 20;

/// The group in which the participants of a domain find each other.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

/// The longest time of a datagram to the own host.
const PATIENCE: Duration = Duration::from_millis(300);

/// All of it.
pub(super) fn findings() -> Vec<Finding> {
    let mut all = vec![buffers(facts::number("/proc/sys/net/core/rmem_max"))];
    all.extend(interfaces());
    let variable = |name| env::var(name).ok();
    all.push(discovery(
        variable("ROS_DOMAIN_ID").as_deref(),
        variable("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref(),
        variable("ROS_LOCALHOST_ONLY").as_deref(),
        variable("ROS_STATIC_PEERS").as_deref(),
    ));
    all
}

fn buffers(most: Option<i64>) -> Finding {
    let topic = "ROS 2 buffers";
    match most {
        Some(most) if most >= BUFFER => Finding::good(topic, format!("{} kB a socket", most >> 10)),
        Some(most) => Finding::limited(
            topic,
            format!(
                "{} kB a socket: a burst of long messages is dropped",
                most >> 10
            ),
            format!("`sysctl -w net.core.rmem_max={BUFFER}`, or more for images"),
        ),
        None => Finding::limited(
            topic,
            "unknown",
            "/proc/sys/net/core/rmem_max cannot be read",
        ),
    }
}

/// A finding for each interface, or one that there is none.
fn interfaces() -> Vec<Finding> {
    let topic = "ROS 2 network";
    let mut up = Vec::new();
    let listed = host_addresses(|ip, _| match ip {
        IpAddr::V4(ip) => up.push(ip),
        IpAddr::V6(_) => {}
    });
    if let Err(why) = listed {
        let advice = "ROS 2 has no interface to choose from";
        return vec![Finding::missing(topic, why.to_string(), advice)];
    }
    if up.is_empty() {
        let advice = "`ip link set lo up` at least: programs on this host talk through it";
        return vec![Finding::missing(topic, "no IPv4 address", advice)];
    }
    up.into_iter().map(|ip| multicast(ip, heard(ip))).collect()
}

fn multicast(ip: Ipv4Addr, heard: io::Result<()>) -> Finding {
    let topic = "ROS 2 network";
    match heard {
        Ok(()) => Finding::good(topic, format!("{ip}: multicast is heard")),
        Err(why) => Finding::limited(
            topic,
            format!("{ip}: multicast is not heard ({why})"),
            "`ip link set DEVICE multicast on`; a firewall must let UDP to 239.255.0.1 and to ports\n\
             7400 to 7649 (domain 0) pass; else name the others in ROS_STATIC_PEERS",
        ),
    }
}

/// Sends one datagram to the group from this interface, and hears it.
fn heard(ip: Ipv4Addr) -> io::Result<()> {
    let receiver = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    receiver.join_multicast_v4(&GROUP, &ip)?;
    receiver.set_read_timeout(Some(PATIENCE))?;
    // A sender that is bound to an address sends to groups from its interface.
    let sender = UdpSocket::bind((ip, 0))?;
    sender.send_to(b"replenish", (GROUP, receiver.local_addr()?.port()))?;
    let from = sender.local_addr()?;
    let mut buf = [0; 16];
    loop {
        let (_, peer) = receiver.recv_from(&mut buf)?;
        if peer == from {
            return Ok(());
        }
    }
}

/// Whom programs with these variables look for.
fn discovery(
    domain: Option<&str>,
    range: Option<&str>,
    localhost: Option<&str>,
    peers: Option<&str>,
) -> Finding {
    let topic = "ROS 2 discovery";
    let domain = domain.filter(|text| !text.is_empty()).unwrap_or("0");
    if !domain.parse::<u16>().is_ok_and(|number| number <= 232) {
        let value = format!("ROS_DOMAIN_ID={domain} is no domain");
        return Finding::missing(topic, value, "allowed is 0 to 232");
    }
    if localhost == Some("1") {
        let value = format!("domain {domain}, this host alone, by ROS_LOCALHOST_ONLY=1");
        let advice = "Jazzy and newer say it with ROS_AUTOMATIC_DISCOVERY_RANGE, which then counts for\n\
                      nothing: `unset ROS_LOCALHOST_ONLY` on all hosts or on none";
        return Finding::limited(topic, value, advice);
    }
    let peers = peers.filter(|peers| !peers.is_empty());
    match (range.unwrap_or("SUBNET"), peers) {
        ("" | "SUBNET" | "SYSTEM_DEFAULT", peers) => {
            let peers = peers.map_or(String::new(), |peers| format!(" and {peers}"));
            Finding::good(topic, format!("domain {domain}, the whole subnet{peers}"))
        }
        ("OFF", _) => Finding::limited(
            topic,
            format!("domain {domain}, nobody: ROS_AUTOMATIC_DISCOVERY_RANGE=OFF"),
            "`unset ROS_AUTOMATIC_DISCOVERY_RANGE`",
        ),
        (_, Some(peers)) => Finding::good(topic, format!("domain {domain}, this host and {peers}")),
        (other, None) => Finding::limited(
            topic,
            format!("domain {domain}, this host alone: ROS_AUTOMATIC_DISCOVERY_RANGE={other}"),
            "`ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET` here and on the other hosts, or their names in\n\
             ROS_STATIC_PEERS; programs of Humble on this host are found with ROS_LOCALHOST_ONLY=1",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn a_small_buffer_is_told_with_the_command_that_enlarges_it() {
        assert_eq!(buffers(Some(4 << 20)).verdict, Verdict::Good);
        let small = buffers(Some(212_992));
        assert_eq!(small.verdict, Verdict::Limited);
        assert!(small.value.starts_with("208 kB"), "{}", small.value);
        assert!(
            small
                .advice
                .is_some_and(|text| text.contains("rmem_max=1048576"))
        );
    }

    #[test]
    fn whom_the_variables_look_for() {
        let verdict = |d, r, l| discovery(d, r, l, None).verdict;
        assert_eq!(verdict(None, None, None), Verdict::Good);
        assert_eq!(
            verdict(Some("232"), Some("SUBNET"), Some("0")),
            Verdict::Good
        );
        assert_eq!(verdict(Some("233"), None, None), Verdict::Missing);
        assert_eq!(verdict(Some("x"), None, None), Verdict::Missing);
        for range in ["LOCALHOST", "OFF", "SOMEWHERE"] {
            assert_eq!(verdict(None, Some(range), None), Verdict::Limited);
        }
        let named = discovery(None, Some("LOCALHOST"), None, Some("robot.local"));
        assert_eq!(named.verdict, Verdict::Good);
        assert!(named.value.contains("robot.local"), "{}", named.value);
        let both = discovery(Some("7"), Some("SUBNET"), Some("1"), Some("robot.local"));
        assert_eq!(both.verdict, Verdict::Limited);
        assert!(both.value.contains("domain 7") && both.value.contains("ROS_LOCALHOST_ONLY"));
    }

    /// An address that no interface here has: a documentation address.
    #[test]
    fn an_interface_without_multicast_is_told() {
        let nowhere = Ipv4Addr::new(192, 0, 2, 77);
        assert!(heard(nowhere).is_err());
        let finding = multicast(nowhere, heard(nowhere));
        assert_eq!(finding.verdict, Verdict::Limited);
        assert!(finding.value.contains("192.0.2.77"));
    }
}
