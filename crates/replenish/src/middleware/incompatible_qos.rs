//! Endpoints that do not talk with each other because of their quality of service.

use super::ReaderId;
use crate::compatibility::{DEADLINE, DURABILITY, LIVELINESS, QosClash, RELIABILITY, names};
use crate::platform::ShortText;
use core::fmt;

/// An endpoint of ours and one of somebody else's that would talk with each other, were it not for
/// the quality of service of both.
#[derive(Debug, Clone, Copy)]
pub struct IncompatibleQos {
    topic: ShortText,
    reader: Option<ReaderId>,
    policies: u8,
    values: Option<QosClash>,
}

impl IncompatibleQos {
    /// On `topic`, whose first 120 bytes are kept; `reader` is ours, `None` if our end is a writer.
    #[must_use]
    pub fn new(topic: &str, reader: Option<ReaderId>, clash: QosClash) -> Self {
        Self {
            policies: clash.bits(),
            values: Some(clash),
            ..Self::known_by_policy(topic, reader, 0)
        }
    }

    /// As [`new`](Self::new), where no more is known than the policies, as bits: 1 reliability,
    /// 2 durability, 4 deadline, 8 liveliness.
    #[must_use]
    pub fn known_by_policy(topic: &str, reader: Option<ReaderId>, policies: u8) -> Self {
        Self {
            topic: ShortText::of(&topic),
            reader,
            policies,
            values: None,
        }
    }

    /// The topic; of a service, `rq` and its name for requests, `rr` and its name for replies.
    #[must_use]
    pub fn topic(&self) -> &str {
        self.topic.as_str()
    }

    /// Our reader; `None` if our end is a writer.
    #[must_use]
    pub fn reader(&self) -> Option<ReaderId> {
        self.reader
    }

    /// The names of the policies: `reliability`, `durability`, `deadline`, `liveliness`.
    pub fn policies(&self) -> impl Iterator<Item = &'static str> {
        names(self.policies)
    }

    /// Our end, for people, if it is a writer.
    pub(crate) fn writer(&self) -> ShortText {
        let topic = self.topic();
        match (topic.strip_prefix("rq"), topic.strip_prefix("rr")) {
            (Some(service), _) => ShortText::of(&format_args!("client {service}")),
            (None, Some(service)) => ShortText::of(&format_args!("server {service}")),
            (None, None) => ShortText::of(&format_args!("publisher {topic}")),
        }
    }
}

impl fmt::Display for IncompatibleQos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(values) = &self.values {
            return values.fmt(f);
        }
        f.write_str("not compatible")?;
        let all = [
            (
                RELIABILITY,
                "reliability BestEffort is offered, Reliable requested",
            ),
            (
                DURABILITY,
                "durability Volatile is offered, TransientLocal requested",
            ),
            (
                DEADLINE,
                "a longer deadline, or none, is offered than requested",
            ),
            (
                LIVELINESS,
                "liveliness is offered with a longer lease, or in a weaker way, than requested",
            ),
        ];
        let told = all.iter().filter(|(bit, _)| self.policies & bit != 0);
        for (at, (_, what)) in told.enumerate() {
            f.write_str(if at == 0 { ": " } else { "; " })?;
            f.write_str(what)?;
        }
        Ok(())
    }
}
