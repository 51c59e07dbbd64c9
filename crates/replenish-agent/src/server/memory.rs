//! The most memory that the process of an agent takes, term by term.

use super::link::LINK_BYTES;
use super::peer::Peer;
use crate::bridge::{MAX_BYTES, MOST_DOMAINS};
use crate::clients::{Client, STREAM_BYTES};
use crate::config::AgentConfig;
use crate::dds::{domain_bytes, endpoint_bytes};
use crate::entities::{ENTITY_OVERHEAD, TOPIC_BYTES};

const KIB: usize = 1024;
const MIB: usize = 1024 * KIB;

/// The program itself: its code, its threads' stacks, the texts that wait for a terminal.
const PROGRAM: usize = 16 * MIB;

/// A datagram of the longest kind, for each socket, and for the messages of one read.
const SOCKET: usize = 64 * KIB;

/// The rates of addresses without a session, replies that wait, and the log.
const OUTSIDE: usize = 2 * MIB;

/// An entity in snapshots, of which the one before is kept for rates, and in the table and the JSON
/// that are made of it.
const REPORT: usize = 16 * KIB;

/// A client in the tables of addresses, keys and timers.
const CLIENT: usize = KIB;

/// A name in the table of those that may cross to DDS, with its type.
const NAME: usize = KIB;

/// The part of all other terms that the allocator may need for itself and for holes.
const ALLOCATOR_PART: usize = 4;

/// The most memory that the process of an agent takes, as terms that add up.
///
/// ```
/// use replenish_agent::{AgentConfig, MemoryBound};
///
/// let bound = MemoryBound::of(&AgentConfig::default());
/// println!("{bound}");
/// assert!(bound.total() > AgentConfig::default().limits.memory());
/// ```
///
/// The bound leaves out the kernel's buffers of sockets, which `net.core` and `net.ipv4` limit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryBound {
    terms: Vec<(&'static str, usize)>,
}

impl MemoryBound {
    /// The bound of an agent with this configuration.
    #[must_use]
    pub fn of(config: &AgentConfig) -> Self {
        let limits = &config.limits;
        let clients = limits.clients;
        let session = size_of::<Client<Peer>>() + CLIENT + limits.streams * STREAM_BYTES;
        let of_one = limits.entities.min(limits.client_bytes / ENTITY_OVERHEAD);
        let entities = clients.saturating_mul(of_one);
        let links = config.serial.len() + config.tcp.map_or(0, |_| clients);
        let sockets = 2 + config.more_udp.len();
        let mut terms = vec![
            ("program", PROGRAM),
            ("clients: --memory", limits.memory()),
            ("sessions", clients.saturating_mul(session)),
            ("topics", entities.saturating_mul(TOPIC_BYTES)),
            ("connections and lines", links.saturating_mul(LINK_BYTES)),
            ("sockets", sockets * SOCKET),
            ("outside of sessions", OUTSIDE),
            ("tables and JSON", entities.saturating_mul(REPORT)),
        ];
        #[cfg(feature = "secure")]
        if config.secure.is_on() {
            let dtls = config
                .secure
                .dtls
                .map_or(0, |_| super::secure::dtls_bytes(clients));
            let tls = config.secure.tls.as_ref();
            let tls = tls.map_or(0, |_| {
                clients.saturating_mul(LINK_BYTES + super::secure::TLS_BYTES)
            });
            terms.push(("DTLS and TLS", dtls.saturating_add(tls)));
        }
        if let Some(bridge) = &config.dds {
            let limits = &bridge.dds.limits;
            let queues = limits.queued_bytes.saturating_mul(2) + MAX_BYTES;
            let names = (MOST_DOMAINS * NAME).saturating_mul(limits.topics);
            terms.push(("bridge: queues and names", queues.saturating_add(names)));
            let endpoint = endpoint_bytes(limits.sample);
            let endpoints = limits.endpoints.saturating_mul(endpoint);
            terms.push(("bridge: endpoints in DDS", endpoints));
            let domains = limits.domains.saturating_mul(domain_bytes(limits));
            terms.push(("bridge: discovery", domains));
        }
        let sum = total(&terms);
        terms.push(("allocator", sum / ALLOCATOR_PART));
        Self { terms }
    }

    /// The terms: what it is for, and bytes.
    #[must_use]
    pub fn terms(&self) -> &[(&'static str, usize)] {
        &self.terms
    }

    /// All of it, in bytes.
    #[must_use]
    pub fn total(&self) -> usize {
        total(&self.terms)
    }
}

fn total(terms: &[(&'static str, usize)]) -> usize {
    let bytes = terms.iter().map(|(_, bytes)| *bytes);
    bytes.fold(0, usize::saturating_add)
}

impl std::fmt::Display for MemoryBound {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mib = |bytes: usize| bytes as f64 / MIB as f64;
        for (name, bytes) in &self.terms {
            writeln!(f, "| {name} | {:.1} |", mib(*bytes))?;
        }
        write!(f, "| **all** | **{:.1}** |", mib(self.total()))
    }
}
