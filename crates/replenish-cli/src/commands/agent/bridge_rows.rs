//! The bridge to DDS as rows, in the names of ROS 2, and what is new in them as lines of the log.

use super::log::Log;
use crate::time::Nanos;
use replenish_agent::dds::EndpointCounts;
use replenish_agent::{BridgeSnapshot, ros_topic, ros_type};
use std::collections::BTreeMap;

/// A node or endpoint of a client in DDS. The names are a contract.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub(crate) struct BridgeRow {
    /// The client's key, and the entity's id.
    pub(crate) client: String,
    pub(crate) id: String,
    /// `/talker`; empty without a participant that has a name.
    pub(crate) node: String,
    pub(crate) kind: &'static str,
    pub(crate) domain: u16,
    /// `/chatter`, or the service; empty for a participant.
    pub(crate) topic: String,
    /// `std_msgs/msg/String`.
    #[serde(rename = "type")]
    pub(crate) type_name: String,
    /// `open`, `opening`, or `refused`.
    pub(crate) state: &'static str,
    /// The reason why it is refused.
    pub(crate) reason: Option<String>,
    pub(crate) matched: usize,
    /// Samples that wait for DDS.
    pub(crate) waiting: usize,
    /// Samples dropped towards DDS and from DDS.
    pub(crate) dropped: u64,
    #[serde(flatten)]
    pub(crate) counts: EndpointCounts,
}

impl From<&BridgeSnapshot> for BridgeRow {
    fn from(row: &BridgeSnapshot) -> Self {
        let (state, reason) = match &*row.state {
            "open" => ("open", None),
            "opening" => ("opening", None),
            why => ("refused", Some(why.to_string())),
        };
        let is_node = row.kind == "participant";
        Self {
            client: row.client.clone(),
            id: row.id.clone(),
            node: row.node.clone(),
            kind: row.kind,
            domain: row.domain,
            topic: if is_node {
                String::new()
            } else {
                ros_topic(&row.name)
            },
            type_name: ros_type(&row.type_name),
            state,
            reason,
            matched: row.matched,
            waiting: row.waiting,
            dropped: row.counts.dropped_out + row.counts.dropped_in,
            counts: row.counts,
        }
    }
}

impl BridgeRow {
    /// Its name in a line of the log.
    fn title(&self) -> String {
        let topic = if self.topic.is_empty() {
            String::new()
        } else {
            format!("{} ({}) of ", self.topic, self.type_name)
        };
        format!("{topic}node {}, client {}", self.node, self.client)
    }

    /// Messages for the user about the changes since `before`.
    fn news(&self, before: &Self) -> Vec<String> {
        let title = self.title();
        let mut news = Vec::new();
        if let (Some(reason), None) = (&self.reason, &before.reason) {
            news.push(format!("{title} is not in DDS: {reason}"));
        }
        let (now, then) = (self.counts, before.counts);
        for (now, then, what) in [
            (now.dropped_out, then.dropped_out, "samples for DDS dropped"),
            (now.dropped_in, then.dropped_in, "samples from DDS dropped"),
            (now.missed, then.missed, "samples from DDS missed"),
            (
                now.lost,
                then.lost,
                "readers or writers in DDS lost: silent for too long",
            ),
            (
                now.returned,
                then.returned,
                "readers or writers in DDS came back",
            ),
            (
                now.unheard,
                then.unheard,
                "samples at most not heard by lost readers",
            ),
        ] {
            let more = now.saturating_sub(then);
            if more > 0 {
                news.push(format!("{title}: {more} {what}"));
            }
        }
        news
    }
}

/// The rows of the last look.
#[derive(Debug, Default)]
pub(super) struct BridgeLog {
    last: BTreeMap<(String, String), BridgeRow>,
}

impl BridgeLog {
    /// Lines about what is new in `rows`, as many as the log allows.
    pub(super) fn lines(
        &mut self,
        rows: &[BridgeSnapshot],
        log: &mut Log,
        now: Nanos,
    ) -> Vec<String> {
        let rows = rows.iter().map(BridgeRow::from);
        let rows: BTreeMap<_, _> = rows
            .map(|row| ((row.client.clone(), row.id.clone()), row))
            .collect();
        let nothing = BridgeRow::default();
        let mut lines = Vec::new();
        for (key, row) in &rows {
            let before = self.last.get(key).unwrap_or(&nothing);
            let news = row.news(before).into_iter();
            lines.extend(news.filter_map(|text| log.line("bridge", || text, now)));
        }
        self.last = rows;
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(dropped_out: u64, state: &str) -> BridgeSnapshot {
        BridgeSnapshot {
            client: "01010101".into(),
            id: "0015".into(),
            node: "/talker".into(),
            kind: "data_writer",
            name: "rt/chatter".into(),
            type_name: "std_msgs::msg::dds_::String_".into(),
            state: state.into(),
            counts: EndpointCounts {
                dropped_out,
                ..EndpointCounts::default()
            },
            ..BridgeSnapshot::default()
        }
    }

    /// Before, the rows were neither in the JSON nor in the log.
    #[test]
    fn rows_and_lines_are_in_the_names_of_ros() {
        let json = serde_json::to_value(BridgeRow::from(&row(3, "there is no room"))).unwrap();
        for (field, value) in [
            ("node", "/talker"),
            ("topic", "/chatter"),
            ("type", "std_msgs/msg/String"),
            ("state", "refused"),
            ("reason", "there is no room"),
        ] {
            assert_eq!(json[field], value);
        }
        assert_eq!(json["dropped"], 3);
        let (mut seen, mut log) = (BridgeLog::default(), Log::default());
        let title = "/chatter (std_msgs/msg/String) of node /talker, client 01010101";
        let lines = seen.lines(&[row(0, "full")], &mut log, 0);
        assert_eq!(lines, [format!("{title} is not in DDS: full")]);
        let lines = seen.lines(&[row(7, "full")], &mut log, 1);
        assert_eq!(lines, [format!("{title}: 7 samples for DDS dropped")]);
        assert_eq!(seen.lines(&[row(7, "open")], &mut log, 2), [""; 0]);
        assert_eq!(seen.lines(&[], &mut log, 3), [""; 0]);
    }

    #[test]
    fn the_log_of_the_bridge_is_bounded() {
        let (mut seen, mut log) = (BridgeLog::default(), Log::default());
        let look = |n| seen.lines(&[row(n, "open")], &mut log, n).len();
        assert_eq!((1..1000).map(look).sum::<usize>(), 5);
        assert_eq!(log.rest(), ["994 more of kind bridge were not logged"]);
    }
}
