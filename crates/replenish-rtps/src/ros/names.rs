//! Names of ROS 2 as DDS has them.

use core::fmt::{self, Write};

/// The use that ROS 2 makes of a topic of DDS; the prefix of its name says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prefix {
    /// `rt`: a topic.
    Topic,
    /// `rq`: requests of a service; the name ends in `Request`.
    Request,
    /// `rr`: replies of a service; the name ends in `Reply`.
    Reply,
}

impl Prefix {
    const fn parts(self) -> (&'static str, &'static str) {
        match self {
            Prefix::Topic => ("rt", ""),
            Prefix::Request => ("rq", "Request"),
            Prefix::Reply => ("rr", "Reply"),
        }
    }
}

/// A name of at most 255 bytes.
#[derive(Clone, Copy)]
pub struct DdsName {
    len: usize,
    bytes: [u8; 255],
}

impl DdsName {
    const EMPTY: DdsName = DdsName {
        len: 0,
        bytes: [0; 255],
    };

    /// The name.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let bytes = self.bytes.get(..self.len).unwrap_or(&[]);
        core::str::from_utf8(bytes).unwrap_or("")
    }

    pub(super) fn of(parts: fmt::Arguments<'_>) -> Option<Self> {
        let mut name = Self::EMPTY;
        name.write_fmt(parts).ok()?;
        Some(name)
    }
}

impl Write for DdsName {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let end = self.len.saturating_add(text.len());
        let room = self.bytes.get_mut(self.len..end).ok_or(fmt::Error)?;
        room.copy_from_slice(text.as_bytes());
        self.len = end;
        Ok(())
    }
}

impl fmt::Debug for DdsName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_str().fmt(f)
    }
}

/// The topic of DDS for a full name of ROS 2: `/chatter` becomes `rt/chatter`. `None` if the name
/// does not begin with a slash or is too long for DDS.
#[must_use]
pub fn dds_topic(prefix: Prefix, name: &str) -> Option<DdsName> {
    let (before, after) = prefix.parts();
    let plain = name.strip_prefix('/')?;
    if plain.is_empty() || plain.ends_with('/') {
        return None;
    }
    DdsName::of(format_args!("{before}{name}{after}"))
}

/// The name of ROS 2 for a topic of DDS, and what it is for; `None` if ROS 2 has not made it.
#[must_use]
pub fn ros_topic(topic: &str) -> Option<(Prefix, &str)> {
    [Prefix::Topic, Prefix::Request, Prefix::Reply]
        .into_iter()
        .find_map(|prefix| {
            let (before, after) = prefix.parts();
            let name = topic.strip_prefix(before)?.strip_suffix(after)?;
            name.starts_with('/').then_some((prefix, name))
        })
}

/// The type of DDS for one of ROS 2: `std_msgs/msg/Int32` becomes
/// `std_msgs::msg::dds_::Int32_`. `None` without two slashes, or if it is too long.
#[must_use]
pub fn dds_type(name: &str) -> Option<DdsName> {
    let (package, rest) = name.split_once('/')?;
    let (kind, message) = rest.split_once('/')?;
    if package.is_empty() || kind.is_empty() || message.is_empty() || message.contains('/') {
        return None;
    }
    DdsName::of(format_args!("{package}::{kind}::dds_::{message}_"))
}

/// The type of ROS 2 for one of DDS; `None` if ROS 2 has not made it.
#[must_use]
pub fn ros_type(name: &str) -> Option<DdsName> {
    let (space, message) = name.split_once("::dds_::")?;
    let (package, kind) = space.split_once("::")?;
    let message = message.strip_suffix('_')?;
    DdsName::of(format_args!("{package}/{kind}/{message}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_go_both_ways() {
        let topic = |prefix, name| dds_topic(prefix, name).map(|name| std::format!("{name:?}"));
        assert_eq!(topic(Prefix::Topic, "/a/b").as_deref(), Some("\"rt/a/b\""));
        assert_eq!(
            topic(Prefix::Request, "/add").as_deref(),
            Some("\"rq/addRequest\"")
        );
        assert_eq!(topic(Prefix::Topic, "chatter"), None);
        assert_eq!(topic(Prefix::Topic, "/"), None);
        assert_eq!(
            topic(Prefix::Topic, &std::format!("/{}", "x".repeat(260))),
            None
        );
        assert_eq!(ros_topic("rr/addReply"), Some((Prefix::Reply, "/add")));
        assert_eq!(ros_topic("rtchatter"), None);
        assert_eq!(ros_topic("ros_discovery_info"), None);
        let dds = dds_type("std_msgs/msg/Int32");
        let dds = dds.as_ref().map(DdsName::as_str);
        assert_eq!(dds, Some("std_msgs::msg::dds_::Int32_"));
        let ros = ros_type("std_msgs::msg::dds_::Int32_");
        assert_eq!(
            ros.as_ref().map(DdsName::as_str),
            Some("std_msgs/msg/Int32")
        );
        assert!(dds_type("Int32").is_none() && ros_type("Int32").is_none());
    }
}
