//! The priorities of topics on the way to clients.

use replenish_os::config::{ConfigError, within};

/// The number of priorities: 0 to `LEVELS - 1`.
pub(crate) const LEVELS: usize = 8;

/// Readers of the topics that match `pattern` are served by `priority` and `weight`. The first rule
/// that matches counts.
///
/// Among all that can be sent, to any client, a higher priority always goes first. Readers of the
/// same priority take turns; one with weight `n` sends `n` samples in its turn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicRule {
    /// A topic's name, with `*` for any part of it. A name that begins with `/` is a ROS name: it
    /// matches what ROS calls so, whether topic (`rt/`), request (`rq/`) or reply (`rr/`).
    pub pattern: String,
    /// 0 to 7, the most urgent; 4 without a rule.
    pub priority: u8,
    /// Samples in a turn, 1 to 1000; 1 without a rule.
    pub weight: u16,
}

/// The priority and weight of a reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Service {
    pub(crate) priority: u8,
    pub(crate) weight: u16,
}

impl TopicRule {
    /// The priority of topics without a rule.
    pub const DEFAULT_PRIORITY: u8 = 4;

    /// A rule for turns of one sample.
    #[must_use]
    pub fn new(pattern: &str, priority: u8) -> Self {
        Self {
            pattern: pattern.into(),
            priority,
            weight: 1,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        within("rules.pattern.length", self.pattern.len(), 1..=1024)?;
        within("rules.priority", self.priority, 0..=7)?;
        within("rules.weight", self.weight, 1..=1000)
    }

    fn matches(&self, topic: &str) -> bool {
        matches_topic(&self.pattern, topic)
    }
}

/// Whether a topic's name, or the name that ROS gives it, is `pattern`, with `*` for any part.
pub(super) fn matches_topic(pattern: &str, topic: &str) -> bool {
    if matches(pattern, topic) {
        return true;
    }
    let ros = ["rt/", "rq/", "rr/"]
        .iter()
        .find_map(|prefix| topic.strip_prefix(prefix));
    match (pattern.strip_prefix('/'), ros) {
        (Some(pattern), Some(name)) => {
            let plain = name
                .strip_suffix("Request")
                .or_else(|| name.strip_suffix("Reply"));
            let plain = plain.filter(|_| !topic.starts_with("rt/"));
            matches(pattern, plain.unwrap_or(name))
        }
        _ => false,
    }
}

/// The priority and weight of the readers of `topic`.
pub(crate) fn service(rules: &[TopicRule], topic: &str) -> Service {
    let rule = rules.iter().find(|rule| rule.matches(topic));
    rule.map_or(
        Service {
            priority: TopicRule::DEFAULT_PRIORITY,
            weight: 1,
        },
        |rule| Service {
            priority: rule.priority.min(7),
            weight: rule.weight.max(1),
        },
    )
}

/// Whether `text` is `pattern` with something, or nothing, in the place of each `*`.
fn matches(pattern: &str, text: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else {
        return pattern == text;
    };
    let Some(mut text) = text.strip_prefix(first) else {
        return false;
    };
    // The earliest place for each part leaves the most for the next; the last must be at the end.
    let mut rest = rest;
    while let Some((part, after)) = rest.split_once('*') {
        let Some(at) = text.find(part) else {
            return false;
        };
        text = text.get(at + part.len()..).unwrap_or_default();
        rest = after;
    }
    text.ends_with(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_stand_for_anything() {
        for (pattern, text, expected) in [
            ("rt/a", "rt/a", true),
            ("rt/a", "rt/ab", false),
            ("*", "", true),
            ("rt/*", "rt/scan/left", true),
            ("rt/*", "rq/x", false),
            ("*left", "rt/left/left", true),
            ("a*a", "a", false),
            ("a*b*c", "aXbYbZc", true),
            ("a*b*c", "acb", false),
            ("**", "x", true),
        ] {
            assert_eq!(matches(pattern, text), expected, "{pattern} {text}");
        }
    }

    #[test]
    fn ros_names_match_topics_and_services() {
        let rule = |pattern| TopicRule::new(pattern, 7);
        assert!(rule("/chatter").matches("rt/chatter"));
        assert!(rule("/add").matches("rq/addRequest"));
        assert!(rule("/add").matches("rr/addReply"));
        assert!(!rule("/add").matches("rt/addReply"));
        assert!(rule("/arm/*").matches("rt/arm/joint"));
        assert!(!rule("/chatter").matches("chatter"));
    }

    #[test]
    fn the_first_rule_counts() {
        let rules = [TopicRule::new("/a*", 7), TopicRule::new("*", 1)];
        let of = |topic| service(&rules, topic).priority;
        assert_eq!((of("rt/ab"), of("rt/b")), (7, 1));
        assert_eq!(service(&[], "rt/b").priority, 4);
    }
}
