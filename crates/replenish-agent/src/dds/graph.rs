//! `ros_discovery_info`: which nodes a participant has, and which writers and readers are theirs.
//!
//! The message is `rmw_dds_common/msg/ParticipantEntitiesInfo`, each one replacing the one before.

use replenish_rtps::ros::{self, GidSize, encode_graph};
use replenish_rtps::wire::{EntityId, GuidPrefix};

/// Bytes of the longest name of a node that is announced, and of what stands around it.
const NODE: usize = 600;

/// Bytes of the longest identifier of a writer or reader.
const GID: usize = 24;

/// A node with its writers and readers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct NodeInfo {
    pub(super) name: String,
    pub(super) readers: Vec<EntityId>,
    pub(super) writers: Vec<EntityId>,
}

/// Bytes of the longest message about this many endpoints and nodes: a service has two ends.
pub(super) const fn most_bytes(endpoints: usize) -> usize {
    (endpoints + 1) * (NODE + 2 * GID)
}

/// The message about `nodes`, with its encapsulation; nodes with names that nobody could read, of
/// more than 255 bytes, are left out.
pub(super) fn encode(prefix: GuidPrefix, nodes: &[NodeInfo], size: GidSize) -> Option<Vec<u8>> {
    let split: Vec<_> = nodes.iter().map(|node| (node, split(&node.name))).collect();
    let nodes: Vec<ros::Node<'_>> = split
        .iter()
        .filter(|(node, _)| node.name.len() <= 255)
        .map(|(node, (namespace, name))| ros::Node {
            namespace,
            name,
            readers: &node.readers,
            writers: &node.writers,
        })
        .collect();
    let gids: usize = nodes
        .iter()
        .map(|node| node.readers.len() + node.writers.len())
        .sum();
    let mut buf = vec![0; (nodes.len() + 1) * NODE + gids * GID];
    let len = encode_graph(&mut buf, prefix, &nodes, size).ok()?.len();
    buf.truncate(len);
    Some(buf)
}

/// A name's namespace, with a slash before it, and the rest.
fn split(full: &str) -> (String, &str) {
    let full = full.trim_start_matches('/');
    match full.rsplit_once('/') {
        Some((space, name)) => (format!("/{space}"), name),
        None => ("/".into(), full),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_split_at_the_last_slash() {
        for (full, space, name) in [
            ("a", "/", "a"),
            ("/a", "/", "a"),
            ("x/a", "/x", "a"),
            ("/x/y/a", "/x/y", "a"),
        ] {
            assert_eq!(split(full), (space.to_string(), name));
        }
    }

    #[test]
    fn the_longest_message_has_room() {
        let node = |at: usize| NodeInfo {
            name: format!("{at:03}/{}", "n".repeat(251)),
            readers: vec![EntityId::reader(1)],
            writers: vec![EntityId::writer(1)],
        };
        let nodes: Vec<_> = (0..40).map(node).collect();
        for size in [GidSize::Bytes16, GidSize::Bytes24] {
            let bytes = encode(GuidPrefix([1; 12]), &nodes, size).unwrap();
            assert!(bytes.len() <= most_bytes(nodes.len()), "{}", bytes.len());
        }
        let unnameable = NodeInfo {
            name: "n".repeat(256),
            ..NodeInfo::default()
        };
        let both = [node(0), unnameable];
        let one = encode(GuidPrefix([1; 12]), &both[..1], GidSize::Bytes16);
        assert_eq!(encode(GuidPrefix([1; 12]), &both, GidSize::Bytes16), one);
    }
}
