//! [`KnownNodes`]: the nodes of other participants, as their `ros_discovery_info` names them.
//!
//! ```text
//!   message of a participant ──► whole and right? ──yes──► its nodes replace those from before
//!                                     │ no
//!                                     └──► an error, and its nodes stay
//! ```
//!
//! The bytes are foreign. Memory is taken at set-up, and a participant fills a part of it at most.

use super::graph::{GidSize, Nodes};
use super::names::DdsName;
use crate::wire::{EntityId, Guid, GuidPrefix, WireError};
use alloc::vec::Vec;

/// Bounds of [`KnownNodes`]; their memory is taken at set-up.
#[derive(Clone, Copy, Debug)]
pub struct NodeLimits {
    /// Nodes of all participants, up to 65 535. About 280 bytes each.
    pub nodes: usize,
    /// Nodes of one participant.
    pub of_one: usize,
    /// Endpoints of all nodes. 20 bytes each.
    pub endpoints: usize,
}

#[derive(Debug)]
struct KnownNode {
    participant: GuidPrefix,
    /// Its place among the nodes of its participant.
    number: u16,
    name: DdsName,
}

/// The nodes of other participants, and which endpoints are theirs.
#[derive(Debug)]
pub struct KnownNodes {
    nodes: Vec<KnownNode>,
    /// Each with the number of its node.
    endpoints: Vec<(Guid, u16)>,
    limits: NodeLimits,
}

impl KnownNodes {
    /// No nodes, and memory for as many as the limits allow.
    #[must_use]
    pub fn new(limits: NodeLimits) -> Self {
        KnownNodes {
            nodes: Vec::with_capacity(limits.nodes),
            endpoints: Vec::with_capacity(limits.endpoints),
            limits,
        }
    }

    /// Takes a message of the participant `from` in, in either form; the number of nodes and
    /// endpoints that were left out, because a limit was reached or the name is none of ROS 2.
    ///
    /// # Errors
    /// Any [`WireError`]: the message is damaged, or names the nodes of another participant. Then
    /// nothing changes.
    pub fn learn(&mut self, from: GuidPrefix, payload: &[u8]) -> Result<usize, WireError> {
        let nodes = whole(from, payload)?;
        self.forget(from);
        let mut left_out = 0_usize;
        for (node, number) in nodes.flatten().zip(0_u16..) {
            let full = self.nodes.len() >= self.limits.nodes;
            let name = full_name(node.namespace, node.name);
            let Some(name) = name.filter(|_| !full && usize::from(number) < self.limits.of_one)
            else {
                left_out = left_out.saturating_add(1);
                continue;
            };
            self.nodes.push(KnownNode {
                participant: from,
                number,
                name,
            });
            for guid in node.readers.chain(node.writers) {
                if self.endpoints.len() >= self.limits.endpoints {
                    left_out = left_out.saturating_add(1);
                } else if guid.prefix == from {
                    self.endpoints.push((guid, number));
                }
            }
        }
        Ok(left_out)
    }

    /// A participant is gone.
    pub fn forget(&mut self, participant: GuidPrefix) {
        self.keep(|prefix| prefix != participant);
    }

    /// Forgets all participants but those that `stays` names.
    pub fn keep(&mut self, stays: impl Fn(GuidPrefix) -> bool) {
        self.nodes.retain(|node| stays(node.participant));
        self.endpoints.retain(|(guid, _)| stays(guid.prefix));
    }

    /// The full names of the nodes, `/ns/name`. Two nodes may have the same one.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.nodes.iter().map(|node| node.name.as_str())
    }

    /// The endpoints that belong to nodes, with the full names of these.
    pub fn endpoints(&self) -> impl Iterator<Item = (Guid, &str)> {
        // Both lists are in the order of participants and their nodes.
        let mut nodes = self.nodes.iter().peekable();
        self.endpoints.iter().filter_map(move |(guid, number)| {
            let other =
                |node: &&KnownNode| node.number != *number || node.participant != guid.prefix;
            while nodes.next_if(other).is_some() {}
            nodes.peek().map(|node| (*guid, node.name.as_str()))
        })
    }
}

/// The nodes of a message that is right from its first to its last byte, in one form or the other.
fn whole(from: GuidPrefix, payload: &[u8]) -> Result<Nodes<'_>, WireError> {
    let of = |size| {
        let (participant, nodes) = Nodes::decode(payload, size)?;
        if participant != Guid::new(from, EntityId::PARTICIPANT) {
            return Err(WireError::OutOfRange("gid"));
        }
        nodes.clone().check()?;
        Ok(nodes)
    };
    of(GidSize::Bytes16).or_else(|error| of(GidSize::Bytes24).map_err(|_| error))
}

/// `None` if it is no name of ROS 2, or over 255 bytes long.
fn full_name(namespace: &str, name: &str) -> Option<DdsName> {
    let word = |text: &str| {
        let legal = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_';
        !text.is_empty() && text.bytes().all(legal)
    };
    let space = namespace.strip_prefix('/')?;
    if !word(name) || !(space.is_empty() || space.split('/').all(word)) {
        return None;
    }
    let slash = if space.is_empty() { "" } else { "/" };
    DdsName::of(format_args!("{namespace}{slash}{name}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::{Node, encode_graph};
    use std::vec::Vec;

    const LIMITS: NodeLimits = NodeLimits {
        nodes: 6,
        of_one: 4,
        endpoints: 8,
    };
    const READERS: [EntityId; 1] = [EntityId::reader(1)];
    const WRITERS: [EntityId; 2] = [EntityId::writer(2), EntityId::writer(3)];

    fn prefix(byte: u8) -> GuidPrefix {
        GuidPrefix([byte; 12])
    }

    fn node<'a>(namespace: &'a str, name: &'a str, writers: &'a [EntityId]) -> Node<'a> {
        Node {
            namespace,
            name,
            readers: &READERS,
            writers,
        }
    }

    fn message(of: GuidPrefix, nodes: &[Node<'_>], size: GidSize) -> Vec<u8> {
        let mut buf = [0; 4096];
        encode_graph(&mut buf, of, nodes, size)
            .unwrap_or(&[])
            .into()
    }

    fn names(known: &KnownNodes) -> Vec<&str> {
        known.names().collect()
    }

    #[test]
    fn nodes_are_known_by_name_until_their_participant_goes() {
        for size in [GidSize::Bytes16, GidSize::Bytes24] {
            let mut known = KnownNodes::new(LIMITS);
            let two = [
                node("/", "a", &WRITERS[..1]),
                node("/x/y", "b", &WRITERS[1..]),
            ];
            assert_eq!(
                known.learn(prefix(1), &message(prefix(1), &two, size)),
                Ok(0)
            );
            let other = message(prefix(2), &two[..1], size);
            assert_eq!(known.learn(prefix(2), &other), Ok(0));
            assert_eq!(names(&known), ["/a", "/x/y/b", "/a"]);
            let of = |of, entity| {
                let guid = Guid::new(prefix(of), entity);
                let mut ends = known.endpoints();
                ends.find(|(end, _)| *end == guid).map(|(_, name)| name)
            };
            assert_eq!(known.endpoints().count(), 6);
            assert_eq!(of(1, WRITERS[0]), Some("/a"));
            assert_eq!(of(1, WRITERS[1]), Some("/x/y/b"));
            assert_eq!(of(2, WRITERS[1]), None);
            // The next message replaces the one before.
            let next = message(prefix(1), &two[1..], size);
            assert_eq!(known.learn(prefix(1), &next), Ok(0));
            assert_eq!(names(&known), ["/a", "/x/y/b"]);
            known.forget(prefix(2));
            assert_eq!(names(&known), ["/x/y/b"]);
            assert!(known.endpoints().all(|(_, name)| name == "/x/y/b"));
        }
    }

    #[test]
    fn limits_hold_and_what_is_left_out_is_counted() {
        let mut known = KnownNodes::new(LIMITS);
        let places = (known.nodes.capacity(), known.endpoints.capacity());
        let many = [node("/", "n", &[]); 9];
        let nine = |of| message(of, &many, GidSize::Bytes16);
        assert_eq!(known.learn(prefix(1), &nine(prefix(1))), Ok(5));
        assert_eq!(known.learn(prefix(2), &nine(prefix(2))), Ok(7));
        assert_eq!(known.names().count(), 6);
        let writers = [EntityId::writer(7); 20];
        let greedy = message(prefix(1), &[node("/", "n", &writers)], GidSize::Bytes16);
        assert_eq!(known.learn(prefix(1), &greedy), Ok(21 - 6));
        assert_eq!(places, (known.nodes.capacity(), known.endpoints.capacity()));
    }

    #[test]
    fn names_that_are_none_of_ros_are_left_out() {
        let long = "n".repeat(256);
        for (namespace, name) in [
            ("", "a"),
            ("x", "a"),
            ("/x/", "a"),
            ("//", "a"),
            ("/", ""),
            ("/", "a/b"),
            ("/", "a\u{1b}[2J"),
            ("/", "ä"),
            ("/", long.as_str()),
        ] {
            let mut known = KnownNodes::new(LIMITS);
            let bytes = message(prefix(1), &[node(namespace, name, &[])], GidSize::Bytes16);
            assert_eq!(known.learn(prefix(1), &bytes), Ok(1), "{namespace} {name}");
            assert_eq!(known.names().count(), 0);
        }
    }

    /// Cut, extended and changed anywhere: an error that changes nothing, or names of ROS within
    /// the limits.
    #[test]
    fn damaged_messages_do_no_harm() {
        let nodes = [
            node("/ns", "talker", &WRITERS),
            node("/", "b", &WRITERS[..1]),
        ];
        for size in [GidSize::Bytes16, GidSize::Bytes24] {
            let good = message(prefix(1), &nodes, size);
            let mut known = KnownNodes::new(LIMITS);
            assert_eq!(known.learn(prefix(1), &good), Ok(0));
            let before = std::format!("{known:?}");
            // The old form ends in zeros there, and is then an empty list of the new form.
            let alike = |end| size == GidSize::Bytes24 && (24..28).contains(&end);
            for end in (0..good.len()).filter(|end| !alike(*end)) {
                let part = good.get(..end).unwrap_or(&[]);
                assert!(known.learn(prefix(1), part).is_err(), "{end} bytes");
            }
            let more = [&good[..], &[0; 8]].concat();
            assert!(known.learn(prefix(1), &more).is_err());
            let foreign = known.learn(prefix(2), &good);
            assert_eq!(foreign, Err(WireError::OutOfRange("gid")));
            assert_eq!(std::format!("{known:?}"), before);
            for at in 0..good.len() {
                for bit in 0..8 {
                    let mut bytes = good.clone();
                    bytes
                        .iter_mut()
                        .skip(at)
                        .take(1)
                        .for_each(|b| *b ^= 1 << bit);
                    known.learn(prefix(1), &bytes).ok();
                    assert!(known.names().count() <= 2);
                    assert!(known.names().all(|name| name.starts_with('/')));
                    assert!(known.endpoints.len() <= LIMITS.endpoints);
                }
            }
            // Counts that no message of this length can hold.
            let head = message(prefix(1), &[], size);
            let mut counts = head.clone();
            counts.truncate(head.len().saturating_sub(4));
            counts.extend_from_slice(&[0xff; 4]);
            assert!(known.learn(prefix(1), &counts).is_err());
        }
    }
}
