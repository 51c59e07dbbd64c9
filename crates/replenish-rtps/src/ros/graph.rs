//! `ros_discovery_info`: `rmw_dds_common/msg/ParticipantEntitiesInfo`.

use crate::wire::{
    CDR_LE, Encapsulated, EntityId, Guid, GuidPrefix, Qos, Reader, WireError, Writer,
};

/// The topic.
pub const GRAPH_TOPIC: &str = "ros_discovery_info";
/// Its type.
pub const GRAPH_TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
/// Its quality of service: the last message, also for readers that come later.
pub const GRAPH_QOS: Qos = Qos::latched(1);

/// Bytes of a gid in the message: they differ between releases, and so do not mix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GidSize {
    /// Iron and later.
    #[default]
    Bytes16,
    /// Humble and before: 16 bytes and 8 zeros.
    Bytes24,
}

impl GidSize {
    const fn padding(self) -> usize {
        match self {
            GidSize::Bytes16 => 0,
            GidSize::Bytes24 => 8,
        }
    }
}

/// A node of our own.
#[derive(Clone, Copy, Debug)]
pub struct Node<'a> {
    /// Its namespace, `/` or `/a/b`.
    pub namespace: &'a str,
    /// Its name.
    pub name: &'a str,
    /// Its readers.
    pub readers: &'a [EntityId],
    /// Its writers.
    pub writers: &'a [EntityId],
}

/// Writes the message with its encapsulation.
///
/// # Errors
/// [`WireError::NoRoom`].
pub fn encode_graph<'b>(
    buf: &'b mut [u8],
    prefix: GuidPrefix,
    nodes: &[Node<'_>],
    size: GidSize,
) -> Result<&'b [u8], WireError> {
    let mut w = Writer::new(buf);
    w.put(&CDR_LE);
    w.set_origin();
    let gid = |w: &mut Writer<'_>, entity| {
        w.put(&Guid::new(prefix, entity).to_bytes());
        w.put([0; 8].get(..size.padding()).unwrap_or(&[]));
    };
    gid(&mut w, EntityId::PARTICIPANT);
    w.u32(u32::try_from(nodes.len()).unwrap_or(u32::MAX));
    for node in nodes {
        w.string(node.namespace);
        w.string(node.name);
        for list in [node.readers, node.writers] {
            w.u32(u32::try_from(list.len()).unwrap_or(u32::MAX));
            for entity in list {
                gid(&mut w, *entity);
            }
        }
    }
    w.finish()
}

/// The nodes of a message that was received.
#[derive(Clone, Debug)]
pub struct Nodes<'a> {
    left: u32,
    size: GidSize,
    rest: Reader<'a>,
}

impl<'a> Nodes<'a> {
    /// Reads the head of the message: the participant, and an iterator over its nodes.
    ///
    /// # Errors
    /// Any [`WireError`].
    pub fn decode(payload: &'a [u8], size: GidSize) -> Result<(Guid, Self), WireError> {
        let mut r = Encapsulated::decode(payload)?.reader();
        let participant = gid(&mut r, size)?;
        let left = r.u32()?;
        let rest = r;
        Ok((participant, Nodes { left, size, rest }))
    }

    /// Reads to the end: every node is right, and nothing but padding comes after the last one.
    ///
    /// # Errors
    /// Any [`WireError`].
    pub(super) fn check(mut self) -> Result<(), WireError> {
        for node in self.by_ref() {
            node?;
        }
        if self.rest.rest().len() > 3 {
            return Err(WireError::OutOfRange("length"));
        }
        Ok(())
    }

    fn step(&mut self) -> Result<RemoteNode<'a>, WireError> {
        let r = &mut self.rest;
        let (namespace, name) = (r.string()?, r.string()?);
        let readers = Gids::step_over(r, self.size)?;
        let writers = Gids::step_over(r, self.size)?;
        Ok(RemoteNode {
            namespace,
            name,
            readers,
            writers,
        })
    }
}

/// A node of another participant.
#[derive(Clone, Debug)]
pub struct RemoteNode<'a> {
    /// Its namespace.
    pub namespace: &'a str,
    /// Its name.
    pub name: &'a str,
    /// Its readers.
    pub readers: Gids<'a>,
    /// Its writers.
    pub writers: Gids<'a>,
}

impl<'a> Iterator for Nodes<'a> {
    type Item = Result<RemoteNode<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.left = self.left.checked_sub(1)?;
        let step = self.step();
        if step.is_err() {
            self.left = 0;
        }
        Some(step)
    }
}

fn gid(r: &mut Reader<'_>, size: GidSize) -> Result<Guid, WireError> {
    let guid = Guid::decode(r)?;
    r.take(size.padding())?;
    Ok(guid)
}

/// Names of endpoints in a message.
#[derive(Clone, Debug)]
pub struct Gids<'a> {
    left: u32,
    size: GidSize,
    rest: Reader<'a>,
}

impl<'a> Gids<'a> {
    fn step_over(r: &mut Reader<'a>, size: GidSize) -> Result<Self, WireError> {
        let left = r.u32()?;
        let rest = *r;
        let each = size.padding().saturating_add(16);
        let all = usize::try_from(left)
            .unwrap_or(usize::MAX)
            .saturating_mul(each);
        r.take(all)?;
        Ok(Gids { left, size, rest })
    }
}

impl Iterator for Gids<'_> {
    type Item = Guid;

    fn next(&mut self) -> Option<Guid> {
        self.left = self.left.checked_sub(1)?;
        gid(&mut self.rest, self.size).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn nodes_come_back_in_both_forms() {
        let prefix = GuidPrefix([5; 12]);
        let (readers, writers) = (
            [EntityId::reader(1)],
            [EntityId::writer(2), EntityId::writer(3)],
        );
        let node = |name| Node {
            namespace: "/ns",
            name,
            readers: &readers,
            writers: &writers,
        };
        for size in [GidSize::Bytes16, GidSize::Bytes24] {
            let mut buf = [0; 512];
            let bytes = encode_graph(&mut buf, prefix, &[node("a"), node("talker")], size);
            let bytes = bytes.unwrap_or(&[]);
            let (participant, nodes) = Nodes::decode(bytes, size).ok().unzip();
            assert_eq!(participant, Some(Guid::new(prefix, EntityId::PARTICIPANT)));
            let nodes: Vec<_> = nodes.into_iter().flatten().flatten().collect();
            let names: Vec<_> = nodes.iter().map(|node| node.name).collect();
            assert_eq!(names, ["a", "talker"]);
            for node in nodes {
                let gids: Vec<_> = node.writers.map(|guid| guid.entity).collect();
                assert_eq!(gids, writers);
                assert_eq!(node.readers.count(), 1);
            }
            // The other form, or a part of it, is an error or something else, never a panic.
            for end in 0..bytes.len() {
                let part = bytes.get(..end).unwrap_or(&[]);
                let read = Nodes::decode(part, GidSize::Bytes24).map(|(_, nodes)| nodes.count());
                assert!(read.is_err() || read.is_ok_and(|count| count <= end));
            }
        }
    }
}
