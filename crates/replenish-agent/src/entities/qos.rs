//! Quality of service: offered by writers, requested by readers, and their compatibility.

use crate::config::Limits;
use crate::xml;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{
    EndpointQos, Notice, QOS_DURABILITY_PERSISTENT, QOS_DURABILITY_TRANSIENT,
    QOS_DURABILITY_TRANSIENT_LOCAL, QOS_HISTORY_KEEP_LAST, QOS_RELIABLE,
};

const MS: Nanos = 1_000_000;
const SECOND: Nanos = 1_000 * MS;

/// Time for which samples are kept for late readers. Transient and persistent samples are kept like
/// transient-local ones: while their writer lives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Durability {
    Volatile,
    TransientLocal,
    Transient,
    Persistent,
}

/// The QoS of a writer or reader, as far as it matters to an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Qos {
    pub(crate) reliable: bool,
    pub(crate) durability: Durability,
    /// Whether no sample is dropped to make room for a newer one.
    pub(crate) keep_all: bool,
    /// Samples to keep.
    pub(crate) depth: usize,
    /// Longest time between samples.
    pub(crate) deadline: Option<Nanos>,
    /// Time after which a writer's samples are of no use.
    pub(crate) lifespan: Option<Nanos>,
    /// Shortest time between samples for a reader.
    pub(crate) separation: Option<Nanos>,
}

impl Qos {
    /// A writer that says nothing: the defaults of Fast DDS.
    pub(crate) fn writer() -> Self {
        Self {
            reliable: true,
            durability: Durability::TransientLocal,
            keep_all: false,
            depth: 1,
            deadline: None,
            lifespan: None,
            separation: None,
        }
    }

    /// A reader that says nothing: the defaults of Fast DDS, but with a queue of some depth.
    pub(crate) fn reader(limits: &Limits) -> Self {
        Self {
            reliable: false,
            durability: Durability::Volatile,
            depth: limits.default_depth.min(limits.max_depth),
            ..Self::writer()
        }
    }

    /// Both directions of a service.
    pub(crate) fn service(limits: &Limits) -> Self {
        Self {
            reliable: true,
            ..Self::reader(limits)
        }
    }

    /// The QoS of the binary form; `self` is the default.
    pub(crate) fn with_binary(self, qos: &EndpointQos<'_>, limits: &Limits) -> Self {
        let flag = |bit| qos.flags & bit != 0;
        let durability = if flag(QOS_DURABILITY_TRANSIENT_LOCAL) {
            Durability::TransientLocal
        } else if flag(QOS_DURABILITY_TRANSIENT) {
            Durability::Transient
        } else if flag(QOS_DURABILITY_PERSISTENT) {
            Durability::Persistent
        } else {
            Durability::Volatile
        };
        let keep_all = !flag(QOS_HISTORY_KEEP_LAST);
        let depth = qos.depth.filter(|depth| *depth > 0).map(usize::from);
        let millis = |ms: u32| Nanos::from(ms) * MS;
        Self {
            reliable: flag(QOS_RELIABLE),
            durability,
            deadline: qos.deadline_ms.filter(|ms| *ms > 0).map(millis),
            lifespan: qos.lifespan_ms.filter(|ms| *ms > 0).map(millis),
            ..self
        }
        .with_history(keep_all, depth, limits)
    }

    /// The QoS of the XML form; `self` is the default.
    pub(crate) fn with_xml(self, xml: &str, limits: &Limits) -> Self {
        let mut qos = self;
        match xml::text(xml, &["reliability", "kind"]) {
            Some("RELIABLE") => qos.reliable = true,
            Some("BEST_EFFORT") => qos.reliable = false,
            _ => {}
        }
        qos.durability = match xml::text(xml, &["durability", "kind"]) {
            Some("VOLATILE") => Durability::Volatile,
            Some("TRANSIENT_LOCAL") => Durability::TransientLocal,
            Some("TRANSIENT") => Durability::Transient,
            Some("PERSISTENT") => Durability::Persistent,
            _ => qos.durability,
        };
        qos.deadline = duration(xml, &["deadline", "period"]).or(qos.deadline);
        qos.lifespan = duration(xml, &["lifespan", "duration"]).or(qos.lifespan);
        let history = xml::element(xml, "historyQos").or_else(|| xml::element(xml, "history"));
        let Some(history) = history else {
            return qos;
        };
        let keep_all = xml::text(history, &["kind"]) == Some("KEEP_ALL");
        let depth = xml::text(history, &["depth"]).and_then(|depth| depth.parse().ok());
        qos.with_history(keep_all, depth.filter(|depth| *depth > 0), limits)
    }

    fn with_history(self, keep_all: bool, depth: Option<usize>, limits: &Limits) -> Self {
        let depth = if keep_all {
            limits.max_depth
        } else {
            depth.unwrap_or(self.depth).min(limits.max_depth)
        };
        Self {
            keep_all,
            depth,
            ..self
        }
    }

    /// Whether what this writer offers is what `reader` asks for, or better (DDS 1.4, 2.2.3).
    pub(crate) fn serves(&self, reader: &Qos) -> bool {
        self.incompatibilities(reader) == 0
    }

    /// The policies of which this writer offers less than `reader` asks for, as [`Notice`]'s bits.
    pub(crate) fn incompatibilities(&self, reader: &Qos) -> u8 {
        let deadline = match (self.deadline, reader.deadline) {
            (_, None) => true,
            (None, Some(_)) => false,
            (Some(offered), Some(asked)) => offered <= asked,
        };
        let bit = |fits: bool, bit: u8| if fits { 0 } else { bit };
        bit(self.reliable || !reader.reliable, Notice::RELIABILITY)
            | bit(self.durability >= reader.durability, Notice::DURABILITY)
            | bit(deadline, Notice::DEADLINE)
    }

    /// Whether samples are kept for readers that come later.
    pub(crate) fn is_durable(&self) -> bool {
        self.durability >= Durability::TransientLocal
    }
}

/// A duration of seconds and nanoseconds; infinite ones, which are not numbers, are none.
fn duration(xml: &str, path: &[&str]) -> Option<Nanos> {
    let text = xml::text(xml, path)?;
    let number = |tag| match xml::text(text, &[tag]) {
        Some(digits) => digits.parse::<Nanos>().ok(),
        None => Some(0),
    };
    let nanos = number("sec")?
        .saturating_mul(SECOND)
        .saturating_add(number("nanosec")?);
    (nanos > 0).then_some(nanos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn xml_says_what_differs_from_the_default() {
        let xml = "<dds><data_reader><topic><kind>NO_KEY</kind><historyQos><kind>KEEP_LAST</kind>\
            <depth>5</depth></historyQos></topic><qos><reliability><kind>RELIABLE</kind>\
            </reliability><durability><kind>TRANSIENT_LOCAL</kind></durability><lifespan><duration>\
            <sec>2</sec><nanosec>7</nanosec></duration></lifespan><deadline><period>\
            <sec>DURATION_INFINITY</sec></period></deadline></qos></data_reader></dds>";
        let qos = Qos::reader(&Limits::DEFAULT).with_xml(xml, &Limits::DEFAULT);
        assert!(qos.reliable && !qos.keep_all && qos.is_durable());
        assert_eq!((qos.depth, qos.deadline), (5, None));
        assert_eq!(qos.lifespan, Some(2 * SECOND + 7));
        let default = Qos::reader(&Limits::DEFAULT);
        assert_eq!(default.with_xml("<dds></dds>", &Limits::DEFAULT), default);
        let all = default.with_xml("<history><kind>KEEP_ALL</kind></history>", &Limits::DEFAULT);
        assert_eq!((all.keep_all, all.depth), (true, 256));
    }

    #[test]
    fn a_reader_is_served_by_what_it_asks_for_or_better() {
        let reader = Qos::reader(&Limits::DEFAULT);
        let writer = Qos::writer();
        let volatile = Qos {
            durability: Durability::Volatile,
            ..writer
        };
        let loose = Qos {
            reliable: false,
            ..writer
        };
        let strict = Qos {
            reliable: true,
            durability: Durability::TransientLocal,
            ..reader
        };
        assert!(writer.serves(&reader) && volatile.serves(&reader) && loose.serves(&reader));
        assert!(writer.serves(&strict));
        assert!(!volatile.serves(&strict) && !loose.serves(&strict));
        let every = |ms: Option<u64>, qos: Qos| Qos {
            deadline: ms.map(|ms| ms * MS),
            ..qos
        };
        for (offered, asked, fits) in [
            (None, Some(1), false),
            (Some(2), Some(1), false),
            (Some(1), Some(1), true),
            (Some(1), None, true),
        ] {
            assert_eq!(every(offered, writer).serves(&every(asked, reader)), fits);
        }
    }
}
