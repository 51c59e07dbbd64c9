//! `ros_discovery_info`: which nodes a participant has, and which writers and readers are theirs.
//!
//! The message is `rmw_dds_common/msg/ParticipantEntitiesInfo`, each one replacing the one before.

use crate::config::GidSize;
use crate::qos::{Durability, History, Qos};

pub(crate) const TOPIC: &str = "ros_discovery_info";
pub(crate) const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

/// As ROS 2 publishes it.
pub(crate) const QOS: Qos = Qos {
    reliable: true,
    durability: Durability::TransientLocal,
    history: History::KeepLast(1),
    deadline: None,
    lifespan: None,
};

/// A node with the ids of its writers and readers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct NodeInfo {
    pub(crate) name: String,
    pub(crate) readers: Vec<[u8; 16]>,
    pub(crate) writers: Vec<[u8; 16]>,
}

/// The message about `nodes` of `participant`.
pub(crate) fn encode(participant: [u8; 16], nodes: &[NodeInfo], size: GidSize) -> Vec<u8> {
    let mut w = Writer {
        bytes: Vec::new(),
        size,
    };
    w.gid(&participant);
    w.count(nodes.len());
    for node in nodes {
        let (space, name) = split(&node.name);
        w.text(&space);
        w.text(name);
        w.gids(&node.readers);
        w.gids(&node.writers);
    }
    w.bytes
}

/// A name's namespace, with a slash before it, and the rest.
fn split(full: &str) -> (String, &str) {
    let full = full.trim_start_matches('/');
    match full.rsplit_once('/') {
        Some((space, name)) => (format!("/{space}"), name),
        None => ("/".into(), full),
    }
}

struct Writer {
    bytes: Vec<u8>,
    size: GidSize,
}

impl Writer {
    fn count(&mut self, count: usize) {
        let aligned = self.bytes.len().next_multiple_of(4);
        self.bytes.resize(aligned, 0);
        let count = u32::try_from(count).unwrap_or(u32::MAX);
        self.bytes.extend(count.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    fn gid(&mut self, gid: &[u8; 16]) {
        self.bytes.extend(gid);
        let padding = self.size.bytes() - gid.len();
        self.bytes.extend(std::iter::repeat_n(0, padding));
    }

    fn gids(&mut self, gids: &[[u8; 16]]) {
        self.count(gids.len());
        gids.iter().for_each(|gid| self.gid(gid));
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
    fn the_message_is_laid_out_like_rmw_dds_common_does() {
        let node = NodeInfo {
            name: "ab".into(),
            readers: vec![[2; 16]],
            writers: Vec::new(),
        };
        let bytes = encode([1; 16], std::slice::from_ref(&node), GidSize::Bytes16);
        let mut expected = vec![1; 16];
        expected.extend([1, 0, 0, 0]); // one node
        expected.extend([2, 0, 0, 0, b'/', 0, 0, 0]); // namespace, padded
        expected.extend([3, 0, 0, 0, b'a', b'b', 0, 0]); // name, padded
        expected.extend([1, 0, 0, 0]);
        expected.extend([2; 16]);
        expected.extend([0; 4]);
        assert_eq!(bytes, expected);
        let old = encode([1; 16], &[node], GidSize::Bytes24);
        assert_eq!(old.len(), bytes.len() + 16);
    }
}
